"""One loop's recording and its settings; the units of every field are stated here and nowhere else.

Inside the tool time is in seconds and signals are normalised: 0..1 of the span given by `pv_range`
(setpoint, measurement) and `op_range` (output). `settings/spans.py` makes them so, reporters give them back."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Self, dataclass_transform

import numpy as np
from numpy.typing import NDArray

from .errors import BacklashError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
NAT = np.iinfo(np.int64).min  # among stamps: no time
PIECE = 1 << 17  # samples taken at once: what is worked out in between stays in the processor's cache
AT_LIMIT = 1e-3  # of the output span: this close to 0 or 100 % is at the limit


def fingerprint(text: str, size: int = 32, more: bytes = b"") -> str:
    """So many hexadecimal digits that tell a text, and bytes behind it, from all others."""
    return hashlib.sha256(text.encode("utf-8", "backslashreplace") + more).hexdigest()[:size]


def duration(seconds: float, digits: int = 3) -> str:
    """A length of time in the unit that suits it.

    >>> [duration(x) for x in (0.5, 44.0, 400.0, 9000.0)], duration(200_000.0, 2)
    (['0.5 s', '44 s', '6.67 min', '2.5 h'], '2.3 d')"""
    units = (("d", 86400.0), ("h", 3600.0), ("min", 60.0), ("s", 1.0))
    name, length = next(((n, u) for n, u in units if seconds >= 1.5 * u), units[-1])
    return f"{float(f'{seconds / length:.{digits}g}'):g} {name}"


def utc_text(micros: int) -> str:
    """Return a stamp [microseconds since 1970 UTC] as readable text, for messages."""
    return str(np.datetime64(int(micros) // 1_000_000, "s")).replace("T", " ")


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
@dataclass(frozen=True, eq=False)
class Frozen:
    """What is known once and never changes: a class that is made from it is a frozen dataclass."""

    def __init_subclass__(cls, **options: bool) -> None:
        super().__init_subclass__()
        dataclass(frozen=True, **options)(cls)


class SampleState(IntEnum):
    """Why a sample can or cannot be used. Only GOOD and FILLED samples enter an estimate."""

    GOOD = 0
    FILLED = 1  # interpolated over a short hole; the measurement itself was not recorded
    MISSING = 2  # no number, bad quality, not finite
    MANUAL = 3  # controller not in automatic
    SATURATED = 4  # output at its limit
    FROZEN = 5  # measurement repeats the same number for too long
    IMPLAUSIBLE = 6  # far outside the span (spike)


class Note(Frozen):
    """A reason or warning: machine-readable code, a sentence for a person, and numbers behind it."""

    code: str
    message: str
    values: Mapping[str, float | int | str] = field(default_factory=dict)


def failure(error: BacklashError, *, loop: str = "", file: str = "") -> Note:
    """Return an error as a failure of the plant, about a loop or a file."""
    values: dict[str, float | str] = {key: value for key, value in (("loop", loop), ("file", file)) if value}
    return Note(error.code, f"{loop}: {error}" if loop else str(error), values)


class LoopSettings(Frozen):
    """Controller and loop settings in the tool's own form: ideal PID on normalised signals, seconds.

    u = K ( -yf + 1/Ti * integral(ysp - yf) - Td dyf/dt ),  Yf = Y / (1 + s Tf)^2   (Haegglund 2007, eqs 2, 3)

    K: controller gain [output span / measurement span], sign = action (negative: the process gain is negative).
    Ti, Td, Tf: seconds. Kp: static process gain [measurement span / output span]. theta: dead time [s].
    pv_range, op_range: engineering values that map to 0 and 1. `None` means not known.
    source: where each value comes from: "metadata", "default", "identified", "data"."""

    K: float | None = None
    Ti: float | None = None
    Td: float = 0.0
    Tf: float | None = None
    Kp: float | None = None
    theta: float | None = None
    pv_range: tuple[float, float] = (0.0, 1.0)
    op_range: tuple[float, float] = (0.0, 1.0)
    source: Mapping[str, str] = field(default_factory=dict)

    @property
    def filter_time(self) -> float | None:
        """Time constant Tf [s] of the measurement filter (3): as given, else Td/5 (PID) or Ti/10 (PI)."""
        if self.Tf is not None:
            return self.Tf
        if self.Td > 0:
            return self.Td / 5.0
        return None if self.Ti is None else self.Ti / 10.0

    def with_values(self, source: str, **values: object) -> Self:
        """Return a copy with `values` replaced and named as coming from `source`."""
        return replace(self, source={**self.source, **dict.fromkeys(values, source)}, **values)  # type: ignore[arg-type]


class Record(Frozen, eq=False):
    """Samples of one loop on a uniform grid, normalised, in time order; gaps are jumps of `index`.

    loop: name. start: UTC epoch seconds of index 0. interval: seconds between grid points.
    index: (samples,) int64, strictly increasing grid number of each sample; a jump > 1 is a gap.
    setpoint, measurement, output: (samples,) float64, normalised; nan where not recorded. `output` may be None.
    state: (samples,) uint8 of SampleState.
    disturbances: further measured columns, name -> (samples,) float64 in their own units.
    notes: what the loader found or assumed. A Record is also a block: consecutive blocks of one loop
    share `start` and `interval`, and their `index` goes on."""

    loop: str
    start: float
    interval: float
    index: IntArray
    setpoint: FloatArray
    measurement: FloatArray
    output: FloatArray | None
    state: NDArray[np.uint8]
    settings: LoopSettings = field(default_factory=LoopSettings)
    disturbances: Mapping[str, FloatArray] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()

    def __len__(self) -> int:
        return len(self.index)

    @property
    def time(self) -> FloatArray:
        """(samples,) UTC epoch seconds."""
        return self.start + self.interval * self.index.astype(np.float64)

    @property
    def usable(self) -> BoolArray:
        """(samples,) True where a sample may enter an estimate."""
        return self.state <= SampleState.FILLED.value  # beside no plain number they would become 64 bits wide

    def slice(self, first: int, last: int) -> Self:
        """Return samples first..last-1 as a block of the same loop (same start and interval)."""
        cut = slice(first, last)
        return replace(self, index=self.index[cut], setpoint=self.setpoint[cut], measurement=self.measurement[cut],
                       output=None if self.output is None else self.output[cut], state=self.state[cut],
                       disturbances={k: v[cut] for k, v in self.disturbances.items()})


def hold(values: FloatArray) -> FloatArray:
    """Values (samples,) with the last number before it in every hole; one at the start takes the first number."""
    good = np.isfinite(values)
    last = np.where(good, np.arange(len(values)), np.argmax(good))
    return values[np.maximum.accumulate(last, out=last)]  # in place: long records


def runs(flags: BoolArray) -> tuple[IntArray, IntArray]:
    """Return (starts, ends) of the stretches where `flags` is True; end is one past the last."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False)) if flags.any() else np.zeros(0, int)
    return edges[0::2], edges[1::2]


