"""Compiled core of the dead-band test: what is left of PV when OP, a moving load and noise have been accounted for.

Model, one row per block of samples (k):

    y_k  = sum_i b_i f_{k - l_i} + z2_k + n_k          f: valve position x behind two equal lags, l_i: LAGS
    z1  += a (w - z1),  z2 += a (z1 - z2)              the load w reaches PV through the same two lags
    w   += s,  s = phi s + e                           the load wanders, e has `ratio` times the variance of n
    n                                                  white measurement noise

plus load steps of known variance at known rows (`shock`). A Kalman filter whitens every column; what remains is a
regression with a bounded step response (`step_response`). Variances are in units of that of n.
Harvey, Forecasting, Structural Time Series Models and the Kalman Filter (1989), sections 3.2 and 3.4.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from .step_response import nonnegative, response_base

LAGS = (1, 2, 4, 6, 8, 11)
DIFFUSE = 1e6  # variance of the unknown state where a stretch begins
WARM_UP = 12  # rows at the start of a stretch that only settle the filter
T_FREEDOM = 6.0  # tails of the residuals: Student t


@numba.njit(cache=True)
def transition(a: float, phi: float) -> NDArray[Any]:
    """Matrix (4, 4) that takes the state (z1, z2, w, s) one row on."""
    F = np.zeros((4, 4))
    F[3, 3] = phi
    F[2, 2], F[2, 3] = 1.0, phi
    F[0, 0], F[0, 2], F[0, 3] = 1.0 - a, a, a * phi
    F[1, 1], F[1, 0], F[1, 2], F[1, 3] = 1.0 - a, a * (1.0 - a), a * a, a * a * phi
    return F


@numba.njit(cache=True)
def gains(a: float, ratio: float, phi: float, shock: NDArray[Any], first: NDArray[Any]) -> Any:
    """Kalman gains (rows, 4) and variances (rows,) of the innovations; `first` (rows,) marks the start of stretches."""
    n = len(shock)
    G = np.empty((n, 4))
    S = np.empty(n)
    F = transition(a, phi)
    g = np.ones(4)
    g[0], g[1] = a, a * a
    P = np.zeros((4, 4))
    T = np.zeros((4, 4))
    settled = 0
    for k in range(n):
        if first[k]:
            for i in range(4):
                for j in range(4):
                    P[i, j] = (1.01 if i == j else 1.0) * DIFFUSE if i < 3 and j < 3 else 0.0
            settled = 0
        if settled >= 3 and shock[k] == 0.0:
            S[k] = S[k - 1]
            for i in range(4):
                G[k, i] = G[k - 1, i]
            continue
        for i in range(4):
            for j in range(4):
                v = 0.0
                for m in range(4):
                    v += F[i, m] * P[m, j]
                T[i, j] = v
        for i in range(4):
            for j in range(i + 1):
                v = ratio * g[i] * g[j]
                if i < 3:
                    v += shock[k] * g[i] * g[j]
                for m in range(4):
                    v += T[i, m] * F[j, m]
                P[i, j] = v
                P[j, i] = v
        s = P[1, 1] + 1.0
        S[k] = s
        for i in range(4):
            G[k, i] = P[i, 1] / s
        for i in range(4):
            for j in range(4):
                P[i, j] -= G[k, i] * G[k, j] * s
        still = k > 0 and shock[k] == 0.0 and abs(S[k] - S[k - 1]) < 1e-4 * S[k]
        settled = settled + 1 if still and abs(G[k, 2] - G[k - 1, 2]) < 1e-4 * abs(G[k, 2]) + 1e-12 else 0
    return G, S


@numba.njit(cache=True, fastmath=True)
def whiten(y: NDArray[Any], G: NDArray[Any], scale: NDArray[Any], a: float, phi: float, first: NDArray[Any],
           out: NDArray[Any]) -> None:
    """Write the innovations of y (rows,), divided by their deviation, to `out`; scale: 1/sqrt(S)."""
    z1 = z2 = w = s = 0.0
    for k in range(len(y)):
        if first[k]:
            z1 = z2 = w = s = 0.0
        s = phi * s
        w += s
        z1 += a * (w - z1)
        z2 += a * (z1 - z2)
        e = y[k] - z2
        z1 += G[k, 0] * e
        z2 += G[k, 1] * e
        w += G[k, 2] * e
        s += G[k, 3] * e
        out[k] = e * scale[k]


@numba.njit(cache=True, fastmath=True)
def _take_out(x: NDArray[Any], unit: NDArray[Any]) -> None:
    """Subtract from x (rows,) its part along `unit`, in place."""
    v = 0.0
    for k in range(len(x)):
        v += x[k] * unit[k]
    for k in range(len(x)):
        x[k] -= v * unit[k]


@numba.njit(cache=True, fastmath=True)
def _normalise(x: NDArray[Any]) -> None:
    v = 0.0
    for k in range(len(x)):
        v += x[k] * x[k]
    v = 1.0 / np.sqrt(v + 1e-300)
    for k in range(len(x)):
        x[k] *= v


@numba.njit(cache=True, fastmath=True)
def regress(y: NDArray[Any], X: NDArray[Any], G: NDArray[Any], S: NDArray[Any], a: float, phi: float,
            first: NDArray[Any], rows: NDArray[Any], ridge: float, line: NDArray[Any], want: bool) -> Any:
    """Log-likelihood of y (rows,) for each candidate valve position X (candidates, rows).

    line (columns, rows): shapes of any size that the load may have besides, e.g. sine and cosine of a periodic one.
    rows: indices that count. ridge: prior precision of the b. Returns the log-likelihoods (candidates,), the noise
    variances (candidates,), the step responses b (candidates, lags) and, if `want`, the residuals (candidates, rows).
    """
    m, n = X.shape
    nb = len(LAGS)
    R = np.empty((m if want else 1, n))
    ll = np.empty(m)
    noise = np.empty(m)
    coefficients = np.empty((m, nb))
    E = np.empty((nb + 1, n))
    # rows that do not count are whitened to zero, so that every sum may run over all rows
    scale = np.zeros(n)
    for k in rows:
        scale[k] = 1.0 / np.sqrt(S[k])
    whiten(y, G, scale, a, phi, first, E[0])
    Q = np.empty((len(line), n))
    for i in range(len(line)):
        whiten(line[i], G, scale, a, phi, first, Q[i])
        for j in range(i):
            _take_out(Q[i], Q[j])
        _normalise(Q[i])
        _take_out(E[0], Q[i])
    base = response_base(nb)
    f = np.empty(n)
    t = np.empty(n)
    logs = 0.0
    product = 1.0
    for k in rows:
        product *= S[k]
        if product > 1e200:
            logs += np.log(product)
            product = 1.0
    logs += np.log(product)
    A = np.empty((nb, nb))
    c = np.empty(nb)
    bounded = np.empty((nb, nb))
    target = np.empty(nb)
    free = np.empty(nb)
    b = np.empty(nb)
    for j in range(m):
        z1 = z2 = 0.0
        for k in range(n):
            if first[k]:
                z1 = z2 = X[j, k]
            z1 += a * (X[j, k] - z1)
            z2 += a * (z1 - z2)
            f[k] = z2
        for i in range(nb):
            begin = 0
            lag = LAGS[i]
            for k in range(n):
                if first[k]:
                    begin = k
                t[k] = f[max(k - lag, begin)]
            whiten(t, G, scale, a, phi, first, E[i + 1])
            for h in range(len(line)):
                _take_out(E[i + 1], Q[h])
        for p in range(nb):
            for q in range(p + 1):
                v = 0.0
                for k in range(n):
                    v += E[p + 1, k] * E[q + 1, k]
                A[p, q] = v
                A[q, p] = v
            v = 0.0
            for k in range(n):
                v += E[p + 1, k] * E[0, k]
            c[p] = v
            A[p, p] += ridge
        for p in range(nb):
            for q in range(nb):
                v = 0.0
                for i in range(nb):
                    for h in range(nb):
                        v += base[i, p] * A[i, h] * base[h, q]
                bounded[p, q] = v
            v = 0.0
            for i in range(nb):
                v += base[i, p] * c[i]
            target[p] = v
        nonnegative(bounded, target, free)
        length = 0.0
        for p in range(nb):
            v = 0.0
            for q in range(nb):
                v += base[p, q] * free[q]
            b[p] = v
            coefficients[j, p] = v
            length += v * v
        r = R[j if want else 0]
        for k in range(n):
            r[k] = E[0, k]
        for i in range(nb):
            if b[i] != 0.0:
                for k in range(n):
                    r[k] -= b[i] * E[i + 1, k]
        s2 = 0.0
        for k in range(n):
            s2 += r[k] * r[k]
        s2 = s2 / len(rows) + 1e-300
        for _ in range(4):
            v = 0.0
            for k in range(n):
                v += r[k] * r[k] / (T_FREEDOM + r[k] * r[k] / s2)
            s2 = (T_FREEDOM + 1.0) * v / len(rows) + 1e-300
        v = 0.0
        product = 1.0
        for k in range(n):
            product *= 1.0 + r[k] * r[k] / (s2 * T_FREEDOM)
            if product > 1e200:
                v += np.log(product)
                product = 1.0
        v += np.log(product)
        ll[j] = -0.5 * ((T_FREEDOM + 1.0) * v + logs + len(rows) * np.log(s2) + ridge * length / s2)
        noise[j] = s2
    return ll, noise, coefficients, R
