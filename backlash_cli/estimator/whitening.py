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
variances are made in double precision. The rounding of the columns is below a thousandth of the least noise that a
record has here (`confirm.with_least_noise`).
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
DIFFUSE = 1e6  # variance of the unknown state where a stretch begins
WARM_UP = 12  # rows at the start of a stretch that only settle the filter
# Lanes: y, LINES shapes of a periodic load, a spare one, and each lag of both valve positions.
LINES = 2
FIRST_LAG = 4  # lane of the first lag of the first valve position; its partner's is the next
WEIGHTS = 5  # of a row: what its innovation adds to the prediction of the next state (four), 1 / deviation
CHUNK = 128  # rows that go through the filter at a time: they stay in the processor's nearest cache


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _go_on(begin: int, end: int, S: NDArray[Any], W: NDArray[Any], use: NDArray[Any], scale: Any) -> None:
    """Give the rows from begin to end what the row before has; rows that are not in `use` get no weight."""
    for i in range(WEIGHTS - 1):
        w, weights = W[i, begin - 1], W[i, begin:end]
        for k in range(len(weights)):
            weights[k] = w
    s, variances, scales, used = S[begin - 1], S[begin:end], W[WEIGHTS - 1, begin:end], use[begin:end]
    for k in range(len(variances)):
        variances[k] = s
        scales[k] = scale if used[k] else np.float32(0.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _quiet_until(k: int, shock: NDArray[Any], first: NDArray[Any]) -> int:
    """Return the next row from k on with a load step or the start of a stretch; many are looked at together."""
    n = len(shock)
    while k + CHUNK <= n:
        loud = False
        shocks, starts = shock[k : k + CHUNK], first[k : k + CHUNK]
        for i in range(CHUNK):
            loud |= (shocks[i] != 0.0) | starts[i]
        if loud:
            break
        k += CHUNK
    while k < n and shock[k] == 0.0 and not first[k]:
        k += 1
    return k


@numba.njit(cache=True, nogil=True, error_model="numpy")
def gains(a: float, ratio: float, phi: float, shock: NDArray[Any], first: NDArray[Any], use: NDArray[Any],
          G: NDArray[Any], S: NDArray[Any], W: NDArray[Any]) -> Any:
    """Write Kalman gains G (rows, 4; or no rows where they are not wanted) and variances S (rows,) of the innovations.

    `first` (rows,) marks the start of stretches. The covariance (ten numbers, it is symmetric) goes through one
    equation of the model after the other.

    Also writes the weights W (WEIGHTS, rows) that `innovations` needs, the last of them 0 for rows not in `use`, and
    returns the number of rows in use and the sum of ln S over them.
    """
    b = 1.0 - a
    aa, bb, ab, g0, g1 = a * a, b * b, 2.0 * a * b, a, a * a
    p00 = p01 = p02 = p03 = p11 = p12 = p13 = p22 = p23 = p33 = 0.0
    logs, product, rows = 0.0, 1.0, 0
    scale, before = np.float32(0.0), 0.0
    n = len(shock)
    settled = 0
    k: Any = np.int64(0)  # a plain 0 would be compiled for itself
    while k < n:
        if settled >= 3:
            end = _quiet_until(k, shock, first)
            _go_on(k, end, S, W, use, scale)
            if len(G):
                for row in range(k, end):
                    for i in range(4):
                        G[row, i] = G[k - 1, i]
            used: Any = np.count_nonzero(use[k:end])
            rows += used
            logs += used * np.log(S[k - 1])
            settled, k = 0, end
            continue
        if first[k]:
            p00 = p11 = p22 = 1.01 * DIFFUSE
            p01 = p02 = p12 = DIFFUSE
            p03 = p13 = p23 = p33 = 0.0
            settled = 0
        # s = phi s
        p03 *= phi
        p13 *= phi
        p23 *= phi
        p33 *= phi * phi
        # w = w + s
        p22 += fma(2.0, p23, p33)
        p02 += p03
        p12 += p13
        p23 += p33
        # z1 = (1 - a) z1 + a w
        p00 = fma(bb, p00, fma(ab, p02, aa * p22))
        p01 = fma(b, p01, a * p12)
        p02 = fma(b, p02, a * p22)
        p03 = fma(b, p03, a * p23)
        # z2 = (1 - a) z2 + a z1
        p11 = fma(bb, p11, fma(ab, p01, aa * p00))
        p01 = fma(b, p01, a * p00)
        p12 = fma(b, p12, a * p02)
        p13 = fma(b, p13, a * p03)
        # the increment of the load reaches all four, a load step the first three
        step = ratio + shock[k]
        p00 += step * g0 * g0
        p01 += step * g0 * g1
        p02 += step * g0
        p03 += ratio * g0
        p11 += step * g1 * g1
        p12 += step * g1
        p13 += ratio * g1
        p22 += step
        p23 += ratio
        p33 += ratio
        s = p11 + 1.0
        inverse = 1.0 / s
        h0, h1, h2, h3 = p01 * inverse, p11 * inverse, p12 * inverse, p13 * inverse
        p00 = fma(-p01, h0, p00)
        p02 = fma(-p01, h2, p02)
        p03 = fma(-p01, h3, p03)
        p22 = fma(-p12, h2, p22)
        p23 = fma(-p12, h3, p23)
        p33 = fma(-p13, h3, p33)
        p01, p11, p12, p13 = h0, h1, h2, h3
        still = k > 0 and shock[k] == 0.0 and abs(s - S[k - 1]) < 1e-4 * s
        settled = settled + 1 if still and abs(h2 - before) < 1e-4 * abs(h2) + 1e-12 else 0
        S[k], before = s, h2
        if len(G):
            G[k, 0], G[k, 1], G[k, 2], G[k, 3] = h0, h1, h2, h3
        # gains of the prediction, so that nothing but one sum lies between one innovation and the next
        k3 = phi * h3
        k2 = h2 + k3
        k0 = b * h0 + a * k2
        W[0, k], W[1, k], W[2, k], W[3, k] = k0, b * h1 + a * k0, k2 + phi * k3, k3
        scale = np.float32(np.sqrt(inverse))
        W[4, k] = scale if use[k] else np.float32(0.0)
        if use[k]:
            rows += 1
            product *= s
            if product > 1e200:
                logs += np.log(product)
                product = 1.0
        k += 1
    return rows, logs + np.log(product)


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

    W (WEIGHTS, rows): see `gains`. Room: f (rows, 2), T (CHUNK, LANES), Z below for the states of all columns.
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
