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
works on eight of them at a time, and a column costs a tenth of what it costs alone.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

LAGS = (1, 2, 4, 6, 8, 11)
DIFFUSE = 1e6  # variance of the unknown state where a stretch begins
WARM_UP = 12  # rows at the start of a stretch that only settle the filter
LANES = 16  # columns side by side: y, two lines, six lags of two valve positions, one spare
LINES = 2  # at most so many shapes of a periodic load
FIRST_LAG = 1 + LINES  # lane of the first lag of the first valve position; its partner's is the next
USED = FIRST_LAG + 2 * len(LAGS)


@numba.njit(cache=True, nogil=True)
def transition(a: float, phi: float) -> NDArray[Any]:
    """Matrix (4, 4) that takes the state (z1, z2, w, s) one row on."""
    F = np.zeros((4, 4))
    F[3, 3] = phi
    F[2, 2], F[2, 3] = 1.0, phi
    F[0, 0], F[0, 2], F[0, 3] = 1.0 - a, a, a * phi
    F[1, 1], F[1, 0], F[1, 2], F[1, 3] = 1.0 - a, a * (1.0 - a), a * a, a * a * phi
    return F


@numba.njit(cache=True, nogil=True)
def gains(a: float, ratio: float, phi: float, shock: NDArray[Any], first: NDArray[Any], G: NDArray[Any],
          S: NDArray[Any]) -> None:
    """Write Kalman gains G (rows, 4) and variances S (rows,) of the innovations; `first` (rows,) marks the start of
    stretches. The covariance (ten numbers, it is symmetric) goes through one equation of the model after the other."""
    b = 1.0 - a
    aa, bb, ab, g0, g1 = a * a, b * b, 2.0 * a * b, a, a * a
    p00 = p01 = p02 = p03 = p11 = p12 = p13 = p22 = p23 = p33 = 0.0
    settled = 0
    for k in range(len(shock)):
        if first[k]:
            p00 = p11 = p22 = 1.01 * DIFFUSE
            p01 = p02 = p12 = DIFFUSE
            p03 = p13 = p23 = p33 = 0.0
            settled = 0
        if settled >= 3 and shock[k] == 0.0:
            S[k] = S[k - 1]
            for i in range(4):
                G[k, i] = G[k - 1, i]
            continue
        # s = phi s
        p03 *= phi
        p13 *= phi
        p23 *= phi
        p33 *= phi * phi
        # w = w + s
        p22 += 2.0 * p23 + p33
        p02 += p03
        p12 += p13
        p23 += p33
        # z1 = (1 - a) z1 + a w
        p00 = bb * p00 + ab * p02 + aa * p22
        p01 = b * p01 + a * p12
        p02 = b * p02 + a * p22
        p03 = b * p03 + a * p23
        # z2 = (1 - a) z2 + a z1
        p11 = bb * p11 + ab * p01 + aa * p00
        p01 = b * p01 + a * p00
        p12 = b * p12 + a * p02
        p13 = b * p13 + a * p03
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
        S[k] = s
        G[k, 0], G[k, 1], G[k, 2], G[k, 3] = p01 / s, p11 / s, p12 / s, p13 / s
        p00 -= p01 * G[k, 0]
        p02 -= p01 * G[k, 2]
        p03 -= p01 * G[k, 3]
        p22 -= p12 * G[k, 2]
        p23 -= p12 * G[k, 3]
        p33 -= p13 * G[k, 3]
        p01 /= s
        p12 /= s
        p13 /= s
        p11 /= s
        still = k > 0 and shock[k] == 0.0 and abs(S[k] - S[k - 1]) < 1e-4 * S[k]
        settled = settled + 1 if still and abs(G[k, 2] - G[k - 1, 2]) < 1e-4 * abs(G[k, 2]) + 1e-12 else 0


@numba.njit(cache=True, nogil=True, fastmath=True)
def columns(y: NDArray[Any], line: NDArray[Any], xa: NDArray[Any], xb: NDArray[Any], a: float, first: NDArray[Any],
            f: NDArray[Any], T: NDArray[Any]) -> None:
    """Write to T (rows, LANES): y, `line` (columns, rows), and every lag of both valve positions behind two lags.

    f (rows, 2): room for the positions behind the two lags.
    """
    b = 1.0 - a
    ua = ub = va = vb = 0.0
    begin = 0
    for k in range(len(y)):
        if first[k]:
            begin = k
            ua = va = xa[k]
            ub = vb = xb[k]
        ua = b * ua + a * xa[k]
        va = b * va + a * ua
        ub = b * ub + a * xb[k]
        vb = b * vb + a * ub
        f[k, 0], f[k, 1] = va, vb
        T[k, 0] = y[k]
        for h in range(len(line)):
            T[k, 1 + h] = line[h, k]
        lane = FIRST_LAG
        for lag in LAGS:
            at = max(k - lag, begin)
            T[k, lane], T[k, lane + 1] = f[at, 0], f[at, 1]
            lane += 2


@numba.njit(cache=True, nogil=True, fastmath=True)
def whiten(T: NDArray[Any], G: NDArray[Any], scale: NDArray[Any], a: float, phi: float, first: NDArray[Any],
           E: NDArray[Any]) -> None:
    """Write the innovations of the columns T (rows, LANES), divided by their deviation, to E (USED, rows).

    scale (rows,): 1 / deviation, 0 for rows that do not count. T is overwritten.
    """
    b = 1.0 - a
    c1, c2, c3, c4 = a * b, a * a, a * a * phi, a * phi
    Z = np.zeros(4 * LANES)  # predicted z1, z2, w, s of each column
    for k in range(len(T)):
        if first[k]:
            for c in range(4 * LANES):
                Z[c] = 0.0
        # gains of the prediction, so that nothing but one sum lies between one innovation and the next
        k3 = phi * G[k, 3]
        k2 = G[k, 2] + k3
        k0 = b * G[k, 0] + a * k2
        k1 = b * G[k, 1] + a * k0
        for c in range(LANES):
            z1, z2, w, s = Z[c], Z[LANES + c], Z[2 * LANES + c], Z[3 * LANES + c]
            e = T[k, c] - z2
            T[k, c] = e * scale[k]
            Z[LANES + c] = b * z2 + c1 * z1 + c2 * w + c3 * s + k1 * e
            Z[c] = b * z1 + a * w + c4 * s + k0 * e
            Z[2 * LANES + c] = w + phi * s + k2 * e
            Z[3 * LANES + c] = phi * s + k3 * e
    for c in range(len(E)):
        for k in range(len(T)):
            E[c, k] = T[k, c]
