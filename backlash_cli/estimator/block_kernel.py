"""Compiled core of the block means: every sample moves the stems of all dead bands, whole blocks become rows."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from ..clean_piece import FILLED
from ..record import FloatArray

# Dead bands that are tried: 0.2 % to 19 % of the output span.
WIDTHS: FloatArray = 0.002 * 1.22 ** np.arange(24, dtype=np.float64)
HOLE = 8  # blocks without a sample after which the stem may stand anywhere in its gap (two Ti)
ENOUGH = 0.7  # share of its samples that a block needs
STRETCH = 250  # blocks that come and go together
BRIDGE = 2  # blocks missing in a row that are bridged by a straight line
LANES = 32  # OP and the widths side by side, filled up: the processor works on eight of them at a time
STEM = 4  # columns at the end of a row: what is known of where the stem stood, see `decimate.BlockMeans`
COLUMNS = 2 + len(WIDTHS) + STEM
# Places in the two vectors that the kernel carries: whole numbers (open block, samples in it, its end, last sample,
# whether the stem may stand anywhere, last row and its stretch) ...
BLOCK, TAKEN, END, LAST, LOOSE, ROW, IN_STRETCH = range(7)
# ... and values (lowest and highest usable OP, first setpoint, whether it moved, OP of the last row, how far OP has
# travelled in its stretch; number of the run, its first, lowest and highest OP, and these four when the block began).
LOW, HIGH, SETPOINT, MOVED, AT_ROW, TRAVEL, RUN, START, LOWEST, HIGHEST, OPENED = range(11)
NOWHERE = -(2**62)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _play(u: FloatArray, W: FloatArray) -> None:
    """Let the stems of all lanes follow OP u (samples,) and add up where they stand: in the order of the samples, so
    that it does not matter where a record is cut; several samples at a time, so that little is loaded and stored."""
    n = len(u)
    for k in range(0, n - n % 4, 4):
        u0, u1, u2, u3 = u[k], u[k + 1], u[k + 2], u[k + 3]
        for j in range(LANES):
            x, half, total = W[j], W[LANES + j], W[2 * LANES + j]
            x = min(max(x, u0 - half), u0 + half)
            total += x
            x = min(max(x, u1 - half), u1 + half)
            total += x
            x = min(max(x, u2 - half), u2 + half)
            total += x
            x = min(max(x, u3 - half), u3 + half)
            total += x
            W[j], W[2 * LANES + j] = x, total
    for k in range(n - n % 4, n):
        for j in range(LANES):
            x = min(max(W[j], u[k] - W[LANES + j]), u[k] + W[LANES + j])
            W[j] = x
            W[2 * LANES + j] += x


@numba.njit(cache=True, nogil=True, error_model="numpy")
def blocks(index: NDArray[np.int64], setpoint: FloatArray, pv: FloatArray, op: FloatArray, state: NDArray[np.uint8],
           size: int, W: FloatArray, at: NDArray[np.int64], seen: FloatArray, before: FloatArray,
           out_at: NDArray[np.int64], out: FloatArray, travel: FloatArray) -> tuple[int, int]:
    """Go through the samples until they end or there is no room for more rows; return how many were taken, and rows.

    W: places, half widths and sums of each lane, sum of PV. at, seen: see the places above. before (columns,): the
    last row. travel (rows,): of OP in its stretch, up to each row.
    """
    rows = 0
    latest = -1  # place of the last row in `out`, where it is not in `before`
    n = len(index)
    k = 0
    while k < n and rows + 1 + BRIDGE <= len(out):
        u, here = op[k], index[k]
        if here > at[LAST] + HOLE * size:
            at[LOOSE] = 1
        at[LAST] = here
        moves = np.isfinite(u)
        if moves and at[LOOSE]:
            at[LOOSE] = 0
            seen[RUN] += 1.0
            seen[START] = seen[LOWEST] = seen[HIGHEST] = u
            for j in range(LANES):
                W[j] = u
        if moves:
            seen[LOWEST], seen[HIGHEST] = min(seen[LOWEST], u), max(seen[HIGHEST], u)
        usable = state[k] <= FILLED
        if not (moves and usable and np.isfinite(pv[k])):
            if moves:
                for j in range(LANES):
                    W[j] = min(max(W[j], u - W[LANES + j]), u + W[LANES + j])
            k += 1
            continue
        if here >= at[END]:
            if at[TAKEN] >= ENOUGH * size:
                if latest >= 0 and at[BLOCK] != at[ROW] + 1:
                    for j in range(len(before)):
                        before[j] = out[latest, j]
                rows = close(W, at, seen, before, rows, out_at, out, travel)
                latest = rows - 1
            at[BLOCK] = here // size
            at[TAKEN] = 0
            at[END] = (at[BLOCK] + 1) * size
            for j in range(STEM):
                seen[OPENED + j] = seen[RUN + j]
            for j in range(LANES + 1):
                W[2 * LANES + j] = 0.0
        # all samples up to the end of the block that follow without a hole are taken at once
        end = k + 1
        last = min(n, k + at[END] - here)
        while (end < last and index[end] == index[end - 1] + 1 and state[end] <= FILLED and np.isfinite(op[end])
               and np.isfinite(pv[end])):
            end += 1
        part = op[k:end]
        low = high = u
        for i in range(len(part)):
            low, high = min(low, part[i]), max(high, part[i])
        seen[LOW], seen[HIGH] = min(seen[LOW], low), max(seen[HIGH], high)
        seen[LOWEST], seen[HIGHEST] = min(seen[LOWEST], low), max(seen[HIGHEST], high)
        for i in range(k, end):
            W[3 * LANES] += pv[i]
        _play(part, W)
        at[TAKEN] += end - k
        at[LAST] = index[end - 1]
        k = end
    for j in range(len(before) if latest >= 0 else 0):
        before[j] = out[latest, j]
    _setpoint(setpoint[:k], state[:k], seen)
    return k, rows


@numba.njit(cache=True, nogil=True, error_model="numpy")
def close(W: FloatArray, at: NDArray[np.int64], seen: FloatArray, before: FloatArray, rows: int,
          out_at: NDArray[np.int64], out: FloatArray, travel: FloatArray) -> int:
    """Write the row of the open block, and of up to BRIDGE missing ones before it, and return how many there are."""
    missing = at[BLOCK] - at[ROW] - 1
    missing = missing if 0 < missing <= BRIDGE else 0
    share = 1.0 / at[TAKEN]
    for m in range(missing, -1, -1):
        stretch = (at[BLOCK] - m) // STRETCH
        if stretch != at[IN_STRETCH]:
            at[IN_STRETCH], seen[TRAVEL] = stretch, 0.0
        row = out[rows]
        row[0] = W[3 * LANES] * share
        for j in range(1 + len(WIDTHS)):
            row[1 + j] = W[2 * LANES + j] * share
        for j in range(STEM):
            row[2 + len(WIDTHS) + j] = seen[OPENED + j]
        if m:
            for j in range(len(row)):
                row[j] = before[j] + (row[j] - before[j]) * (missing + 1 - m) / (missing + 1)
        out_at[rows] = at[BLOCK] - m
        if not np.isnan(seen[AT_ROW]):
            seen[TRAVEL] += abs(row[1] - seen[AT_ROW])
        travel[rows], seen[AT_ROW] = seen[TRAVEL], row[1]
        rows += 1
    at[ROW] = at[BLOCK]
    return rows


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _setpoint(setpoint: FloatArray, state: NDArray[np.uint8], seen: FloatArray) -> None:
    """Note whether the setpoint moved."""
    for k in range(len(setpoint)):
        r = setpoint[k]
        if r != seen[SETPOINT] and state[k] <= FILLED and np.isfinite(r):
            seen[MOVED] = 0.0 if np.isnan(seen[SETPOINT]) else 1.0
            seen[SETPOINT] = r
