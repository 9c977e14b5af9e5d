"""Cuts the control error into half periods between zero crossings: duration, area, peak.

A half period is complete when it begins and ends with a zero crossing of e = ysp - yf. One that touches the start of
the record, its end, a gap or a sample that must not be used is incomplete: nothing is estimated on it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from .error_walk import COLUMNS, NEVER, PLACES, STORED, cut
from .record import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Segments:
    """Half periods of one loop, (half_periods,) arrays; positions in samples on the record's grid.

    begin, end: grid position of the two zero crossings, interpolated between samples. area: integral of |e|
    [span * samples], the error taken as straight between samples. e_max: largest |e| [span].
    direction: sign of e. setpoint_move: sum of |change of setpoint| inside [span]. complete: crossing at both ends.
    """

    begin: FloatArray
    end: FloatArray
    area: FloatArray
    e_max: FloatArray
    direction: IntArray
    setpoint_move: FloatArray
    complete: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.begin)

    def select(self, mask: object) -> Segments:
        return Segments(*(getattr(self, f.name)[mask] for f in fields(self)))

    @staticmethod
    def of(table: FloatArray) -> Segments:
        """Half periods from the (half_periods, 7) table that a walk fills, columns in the order of the fields."""
        begin, end, area, e_max, direction, move, complete = np.ascontiguousarray(table.T)
        return Segments(begin, end, area, e_max, direction.astype(np.int64), move, complete > 0.0)

    @staticmethod
    def join(parts: list[Segments]) -> Segments:
        if not parts:
            empty = np.zeros(0)
            return Segments(empty, empty, empty, empty, np.zeros(0, np.int64), empty, np.zeros(0, bool))
        return Segments(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Segments)))


@dataclass(frozen=True)
class OpenHalfPeriod:
    """The half period that the next block goes on with."""

    sign: int
    begin: float
    crossed: bool  # began with a zero crossing
    area: float  # up to the last sample
    e_max: float
    move: float
    last_index: int
    last_error: float
    last_setpoint: float


def segment(
    error: FloatArray, setpoint: FloatArray, index: IntArray, open_: OpenHalfPeriod | None
) -> tuple[Segments, OpenHalfPeriod | None]:
    """Cut a block of usable samples into half periods.

    error, setpoint: (samples,) [span]. index: (samples,) grid positions, strictly increasing; a jump ends a half
    period. open_: what the previous block left open. Returns the half periods that ended inside this block and the
    one left open. The cut into blocks does not matter, rounding aside.
    """
    n = len(error)
    if n == 0:
        return Segments.join([]), open_
    track = np.zeros(PLACES)
    before, last_setpoint = put(open_, track)
    at = np.concatenate([[int(before)], index])
    found = np.empty((n + 1, COLUMNS))
    cut(error, at, np.abs(np.diff(setpoint, prepend=last_setpoint)), n, track, found, 0.0, 0.0)
    return Segments.of(found[: int(track[STORED])]), opened(track, float(index[-1]), float(setpoint[-1]))


def put(open_: OpenHalfPeriod | None, track: FloatArray) -> tuple[float, float]:
    """Write an open half period into the places of a walk (see error_walk); return its last position and setpoint."""
    if open_ is None:
        track[:STORED] = 0.0
        return NEVER, 0.0
    o = open_
    track[:STORED] = o.sign, o.begin, o.crossed, o.area, o.e_max, o.move, o.last_error
    return o.last_index, o.last_setpoint


def opened(track: FloatArray, last_index: float, last_setpoint: float) -> OpenHalfPeriod | None:
    """Return what `put` wrote, or what a walk has left open."""
    if last_index == NEVER:
        return None
    sign, begin, crossed, area, e_max, move, last_error = track[:STORED].tolist()
    return OpenHalfPeriod(int(sign), begin, crossed > 0.0, area, e_max, move, int(last_index), last_error,
                          float(last_setpoint))


def close(open_: OpenHalfPeriod | None) -> Segments:
    """Return the half period left open at the end of the record, as incomplete."""
    if open_ is None or open_.sign == 0:
        return Segments.join([])
    return _one(open_, float(open_.last_index), open_.area, False)


def _one(o: OpenHalfPeriod, end: float, area: float, complete: bool) -> Segments:
    return Segments(np.array([o.begin]), np.array([end]), np.array([area]), np.array([o.e_max]),
                    np.array([o.sign], np.int64), np.array([o.move]), np.array([complete]))
