"""The estimator as published: one dead-band estimate per half period, and the two gates of the paper.

T. Haegglund, Automatic on-line estimation of backlash in control loops, J. Process Control 17 (2007) 489-499.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..filters import DoubleLag, double_lag
from ..record import FloatArray, LoopSettings, Record, SampleState
from ..segmenter import OpenHalfPeriod, Segments, close, segment

DEFAULT_KP = 1.5  # section 4: errors below 20 % for 1 < Kp < 3.4
SLOW_ENOUGH = 5.0  # gate dt >= 5 Ti: the signals are slow, the valve moves through statics
SHAPE_LIMIT = 2.0  # gate e_max < 2 dy: a half period flattened by the dead band, not a load disturbance


def mean_error(area: FloatArray, duration: FloatArray) -> FloatArray:
    """Return dy, the mean of |e| over each half period (12). area [span s], duration [s] -> [span]."""
    return np.divide(area, duration, out=np.zeros_like(area), where=duration > 0)


def output_change(dy: FloatArray, duration: FloatArray, K: float, Ti: float) -> FloatArray:
    """Return du = K/Ti dy dt (11): how far the integral part moved the output [output span]."""
    return abs(K) / Ti * dy * duration


def dead_band(dy: FloatArray, duration: FloatArray, K: float, Ti: float, Kp: float) -> FloatArray:
    """Return the dead-band estimate d = (K dt/Ti - 1/Kp) dy of each half period (15) [output span].

    >>> float(dead_band(np.array([0.01]), np.array([20.0]), K=1.2, Ti=2.2, Kp=1.0)[0])  # (10.909 - 1) * 0.01
    0.09909090909090909
    """
    return output_change(dy, duration, K, Ti) - dy / abs(Kp)


def gates(duration: FloatArray, dy: FloatArray, e_max: FloatArray, complete: NDArray[np.bool_],
          Ti: float) -> NDArray[np.str_]:
    """Return for each half period the code why it is refused, "ok" if it is not."""
    why = np.full(len(duration), "ok", dtype="<U16")
    why[e_max >= SHAPE_LIMIT * dy] = "shape"
    why[duration < SLOW_ENOUGH * Ti] = "too_short"
    why[~complete] = "incomplete"
    return why


@dataclass(frozen=True, eq=False)
class HalfPeriods:
    """Half periods with their estimates, (half_periods,) arrays; seconds and spans.

    begin: seconds since the record's start. why: code of the gate that refused it, else "ok".
    """

    begin: FloatArray
    duration: FloatArray
    dy: FloatArray
    e_max: FloatArray
    d: FloatArray
    direction: NDArray[np.int64]
    setpoint_move: FloatArray
    why: NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.begin)


def estimate(segments: Segments, interval: float, settings: LoopSettings) -> HalfPeriods:
    """Return the estimates (15) of all half periods; the settings must hold K and Ti (Kp defaults to 1.5)."""
    K, Ti, Kp = settings.K, settings.Ti, settings.Kp or DEFAULT_KP
    assert K is not None and Ti is not None
    duration = (segments.end - segments.begin) * interval
    dy = mean_error(segments.area * interval, duration)
    why = gates(duration, dy, segments.e_max, segments.complete, Ti)
    d = dead_band(dy, duration, K, Ti, Kp)
    why[(why == "ok") & (d <= 0)] = "not_positive"
    return HalfPeriods(segments.begin * interval, duration, dy, segments.e_max, d, segments.direction,
                       segments.setpoint_move, why)


@dataclass
class ErrorScanner:
    """Filters the measurement block by block and cuts the error into half periods.

    The filters run on through manual operation and saturation, where the measurement is still true, and start
    afresh at rest after a hole. Half periods end at any sample that must not be used.
    """

    stages: tuple[DoubleLag, ...]
    parts: list[Segments] = field(default_factory=list)
    open: OpenHalfPeriod | None = None
    states: list[FloatArray] = field(default_factory=list)
    last_index: int = -2

    def update(self, block: Record) -> None:
        """Take the next block of the record."""
        known = (block.state != SampleState.MISSING) & (block.state != SampleState.IMPLAUSIBLE)
        known &= np.isfinite(block.measurement) & np.isfinite(block.setpoint)
        if not known.all():
            block_index, pv, sp = block.index[known], block.measurement[known], block.setpoint[known]
            usable = block.usable[known]
        else:
            block_index, pv, sp, usable = block.index, block.measurement, block.setpoint, block.usable
        if not len(pv):
            return
        filtered = self._filter(block_index, pv)
        error = sp - filtered
        if not usable.all():
            block_index, error, sp = block_index[usable], error[usable], sp[usable]
        done, self.open = segment(error, sp, block_index, self.open)
        if len(done):
            self.parts.append(done)

    def finish(self) -> Segments:
        """Return all half periods of the record in time order."""
        return Segments.join([*self.parts, close(self.open)])

    def _filter(self, index: NDArray[np.int64], pv: FloatArray) -> FloatArray:
        cuts = np.flatnonzero(np.diff(index) != 1) + 1
        out = np.empty_like(pv)
        for first, last in zip([0, *cuts], [*cuts, len(pv)], strict=True):
            if first > 0 or index[0] != self.last_index + 1:
                self.states = [stage.settled(float(pv[first])) for stage in self.stages]
            y = pv[first:last]
            for i, stage in enumerate(self.stages):
                y, self.states[i] = stage.run(y, self.states[i])
            out[first:last] = y
        self.last_index = int(index[-1])
        return out


def error_scanner(settings: LoopSettings, interval: float, *, smooth: bool = True) -> ErrorScanner:
    """Return a scanner with the measurement filter (3) and, if `smooth`, the estimator's filter of Ti/2."""
    assert settings.Ti is not None
    stages = [double_lag(settings.filter_time or 0.0, interval)]
    if smooth:
        stages.append(double_lag(settings.Ti / 2.0, interval))
    return ErrorScanner(tuple(stages))
