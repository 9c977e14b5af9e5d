"""Block means of PV and of OP through a grid of dead bands, made while the record comes in."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray
from .block_kernel import (
    BRIDGE,
    COLUMNS,
    ENOUGH,
    HIGH,
    LANES,
    LOW,
    MOVED,
    NOWHERE,
    STEM,
    STRETCH,
    TAKEN,
    WIDTHS,
    blocks,
    close,
)

WHOLE = 0.8  # share of its rows that a stretch in a row with others needs
ROOM = 1000  # rows made at a time: what they need stays in the processor's cache


class BlockMeans:
    """Means over `size` samples of the grid, of PV, of OP, and of OP through each width.

    A block without ENOUGH of its samples is left out; up to BRIDGE missing ones are bridged by a straight line.

    Blocks are locked to the grid number of the samples, so it does not matter where a record is cut. The dead bands
    follow every recorded OP, also where the sample is not usable (manual): the valve moves then as well. At the first
    sample, and after a hole, the stem is taken to stand in the middle of its gap. Each row ends with what is known of
    that: the number of the run (since the first sample or a hole), its first, and its lowest and highest OP so far.

    Of a long record at most `most` rows are kept, whole stretches of STRETCH blocks: those in a row in which OP
    travels most, or, where holes leave no such row, the ones in which it does wherever they are. A load that swings or
    switches shows in rows without holes only, and passes for the valve's doing where it does not show: with stretches
    picked one by one the sizes in simulated days were off by half as much again.
    """

    def __init__(self, size: int, most: int) -> None:
        self.size, self.most = size, most
        self._lanes = np.zeros(3 * LANES + 1)
        self._lanes[LANES + 1 : LANES + 1 + len(WIDTHS)] = 0.5 * WIDTHS
        self._at = np.array([0, 0, NOWHERE, 2**61, 1, NOWHERE, NOWHERE], dtype=np.int64)
        self._seen = np.array([np.inf, -np.inf, np.nan, 0.0, np.nan, 0.0, -1.0, *[np.nan] * (3 + STEM)])
        self._before = np.empty(COLUMNS)  # the last complete row
        self._kept = Kept(most)

    @property
    def range(self) -> float:
        """How much of its span OP covered; below 0 when no sample was usable."""
        return float(self._seen[HIGH] - self._seen[LOW])

    @property
    def count(self) -> int:
        """Number of rows that the record made, kept or not."""
        return self._kept.count

    @property
    def setpoint_moves(self) -> bool:
        """Whether the setpoint was not the same number throughout."""
        return bool(self._seen[MOVED])

    def update(self, index: IntArray, setpoint: FloatArray, pv: FloatArray, op: FloatArray,
               state: NDArray[np.uint8]) -> None:
        """Take in samples: index (samples,) strictly increasing over all calls; state: SampleState of each."""
        at, means, travel = _room(ROOM)
        while len(index):
            taken, rows = blocks(index, setpoint, pv, op, state, self.size, self._lanes, self._at, self._seen,
                                 self._before, at, means, travel)
            index, setpoint, pv = index[taken:], setpoint[taken:], pv[taken:]
            op, state = op[taken:], state[taken:]
            if rows:
                self._kept.add(at[:rows], means[:rows], travel[:rows])

    def rows(self) -> tuple[IntArray, FloatArray]:
        """Block numbers (rows,) and means (rows, COLUMNS): PV, OP, OP through each of WIDTHS; what is known of the
        stem."""
        kept = self._kept
        if self._at[TAKEN] >= ENOUGH * self.size:
            at, means, travel = _room(1 + BRIDGE)
            n = close(self._lanes, self._at.copy(), self._seen.copy(), self._before.copy(), 0, at, means, travel)
            kept = kept.copy()
            kept.add(at[:n], means[:n], travel[:n])
        parts = kept.rows()
        if not parts:
            return np.empty(0, dtype=np.int64), np.empty((0, COLUMNS))
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def _room(rows: int) -> tuple[IntArray, FloatArray, FloatArray]:
    return np.empty(rows, dtype=np.int64), np.empty((rows, COLUMNS)), np.empty(rows)


@dataclass
class Stretch:
    """Rows of up to STRETCH blocks, and how far OP travels in them."""

    number: int
    travel: float = 0.0
    rows: int = 0
    parts: list[tuple[IntArray, FloatArray]] = field(default_factory=list)

    def follows(self, number: int) -> bool:
        """Whether the stretch of that number goes on where this one ends, which has few holes itself."""
        return number == self.number + 1 and self.rows >= WHOLE * STRETCH


class Kept:
    """Of all stretches those in a row, of at most `most` rows together, in which OP travels most; and the ones in which
    it travels most wherever they are, for records that have no so many rows without a hole."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.count = 0
        self.last: list[Stretch] = []  # in a row; they may become part of a better choice
        self.best: list[Stretch] = []
        self.lively: list[Stretch] = []

    @property
    def stored(self) -> int:
        """Number of rows in memory."""
        return sum(s.rows for s in {s.number: s for s in (*self.last, *self.best, *self.lively)}.values())

    def copy(self) -> Kept:
        """Return one to which rows can be added without a change of this one."""
        other = Kept(self.most)
        other.last = [Stretch(s.number, s.travel, s.rows, list(s.parts)) for s in self.last]
        other.count, other.best, other.lively = self.count, self.best, self.lively
        return other

    def add(self, at: IntArray, means: FloatArray, travel: FloatArray) -> None:
        """Take in rows in the order of time: block numbers (rows,), means (rows, COLUMNS) and how far OP has travelled
        in the stretch up to each row."""
        self.count += len(at)
        number = at // STRETCH
        edges = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(at)]
        for low, high in pairwise(edges):
            if not self.last or self.last[-1].number != number[low]:
                self._close()
                in_a_row = self.last and self.last[-1].follows(int(number[low]))
                self.last = [*(_ending(self.last, self.most) if in_a_row else ()), Stretch(int(number[low]))]
            s = self.last[-1]
            s.travel = float(travel[high - 1])
            s.rows += high - low
            s.parts.append((at[low:high].copy(), means[low:high].copy()))

    def rows(self) -> list[tuple[IntArray, FloatArray]]:
        """Return the parts of the stretches that are to be used, in the order of time."""
        whole = self.copy()
        whole._close()
        if whole.best:
            chosen = whole.best
        else:
            chosen = whole.lively
            while sum(s.rows for s in chosen) > self.most:
                calmest = _calmest(chosen)
                chosen = [s for s in chosen if s is not calmest]
        return [part for s in chosen for part in s.parts]

    def _close(self) -> None:
        """The last stretch is complete."""
        if not self.last:
            return
        end = _ending(self.last, self.most)
        if sum(s.rows for s in end) > self.most - STRETCH and sum(s.travel for s in end) > sum(
                s.travel for s in self.best):
            self.best = end
        self.lively = [*self.lively, self.last[-1]]
        while sum(s.rows for s in self.lively) - (calmest := _calmest(self.lively)).rows >= self.most:
            self.lively = [s for s in self.lively if s is not calmest]


def _calmest(stretches: list[Stretch]) -> Stretch:
    return min(stretches, key=lambda s: (s.travel, -s.number))


def _ending(stretches: list[Stretch], most: int) -> list[Stretch]:
    """The last of them that have no more than `most` rows together."""
    rows = 0
    for k in range(len(stretches), 0, -1):
        rows += stretches[k - 1].rows
        if rows > most:
            return stretches[k:]
    return stretches
