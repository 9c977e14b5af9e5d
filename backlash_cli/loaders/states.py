"""Which samples count: frozen, saturated, implausible and missing ones marked, short holes filled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BEYOND = 0.5  # spans outside the range at which a measurement is no longer believed
AT_LIMIT = 1e-3  # of the output span: this close to 0 or 100 % is at the limit
LIMIT_RUN = 3  # samples at the limit that make saturation
FROZEN_RUN = 10  # equal samples below which nothing is called frozen
FROZEN_CHANCE = 1e-6  # chance that a noisy signal repeats itself this long anywhere in the record
LEAST_CHANGES = 50  # changes that any working measurement shows in a record, however slow and coarse
RESOLVED = 3.0  # recorder steps that a usual change of a noisy signal is large
OPPOSED = -0.2  # correlation of neighbouring changes below which there is noise
QUIET_SHARE = 0.25  # of the record: a signal without noise must stand still this long to be called frozen


def complete(values: NDArray[np.float64]) -> bool:
    """Is there a number everywhere? Asked of the sum, which is cheap; False as well when that is too large."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(np.add.reduce(values)))


def runs(flags: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (starts, ends) of the stretches where `flags` is True; end is one past the last."""
    edges = np.flatnonzero(flags[1:] != flags[:-1]) + 1
    if len(flags) and flags[0]:
        edges = np.concatenate([[0], edges])
    if len(flags) and flags[-1]:
        edges = np.append(edges, len(flags))
    return edges[0::2], edges[1::2]


def short_holes(
    values: NDArray[np.float64], index: NDArray[np.int64], longest: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
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


def hold_last(values: NDArray[np.float64], longest: int | None = None) -> NDArray[np.float64]:
    """Fill nan with the last number before it, over at most `longest` samples."""
    known = np.isfinite(values)
    if known.all():
        return values
    place = np.arange(len(values))
    last = np.maximum.accumulate(np.where(known, place, -1))
    out = np.where(last >= 0, values[last.clip(0)], np.nan)
    if longest is not None:
        out[place - last > longest] = np.nan
    return out


def saturated(output: NDArray[np.float64]) -> NDArray[np.bool_] | None:
    """(samples,) True where a normalised output stays at 0 or 1 for several samples; None when it never does."""
    from .signal_kernel import stays_outside

    return stays_outside(output, AT_LIMIT, 1.0 - AT_LIMIT, LIMIT_RUN)


def implausible(measurement: NDArray[np.float64]) -> NDArray[np.bool_] | None:
    """(samples,) True where a normalised measurement lies more than BEYOND spans outside its range."""
    with np.errstate(invalid="ignore"):
        if np.fmin.reduce(measurement) >= -BEYOND and np.fmax.reduce(measurement) <= 1.0 + BEYOND:
            return None
        return (measurement < -BEYOND) | (measurement > 1.0 + BEYOND)


def frozen(values: NDArray[np.float64]) -> NDArray[np.bool_] | None:
    """(samples,) True where a measurement repeats one number for longer than its own noise allows; None if nowhere.

    A signal with noise repeats a number with some chance p, so a run of L repeats somewhere among n samples has
    chance about n p^L; runs with less than FROZEN_CHANCE are frozen. A signal without noise may stand still, as a
    valve does in its dead band: it must do so for QUIET_SHARE of the record.
    """
    from .signal_kernel import stands_still

    if len(values) < 2 * LEAST_CHANGES:
        return None
    if not stands_still(values):
        return None
    equal = values[1:] == values[:-1]
    starts, ends = runs(equal)
    lengths = ends - starts
    limit = _longest_by_chance(len(values), len(lengths), int(lengths.sum()))
    kept = lengths < limit
    if kept.all():
        return None
    if not _noisy(values, starts[~kept], ends[~kept]):
        kept = lengths < max(limit, QUIET_SHARE * len(values))
    if kept.all():
        return None
    out = np.zeros(len(values), bool)
    for start, end in zip(starts[~kept], ends[~kept], strict=True):
        out[start : end + 1] = True
    return out


def _longest_by_chance(samples: int, stretches: int, repeats: int) -> float:
    """Repeats in a row that noise still explains. stretches: of repeats; repeats: in all of them."""
    # of all new values, how many are repeated at once: a long run counts once, so it does not hide itself
    p = min(max((stretches + 1.0) / (samples - repeats + 2.0), 1e-4), 1.0 - LEAST_CHANGES / (samples - 1))
    return max(float(FROZEN_RUN - 1), float(np.log(FROZEN_CHANCE / samples) / np.log(p)))


class Repeats:
    """Counts the repeats of a long signal piece by piece, to know whether `frozen` could find anything in it."""

    def __init__(self) -> None:
        self.samples = self.stretches = self.total = self.longest = self._open = self._begun = 0
        self.long: list[tuple[int, int]] = []  # first sample and repeats of stretches that may be frozen
        self._last = np.empty(0)

    def add(self, values: NDArray[np.float64]) -> None:
        """Take the next samples."""
        joined = np.concatenate([self._last, values])
        before = self.samples - len(self._last)
        starts, ends = runs(joined[1:] == joined[:-1])
        lengths = ends - starts
        self.samples += len(values)
        self.total += int(lengths.sum())
        goes_on = len(starts) > 0 and starts[0] == 0 and self._open > 0
        self.stretches += len(starts) - goes_on
        starts = starts + before
        if goes_on:
            lengths[0] += self._open
            starts[0] = self._begun
            if self.long and self.long[-1][0] == self._begun:
                self.long.pop()
        self.longest = max(self.longest, int(lengths.max(initial=0)))
        kept = lengths >= FROZEN_RUN - 1
        self.long += zip(starts[kept].tolist(), lengths[kept].tolist(), strict=True)
        still_open = len(ends) > 0 and ends[-1] == len(joined) - 1
        self._open, self._begun = (int(lengths[-1]), int(starts[-1])) if still_open else (0, 0)
        self._last = values[-1:] if len(values) else self._last

    def longest_by_chance(self) -> float:
        """Repeats in a row that noise still explains."""
        return _longest_by_chance(self.samples, self.stretches, self.total)

    def may_be_frozen(self) -> bool:
        """Is there a stretch that noise does not explain?"""
        return self.samples >= 2 * LEAST_CHANGES and self.longest >= self.longest_by_chance()


def _noisy(values: NDArray[np.float64], starts: NDArray[np.int64], ends: NDArray[np.int64]) -> bool:
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
