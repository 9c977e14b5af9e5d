"""Which samples count: frozen, saturated, implausible and missing ones marked, short holes filled."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray, Note, SampleState

BEYOND = 0.5  # spans outside the range at which a measurement is no longer believed
AT_LIMIT = 1e-3  # of the output span: this close to 0 or 100 % is at the limit
LIMIT_RUN = 3  # samples at the limit that make saturation
FROZEN_RUN = 10  # equal samples below which nothing is called frozen
FROZEN_CHANCE = 1e-6  # chance that a noisy signal repeats itself this long anywhere in the record
LEAST_CHANGES = 50  # changes that any working measurement shows in a record, however slow and coarse
RESOLVED = 3.0  # recorder steps that a usual change of a noisy signal is large
OPPOSED = -0.2  # correlation of neighbouring changes below which there is noise
QUIET_SHARE = 0.25  # of the record: a signal without noise must stand still this long to be called frozen


def runs(flags: NDArray[np.bool_]) -> tuple[IntArray, IntArray]:
    """Return (starts, ends) of the stretches where `flags` is True; end is one past the last."""
    edges = np.flatnonzero(flags[1:] != flags[:-1]) + 1
    if len(flags) and flags[0]:
        edges = np.concatenate([[0], edges])
    if len(flags) and flags[-1]:
        edges = np.append(edges, len(flags))
    return edges[0::2], edges[1::2]


def short_holes(values: FloatArray, index: IntArray, longest: int) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Fill holes (nan) of at most `longest` samples on a straight line between their neighbours.

    Holes at the ends and next to a gap (a jump of `index`) stay. Returns (values, filled).
    """
    missing = ~np.isfinite(values)
    filled = np.zeros(len(values), bool)
    starts, ends = runs(missing)
    inner = (starts > 0) & (ends < len(values)) & (ends - starts <= longest)
    starts, ends = starts[inner], ends[inner]
    unbroken = index[ends] - index[starts - 1] == ends - starts + 1
    starts, ends = starts[unbroken], ends[unbroken]
    if not len(starts):
        return values, filled
    out = values.copy()
    counts = ends - starts
    position = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    where = np.repeat(starts, counts) + position
    left, right = values[starts - 1], values[ends]
    share = (position + 1) / np.repeat(counts + 1, counts)
    out[where] = np.repeat(left, counts) + share * np.repeat(right - left, counts)
    filled[where] = True
    return out, filled


def saturated(output: FloatArray) -> NDArray[np.bool_]:
    """(samples,) True where a normalised output stays at 0 or 1 for several samples."""
    with np.errstate(invalid="ignore"):
        starts, ends = runs((output <= AT_LIMIT) | (output >= 1.0 - AT_LIMIT))
    long = ends - starts >= LIMIT_RUN
    return inside(starts[long], ends[long], len(output))


def inside(starts: IntArray, ends: IntArray, samples: int) -> NDArray[np.bool_]:
    """(samples,) True in stretches that do not overlap; ends: one past the last."""
    edges = np.zeros(samples + 1, np.int8)
    edges[starts] += 1
    edges[ends] -= 1
    return np.cumsum(edges[:-1]).astype(bool)


def implausible(measurement: FloatArray) -> NDArray[np.bool_]:
    """(samples,) True where a normalised measurement lies more than BEYOND spans outside its range."""
    with np.errstate(invalid="ignore"):
        return (measurement < -BEYOND) | (measurement > 1.0 + BEYOND)


def frozen(values: FloatArray) -> NDArray[np.bool_]:
    """(samples,) True where a measurement repeats one number for longer than its own noise allows.

    A signal with noise repeats a number with some chance p, so a run of L repeats somewhere among n samples has
    chance about n p^L; runs with less than FROZEN_CHANCE are frozen. A signal without noise may stand still, as a
    valve does in its dead band: it must do so for QUIET_SHARE of the record.
    """
    starts, ends = runs(values[1:] == values[:-1]) if len(values) >= 2 * LEAST_CHANGES else (np.zeros(0, int),) * 2
    lengths = ends - starts
    if lengths.max(initial=0) < FROZEN_RUN - 1:
        return np.zeros(len(values), bool)
    limit = _longest_by_chance(len(values), len(lengths), int(lengths.sum()))
    kept = lengths < limit
    if not kept.all() and not _noisy(values, starts[~kept], ends[~kept]):
        kept = lengths < max(limit, QUIET_SHARE * len(values))
    return inside(starts[~kept], ends[~kept] + 1, len(values))


