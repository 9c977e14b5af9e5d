"""Oscillation detector: many large half periods of the control error within a supervision time.

T. Haegglund, A control-loop performance monitor, Control Engineering Practice 3 (1995) 1543-1551.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..half_periods import Segments

AMPLITUDE = 0.01  # a: an oscillation of 1 % of span must count
ENOUGH = 10  # this many half periods within the supervision time are an oscillation
SUPERVISION = 50.0  # supervision time in integral times


@dataclass(frozen=True)
class Oscillation:
    """What the detector saw: `present`, share of the record in it, period [s] and mean amplitude [span]."""

    present: bool
    share: float
    period: float | None = None
    amplitude: float | None = None


def least_area(Ti: float) -> float:
    """Return the integral of |e| over a half period [span s] above which it counts: that of a sine of period Ti."""
    return 2.0 * AMPLITUDE / (2.0 * np.pi / Ti)


def detect_oscillation(segments: Segments, interval: float, Ti: float) -> Oscillation:
    """Count half periods with IAE > 2 a / w, w = 2 pi / Ti, forgetting over 50 Ti: x <- lambda x + 1.

    segments: half periods of the error after the measurement filter alone.
    """
    large = np.flatnonzero(segments.complete & (segments.area * interval > least_area(Ti)))
    ages = segments.end[large] * interval / (SUPERVISION * Ti)
    counts = np.exp(np.logaddexp.accumulate(ages) - ages)  # one counts 1/e after the supervision time
    inside = counts >= ENOUGH
    if not inside.any():
        return Oscillation(False, 0.0)
    span = float(segments.end[-1] - segments.begin[0]) * interval
    # the half periods that filled the counter belong to the oscillation as well
    member = np.convolve(inside, np.ones(ENOUGH))[ENOUGH - 1 :] > 0.0
    of_large = large[member]
    dt = (segments.end[of_large] - segments.begin[of_large]) * interval
    amplitude = 0.5 * np.pi * np.median(segments.area[of_large] * interval / dt)
    return Oscillation(True, float(min(1.0, dt.sum() / span)), 2.0 * float(np.median(dt)), float(amplitude))
