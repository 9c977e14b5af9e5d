"""Block means of PV and of OP through a grid of dead bands, made while the record comes in."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray

# Dead bands that are tried: 0.2 % to 19 % of the output span.
WIDTHS: FloatArray = 0.002 * 1.22 ** np.arange(24, dtype=np.float64)
HOLE = 8  # blocks without a sample after which the stem may stand anywhere in its gap (two Ti)
ENOUGH = 0.7  # share of its samples that a block needs


@numba.njit(cache=True)
def _blocks(index: NDArray[np.int64], pv: FloatArray, op: FloatArray, usable: NDArray[np.bool_], size: int,
            half: FloatArray, place: FloatArray, open_at: NDArray[np.int64], sums: FloatArray,
            out_at: NDArray[np.int64], out: FloatArray) -> int:
    n, m = len(index), len(half)
    rows = 0
    for k in range(n):
        u = op[k]
        if index[k] > open_at[2] + HOLE * size:
            for j in range(m):
                place[j] = np.nan
        open_at[2] = index[k]
        if u == u:
            for j in range(m):
                x = place[j]
                if x != x:
                    x = u
                elif u - half[j] > x:
                    x = u - half[j]
                elif u + half[j] < x:
                    x = u + half[j]
                place[j] = x
        if not usable[k]:
            continue
        block = index[k] // size
        if block != open_at[0]:
            if open_at[1] >= ENOUGH * size:
                out_at[rows] = open_at[0]
                for j in range(m + 1):
                    out[rows, j] = sums[j] / open_at[1]
                rows += 1
            open_at[0] = block
            open_at[1] = 0
            sums[:] = 0.0
        sums[0] += pv[k]
        for j in range(m):
            sums[j + 1] += place[j]
        open_at[1] += 1
    return rows


class BlockMeans:
    """Means over `size` samples of the grid, of PV and of OP through each width.

    A block without ENOUGH of its samples is left out.

    Blocks are locked to the grid number of the samples, so it does not matter where a record is cut. The dead bands
    follow every recorded OP, also where the sample is not usable (manual): the valve moves then as well. At the first
    sample, and after a hole, the stem is taken to stand in the middle of its gap.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._half = np.concatenate([[0.0], 0.5 * WIDTHS])
        self._place = np.full(len(self._half), np.nan)
        self._open = np.array([-(2**62), 0, 2**62], dtype=np.int64)
        self._sums = np.zeros(len(self._half) + 1)
        self._parts: list[tuple[IntArray, FloatArray]] = []

    def update(self, index: IntArray, pv: FloatArray, op: FloatArray, usable: NDArray[np.bool_]) -> None:
        """Take in samples: index (samples,) strictly increasing over all calls."""
        room = len(index) // self.size + 2
        at = np.empty(room, dtype=np.int64)
        out = np.empty((room, len(self._half) + 1))
        rows = _blocks(index, pv, op, usable, self.size, self._half, self._place, self._open, self._sums, at, out)
        self._parts.append((at[:rows].copy(), out[:rows].copy()))

    def rows(self) -> tuple[IntArray, FloatArray]:
        """Block numbers (rows,) and means (rows, 2 + widths): PV, OP, OP through each of WIDTHS."""
        at, means = list(self._open[:1]), [self._sums / max(self._open[1], 1)]
        if self._open[1] < ENOUGH * self.size:
            at, means = [], []
        index = [*(a for a, _ in self._parts), np.array(at, dtype=np.int64)]
        values = [*(v for _, v in self._parts), np.array(means).reshape(-1, len(self._sums))]
        return np.concatenate(index), np.concatenate(values)