def quantile(values: FloatArray, share: float) -> float:
    """np.quantile of finite values (samples,) without its search for nan and its general shape: a fifth of its time."""
    below, part = divmod(share * (len(values) - 1), 1.0)
    low = int(below)
    parted = np.partition(values, low)
    return float(parted[low] + part * (parted[low + 1 :].min() - parted[low])) if part else float(parted[low])


def record_from_arrays(setpoint: object, measurement: object, output: object | None = None, *, interval: float,
                       loop: str = "loop", start: float = 0.0, settings: LoopSettings | None = None,
                       disturbances: Mapping[str, object] | None = None) -> Record:
    """Make a gap-free Record from normalised arrays of one length; `setpoint` may be one number. Values in engineering
    units are noted (`read` scales those of a DataFrame). Raises ValueError for other lengths and impossible numbers."""
    pv = np.asarray(measurement, dtype=np.float64)
    sp = np.broadcast_to(np.asarray(setpoint, dtype=np.float64), pv.shape).copy()
    op = None if output is None else np.asarray(output, dtype=np.float64)
    extra = {k: np.asarray(v, dtype=np.float64) for k, v in (disturbances or {}).items()}
    for name, values in {"output": op, **extra}.items():
        if values is not None and values.shape != pv.shape:
            raise ValueError(f"{name} has {values.shape} samples, measurement has {pv.shape}")
    if pv.ndim != 1:
        raise ValueError(f"measurement has {pv.ndim} dimensions: one array per loop is needed")
    own = settings or LoopSettings()
    if not all(0.0 < time < np.inf for time in (interval, own.Ti) if time is not None) or not own.Td >= 0.0 or not all(
            abs(gain) > 0.0 for gain in (own.K, own.Kp) if gain is not None):
        raise ValueError(f"interval {interval}, K {own.K}, Ti {own.Ti}, Td {own.Td}, Kp {own.Kp}: seconds above 0 are "
                         "needed (Td may be 0), and gains other than 0")
    middle = {name: float(np.median(x[np.isfinite(x)])) for name, x in {"measurement": pv, "output": op}.items()
              if x is not None and np.isfinite(x).any()}
    notes = tuple(Note("not_in_spans", f"{name} is {value:.4g} in the middle: sizes and limits are right for parts of "
                       "the span only, 0 to 1") for name, value in middle.items() if abs(value - 0.5) > 1.0)
    good = np.isfinite([x for x in (pv, sp, op) if x is not None]).all(axis=0)
    state = np.where(good, SampleState.GOOD, SampleState.MISSING).astype(np.uint8)
    return Record(loop, start, interval, np.arange(len(pv), dtype=np.int64), sp, pv, op, state, own, extra, notes)
