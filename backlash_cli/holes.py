"""Values between records: on straight lines, held until the next record, or lost where a hole is too long."""

import numpy as np
from numpy.typing import NDArray

from .record import FloatArray, IntArray, runs

MAX_HOLE = 5  # absent samples that may be bridged


def inside(starts: IntArray, ends: IntArray, samples: int) -> NDArray[np.bool_]:
    """(samples,) True in stretches that do not overlap; ends: one past the last."""
    found = np.zeros(samples, bool)
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        found[start:end] = True
    return found


def short_holes(values: FloatArray, index: IntArray, longest: int) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return (values, filled): holes (nan) of at most `longest` samples on a line, but not beside a jump of `index`."""
    starts, ends = runs(~np.isfinite(values))
    inner = (starts > 0) & (ends < len(values)) & (ends - starts <= longest)
    starts, ends = starts[inner], ends[inner]
    unbroken = index[ends] - index[starts - 1] == ends - starts + 1
    filled = inside(starts[unbroken], ends[unbroken], len(values))
    if not filled.any():
        return values, filled
    out, known = values.copy(), np.flatnonzero(np.isfinite(values))
    out[filled] = np.interp(np.flatnonzero(filled), known, values[known])
    return out, filled


def linear(times: IntArray, known: IntArray, heights: FloatArray, limit: float) -> FloatArray:
    """(samples,) Values at `times` on lines between good records at most `limit` microseconds apart, else nan."""
    if len(known) < 2:
        return np.full(len(times), np.nan)
    out = np.interp((times - known[0]).astype(float), (known - known[0]).astype(float), heights, np.nan, np.nan)
    after = np.searchsorted(known, times).clip(1, len(known) - 1)
    wide = known[after] - known[after - 1] > limit
    out[wide & (known[after] != times) & (known[after - 1] != times)] = np.nan
    return out


def held(times: IntArray, stamps: IntArray, values: FloatArray, limit: float, few: float) -> FloatArray:
    """(samples,) The last good record at or before each of `times`; nan before the first, after `limit` microseconds,
    and from a bad record (nan) on when no good one follows within `few` microseconds or MAX_HOLE records."""
    good = np.isfinite(values)
    if not good.any():
        return np.full(len(times), np.nan)
    known, heights = stamps[good], values[good]
    last = np.searchsorted(known, times, side="right") - 1
    age = times - known[last.clip(0)]
    out = np.where((last >= 0) & (age <= limit), heights[last], np.nan)
    if not good.all():
        faults = stamps[~good]
        fault = np.searchsorted(faults, times, side="right") - 1
        stale = (fault >= 0) & (faults[fault.clip(0)] > known[last.clip(0)])
        out[stale & (age > max(few, (MAX_HOLE + 0.5) * float(np.median(np.diff(stamps)))))] = np.nan
    return out
