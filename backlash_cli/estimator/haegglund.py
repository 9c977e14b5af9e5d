"""The estimator as published: from duration, area and peak of a half period to its dead-band estimate, the two gates,
and their tally; and the oscillation detector: many large half periods within a supervision time.

T. Haegglund, Automatic on-line estimation of backlash in control loops, J. Process Control 17 (2007) 489-499; A
control-loop performance monitor, Control Engineering Practice 3 (1995) 1543-1551."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..half_periods import ErrorScanner, Segments, double_lag
from ..record import FloatArray, LoopSettings, Record, quantile
from ..results import Estimate, Estimates

Numbers = TypeVar("Numbers", float, FloatArray)

SLOW_ENOUGH = 5.0  # gate dt >= 5 Ti: the signals are slow, the valve moves through statics
SHAPE_LIMIT = 2.0  # gate e_max < 2 dy: a half period flattened by the dead band, not a load disturbance

# Why a half period is refused, as it is named in reports; inside, its place here.
WHY = ("ok", "shape", "too_short", "incomplete", "not_positive")
OK, SHAPE, TOO_SHORT, INCOMPLETE, NOT_POSITIVE = range(len(WHY))

DEFAULT_KP = 1.5  # section 4: errors below 20 % for 1 < Kp < 3.4
AMPLITUDE = 0.01  # a: an oscillation of 1 % of span must count
ENOUGH = 10  # this many half periods within the supervision time are an oscillation
SUPERVISION = 50.0  # supervision time in integral times


def mean_error(area: ArrayLike, duration: ArrayLike) -> FloatArray:
    """Return dy, the mean of |e| over a half period (12). area [span s], duration [s] -> [span]."""
    length = np.asarray(duration, dtype=np.float64)
    return np.asarray(np.where(length > 0.0, area / np.where(length > 0.0, length, 1.0), 0.0))


def output_change(dy: Numbers, duration: Numbers, K: float, Ti: float) -> Numbers:
    """Return du = K/Ti dy dt (11): how far the integral part moved the output [output span]."""
    return abs(K) / Ti * dy * duration


def dead_band(dy: Numbers, duration: Numbers, K: float, Ti: float, Kp: float) -> Numbers:
    """Return the dead-band estimate d = (K dt/Ti - 1/Kp) dy of a half period (15) [output span].

    >>> round(dead_band(0.01, 20.0, K=1.2, Ti=2.2, Kp=1.0), 12)  # (10.909 - 1) * 0.01
    0.099090909091"""
    return output_change(dy, duration, K, Ti) - dy / abs(Kp)


def gate(duration: ArrayLike, dy: ArrayLike, e_max: ArrayLike, complete: ArrayLike, d: ArrayLike,
         Ti: float) -> NDArray[np.uint8]:
    """Return why each half period is refused, as its place in WHY; OK if it is not.

    duration [s], dy and e_max [span], complete, d [output span]: (half_periods,)."""
    why = np.where(np.asarray(d) <= 0.0, NOT_POSITIVE, OK).astype(np.uint8)
    why[np.asarray(e_max) >= SHAPE_LIMIT * np.asarray(dy)] = SHAPE
    why[np.asarray(duration) < SLOW_ENOUGH * Ti] = TOO_SHORT
    why[~np.asarray(complete)] = INCOMPLETE
    return why


def estimate(segments: Segments, interval: float, settings: LoopSettings, start: float = 0.0) -> Estimates:
    """Estimates (15) of all half periods of a record that begins at `start` (UTC epoch seconds), K and Ti known."""
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

    The record's settings must hold K and Ti. Times are UTC epoch seconds. Source: Haegglund (2007), section 4."""
    scanner = error_scanner(record.settings, record.interval)
    scanner.update(record)
    found = estimate(scanner.smooth.finish(), record.interval, record.settings, record.start)
    return tuple(found.select((found.why != TOO_SHORT) & (found.why != INCOMPLETE)))


def tally(h: Estimates, left_out: int, seconds: float) -> dict[str, Any]:
    """Return counts and estimates by their names in a LoopReport. left_out: too short to be kept. seconds: used."""
    counts = np.bincount(h.why, minlength=len(WHY)).tolist()
    counts[TOO_SHORT] += left_out
    everything, accepted = sum(counts), counts[OK]
    return {"half_periods": everything, "long_half_periods": everything - counts[TOO_SHORT] - counts[INCOMPLETE],
        "detections": accepted, "detection_rate": accepted / max(everything, 1),
        "detections_per_hour": accepted / max(seconds / 3600.0, 1e-12),
        "rejected": dict(sorted((WHY[code], n) for code, n in enumerate(counts) if n and code != OK)),
        "estimates": h.select(h.why != TOO_SHORT)}


def detect_oscillation(segments: Segments, interval: float, Ti: float) -> tuple[float, float]:
    """Return the share of the record in which the error oscillates, and the period [s]; (0, 0) where it does not.

    Half periods with IAE > 2 a / w, w = 2 pi / Ti (as a sine of period Ti has), are counted, forgetting over 50 Ti:
    x <- lambda x + 1. segments: of the error after the measurement filter alone. Source: Haegglund (1995)."""
    large = np.flatnonzero(segments.complete & (segments.area * interval > AMPLITUDE * Ti / np.pi))
    ages = segments.end[large] * interval / (SUPERVISION * Ti)
    inside = np.exp(np.logaddexp.accumulate(ages) - ages) >= ENOUGH  # one counts 1/e after the supervision time
    if not inside.any():
        return 0.0, 0.0
    span = float(segments.end[-1] - segments.begin[0])
    # the half periods that filled the counter belong to the oscillation as well
    of_large = large[np.convolve(inside, np.ones(ENOUGH))[ENOUGH - 1 :] > 0.0]
    length = segments.end[of_large] - segments.begin[of_large]
    return float(min(1.0, length.sum() / span)), 2.0 * quantile(length, 0.5) * interval
