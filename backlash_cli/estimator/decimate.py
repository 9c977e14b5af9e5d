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
    IN_STRETCH,
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

ROOM = 1000  # rows made at a time: what they need stays in the processor's cache


class BlockMeans:
    """Means over `size` samples of the grid, of PV, of OP, and of OP through each width.

    A block without ENOUGH of its samples is left out; up to BRIDGE missing ones are bridged by a straight line.

    Blocks are locked to the grid number of the samples, so it does not matter where a record is cut. The dead bands
    follow every recorded OP, also where the sample is not usable (manual): the valve moves then as well. At the first
    sample, and after a hole, the stem is taken to stand in the middle of its gap. Each row ends with what is known of
    that: the number of the run (since the first sample or a hole), its first, and its lowest and highest OP so far.

    Of a long record whole stretches of STRETCH blocks are kept, those in which OP travels most: at most `most` rows.
    """

    def __init__(self, size: int, most: int) -> None:
        self.size, self.most = size, most
        self._lanes = np.zeros(3 * LANES + 1)
        self._lanes[LANES + 1 : LANES + 1 + len(WIDTHS)] = 0.5 * WIDTHS
        self._at = np.array([0, 0, NOWHERE, 2**61, 1, NOWHERE, NOWHERE], dtype=np.int64)
        self._seen = np.array([np.inf, -np.inf, np.nan, 0.0, np.nan, 0.0, -1.0, *[np.nan] * (3 + STEM)])
        self._before = np.empty(COLUMNS)  # the last complete row
        self._least = 0.0  # stretches in which OP travels less cannot be among those kept
        self._kept: dict[int, _Stretch] = {}

    @property
    def range(self) -> float:
        """How much of its span OP covered; below 0 when no sample was usable."""
        return float(self._seen[HIGH] - self._seen[LOW])

    @property
    def setpoint_moves(self) -> bool:
        """Whether the setpoint was not the same number throughout."""
        return bool(self._seen[MOVED])

    def update(self, index: IntArray, setpoint: FloatArray, pv: FloatArray, op: FloatArray,
               state: NDArray[np.uint8]) -> None:
        """Take in samples: index (samples,) strictly increasing over all calls; state: SampleState of each."""
        at, means, travel = _room(ROOM)
        while len(index):
            taken, rows = blocks(index, setpoint, pv, op, state, self.size, self._least, self._lanes, self._at,
                                 self._seen, self._before, at, means, travel)
            index, setpoint, pv = index[taken:], setpoint[taken:], pv[taken:]
            op, state = op[taken:], state[taken:]
            if rows:
                _keep(self._kept, at[:rows], means[:rows], travel[:rows])
                self._least = _drop(self._kept, self.most, int(self._at[IN_STRETCH]))

    def rows(self) -> tuple[IntArray, FloatArray]:
        """Block numbers (rows,) and means (rows, COLUMNS): PV, OP, OP through each of WIDTHS; what is known of the
        stem."""
        kept = {number: _Stretch(s.travel, s.rows, list(s.parts)) for number, s in self._kept.items()}
        if self._at[TAKEN] >= ENOUGH * self.size:
            at, means, travel = _room(1 + BRIDGE)
            n, _ = close(self._lanes, self._at.copy(), self._seen.copy(), 0.0, self._before.copy(), 0, 0, at, means,
                         travel)
            _keep(kept, at[:n], means[:n], travel[:n])
        while sum(s.rows for s in kept.values()) > self.most:
            del kept[_calmest(kept)]
        parts = [part for number in sorted(kept) for part in kept[number].parts]
        if not parts:
            return np.empty(0, dtype=np.int64), np.empty((0, COLUMNS))
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def _room(rows: int) -> tuple[IntArray, FloatArray, FloatArray]:
    return np.empty(rows, dtype=np.int64), np.empty((rows, COLUMNS)), np.empty(rows)


@dataclass
class _Stretch:
    travel: float = 0.0
    rows: int = 0
    parts: list[tuple[IntArray, FloatArray]] = field(default_factory=list)


def _keep(kept: dict[int, _Stretch], at: IntArray, means: FloatArray, travel: FloatArray) -> None:
    stretch = at // STRETCH
    edges = [0, *(np.flatnonzero(np.diff(stretch)) + 1).tolist(), len(at)]
    for low, high in pairwise(edges):
        s = kept.setdefault(int(stretch[low]), _Stretch())
        s.travel = float(travel[high - 1])
        s.rows += high - low
        s.parts.append((at[low:high].copy(), means[low:high].copy()))


def _calmest(kept: dict[int, _Stretch]) -> int:
    return min(kept, key=lambda number: (kept[number].travel, -number))


def _drop(kept: dict[int, _Stretch], most: int, current: int) -> float:
    """Drop what cannot be among the `most` rows any more; the current stretch may still grow.

    Returns how far OP must travel in a stretch to be kept from now on.
    """
    done = {number: s for number, s in kept.items() if number != current}
    rows = sum(s.rows for s in done.values())
    least = 0.0
    while done:
        number = _calmest(done)
        if rows >= most:
            least = done[number].travel
        rows -= done.pop(number).rows
        if rows < most:
            break
        del kept[number]
    return least