def _longest_by_chance(samples: int, stretches: int, repeats: int) -> float:
    """Repeats in a row that noise still explains. stretches: of repeats; repeats: in all of them."""
    # of all new values, how many are repeated at once: a long run counts once, so it does not hide itself
    p = min(max((stretches + 1.0) / (samples - repeats + 2.0), 1e-4), 1.0 - LEAST_CHANGES / (samples - 1))
    return max(float(FROZEN_RUN - 1), float(np.log(FROZEN_CHANCE / samples) / np.log(p)))


def _noisy(values: FloatArray, starts: IntArray, ends: IntArray) -> bool:
    """Is the noise resolved? Then neighbouring changes point in opposite directions (their correlation tends to -1/2),
    and changes are larger than the recorder's step."""
    changes = np.diff(values)
    keep = np.isfinite(changes)
    for start, end in zip(starts, ends, strict=True):
        keep[start:end] = False
    both = keep[1:] & keep[:-1]
    a, b = changes[:-1][both], changes[1:][both]
    power = float(a @ a + b @ b) / 2.0
    if len(a) < FROZEN_RUN or not power > 0 or float(a @ b) / power >= OPPOSED:
        return False
    sizes = np.abs(a[a != 0])
    return float(np.median(sizes)) >= RESOLVED * float(np.quantile(sizes, 0.01))


def state_notes(counts: Counter[str], samples: int, *kinds: str) -> list[Note]:
    """Say how many of so many samples are of these kinds, in order."""
    found = []
    for kind in kinds:
        count = counts[kind]
        code, text = _SAID[kind]
        if kind == "wild" and count > 0.5 * samples:
            text = f"{100 * count / samples:.0f} % of the measurement lies far outside pv_range: check it"
            found.append(Note("outside_range", text))
        elif count:
            text = text if kind in ("wild", "filled") else f"of {samples} samples {text}; not used"
            found.append(Note(code, f"{count} {text}", {"samples": float(count)}))
    return found


MEASURED = ("wild", "filled", "frozen", "saturated", "missing")
_SAID = {"wild": ("implausible", "samples of PV far outside the range (spikes) were rejected"),
         "filled": ("filled", "samples in short holes were interpolated"),
         "frozen": ("frozen", "repeat one number for too long (PV constant or frozen)"),
         "saturated": ("saturated", "have the output at its limit"), "missing": ("missing", "have no measurement"),
         "setpoint": ("setpoint_missing", "have no setpoint"), "output": ("output_missing", "have no output"),
         "manual": ("manual", "are not in automatic")}


class Samples:
    """Samples of one loop on its grid, all (samples,). index: grid numbers. sp, pv, op: None where not recorded.

    interpolated: the measurement was not recorded there. manual: not in automatic. bridge: longest hole in samples that
    is filled.
    After it is made, holes of `measurement` are filled, `state` says what each sample is, `count` how many are what.
    """

    def __init__(self, index: IntArray, sp: FloatArray | None, pv: FloatArray, op: FloatArray | None,
                 interpolated: NDArray[np.bool_] | None, manual: NDArray[np.bool_] | None, bridge: int) -> None:
        self.index = index
        self.setpoint = np.full(len(index), np.nan) if sp is None else sp
        self.output = op
        self.state = np.zeros(len(index), np.uint8)
        self._marks: dict[str, NDArray[np.bool_]] = {}
        self.measurement = self._measured(pv, op, interpolated, bridge)
        for what, values in (("setpoint", sp), ("output", op)):
            if values is not None and not np.isfinite(values).all():
                self._mark(what, ~np.isfinite(values), SampleState.MISSING)
        if manual is not None:
            there = (self.state != SampleState.MISSING) & (self.state != SampleState.IMPLAUSIBLE)
            self._mark("manual", manual & there, SampleState.MANUAL)

    def count(self, first: int = 0, last: int | None = None) -> Counter[str]:
        """Return how many of the samples first..last-1 are what."""
        return Counter({name: int(np.count_nonzero(where[first:last])) for name, where in self._marks.items()})

    def _measured(self, pv: FloatArray, op: FloatArray | None, interpolated: NDArray[np.bool_] | None,
                  bridge: int) -> FloatArray:
        wild = implausible(pv)
        self._marks["wild"] = wild
        y, filled = short_holes(np.where(wild, np.nan, pv), self.index, bridge)
        self._mark("filled", filled, SampleState.FILLED)
        if interpolated is not None:
            self.state[interpolated] = SampleState.FILLED
        self._mark("frozen", frozen(y), SampleState.FROZEN)
        if op is not None:
            self._mark("saturated", saturated(op), SampleState.SATURATED)
        missing = ~np.isfinite(y)
        self.state[missing & wild] = SampleState.IMPLAUSIBLE
        self._mark("missing", missing & ~wild, SampleState.MISSING)
        return y

    def _mark(self, what: str, where: NDArray[np.bool_], value: SampleState) -> None:
        self.state[where] = value
        self._marks[what] = where
