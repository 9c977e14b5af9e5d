"""Likelihood of PV for two valve positions at a time, or for many with one shape of the noise.

Whitened columns (`whitening`) are regressed with a bounded step response (`step_response`); the residuals have a
Student t distribution, whose scale is the most likely one.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from .kalman import WEIGHTS, gains
from .lane_loops import HIGHEST_TERM, grow, sums_of_products
from .lanes import STRIPES, add, dot, fma, folded
from .step_response import nonnegative, response_base
from .vector_code import LANES
from .whitening import FIRST_LAG, LAGS, innovations

FACTORS = 31  # of at most 1 + HIGHEST_TERM: their product is still a number, also times 1e10
T_FREEDOM = 6.0  # tails of the residuals: Student t
STEPS = (0.35, 0.8, 1.0)  # by which the likelihood is looked at: ln lag, ln ratio, logit phi
BASE = response_base(len(LAGS))
LOWEST = (-1.0, -16.0, -4.0)
HIGHEST = (3.5, 8.0, 6.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def t_scale(r: NDArray[Any], rows: int) -> tuple[float, float]:
    """Most likely squared scale of r (rows,) and the sum of ln(1 + r^2 / (freedom s^2)) there; zeros do not count.

    Newton's steps on the logarithm of the scale, from the one that normal residuals would have.
    """
    s2 = 0.8 * dot(r, r) / rows + 1e-300
    a, b = np.empty(STRIPES, dtype=np.float32), np.empty(STRIPES, dtype=np.float32)
    for _ in range(4):
        q = np.float32(1.0 / (T_FREEDOM * s2))
        a[:] = 0.0
        b[:] = 0.0
        for begin in range(0, len(r), STRIPES):
            piece = r[begin : begin + STRIPES]
            for k in range(len(piece)):
                u = q * piece[k] * piece[k]
                u = u / (np.float32(1.0) + u)
                a[k] += u
                b[k] = fma(u, u, b[k])
        one, two = folded(a), folded(b)
        slope = 0.5 * (T_FREEDOM + 1.0) * one - 0.5 * rows
        bend = 0.5 * (T_FREEDOM + 1.0) * (one - two)
        s2 *= np.exp(min(max(slope / max(bend, 1e-300), -1.5), 1.5))
    q = np.float32(1.0 / (T_FREEDOM * s2))
    return s2, _log_products(r, q)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _log_products(r: NDArray[Any], q: Any) -> float:
    """Sum of ln(1 + q r^2): the logarithm of products, because it is slow; several side by side."""
    logs, product = 0.0, 1.0
    side = np.empty(LANES)
    whole = len(r) - len(r) % LANES
    for begin in range(0, whole, FACTORS * LANES):
        side[:] = 1.0
        grow(r, begin, min(begin + FACTORS * LANES, whole), q, side)
        for i in range(LANES):
            product *= side[i]
            if product > 1e10:
                logs += np.log(product)
                product = 1.0
    for k in range(whole, len(r)):
        product *= 1.0 + min(q * r[k] * r[k], np.float32(HIGHEST_TERM))
        if product > 1e10:
            logs += np.log(product)
            product = 1.0
    return logs + np.log(product)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _gram(j: int, E: NDArray[Any], A: NDArray[Any], c: NDArray[Any]) -> None:
    """Write the sums of products of the lags of valve position j with each other to A and with y to c."""
    nb = len(c)
    sums = np.empty((nb + 1) * (nb + 2) // 2)
    columns = (0, FIRST_LAG + j, FIRST_LAG + 2 + j, FIRST_LAG + 4 + j, FIRST_LAG + 6 + j, FIRST_LAG + 8 + j,
               FIRST_LAG + 10 + j)
    sums_of_products(E, columns, sums)
    m = 1  # y with itself is not needed
    for i in range(nb):
        c[i] = sums[m]
        for q in range(i + 1):
            A[i, q] = A[q, i] = sums[m + 1 + q]
        m += i + 2


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _regress(j: int, rows: int, logs: float, ridge: float, lines: int, E: NDArray[Any], r: NDArray[Any],
             b: NDArray[Any]) -> tuple[float, float]:
    """Log-likelihood and noise variance of valve position j from whitened columns E, of which `rows` rows count.

    logs: sum of the logarithms of their variances. Writes residuals to r (rows,) and the step response to b (lags,).
    """
    nb = len(LAGS)
    A, c, free = np.empty((nb, nb)), np.empty(nb), np.empty(nb)
    for i in range(nb):
        for h in range(lines):
            column = E[FIRST_LAG + 2 * i + j]
            add(column, -dot(column, E[1 + h]), E[1 + h])
    _gram(j, E, A, c)
    for i in range(nb):
        A[i, i] += ridge
    bounded, target = np.zeros((nb, nb)), np.zeros(nb)
    for i in range(nb):
        for h in range(nb):
            target[i] += BASE[h, i] * c[h]
            v = 0.0
            for g in range(nb):
                v += BASE[g, i] * A[g, h]
            for q in range(nb):
                bounded[i, q] += v * BASE[h, q]
    nonnegative(bounded, target, free)
    for k in range(len(r)):
        r[k] = E[0, k]
    length = 0.0
    for i in range(nb):
        b[i] = 0.0
        for q in range(nb):
            b[i] += BASE[i, q] * free[q]
        length += b[i] * b[i]
        if b[i] != 0.0:
            add(r, -b[i], E[FIRST_LAG + 2 * i + j])
    s2, v = t_scale(r, rows)
    return -0.5 * ((T_FREEDOM + 1.0) * v + logs + rows * np.log(s2) + ridge * length / s2), s2


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _without_lines(lines: int, E: NDArray[Any]) -> None:
    """Make the whitened shapes of a periodic load orthonormal, and take them out of y."""
    for h in range(lines):
        for g in range(h):
            add(E[1 + h], -dot(E[1 + h], E[1 + g]), E[1 + g])
        add(E[1 + h], 1.0 / np.sqrt(dot(E[1 + h], E[1 + h]) + 1e-300) - 1.0, E[1 + h])
        add(E[0], -dot(E[0], E[1 + h]), E[1 + h])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def shape_of(p: NDArray[Any]) -> tuple[float, float, float]:
    """Share a of a lag that a row takes, variance ratio of the load, and phi (see `whitening`) of shape numbers p."""
    return 1.0 - np.exp(-1.0 / np.exp(p[0])), np.exp(p[1]), 1.0 / (1.0 + np.exp(-p[2]))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def pair(p: NDArray[Any], xa: NDArray[Any], xb: NDArray[Any], two: bool, y: NDArray[Any], line: NDArray[Any],
         first: NDArray[Any], use: NDArray[Any], ridge: float, shock: NDArray[Any], G: NDArray[Any], S: NDArray[Any],
         T: NDArray[Any], E: NDArray[Any], R: NDArray[Any]) -> Any:
    """Log-likelihoods (2,) of y (rows,) for the valve positions xa and, if `two`, xb, (rows,) each.

    p: ln lag, ln ratio, logit phi. line (columns, rows): shapes of any size that the load may have besides, e.g. sine
    and cosine of a periodic one. use (rows,): rows that count. ridge: prior precision of the b. shock (rows,):
    variance of load steps. Also returns noise variances (2,), step responses b (2, lags) and the geometric mean of
    the variances of the rows; writes gains (where G has rows) and variances to G, S, whitened columns to E and
    residuals to R (2, rows); these and T, room (CHUNK, LANES), are in single precision.
    """
    a, ratio, phi = shape_of(p)
    W, f = np.empty((WEIGHTS, len(y)), dtype=np.float32), np.empty((len(y), 2), dtype=np.float32)
    rows, logs = gains(a, ratio, phi, shock, first, use, G, S, W)
    innovations(y, line, xa, xb, a, phi, first, W, f, T, E)
    _without_lines(len(line), E)
    ll, noise, b = np.zeros(2), np.zeros(2), np.zeros((2, len(LAGS)))
    for j in range(2 if two else 1):
        ll[j], noise[j] = _regress(j, rows, logs, ridge, len(line), E, R[j], b[j])
    return ll, noise, b, np.exp(logs / rows)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def several(p: NDArray[Any], x: NDArray[Any], which: NDArray[Any], y: NDArray[Any], line: NDArray[Any],
            first: NDArray[Any], use: NDArray[Any], ridge: float, shock: NDArray[Any], G: NDArray[Any],
            S: NDArray[Any], T: NDArray[Any], E: NDArray[Any], R: NDArray[Any]) -> NDArray[Any]:
    """Log-likelihood of the valve positions x[which], each as in `pair`; what they share is worked out once."""
    a, ratio, phi = shape_of(p)
    W, f = np.empty((WEIGHTS, len(y)), dtype=np.float32), np.empty((len(y), 2), dtype=np.float32)
    rows, logs = gains(a, ratio, phi, shock, first, use, G, S, W)
    ll, b = np.empty(len(which)), np.empty(len(LAGS))
    for i in range(0, len(which), 2):
        two = min(2, len(which) - i)
        innovations(y, line, x[which[i]], x[which[i + two - 1]], a, phi, first, W, f, T, E)
        _without_lines(len(line), E)
        for j in range(two):
            ll[i + j] = _regress(j, rows, logs, ridge, len(line), E, R[j], b)[0]
    return ll
