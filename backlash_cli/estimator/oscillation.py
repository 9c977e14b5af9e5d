"""Oscillation detector: many large half periods of the control error within a supervision time.

T. Haegglund, A control-loop performance monitor, Control Engineering Practice 3 (1995) 1543-1551.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray
from ..segmenter import Segments

AMPLITUDE = 0.01  # a: an oscillation of 1 % of span must count
ENOUGH = 10.0  # this many half periods within the supervision time are an oscillation
SUPERVISION = 50.0  # supervision time in integral times


@dataclass(frozen=True)
class Oscillation:
    """What the detector saw: `present`, share of the record in it, period [s] and mean amplitude [span]."""

    present: bool
    share: float
    peak_count: float
    period: float | None = None
    amplitude: float | None = None


def least_area(Ti: float) -> float:
    """Return the integral of |e| over a half period [span s] above which it counts: that of a sine of period Ti."""
    return 2.0 * AMPLITUDE / (2.0 * np.pi / Ti)


@numba.njit(cache=True, nogil=True)
def counted(end: FloatArray, area: FloatArray, complete: NDArray[np.bool_], interval: float, least: float,
            memory: float) -> tuple[IntArray, FloatArray]:
    """Places of the complete half periods of more than `least` area [span s]; and their number up to the end of each,
    those of long ago forgotten: one counts 1/e after `memory` [s]. end, area: in samples."""
    places, counts = np.empty(len(end), np.int64), np.empty(len(end))
    n, x, last = 0, 0.0, 0.0
    for k in range(len(end)):
        if complete[k] and area[k] * interval > least:
            now = end[k] * interval
            x = x * np.exp((last - now) / memory) + 1.0 if n else 1.0
            places[n], counts[n], last = k, x, now
            n += 1
    return places[:n], counts[:n]


def detect_oscillation(segments: Segments, interval: float, Ti: float) -> Oscillation:
    """Count half periods with IAE > 2 a / w, w = 2 pi / Ti, forgetting over 50 Ti: x <- lambda x + 1.

    segments: half periods of the error after the measurement filter alone.
    """
    large, counts = counted(segments.end, segments.area, segments.complete, float(interval), least_area(Ti),
                            SUPERVISION * Ti)
    if not len(large):
        return Oscillation(False, 0.0, 0.0)
    inside = counts >= ENOUGH
    if not inside.any():
        return Oscillation(False, 0.0, float(counts.max()))
    span = float(segments.end[-1] - segments.begin[0]) * interval
    # the half periods that filled the counter belong to the oscillation as well
    full = np.flatnonzero(inside)
    edges = np.zeros(len(counts) + 1, dtype=np.int64)
    np.add.at(edges, np.maximum(full - int(ENOUGH) + 1, 0), 1)
    np.add.at(edges, full + 1, -1)
    member = np.cumsum(edges[:-1]) > 0
    of_large = large[member]
    dt = (segments.end[of_large] - segments.begin[of_large]) * interval
    amplitude = 0.5 * np.pi * np.median(segments.area[of_large] * interval / dt)
    return Oscillation(True, float(min(1.0, dt.sum() / span)), float(counts.max()),
                       2.0 * float(np.median(dt)), float(amplitude))
