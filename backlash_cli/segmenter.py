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
    joined = open_ is not None and index[0] == open_.last_index + 1
    e = np.concatenate([[open_.last_error if joined and open_ else 0.0], error])
    sp = np.concatenate([[open_.last_setpoint if joined and open_ else setpoint[0]], setpoint])
    at = np.concatenate([[index[0] - 1], index])
    breaks = np.diff(at) != 1
    breaks[0] = not joined
    sign = _signs(error, breaks, open_.sign if joined and open_ else 0)

    magnitude = np.abs(e)
    before = np.concatenate([[open_.sign if joined and open_ else 0], sign[:-1]])
    crossing = ~breaks & (sign != before) & (before != 0)
    # an interval between two samples belongs to one half period, or is split at the crossing
    step = e[:-1] - e[1:]
    share = np.where(crossing, e[:-1] / np.where(crossing, step, 1.0), 0.0)
    move = np.where(breaks, 0.0, np.abs(np.diff(sp)))
    inside = np.where(breaks, 0.0, np.where(crossing, 0.5 * magnitude[1:] * (1.0 - share),
                                            0.5 * (magnitude[:-1] + magnitude[1:])))
    tail = np.where(crossing, 0.5 * magnitude[:-1] * share, 0.0)

    starts = np.flatnonzero(crossing | breaks)
    first = open_ if joined else None
    cuts = starts if len(starts) and starts[0] == 0 else np.concatenate([[0], starts]).astype(np.int64)
    area = np.add.reduceat(inside, cuts)
    peak = np.maximum.reduceat(magnitude[1:], cuts)
    moved = np.add.reduceat(move, cuts)
    begin = np.where(breaks[cuts], at[1:][cuts].astype(float), at[:-1][cuts] + share[cuts])
    crossed = crossing[cuts].copy()
    ends_crossing = np.concatenate([crossing[cuts[1:]], [False]])
    end = np.concatenate([np.where(crossing[cuts[1:]], begin[1:], at[:-1][cuts[1:]].astype(float)), [np.nan]])
    area[:-1] += tail[cuts[1:]]
    # the last sample knows the sign even where the half period opened with exact zeros
    direction = sign[np.concatenate([cuts[1:], [n]]) - 1].astype(np.int64)

    closed: list[Segments] = []
    if first is not None and not (len(starts) and starts[0] == 0):
        area[0] += first.area
        peak[0] = max(peak[0], first.e_max)
        moved[0] += first.move
        begin[0], crossed[0] = first.begin, first.crossed
    elif open_ is not None:
        # it ended exactly at the block's edge: by a crossing between the blocks, or by a gap
        cut_area = open_.area + (tail[0] if crossing[0] else 0.0)
        stop = begin[0] if crossing[0] else float(open_.last_index)
        if open_.sign:
            closed.append(_one(open_, stop, cut_area, bool(crossing[0]) and open_.crossed))
    whole = Segments(begin, end, area, peak, direction, moved, crossed & ends_crossing)
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


def _signs(error: FloatArray, breaks: NDArray[np.bool_], carried: int) -> NDArray[np.int8]:
    """Return the sign of each sample; an exact zero belongs to the half period before it."""
    sign = np.sign(error).astype(np.int8)
    if np.all(sign != 0):
        return sign
    known = (sign != 0) | breaks
    source = np.maximum.accumulate(np.where(known, np.arange(len(sign)), -1))
    return np.where(source < 0, np.int8(carried), sign[np.maximum(source, 0)]).astype(np.int8)
