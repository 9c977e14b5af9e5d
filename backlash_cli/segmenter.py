"""Cuts the control error into half periods between zero crossings: duration, area, peak, all at once for a block.

A half period is complete when it begins and ends with a zero crossing of e = ysp - yf. One that touches the start of
the record, its end, a gap or a sample that must not be used is incomplete: nothing is estimated on it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

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
    carried = open_ if open_ is not None and index[0] == open_.last_index + 1 else None
    jump = np.diff(index) != 1 if index[-1] - index[0] != n - 1 else None
    sign, changed = _sign_changes(error, jump, carried.sign if carried else 0)
    cuts = np.concatenate([[0], np.flatnonzero(changed) + 1])
    lasts = np.concatenate([cuts[1:], [n]]) - 1

    # what stands before each cut: the sample before it, or what the last block left
    e_before = error[cuts - 1]
    at_before = index[cuts - 1]
    crossing = index[cuts] - at_before == 1
    if carried:
        e_before[0], at_before[0] = carried.last_error, carried.last_index
        crossing[0] = sign[0] != carried.sign != 0
    else:
        crossing[0] = False
    e_first, e_last = np.abs(error[cuts]), np.abs(error[lasts])
    share = np.zeros(len(cuts))
    np.divide(e_before, e_before - error[cuts], out=share, where=crossing)

    # trapezia between samples, and a triangle on each side of a crossing
    magnitude = np.abs(error)
    area = np.add.reduceat(magnitude, cuts) - 0.5 * (e_first + e_last)
    area += np.where(crossing, 0.5 * e_first * (1.0 - share), 0.0)
    tail = np.where(crossing, 0.5 * np.abs(e_before) * share, 0.0)
    area[:-1] += tail[1:]
    peak = np.maximum.reduceat(magnitude, cuts)
    moved = _setpoint_moves(setpoint, cuts, crossing, carried)
    begin = np.where(crossing, at_before + share, index[cuts].astype(float))
    end = np.append(np.where(crossing[1:], begin[1:], index[lasts[:-1]].astype(float)), np.nan)
    complete = crossing & np.append(crossing[1:], False)
    crossed = crossing.copy()
    # the last sample knows the sign even where the half period opened with exact zeros
    direction = sign[lasts].astype(np.int64)

    closed: list[Segments] = []
    if carried and not crossing[0]:
        area[0] += carried.area + 0.5 * (abs(carried.last_error) + e_first[0])
        peak[0] = max(peak[0], carried.e_max)
        begin[0], crossed[0] = carried.begin, carried.crossed
        complete[0] = carried.crossed and len(cuts) > 1 and crossing[1]
    elif open_ is not None and open_.sign:
        # it ended exactly at the block's edge: by a crossing between the blocks, or by a gap
        stop = begin[0] if crossing[0] else float(open_.last_index)
        closed.append(_one(open_, stop, open_.area + tail[0], bool(crossing[0]) and open_.crossed))
    whole = Segments(begin, end, area, peak, direction, moved, complete)
    left = OpenHalfPeriod(int(sign[-1]), float(begin[-1]), bool(crossed[-1]), float(area[-1]), float(peak[-1]),
                          float(moved[-1]), int(index[-1]), float(error[-1]), float(setpoint[-1]))
    done = np.arange(len(whole)) < len(whole) - 1
    closed.append(whole.select(done & (whole.direction != 0)))
    return Segments.join(closed), left


def close(open_: OpenHalfPeriod | None) -> Segments:
    """Return the half period left open at the end of the record, as incomplete."""
    if open_ is None or open_.sign == 0:
        return Segments.join([])
    return _one(open_, float(open_.last_index), open_.area, False)


def _one(o: OpenHalfPeriod, end: float, area: float, complete: bool) -> Segments:
    return Segments(np.array([o.begin]), np.array([end]), np.array([area]), np.array([o.e_max]),
                    np.array([o.sign], np.int64), np.array([o.move]), np.array([complete]))


def _setpoint_moves(setpoint: FloatArray, cuts: IntArray, crossing: NDArray[np.bool_],
                    carried: OpenHalfPeriod | None) -> FloatArray:
    """Return the sum of |change of setpoint| in each piece, the change at its opening crossing included."""
    before = carried.last_setpoint if carried else setpoint[0]
    if before == setpoint[0] and setpoint.min() == setpoint.max():
        moved = np.zeros(len(cuts))
    else:
        move = np.abs(np.diff(setpoint, prepend=before))
        move[cuts[1:][~crossing[1:]]] = 0.0
        moved = np.add.reduceat(move, cuts)
    if carried and not crossing[0]:
        moved[0] += carried.move
    return moved


def _sign_changes(error: FloatArray, jump: NDArray[np.bool_] | None,
                  carried: int) -> tuple[NDArray[np.int8], NDArray[np.bool_]]:
    """Return the sign of each sample and whether the next begins a new piece: by a crossing or a jump.

    An exact zero belongs to the half period before it.
    """
    sign = np.sign(error).astype(np.int8)
    if np.count_nonzero(sign) != len(sign):
        known = sign != 0
        if jump is not None:
            known[1:] |= jump
        source = np.maximum.accumulate(np.where(known, np.arange(len(sign)), -1))
        sign = np.where(source < 0, np.int8(carried), sign[np.maximum(source, 0)]).astype(np.int8)
        changed = (sign[1:] != sign[:-1]) & (sign[:-1] != 0)
    else:
        changed = sign[1:] != sign[:-1]
    return sign, changed if jump is None else changed | jump
