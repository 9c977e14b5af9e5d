"""What a scan found: one LoopReport per loop, with every half period and the reasons behind the verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, LoopSettings, Note


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

@dataclass(frozen=True)
class Estimate:
    """One half period: the interval between two zero crossings of the control error.

    start, end: UTC epoch seconds. dt_s: duration [s]. dy: mean |e| (12). e_max: largest |e|. d: estimate (15),
    all normalised. direction: sign of e. accepted: passed every gate; why: code of the gate that refused it, else "ok".
    """

    start: float
    end: float
    dt_s: float
    dy: float
    e_max: float
    d: float
    direction: int
    accepted: bool
    why: str = "ok"


@dataclass(frozen=True, eq=False)
class Estimates(Sequence[Estimate]):
    """The half periods of one loop as columns, (half_periods,) arrays: read like a tuple of Estimate.

    A year of a plant has millions of half periods; as columns each takes some forty bytes. begin: seconds since
    `origin` (UTC epoch seconds), and each `why` a position in `codes`; the rest as in Estimate.
    """

    origin: float
    begin: FloatArray
    dt_s: FloatArray
    dy: FloatArray
    e_max: FloatArray
    d: FloatArray
    direction: NDArray[np.int8]
    why: NDArray[np.uint8]
    codes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.begin)

    def select(self, wanted: NDArray[np.bool_]) -> Estimates:
        """Return some of them; wanted: (half_periods,)."""
        return replace(self, begin=self.begin[wanted], dt_s=self.dt_s[wanted], dy=self.dy[wanted], d=self.d[wanted],
                       e_max=self.e_max[wanted], direction=self.direction[wanted], why=self.why[wanted])

    def __getitem__(self, at: int | slice) -> Any:
        if isinstance(at, slice):
            return tuple(self[i] for i in range(*at.indices(len(self))))
        begin, duration, code = float(self.begin[at]), float(self.dt_s[at]), self.codes[self.why[at]]
        return Estimate(self.origin + begin, self.origin + (begin + duration), duration, float(self.dy[at]),
                        float(self.e_max[at]), float(self.d[at]), int(self.direction[at]), code == "ok", code)

    def __iter__(self) -> Iterator[Estimate]:
        return (self[i] for i in range(len(self)))

    def __eq__(self, other: object) -> bool:
        return tuple(self) == tuple(other) if isinstance(other, Sequence) else NotImplemented

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True)
class Cluster:
    """Where the accepted estimates gather: dead band d [span of output] with its interval.

    spread: robust relative spread (interquartile range / d). n: estimates in it. share: of all accepted estimates.
    limit_of_detection: smallest dead band [span] that this record could have shown, None if not known.
    """

    d: float
    ci95: tuple[float, float]
    spread: float
    n: int
    share: float
    limit_of_detection: float | None = None


@dataclass(frozen=True)
class Confirmation:
    """Does PV follow OP, or OP through a dead band? Size d [span of output], its interval, and the evidence.

    error_reduction: share of the prediction error variance that the dead band removes. delta_bic: difference of
    the Bayesian information criterion, positive in favour of a dead band. details: further numbers by name.
    profile: (d, evidence) pairs of the scan over d, for the picture.
    """

    d: float
    ci95: tuple[float, float]
    error_reduction: float
    delta_bic: float
    limit_of_detection: float | None = None
    details: Mapping[str, float | str] = field(default_factory=dict)
    profile: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Compensator:
    """Recommended compensator gain [span of output], the scheme of the paper, and why. Advice to a person."""

    gain: float
    scheme: str
    reason: str


@dataclass(frozen=True)
class LoopReport:
    """All that is known about one loop after a scan; times are UTC epoch seconds, signals normalised.

    carry: what the next night of this loop needs to go on without a cut (estimator/carry.py), packed.
    """

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
    estimates: Sequence[Estimate] = ()
    cluster: Cluster | None = None
    confirmation: Confirmation | None = None
    compensator: Compensator | None = None
    warnings: tuple[Note, ...] = ()
    details: Mapping[str, object] = field(default_factory=dict)
    carry: bytes | None = field(default=None, repr=False, compare=False)

    @property
    def limit_of_detection(self) -> float | None:
        """Smallest dead band [span] that this record would have shown, None where it is not known."""
        known = (found.limit_of_detection for found in (self.confirmation, self.cluster) if found is not None)
        return next((limit for limit in known if limit is not None), None)


@dataclass(frozen=True)
class ScanResult:
    """A whole run: the reports of all loops, the inputs, and what could not be read."""

    loops: tuple[LoopReport, ...]
    inputs: tuple[str, ...] = ()
    warnings: tuple[Note, ...] = ()
    failures: tuple[Note, ...] = ()
