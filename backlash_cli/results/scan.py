"""What a scan found: one LoopReport per loop, with every half period and the reasons behind the verdict.

Times are UTC epoch seconds, signals normalised: a dead band is in spans of the controller output (0.03 = 3 %)."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, fields, replace
from enum import StrEnum
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..record import BoolArray, FloatArray, Frozen, LoopSettings, Note


class Verdict(StrEnum):
    """The answer for one loop."""

    BACKLASH = "backlash"
    SUSPECTED = "suspected"
    NO_BACKLASH = "no_backlash"
    OSCILLATING = "oscillating"
    INSUFFICIENT_DATA = "insufficient_data"
    CANNOT_TELL = "cannot_tell"
    ERROR = "error"


NOTHING_SAID = (Verdict.CANNOT_TELL, Verdict.INSUFFICIENT_DATA)
UNDECIDED = (Verdict.SUSPECTED, Verdict.OSCILLATING, *NOTHING_SAID)  # a plan may tell


class Estimate(Frozen):
    """One half period: the interval between two zero crossings of the control error e."""

    start: float
    end: float
    dt_s: float
    dy: float  # mean |e| (12)
    e_max: float  # largest |e|
    d: float  # estimate (15)
    direction: int  # sign of e
    accepted: bool  # passed every gate
    why: str = "ok"  # else the code of the gate that refused it
    joined: bool = field(default=False, repr=False)  # goes over the cut between two nights of a history


class Estimates(Frozen, Sequence[Estimate], eq=False):
    """The half periods of one loop as columns (half_periods,), forty bytes a row: read like a tuple of Estimate."""

    origin: float
    begin: FloatArray  # seconds since `origin`
    dt_s: FloatArray
    dy: FloatArray
    e_max: FloatArray
    d: FloatArray
    direction: NDArray[np.int8]
    why: NDArray[np.uint8]  # each a position in `codes`
    codes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.begin)

    def select(self, wanted: BoolArray) -> Self:
        """Return some of them; wanted: (half_periods,)."""
        columns: dict[str, Any] = {n: x[wanted] for n, x in vars(self).items() if isinstance(x, np.ndarray)}
        return replace(self, **columns)

    def __getitem__(self, at: int | slice) -> Any:
        return tuple(self)[at]

    def columns(self) -> dict[str, list[Any]]:
        """Return the fields of an Estimate by name, in their order, each with a value per half period."""
        why, begin = [self.codes[at] for at in self.why.tolist()], self.origin + self.begin
        numbers = begin, self.origin + (self.begin + self.dt_s), self.dt_s, self.dy, self.e_max, self.d, self.direction
        columns = [*(x.tolist() for x in numbers), [code == "ok" for code in why], why]
        return dict(zip((one.name for one in fields(Estimate) if one.repr), columns, strict=True))

    def __iter__(self) -> Iterator[Estimate]:
        return map(Estimate, *self.columns().values())

    def __eq__(self, other: object) -> bool:
        return tuple(self) == tuple(other) if isinstance(other, Sequence) else NotImplemented


class Cluster(Frozen):
    """The size that is reported: where the accepted estimates gather, or what PV against OP tells."""

    d: float
    ci95: tuple[float, float]
    spread: float  # interquartile range, or half the interval, / d
    n: int  # estimates in it
    share: float  # of all accepted estimates
    limit_of_detection: float | None = None  # smallest dead band that this record could have shown


class Confirmation(Frozen):
    """Does PV follow OP, or OP through a dead band of size d?"""

    d: float
    ci95: tuple[float, float]
    error_reduction: float  # share of the prediction error variance that the dead band removes
    delta_bic: float  # Bayesian information criterion, positive in favour of a dead band
    limit_of_detection: float | None = None
    details: Mapping[str, float | str] = field(default_factory=dict)  # further numbers by name
    profile: tuple[tuple[float, float], ...] = field(default=(), repr=False)  # (d, evidence) of each size tried


class Compensator(Frozen):
    """Recommended compensator gain [span of output], the scheme of the paper, and why. Advice to a person."""

    gain: float
    scheme: str
    reason: str


class LoopReport(Frozen):
    """All that is known about one loop after a scan."""

    loop: str
    verdict: Verdict
    reasons: tuple[Note, ...] = ()
    confidence: float = 0.0
    start: float | None = None
    end: float | None = None
    samples: int = 0
    interval_s: float | None = None
    settings: LoopSettings = field(default_factory=LoopSettings)
    half_periods: int = 0
    long_half_periods: int = 0
    detections: int = 0
    detection_rate: float = 0.0
    detections_per_hour: float = 0.0
    rejected: Mapping[str, int] = field(default_factory=dict)
    estimates: Estimates | tuple[Estimate, ...] = ()
    cluster: Cluster | None = None
    confirmation: Confirmation | None = None
    compensator: Compensator | None = None
    warnings: tuple[Note, ...] = ()
    details: Mapping[str, object] = field(default_factory=dict)
    # what the next night needs to go on without a cut (estimator/carry.py), packed
    carry: bytes | None = field(default=None, repr=False, compare=False)

    @property
    def claimed(self) -> Confirmation | Cluster | None:
        """The dead band that the report stands for, None where the verdict claims none: PV against OP goes before the
        half periods, which read low in noise."""
        if self.verdict not in (Verdict.BACKLASH, Verdict.SUSPECTED):
            return None
        sizes = (self.confirmation, self.cluster)
        return next((found for found in sizes if found is not None and math.isfinite(found.d) and found.d > 0.0), None)

    @property
    def limit_of_detection(self) -> float | None:
        """Smallest dead band [span] that this record would have shown, None where it is not known; of a size that is
        called, the cluster's, which is never above it."""
        called = self.verdict in (Verdict.BACKLASH, Verdict.SUSPECTED)
        first, second = (self.cluster, self.confirmation) if called else (self.confirmation, self.cluster)
        limits = (found.limit_of_detection for found in (first, second) if found is not None)
        return next((limit for limit in limits if limit is not None), None)


class PlantResult(Frozen):
    """What was found of each loop of a plant, the inputs, and what could not be read or analysed."""

    loops: tuple[Any, ...]
    inputs: tuple[str, ...] = ()
    warnings: tuple[Note, ...] = ()
    failures: tuple[Note, ...] = ()


class ScanResult(PlantResult):
    """A whole scan."""

    loops: tuple[LoopReport, ...]
