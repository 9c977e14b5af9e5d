"""The estimator as published: one dead-band estimate per half period, the two gates of the paper, and their tally; and
the oscillation detector: many large half periods of the control error within a supervision time.

T. Haegglund, Automatic on-line estimation of backlash in control loops, J. Process Control 17 (2007) 489-499; A
control-loop performance monitor, Control Engineering Practice 3 (1995) 1543-1551.
"""

from typing import Any

import numpy as np

from ..half_periods import ErrorScanner, Segments, double_lag
from ..record import LoopSettings, Record
from ..results import Estimate, Estimates
from .rule import INCOMPLETE, OK, SLOW_ENOUGH, TOO_SHORT, WHY, dead_band, gate, mean_error

DEFAULT_KP = 1.5  # section 4: errors below 20 % for 1 < Kp < 3.4
AMPLITUDE = 0.01  # a: an oscillation of 1 % of span must count
ENOUGH = 10  # this many half periods within the supervision time are an oscillation
SUPERVISION = 50.0  # supervision time in integral times


def estimate(segments: Segments, interval: float, settings: LoopSettings, start: float = 0.0) -> Estimates:
    """Return the estimates (15) of all half periods of a record that begins at `start` (UTC epoch seconds); K and Ti
    must be known."""
    s, K, Ti, Kp = segments, settings.K, settings.Ti, settings.Kp or DEFAULT_KP
    assert K is not None and Ti is not None
    duration = (s.end - s.begin) * interval
    dy = mean_error(s.area * interval, duration)
    d = dead_band(dy, duration, K, Ti, Kp)
    return Estimates(start, s.begin * interval, duration, dy, s.e_max, d, s.direction.astype(np.int8),
                     gate(duration, dy, s.e_max, s.complete, d, Ti), WHY)


def error_scanner(settings: LoopSettings, interval: float, *, every: bool = True) -> ErrorScanner:
    """Return a scanner with the measurement filter (3) and the estimator's filter of Ti/2. every: keep all half
    periods; False: only those that an estimate or the oscillation detector can use."""
    Ti = settings.Ti
    assert Ti is not None
    least = (0.0, 0.0)
    if not every:
        # a little less than the limits, so that rounding leaves nothing out that would pass them
        least = (0.999 * AMPLITUDE * Ti / np.pi / interval, 0.999 * SLOW_ENOUGH * Ti / interval)
    return ErrorScanner((double_lag(settings.filter_time or 0.0, interval), double_lag(Ti / 2.0, interval)), least)


def published_estimates(record: Record) -> tuple[Estimate, ...]:
    """Return every half period of at least 5 Ti of a record, as the publication treats it; `accepted` are detections.

    The record's settings must hold K and Ti. Times are UTC epoch seconds. Source: Haegglund (2007), section 4.
    """
    scanner = error_scanner(record.settings, record.interval)
    scanner.update(record)
    found = estimate(scanner.smooth.finish(), record.interval, record.settings, record.start)
    return tuple(found.select((found.why != TOO_SHORT) & (found.why != INCOMPLETE)))


def tally(h: Estimates, left_out: int, seconds: float) -> dict[str, Any]:
    """Return counts and estimates by their names in a LoopReport. left_out: half periods too short to be kept. seconds:
    of the record that were used."""
    counts = np.bincount(h.why, minlength=len(WHY)).tolist()
    everything, accepted = len(h) + left_out, counts[OK]
    long = len(h) - counts[TOO_SHORT] - counts[INCOMPLETE]
    counts[TOO_SHORT] += left_out
    return {
        "half_periods": everything,
        "long_half_periods": long,
        "detections": accepted,
        "detection_rate": accepted / max(everything, 1),
        "detections_per_hour": accepted / max(seconds / 3600.0, 1e-12),
        "rejected": dict(sorted((WHY[code], n) for code, n in enumerate(counts) if n and code != OK)),
        "estimates": h.select(h.why != TOO_SHORT),
    }


def detect_oscillation(segments: Segments, interval: float, Ti: float) -> tuple[float, float]:
    """Return the share of the record in which the error oscillates, and the period [s]; (0, 0) where it does not.

    Half periods with IAE > 2 a / w, w = 2 pi / Ti (as a sine of period Ti has), are counted, forgetting over 50 Ti:
    x <- lambda x + 1. segments: of the error after the measurement filter alone. Source: Haegglund (1995).
    """
    large = np.flatnonzero(segments.complete & (segments.area * interval > AMPLITUDE * Ti / np.pi))
    ages = segments.end[large] * interval / (SUPERVISION * Ti)
    counts = np.exp(np.logaddexp.accumulate(ages) - ages)  # one counts 1/e after the supervision time
    inside = counts >= ENOUGH
    if not inside.any():
        return 0.0, 0.0
    span = float(segments.end[-1] - segments.begin[0])
    # the half periods that filled the counter belong to the oscillation as well
    of_large = large[np.convolve(inside, np.ones(ENOUGH))[ENOUGH - 1 :] > 0.0]
    length = segments.end[of_large] - segments.begin[of_large]
    return float(min(1.0, length.sum() / span)), 2.0 * float(np.median(length)) * interval
