"""The estimator as published: one dead-band estimate per half period, the two gates of the paper, and their tally.

T. Haegglund, Automatic on-line estimation of backlash in control loops, J. Process Control 17 (2007) 489-499.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..half_periods import ErrorScanner, Segments, double_lag
from ..record import FloatArray, LoopSettings, Record
from ..results import Estimate, Estimates
from .oscillation import least_area
from .rule import INCOMPLETE, OK, SLOW_ENOUGH, TOO_SHORT, WHY, dead_band, gate, mean_error

DEFAULT_KP = 1.5  # section 4: errors below 20 % for 1 < Kp < 3.4


@dataclass(frozen=True, eq=False)
class HalfPeriods:
    """Half periods with their estimates, (half_periods,) arrays; seconds and spans.

    begin: seconds since the record's start. refused: place in WHY of the gate that refused it, else OK.
    """

    begin: FloatArray
    duration: FloatArray
    dy: FloatArray
    e_max: FloatArray
    d: FloatArray
    direction: NDArray[np.int64]
    setpoint_move: FloatArray
    refused: NDArray[np.uint8]

    @property
    def why(self) -> NDArray[np.str_]:
        """The name of the gate that refused each half period, else "ok"."""
        return np.array(WHY)[self.refused]

    def __len__(self) -> int:
        return len(self.begin)


def estimate(segments: Segments, interval: float, settings: LoopSettings) -> HalfPeriods:
    """Return the estimates (15) of all half periods; the settings must hold K and Ti (Kp defaults to 1.5)."""
    K, Ti, Kp = settings.K, settings.Ti, settings.Kp or DEFAULT_KP
    assert K is not None and Ti is not None
    s = segments
    duration = (s.end - s.begin) * interval
    dy = mean_error(s.area * interval, duration)
    d = dead_band(dy, duration, K, Ti, Kp)
    return HalfPeriods(s.begin * interval, duration, dy, s.e_max, d, s.direction, s.setpoint_move,
                       gate(duration, dy, s.e_max, s.complete, d, Ti))


def no_half_periods() -> HalfPeriods:
    """Of a record that the rule cannot be asked of."""
    return estimate(Segments.join([]), 1.0, LoopSettings(K=1.0, Ti=1.0))


def error_scanner(settings: LoopSettings, interval: float, *, every: bool = True) -> ErrorScanner:
    """Return a scanner with the measurement filter (3) and the estimator's filter of Ti/2.

    every: keep all half periods; False: only those that an estimate or the oscillation detector can use.
    """
    Ti = settings.Ti
    assert Ti is not None
    least = (0.0, 0.0)
    if not every:
        # a little less than the limits, so that rounding leaves nothing out that would pass them
        least = (0.999 * least_area(Ti) / interval, 0.999 * SLOW_ENOUGH * Ti / interval)
    return ErrorScanner((double_lag(settings.filter_time or 0.0, interval), double_lag(Ti / 2.0, interval)), least)


def published_estimates(record: Record) -> tuple[Estimate, ...]:
    """Return every half period of at least 5 Ti of a record, as the publication treats it; `accepted` are detections.

    The record's settings must hold K and Ti. Times are UTC epoch seconds. Source: Haegglund (2007), section 4.
    """
    scanner = error_scanner(record.settings, record.interval)
    scanner.update(record)
    h = estimate(scanner.smooth.finish(), record.interval, record.settings)
    why = h.why.tolist()
    return tuple(
        Estimate(record.start + float(h.begin[i]), record.start + float(h.begin[i] + h.duration[i]),
                 float(h.duration[i]), float(h.dy[i]), float(h.e_max[i]), float(h.d[i]), int(h.direction[i]),
                 why[i] == "ok", why[i])
        for i in range(len(h)) if h.refused[i] not in (TOO_SHORT, INCOMPLETE)
    )


def tally(h: HalfPeriods, left_out: int, start: float, seconds: float) -> dict[str, Any]:
    """Return counts and estimates by their names in a LoopReport.

    left_out: half periods too short to be kept. start: of the record. seconds: of it that were used.
    """
    counts = np.bincount(h.refused, minlength=len(WHY)).tolist()
    everything, accepted = len(h) + left_out, counts[OK]
    rejected = {WHY[code]: n for code, n in enumerate(counts) if n and code != OK}
    if left_out:
        rejected["too_short"] = rejected.get("too_short", 0) + left_out
    codes = tuple(sorted(WHY[code] for code, n in enumerate(counts) if n))
    places = np.array([codes.index(code) if code in codes else 0 for code in WHY], dtype=np.uint8)
    listed = np.flatnonzero(h.refused != TOO_SHORT)
    return {
        "half_periods": everything,
        "long_half_periods": len(h) - counts[TOO_SHORT] - counts[INCOMPLETE],
        "detections": accepted,
        "detection_rate": accepted / max(everything, 1),
        "detections_per_hour": accepted / max(seconds / 3600.0, 1e-12),
        "rejected": dict(sorted(rejected.items())),
        "estimates": Estimates(start, h.begin[listed], h.duration[listed], h.dy[listed], h.e_max[listed], h.d[listed],
                               h.direction[listed].astype(np.int8), places[h.refused[listed]], codes),
    }
