"""The estimator as published: one dead-band estimate per half period, and the two gates of the paper.

T. Haegglund, Automatic on-line estimation of backlash in control loops, J. Process Control 17 (2007) 489-499.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..filters import DoubleLag, double_lag
from ..record import FloatArray, IntArray, LoopSettings, Record, SampleState
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
class ErrorTrack:
    """Half periods of one error signal: those that have ended, and the open one."""

    parts: list[Segments] = field(default_factory=list)
    open: OpenHalfPeriod | None = None

    def update(self, error: FloatArray, setpoint: FloatArray, index: IntArray) -> None:
        done, self.open = segment(error, setpoint, index, self.open)
        if len(done):
            self.parts.append(done)

    def finish(self) -> Segments:
        return Segments.join([*self.parts, close(self.open)])


@dataclass
class ErrorScanner:
    """Filters the measurement block by block and cuts two errors into half periods.

    `plain` is the error after the measurement filter (3), for the oscillation detector; `smooth` after the second
    filter of Ti/2 as well, for the estimator. The filters run on through manual operation and saturation, where the
    measurement is still true, and start afresh at rest after a hole. Half periods end at any sample that must not
    be used.
    """

    stages: tuple[DoubleLag, DoubleLag]
    plain: ErrorTrack = field(default_factory=ErrorTrack)
    smooth: ErrorTrack = field(default_factory=ErrorTrack)
    states: list[FloatArray] = field(default_factory=list)
    last_index: int = -2

    def update(self, block: Record) -> None:
        """Take the next block of the record."""
        index, pv, sp, usable = block.index, block.measurement, block.setpoint, block.usable
        whole = bool(usable.all())
        if not whole:
            known = (block.state != SampleState.MISSING) & (block.state != SampleState.IMPLAUSIBLE)
            index, pv, sp, usable = index[known], pv[known], sp[known], usable[known]
        if not len(pv):
            return
        for track, filtered in zip((self.plain, self.smooth), self._filter(index, pv), strict=True):
            error = sp - filtered
            if whole:
                track.update(error, sp, index)
            else:
                track.update(error[usable], sp[usable], index[usable])

    def _filter(self, index: IntArray, pv: FloatArray) -> tuple[FloatArray, FloatArray]:
        whole = index[-1] - index[0] == len(index) - 1
        jumps = [] if whole else (np.flatnonzero(np.diff(index) != 1) + 1).tolist()
        outputs: tuple[list[FloatArray], list[FloatArray]] = ([], [])
        for first, last in zip([0, *jumps], [*jumps, len(pv)], strict=True):
            if first > 0 or index[0] != self.last_index + 1:
                self.states = [stage.settled(float(pv[first])) for stage in self.stages]
            y = pv[first:last]
            for i, stage in enumerate(self.stages):
                y, self.states[i] = stage.run(y, self.states[i])
                outputs[i].append(y)
        self.last_index = int(index[-1])
        plain, smooth = (o[0] if len(o) == 1 else np.concatenate(o) for o in outputs)
        return plain, smooth


def error_scanner(settings: LoopSettings, interval: float) -> ErrorScanner:
    """Return a scanner with the measurement filter (3) and the estimator's filter of Ti/2."""
    assert settings.Ti is not None
    return ErrorScanner((double_lag(settings.filter_time or 0.0, interval), double_lag(settings.Ti / 2.0, interval)))
