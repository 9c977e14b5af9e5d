"""Compiled core of the dead-band test: what is left of PV when OP, a moving load and noise have been accounted for.

Model, one row per block of samples (k):

    y_k  = sum_i b_i f_{k - l_i} + z2_k + n_k          f: valve position x behind two equal lags, l_i: LAGS
    z1  += a (w - z1),  z2 += a (z1 - z2)              the load w reaches PV through the same two lags
    w   += s,  s = phi s + e                           the load wanders, e has `ratio` times the variance of n
    n                                                  white measurement noise

plus load steps of known variance at known rows (`shock`). A Kalman filter whitens every column; what remains is a
regression with a bounded step response (`likelihood`). Variances are in units of that of n.
Harvey, Forecasting, Structural Time Series Models and the Kalman Filter (1989), sections 3.2 and 3.4.

All columns of two valve positions go through the filter side by side, one row after the other: the processor then
works on sixteen of them at a time, in single precision, and a column costs a tenth of what it costs alone. Gains and
variances are made in double precision (`kalman`). The rounding of the columns is below a thousandth of the least noise
that a record has here (`confirm.with_least_noise`).
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from .lane_loops import columns_of, whiten_rows
from .lanes import fma
from .vector_code import LANES

LAGS = (1, 2, 4, 6, 8, 11)
BACK = tuple(np.uint64(lag) for lag in LAGS)
WARM_UP = 12  # rows at the start of a stretch that only settle the filter
# Lanes: y, two shapes of a periodic load at most, a spare one, and each lag of both valve positions.
FIRST_LAG = 4  # lane of the first lag of the first valve position; its partner's is the next
CHUNK = 128  # rows that go through the filter at a time: they stay in the processor's nearest cache


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _behind(both: NDArray[Any], low: int, first: NDArray[Any], begin: int, lanes: NDArray[Any]) -> int:
    """Write to each row of `lanes` what both valve positions were so many rows before as LAGS say, or at its `begin`.

    both (all rows,): two numbers in one; first: of the rows from `low` on. Returns where the last stretch begins.
    """
    for i in range(len(first)):
        k = low + i
        if first[i]:
            begin = k
        lane = np.uint64(i * (LANES // 2) + FIRST_LAG // 2)
        if k - begin >= LAGS[-1]:
            at = np.uint64(k)  # numbers without sign, so that none is taken to count from the end
            for m in range(len(BACK)):
                lanes[lane + np.uint64(m)] = both[at - BACK[m]]
        else:
            for m in range(len(BACK)):
                lanes[lane + np.uint64(m)] = both[max(k - LAGS[m], begin)]
    return begin


@numba.njit(cache=True, nogil=True, error_model="numpy")
def innovations(y: NDArray[Any], line: NDArray[Any], xa: NDArray[Any], xb: NDArray[Any], a: float, phi: float,
                first: NDArray[Any], W: NDArray[Any], f: NDArray[Any], T: NDArray[Any], E: NDArray[Any]) -> None:
    """Write the innovations of y, of `line` (columns, rows) and of every lag of both valve positions behind two lags,
    each divided by its deviation, to E (LANES, rows).

    W (WEIGHTS, rows): see `kalman.gains`. Room: f (rows, 2), T (CHUNK, LANES), Z below for the states of all columns.
    """
    b = 1.0 - a
    state = np.zeros(4)  # positions behind the first lag, then behind the second
    Z = np.zeros(4 * LANES, dtype=np.float32)  # predicted z1, z2, load (w and what s adds to it) and s of each column
    both, lanes = f.reshape(-1).view(np.int64), T.reshape(-1).view(np.int64)  # two valve positions in one
    begin: Any = np.int64(0)
    for low in range(0, len(y), CHUNK):
        rows = min(CHUNK, len(y) - low)
        ua, ub, va, vb = state[0], state[1], state[2], state[3]
        for i in range(rows):
            k = low + i
            if first[k]:
                ua = va = xa[k]
                ub = vb = xb[k]
            ua = fma(b, ua, a * xa[k])
            va = fma(b, va, a * ua)
            ub = fma(b, ub, a * xb[k])
            vb = fma(b, vb, a * ub)
            f[k, 0], f[k, 1] = va, vb
        state[0], state[1], state[2], state[3] = ua, ub, va, vb
        for h in range(len(line)):
            for i in range(rows):
                T[i, 1 + h] = line[h, low + i]
        for i in range(rows):
            T[i, 0] = y[low + i]
        begin = _behind(both, low, first[low : low + rows], begin, lanes)
        whiten(T[:rows], W, low, np.float32(a), np.float32(phi), first[low : low + rows], Z)
        columns_of(T, rows, E, low)
        for i in range(rows - rows % LANES, rows):
            for c in range(LANES):
                E[c, low + i] = T[i, c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def whiten(T: NDArray[Any], W: NDArray[Any], low: int, a: Any, phi: Any, first: NDArray[Any],
           Z: NDArray[Any]) -> None:
    """Replace the columns T (rows, LANES) by their innovations over their deviation; Z is carried to the next rows.

    Their weights W (WEIGHTS, all rows) begin at row `low`. All numbers in single precision; see
    `lane_loops.whiten_rows`.
    """
    n = len(T)
    k = 0
    while k < n:
        if first[k]:
            for c in range(4 * LANES):
                Z[c] = np.float32(0.0)
        end = k + 1
        while end < n and not first[end]:
            end += 1
        whiten_rows(T, W, low, k, end, a, phi, Z)
        k = end
