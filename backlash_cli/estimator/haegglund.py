"""The estimator as published: one dead-band estimate per half period, and the two gates of the paper.

T. Haegglund, Automatic on-line estimation of backlash in control loops, J. Process Control 17 (2007) 489-499.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..error_walk import (
    COLUMNS,
    KNOWN,
    LEFT_OUT,
    NEVER,
    PLACES,
    PLAIN,
    ROOM,
    SETPOINT,
    SMOOTH,
    STORED,
    USED,
    desk,
    start,
    walk,
)
from ..filters import DoubleLag, double_lag
from ..record import FloatArray, LoopSettings, Record
from ..segmenter import OpenHalfPeriod, Segments, opened, put
from .oscillation import least_area
from .rule import SLOW_ENOUGH, WHY, judged

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
    (begin, duration, dy, d), refused = judged(s.begin, s.end, s.area, s.e_max, s.complete, float(interval), float(K),
                                               float(Ti), float(Kp))
    return HalfPeriods(begin, duration, dy, s.e_max, d, s.direction, s.setpoint_move, refused)


def no_half_periods() -> HalfPeriods:
    """Of a record that the rule cannot be asked of."""
    none, flags = np.zeros(0), np.zeros(0, dtype=np.uint8)
    return HalfPeriods(none, none, none, none, none, np.zeros(0, dtype=np.int64), none, flags)


class ErrorTrack:
    """Half periods of one error signal: those that have ended, and the open one."""

    def __init__(self, carried: FloatArray, place: int) -> None:
        self._carried, self._own = carried, carried[place : place + PLACES]
        self.table = np.empty((2 * ROOM, COLUMNS))

    def make_room(self) -> None:
        """Double the table where the next ROOM samples might fill it."""
        while self._own[STORED] + ROOM > len(self.table):
            self.table = np.concatenate([self.table, np.empty_like(self.table)])

    @property
    def left_out(self) -> int:
        """Number of complete half periods that were counted and not kept."""
        return int(self._own[LEFT_OUT])

    @property
    def ended(self) -> Segments:
        """The half periods that have ended."""
        return Segments.of(self.table[: int(self._own[STORED])])

    @property
    def open(self) -> OpenHalfPeriod | None:
        """The half period that the next sample goes on with; None before the first."""
        return opened(self._own, self._carried[USED], self._carried[SETPOINT])

    @open.setter
    def open(self, left: OpenHalfPeriod | None) -> None:
        self._carried[USED], self._carried[SETPOINT] = put(left, self._own)

    def finish(self) -> Segments:
        """All half periods, the open one as incomplete."""
        self.make_room()
        sign, begin, _, area, peak, move, _, stored, _ = self._own.tolist()
        ended, last = int(stored), self._carried[USED]
        if sign and last != NEVER:
            self.table[ended] = begin, last, area, peak, sign, move, 0.0
            ended += 1
        return Segments.of(self.table[:ended])


class ErrorScanner:
    """Filters the measurement block by block and cuts two errors into half periods.

    `plain` is the error after the measurement filter (3), for the oscillation detector; `smooth` after the second
    filter of Ti/2 as well, for the estimator. The filters run on through manual operation and saturation, where the
    measurement is still true, and start afresh at rest after a hole. Half periods end at any sample that must not
    be used.

    least: area [span samples] of plain and length [samples] of smooth half periods below which complete ones are
    counted and not kept.
    """

    def __init__(self, stages: tuple[DoubleLag, DoubleLag], least: tuple[float, float] = (0.0, 0.0)) -> None:
        self.stages = stages
        self._filters = np.array([stage.coefficients for stage in stages])
        self._least = np.array(least)
        self._carried = start()
        self.plain, self.smooth = (ErrorTrack(self._carried, place) for place in (PLAIN, SMOOTH))

    @property
    def states(self) -> list[FloatArray]:
        """State of each filter; none before the first sample."""
        if self._carried[KNOWN] == NEVER:
            return []
        return [np.zeros(0) if stage.is_identity else self._carried[2 * i : 2 * i + 2].copy()
                for i, stage in enumerate(self.stages)]

    @property
    def last_index(self) -> int:
        """Position of the last sample that went through the filters."""
        return int(self._carried[KNOWN])

    def go_on(self, states: Sequence[FloatArray], last_index: int) -> None:
        """Take over the filters as another scanner left them after the sample at `last_index`."""
        for i, state in enumerate(states):
            self._carried[2 * i : 2 * i + len(state)] = state
        self._carried[KNOWN] = last_index if len(states) else NEVER

    def update(self, block: Record) -> None:
        """Take the next block of the record."""
        index = np.ascontiguousarray(block.index, dtype=np.int64)
        setpoint, pv = (np.ascontiguousarray(x, dtype=np.float64) for x in (block.setpoint, block.measurement))
        state = np.ascontiguousarray(block.state, dtype=np.uint8)
        taken, room = 0, desk()
        while taken < len(index):
            self.plain.make_room()
            self.smooth.make_room()
            taken = walk(index, setpoint, pv, state, taken, self._filters, self._least, self._carried,
                         self.plain.table, self.smooth.table, *room)


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
