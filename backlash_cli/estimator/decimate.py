"""Block means of PV and of OP through a grid of dead bands, made while the record comes in."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numba
import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray

# Dead bands that are tried: 0.2 % to 19 % of the output span.
WIDTHS: FloatArray = 0.002 * 1.22 ** np.arange(24, dtype=np.float64)
HOLE = 8  # blocks without a sample after which the stem may stand anywhere in its gap (two Ti)
ENOUGH = 0.7  # share of its samples that a block needs
STRETCH = 250  # blocks that are kept or dropped together
CHUNK = 2000  # blocks made at a time: what they need stays in the processor's cache
BRIDGE = 2  # blocks missing in a row that are bridged by a straight line
LANES = 32  # OP and the widths side by side, filled up: the processor works on eight of them at a time
FILLED = 1  # highest SampleState that may be used


@numba.njit(cache=True, nogil=True)
def _blocks(index: NDArray[np.int64], setpoint: FloatArray, pv: FloatArray, op: FloatArray, state: NDArray[np.uint8],
            size: int, W: FloatArray, at: NDArray[np.int64], seen: FloatArray, out_at: NDArray[np.int64],
            out: FloatArray) -> int:
    """One pass over the samples. W: places, half widths and sums of each lane, sum of PV. at: open block, its samples,
    its end, last sample, whether the stem may stand anywhere. seen: lowest and highest usable OP, first setpoint,
    whether the setpoint moved."""
    rows = 0
    for k in range(len(index)):
        u = op[k]
        here = index[k]
        if here > at[3] + HOLE * size:
            at[4] = 1
        at[3] = here
        moves = np.isfinite(u)
        if moves:
            if at[4]:
                at[4] = 0
                for j in range(LANES):
                    W[j] = u
            for j in range(LANES):
                x = W[j]
                low = u - W[LANES + j]
                high = u + W[LANES + j]
                x = low if low > x else x
                W[j] = high if high < x else x
        if state[k] > FILLED:
            continue
        r = setpoint[k]
        if r != seen[2] and np.isfinite(r):
            seen[3] = 0.0 if np.isnan(seen[2]) else 1.0
            seen[2] = r
        if not moves or not np.isfinite(pv[k]):
            continue
        seen[0] = min(seen[0], u)
        seen[1] = max(seen[1], u)
        if here >= at[2]:
            if at[1] >= ENOUGH * size:
                out_at[rows] = at[0]
                out[rows, 0] = W[3 * LANES] / at[1]
                for j in range(out.shape[1] - 1):
                    out[rows, 1 + j] = W[2 * LANES + j] / at[1]
                rows += 1
            at[0] = here // size
            at[1] = 0
            at[2] = (at[0] + 1) * size
            for j in range(LANES + 1):
                W[2 * LANES + j] = 0.0
        for j in range(LANES):
            W[2 * LANES + j] += W[j]
        W[3 * LANES] += pv[k]
        at[1] += 1
    return rows


class BlockMeans:
    """Means over `size` samples of the grid, of PV, of OP, and of OP through each width.

    A block without ENOUGH of its samples is left out; up to BRIDGE missing ones are bridged by a straight line.

    Blocks are locked to the grid number of the samples, so it does not matter where a record is cut. The dead bands
    follow every recorded OP, also where the sample is not usable (manual): the valve moves then as well. At the first
    sample, and after a hole, the stem is taken to stand in the middle of its gap.

    Of a long record whole stretches of STRETCH blocks are kept, those in which OP travels most: at most `most` rows.
    """

    def __init__(self, size: int, most: int) -> None:
        self.size, self.most = size, most
        self._lanes = np.zeros(3 * LANES + 1)
        self._lanes[LANES + 1 : LANES + 1 + len(WIDTHS)] = 0.5 * WIDTHS
        self._at = np.array([0, 0, -(2**62), 2**61, 1], dtype=np.int64)
        self._seen = np.array([np.inf, -np.inf, np.nan, 0.0])
        self._before: tuple[int, FloatArray] | None = None  # the last complete row
        self._kept: dict[int, _Stretch] = {}

    @property
    def range(self) -> float:
        """How much of its span OP covered; below 0 when no sample was usable."""
        return float(self._seen[1] - self._seen[0])

    @property
    def setpoint_moves(self) -> bool:
        """Whether the setpoint was not the same number throughout."""
        return bool(self._seen[3])

    def update(self, index: IntArray, setpoint: FloatArray, pv: FloatArray, op: FloatArray,
               state: NDArray[np.uint8]) -> None:
        """Take in samples: index (samples,) strictly increasing over all calls; state: SampleState of each."""
        room = np.empty(CHUNK + 2, dtype=np.int64), np.empty((CHUNK + 2, 2 + len(WIDTHS)))
        for low in range(0, len(index), CHUNK * self.size):
            part = slice(low, low + CHUNK * self.size)
            rows = _blocks(index[part], setpoint[part], pv[part], op[part], state[part], self.size, self._lanes,
                           self._at, self._seen, *room)
            if rows:
                at, means, travel = self._bridged(room[0][:rows], room[1][:rows])
                self._before = int(at[-1]), means[-1].copy()
                _keep(self._kept, at, means, travel)
                _drop(self._kept, self.most, int(at[-1]) // STRETCH)

    def rows(self) -> tuple[IntArray, FloatArray]:
        """Block numbers (rows,) and means (rows, 2 + widths): PV, OP, OP through each of WIDTHS."""
        kept = {number: _Stretch(s.travel, s.rows, list(s.parts)) for number, s in self._kept.items()}
        if self._at[1] >= ENOUGH * self.size:
            sums = self._lanes[2 * LANES :]
            last = np.concatenate([sums[LANES:], sums[: 1 + len(WIDTHS)]]) / self._at[1]
            _keep(kept, *self._bridged(self._at[:1].copy(), last[None, :]))
        while sum(s.rows for s in kept.values()) > self.most:
            del kept[_calmest(kept)]
        parts = [part for number in sorted(kept) for part in kept[number].parts]
        if not parts:
            return np.empty(0, dtype=np.int64), np.empty((0, 2 + len(WIDTHS)))
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])

    def _bridged(self, at: IntArray, means: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Fill short holes up to each row; also how far OP travelled from row to row."""
        before, row = self._before or (int(at[0]) - 1, means[0])
        steps = np.diff(at, prepend=before)
        holes = np.flatnonzero((steps > 1) & (steps <= 1 + BRIDGE))
        if len(holes):
            known, values = np.concatenate([[before], at]), np.vstack([row, means])
            at = np.sort(np.concatenate([at, *(np.arange(known[i] + 1, known[i + 1]) for i in holes)]))
            means = np.column_stack([np.interp(at, known, column) for column in values.T])
        return at, means, np.abs(np.diff(means[:, 1], prepend=row[1]))


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
        s.travel += float(travel[low:high].sum())
        s.rows += high - low
        s.parts.append((at[low:high].copy(), means[low:high].copy()))


def _calmest(kept: dict[int, _Stretch]) -> int:
    return min(kept, key=lambda number: (kept[number].travel, -number))


def _drop(kept: dict[int, _Stretch], most: int, current: int) -> None:
    """Drop what cannot be among the `most` rows any more; the current stretch may still grow."""
    done = {number: s for number, s in kept.items() if number != current}
    rows = sum(s.rows for s in done.values())
    while done:
        number = _calmest(done)
        rows -= done.pop(number).rows
        if rows < most:
            break
        del kept[number]
