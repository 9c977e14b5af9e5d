"""Compiled core of the block means: every sample moves the stems of all dead bands, whole blocks become rows."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from ..clean_piece import FILLED, extremes, usable
from ..record import FloatArray, IntArray

# Dead bands that are tried: 0.2 % to 19 % of the output span.
WIDTHS: FloatArray = 0.002 * 1.22 ** np.arange(24, dtype=np.float64)
HOLE = 8  # blocks without a sample after which the stem may stand anywhere in its gap (two Ti)
ENOUGH = 0.7  # share of its samples that a block needs
STRETCH = 250  # blocks that come and go together
BRIDGE = 2  # blocks missing in a row that are bridged by a straight line
PIECE = 256  # samples that are looked over at a time
LANES = len(WIDTHS)  # side by side: the processor works on eight of them at a time
TOTALS, SUM_PV, SUM_OP = 2 * LANES, 3 * LANES, 3 * LANES + 1  # places in the lanes: behind stems and half widths
STEM = 4  # columns at the end of a row: what is known of where the stem stood, see `decimate.BlockMeans`
COLUMNS = 2 + LANES + STEM
# Places in the two vectors that the kernel carries: whole numbers (open block, samples in it, its end, last sample,
# whether the stem may stand anywhere, last row; number of the open stretch, its shelf and rows; how many shelves are
# free, and how many stretches are complete) ...
BLOCK, TAKEN, END, LAST, LOOSE, ROW, NUMBER, SHELF, ROWS, FREE, COMPLETE = range(11)
# ... and values (lowest and highest usable OP, first setpoint, whether it moved, OP of the last row, how far OP has
# travelled in its stretch; number of the run, its first, lowest and highest OP, and these four when the block began).
LOW, HIGH, SETPOINT, MOVED, AT_ROW, TRAVEL, RUN, START, LOWEST, HIGHEST, OPENED = range(11)
NOWHERE = -(2**62)


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _play(u: FloatArray, begin: int, end: int, W: FloatArray) -> None:
    """Let the stems of all lanes follow OP u (samples,) from `begin` to `end` and add up where they stand: in the
    order of the samples, so that it does not matter where a record is cut; several samples at a time, so that little
    is loaded and stored."""
    whole = end - (end - begin) % 4
    for k in range(begin, whole, 4):
        u0, u1, u2, u3 = u[k], u[k + 1], u[k + 2], u[k + 3]
        for j in range(LANES):
            x, half, total = W[j], W[LANES + j], W[TOTALS + j]
            x = min(max(x, u0 - half), u0 + half)
            total += x
            x = min(max(x, u1 - half), u1 + half)
            total += x
            x = min(max(x, u2 - half), u2 + half)
            total += x
            x = min(max(x, u3 - half), u3 + half)
            total += x
            W[j], W[TOTALS + j] = x, total
    for k in range(whole, end):
        u0 = u[k]
        for j in range(LANES):
            x = min(max(W[j], u0 - W[LANES + j]), u0 + W[LANES + j])
            W[j] = x
            W[TOTALS + j] += x


@numba.njit(cache=True, nogil=True, error_model="numpy")
def blocks(k: int, index: IntArray, setpoint: FloatArray, pv: FloatArray, op: FloatArray, state: NDArray[np.uint8],
           size: int, W: FloatArray, at: IntArray, seen: FloatArray, free: IntArray, complete: IntArray,
           travel: FloatArray, out_at: IntArray, out: FloatArray) -> int:
    """Go through the samples from number k on until they end or there is no room for more rows; return where.

    W: stems, half widths and sums of each lane, sum of PV and of OP. at, seen: see the places above. free: numbers of
    the shelves on which no stretch lies. complete (stretches, 3), travel (stretches,): number, shelf and rows of each
    stretch completed, and how far OP travels in it. out_at (shelves, STRETCH), out (shelves, STRETCH, COLUMNS).
    """
    n = len(index)
    piece, clean = k, False
    while k < n and at[FREE] > 0 and at[COMPLETE] < len(travel):
        if k >= piece:
            piece = min(n, k + PIECE)
            _setpoint(setpoint[k:piece], state[k:piece], seen)
            clean = (usable(index[k:piece], state[k:piece]) and extremes(op[k:piece].view(np.int64))[2]
                     and extremes(pv[k:piece].view(np.int64))[2])
        u, here = op[k], index[k]
        if here > at[LAST] + HOLE * size:
            at[LOOSE] = 1
        at[LAST] = here
        moves = clean or np.isfinite(u)
        if moves and at[LOOSE]:
            at[LOOSE] = 0
            seen[RUN] += 1.0
            seen[START] = seen[LOWEST] = seen[HIGHEST] = u
            for j in range(LANES):
                W[j] = u
        if moves:
            seen[LOWEST], seen[HIGHEST] = min(seen[LOWEST], u), max(seen[HIGHEST], u)
        if not (clean or (moves and state[k] <= FILLED and np.isfinite(pv[k]))):
            if moves:
                for j in range(LANES):
                    W[j] = min(max(W[j], u - W[LANES + j]), u + W[LANES + j])
            k += 1
            continue
        if here >= at[END]:
            if at[TAKEN] >= ENOUGH * size:
                _close(W, at, seen, free, complete, travel, out_at, out)
            at[BLOCK] = here // size
            at[TAKEN] = 0
            at[END] = (at[BLOCK] + 1) * size
            for j in range(STEM):
                seen[OPENED + j] = seen[RUN + j]
            W[SUM_PV] = W[SUM_OP] = 0.0
            for j in range(LANES):
                W[TOTALS + j] = 0.0
        # all samples up to the end of the block that follow without a hole are taken at once
        end = last = min(piece, k + at[END] - here)
        if not clean:
            end = k + 1
            while (end < last and index[end] == index[end - 1] + 1 and state[end] <= FILLED and np.isfinite(op[end])
                   and np.isfinite(pv[end])):
                end += 1
        low, high, of_pv, of_op = u, u, W[SUM_PV], W[SUM_OP]
        for i in range(k, end):
            low, high = min(low, op[i]), max(high, op[i])
            of_pv += pv[i]
            of_op += op[i]
        W[SUM_PV], W[SUM_OP] = of_pv, of_op
        seen[LOW], seen[HIGH] = min(seen[LOW], low), max(seen[HIGH], high)
        seen[LOWEST], seen[HIGHEST] = min(seen[LOWEST], low), max(seen[HIGHEST], high)
        _play(op, k, end, W)
        at[TAKEN] += end - k
        at[LAST] = index[end - 1]
        k = end
    return k


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _close(W: FloatArray, at: IntArray, seen: FloatArray, free: IntArray, complete: IntArray, travel: FloatArray,
          out_at: IntArray, out: FloatArray) -> None:
    """Write the row of the open block, and of up to BRIDGE missing ones before it; see `blocks`."""
    missing = at[BLOCK] - at[ROW] - 1
    missing = missing if 0 < missing <= BRIDGE else 0
    share = 1.0 / at[TAKEN]
    shelf_before, row_before = at[SHELF], at[ROWS] - 1
    for m in range(missing, -1, -1):
        number = (at[BLOCK] - m) // STRETCH
        if number != at[NUMBER]:
            if at[ROWS]:
                done = at[COMPLETE]
                complete[done, 0], complete[done, 1], complete[done, 2] = at[NUMBER], at[SHELF], at[ROWS]
                travel[done] = seen[TRAVEL]
                at[COMPLETE] += 1
            at[FREE] -= 1
            at[NUMBER], at[SHELF], at[ROWS], seen[TRAVEL] = number, free[at[FREE]], 0, 0.0
        shelf, row = at[SHELF], at[ROWS]
        out[shelf, row, 0], out[shelf, row, 1] = W[SUM_PV] * share, W[SUM_OP] * share
        for j in range(LANES):
            out[shelf, row, 2 + j] = W[TOTALS + j] * share
        for j in range(STEM):
            out[shelf, row, 2 + LANES + j] = seen[OPENED + j]
        if m:
            for j in range(COLUMNS):
                before = out[shelf_before, row_before, j]
                out[shelf, row, j] = before + (out[shelf, row, j] - before) * (missing + 1 - m) / (missing + 1)
        out_at[shelf, row] = at[BLOCK] - m
        if not np.isnan(seen[AT_ROW]):
            seen[TRAVEL] += abs(out[shelf, row, 1] - seen[AT_ROW])
        seen[AT_ROW] = out[shelf, row, 1]
        at[ROWS] += 1
    at[ROW] = at[BLOCK]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _setpoint(setpoint: FloatArray, state: NDArray[np.uint8], seen: FloatArray) -> None:
    """Note whether the setpoint moved."""
    if seen[MOVED]:
        return
    for k in range(len(setpoint)):
        r = setpoint[k]
        if r != seen[SETPOINT] and state[k] <= FILLED and np.isfinite(r):
            seen[MOVED] = 0.0 if np.isnan(seen[SETPOINT]) else 1.0
            seen[SETPOINT] = r
