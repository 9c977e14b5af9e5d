"""Block means of PV and of OP through a grid of dead bands, made while the record comes in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray
from .block_kernel import (
    COLUMNS,
    COMPLETE,
    END,
    FREE,
    HIGH,
    LANES,
    LOW,
    MOVED,
    NOWHERE,
    NUMBER,
    ROWS,
    SHELF,
    START,
    STEM,
    STRETCH,
    TAKEN,
    TRAVEL,
    WIDTHS,
    blocks,
)
from .kept import WHOLE, Kept, Stretch

__all__ = ["STEM", "STRETCH", "WHOLE", "WIDTHS", "BlockMeans"]

AT_ONCE = 4  # stretches made at a time
SHELVES = 40  # at first; more only for records with many holes. They take memory where something lies on them
LINE = 64  # bytes that the processor loads at a time


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
        self.size = size
        self._lanes = _aligned(3 * LANES + 2)
        self._lanes[LANES : 2 * LANES] = 0.5 * WIDTHS
        self._at = np.array([0, 0, NOWHERE, 2**61, 1, NOWHERE, NOWHERE, 0, 0, SHELVES, 0], dtype=np.int64)
        self._seen = np.array([np.inf, -np.inf, np.nan, 0.0, np.nan, 0.0, -1.0, *[np.nan] * (3 + STEM)])
        self._complete, self._travel = np.empty((AT_ONCE, 3), dtype=np.int64), np.empty(AT_ONCE)
        self._kept = Kept(most)
        # shelves with the rows of one stretch each, and the numbers of those on which nothing lies
        self._numbers = np.empty((SHELVES, STRETCH), dtype=np.int64)
        self._means = np.empty((SHELVES, STRETCH, COLUMNS))
        self._free = np.arange(SHELVES)[::-1].copy()

    @property
    def range(self) -> float:
        """How much of its span OP covered; below 0 when no sample was usable."""
        return float(self._seen[HIGH] - self._seen[LOW])

    @property
    def count(self) -> int:
        """Number of rows that the record made, kept or not."""
        return self._kept.count + int(self._at[ROWS])

    @property
    def setpoint_moves(self) -> bool:
        """Whether the setpoint was not the same number throughout."""
        return bool(self._seen[MOVED])

    def update(self, index: IntArray, setpoint: FloatArray, pv: FloatArray, op: FloatArray,
               state: NDArray[np.uint8]) -> None:
        """Take in samples: index (samples,) strictly increasing over all calls; state: SampleState of each."""
        pv, op = np.ascontiguousarray(pv), np.ascontiguousarray(op)
        k = 0
        while k < len(index):
            k = blocks(k, index, setpoint, pv, op, state, self.size, self._lanes, self._at, self._seen, self._free,
                       self._complete, self._travel, self._numbers, self._means)
            if self._at[COMPLETE]:
                self._keep()

    def _keep(self) -> None:
        """Keep the complete stretches that may be needed, and make sure that some shelves are free."""
        complete = self._complete[: self._at[COMPLETE]].tolist()
        free = int(self._at[FREE])
        for (number, shelf, rows), travel in zip(complete, self._travel.tolist(), strict=False):
            s = Stretch(number, travel, rows, shelf)
            if not s.whole:
                s.own = self._rows_of(s)
                self._free[free] = shelf
                free += 1
            for gone in self._kept.add(s):
                if gone.own is None:
                    self._free[free] = gone.shelf
                    free += 1
        if free <= AT_ONCE:
            n = len(self._free)
            self._numbers = np.concatenate([self._numbers, np.empty_like(self._numbers)])
            self._means = np.concatenate([self._means, np.empty_like(self._means)])
            self._free = np.concatenate([self._free[:free], np.arange(2 * n)[n:][::-1], np.empty(n - free, np.int64)])
            free += n
        self._at[FREE], self._at[COMPLETE] = free, 0

    def _rows_of(self, s: Stretch) -> tuple[IntArray, FloatArray]:
        if s.own is not None:
            return s.own
        return self._numbers[s.shelf, : s.rows].copy(), self._means[s.shelf, : s.rows].copy()

    def rows(self) -> tuple[IntArray, FloatArray]:
        """Block numbers (rows,) and means (rows, COLUMNS): PV, OP, OP through each of WIDTHS; what is known of the
        stem."""
        at, seen = self._at.copy(), self._seen.copy()
        if at[TAKEN]:  # the first sample of the next block closes the open one
            one = np.full(1, seen[START])
            blocks(0, at[END : END + 1].copy(), one, one, one, np.zeros(1, dtype=np.uint8), self.size,
                   self._lanes.copy(), at, seen, self._free, self._complete, self._travel, self._numbers, self._means)
        also = [Stretch(number, float(self._travel[0]), rows, shelf)
                for number, shelf, rows in self._complete[: at[COMPLETE]].tolist()]
        if at[ROWS]:
            also.append(Stretch(int(at[NUMBER]), float(seen[TRAVEL]), int(at[ROWS]), int(at[SHELF])))
        parts = [self._rows_of(s) for s in self._kept.chosen(*also)]
        if not parts:
            return np.empty(0, dtype=np.int64), np.empty((0, COLUMNS))
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def _aligned(n: int) -> FloatArray:
    """Return n zeros that begin where the processor loads: it takes twice as long across two such lines."""
    room = np.zeros(n + LINE // 8)
    begin = -room.ctypes.data % LINE // 8
    return room[begin : begin + n]
