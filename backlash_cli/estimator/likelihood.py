"""Likelihood of PV for two valve positions at a time, and the climb over the numbers that shape the noise.

Whitened columns (`whitening`) are regressed with a bounded step response (`step_response`); the residuals have a
Student t distribution, whose scale is the most likely one.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from .step_response import nonnegative, response_base
from .whitening import FIRST_LAG, LAGS, LANES, WEIGHTS, gains, innovations

T_FREEDOM = 6.0  # tails of the residuals: Student t
PIECE = 512  # rows that are added up in single precision
STEPS = (0.35, 0.8, 1.0)  # first steps of the climb: ln lag, ln ratio, logit phi
LOWEST = (-1.0, -16.0, -4.0)
HIGHEST = (3.5, 8.0, 6.0)
WORTH = 0.2  # nats: smaller gains are not followed
UP, DOWN, ON, TOP = 0, 1, 2, 3  # what the climb along one number does next


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _dot(x: NDArray[Any], y: NDArray[Any]) -> Any:
    """Sum of products: single precision within a piece, double precision over the pieces."""
    total: Any = 0.0
    for begin in range(0, len(x), PIECE):
        xs, ys = x[begin : begin + PIECE], y[begin : begin + PIECE]
        v = np.float32(0.0)
        for k in range(len(xs)):
            v += xs[k] * ys[k]
        total += v
    return total


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _add(x: NDArray[Any], share: float, y: NDArray[Any]) -> None:
    """Add `share` times y to x in place."""
    factor = np.float32(share)
    for k in range(len(x)):
        x[k] += factor * y[k]


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def t_scale(r: NDArray[Any], rows: int) -> tuple[float, float]:
    """Most likely squared scale of r (rows,) and the sum of ln(1 + r^2 / (freedom s^2)) there; zeros do not count.

    Newton's steps on the logarithm of the scale, from the one that normal residuals would have.
    """
    s2 = 0.8 * _dot(r, r) / rows + 1e-300
    for _ in range(4):
        q = np.float32(1.0 / (T_FREEDOM * s2))
        one: Any = 0.0
        two: Any = 0.0
        for begin in range(0, len(r), PIECE):
            piece = r[begin : begin + PIECE]
            a = b = np.float32(0.0)
            for k in range(len(piece)):
                u = q * piece[k] * piece[k]
                u = u / (np.float32(1.0) + u)
                a += u
                b += u * u
            one += a
            two += b
        slope = 0.5 * (T_FREEDOM + 1.0) * one - 0.5 * rows
        bend = 0.5 * (T_FREEDOM + 1.0) * (one - two)
        s2 *= np.exp(min(max(slope / max(bend, 1e-300), -1.5), 1.5))
    q = np.float32(1.0 / (T_FREEDOM * s2))
    return s2, _log_products(r, q)


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _log_products(r: NDArray[Any], q: Any) -> float:
    """Sum of ln(1 + q r^2): the logarithm of products, because it is slow; several side by side."""
    logs = 0.0
    products = np.empty(LANES)
    for begin in range(0, len(r), 32 * LANES):
        products[:] = 1.0
        for low in range(begin, min(begin + 32 * LANES, len(r)), LANES):
            piece = r[low : low + LANES]
            for i in range(len(piece)):
                products[i] *= 1.0 + min(q * piece[i] * piece[i], np.float32(1e9))
        for i in range(LANES):
            logs += np.log(products[i])
    return logs


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _regress(j: int, rows: int, logs: float, ridge: float, lines: int, E: NDArray[Any], r: NDArray[Any],
             b: NDArray[Any]) -> tuple[float, float]:
    """Log-likelihood and noise variance of valve position j from whitened columns E, of which `rows` rows count.

    logs: sum of the logarithms of their variances. Writes residuals to r (rows,) and the step response to b (lags,).
    """
    nb = len(LAGS)
    base = response_base(nb)
    A, c, free = np.empty((nb, nb)), np.empty(nb), np.empty(nb)
    for i in range(nb):
        column = E[FIRST_LAG + 2 * i + j]
        for h in range(lines):
            _add(column, -_dot(column, E[1 + h]), E[1 + h])
        for q in range(i + 1):
            A[i, q] = A[q, i] = _dot(column, E[FIRST_LAG + 2 * q + j])
        A[i, i] += ridge
        c[i] = _dot(column, E[0])
    bounded, target = np.zeros((nb, nb)), np.zeros(nb)
    for i in range(nb):
        for h in range(nb):
            target[i] += base[h, i] * c[h]
            v = 0.0
            for g in range(nb):
                v += base[g, i] * A[g, h]
            for q in range(nb):
                bounded[i, q] += v * base[h, q]
    nonnegative(bounded, target, free)
    for k in range(len(r)):
        r[k] = E[0, k]
    length = 0.0
    for i in range(nb):
        b[i] = 0.0
        for q in range(nb):
            b[i] += base[i, q] * free[q]
        length += b[i] * b[i]
        if b[i] != 0.0:
            _add(r, -b[i], E[FIRST_LAG + 2 * i + j])
    s2, v = t_scale(r, rows)
    return -0.5 * ((T_FREEDOM + 1.0) * v + logs + rows * np.log(s2) + ridge * length / s2), s2


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _without_lines(lines: int, E: NDArray[Any]) -> None:
    """Make the whitened shapes of a periodic load orthonormal, and take them out of y."""
    for h in range(lines):
        for g in range(h):
            _add(E[1 + h], -_dot(E[1 + h], E[1 + g]), E[1 + g])
        _add(E[1 + h], 1.0 / np.sqrt(_dot(E[1 + h], E[1 + h]) + 1e-300) - 1.0, E[1 + h])
        _add(E[0], -_dot(E[0], E[1 + h]), E[1 + h])


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def pair(p: NDArray[Any], xa: NDArray[Any], xb: NDArray[Any], two: bool, y: NDArray[Any], line: NDArray[Any],
         first: NDArray[Any], use: NDArray[Any], ridge: float, shock: NDArray[Any], G: NDArray[Any], S: NDArray[Any],
         T: NDArray[Any], E: NDArray[Any], R: NDArray[Any]) -> Any:
    """Log-likelihoods (2,) of y (rows,) for the valve positions xa and, if `two`, xb, (rows,) each.

    p: ln lag, ln ratio, logit phi. line (columns, rows): shapes of any size that the load may have besides, e.g. sine
    and cosine of a periodic one. use (rows,): rows that count. ridge: prior precision of the b. shock (rows,):
    variance of load steps. Also returns noise variances (2,) and step responses b (2, lags); writes gains (where G
    has rows) and variances to G, S, whitened columns to E and residuals to R (2, rows); these and T, room
    (CHUNK, LANES), are in single precision.
    """
    a, phi = 1.0 - np.exp(-1.0 / np.exp(p[0])), 1.0 / (1.0 + np.exp(-p[2]))
    W, f = np.empty((len(y), WEIGHTS), dtype=np.float32), np.empty((len(y), 2), dtype=np.float32)
    rows, logs = gains(a, np.exp(p[1]), phi, shock, first, use, G, S, W)
    innovations(y, line, xa, xb, a, phi, first, W, f, T, E)
    _without_lines(len(line), E)
    ll, noise, b = np.zeros(2), np.zeros(2), np.zeros((2, len(LAGS)))
    for j in range(2 if two else 1):
        ll[j], noise[j] = _regress(j, rows, logs, ridge, len(line), E, R[j], b[j])
    return ll, noise, b


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def several(p: NDArray[Any], x: NDArray[Any], which: NDArray[Any], y: NDArray[Any], line: NDArray[Any],
            first: NDArray[Any], use: NDArray[Any], ridge: float, shock: NDArray[Any], G: NDArray[Any],
            S: NDArray[Any], T: NDArray[Any], E: NDArray[Any], R: NDArray[Any]) -> NDArray[Any]:
    """Log-likelihood of the valve positions x[which], each as in `pair`; what they share is worked out once."""
    a, phi = 1.0 - np.exp(-1.0 / np.exp(p[0])), 1.0 / (1.0 + np.exp(-p[2]))
    W, f = np.empty((len(y), WEIGHTS), dtype=np.float32), np.empty((len(y), 2), dtype=np.float32)
    rows, logs = gains(a, np.exp(p[1]), phi, shock, first, use, G, S, W)
    ll, b = np.empty(len(which)), np.empty(len(LAGS))
    for i in range(0, len(which), 2):
        two = min(2, len(which) - i)
        innovations(y, line, x[which[i]], x[which[i + two - 1]], a, phi, first, W, f, T, E)
        _without_lines(len(line), E)
        for j in range(two):
            ll[i + j] = _regress(j, rows, logs, ridge, len(line), E, R[j], b)[0]
    return ll


@numba.njit(cache=True, nogil=True, error_model="numpy")
def climb(p: NDArray[Any], which: int, rounds: int, share: float, xa: NDArray[Any], xb: NDArray[Any], y: NDArray[Any],
          line: NDArray[Any], first: NDArray[Any], use: NDArray[Any], ridge: float, shock: NDArray[Any],
          G: NDArray[Any], S: NDArray[Any], T: NDArray[Any], E: NDArray[Any], R: NDArray[Any]) -> Any:
    """Raise the likelihood of xa (which = 0) or xb (1) over p, one number after the other, by parabolas.

    share: of STEPS, the first step; halved every round. Returns (2, 4): for xa and for xb the best p on the way and
    its log-likelihood.
    """
    best = np.full((2, 4), -np.inf)
    x, v = np.empty(3), np.empty(3)  # places along one number and their values: one side, best, other side
    for turn in range(-1, 3 * rounds):
        i = max(turn, 0) % 3
        step = share * STEPS[i] * 0.5 ** (turn // 3)
        phase = UP
        if turn >= 0:
            p = best[which, :3].copy()
        x[1], v[1] = p[i], best[which, 3]
        for _ in range(12):
            if turn < 0:
                target = x[1]
            elif phase == TOP:
                target = _top(x, v)
                if target == x[1]:
                    break
            else:
                target = x[1] + (-step if phase == DOWN else step)
            target = min(max(target, LOWEST[i]), HIGHEST[i])
            value = -np.inf
            if target != x[1] or turn < 0:
                trial = p.copy()
                trial[i] = target
                ll = pair(trial, xa, xb, True, y, line, first, use, ridge, shock, G, S, T, E, R)[0]
                value = ll[which]
                for c in range(2):
                    if ll[c] > best[c, 3]:
                        for j in range(3):
                            best[c, j] = trial[j]
                        best[c, 3] = ll[c]
            if turn < 0 or phase == TOP:
                break
            if value > v[1] + WORTH:
                # on in this direction, twice as far each time
                step = 2.0 * (target - x[1])
                x[0], v[0] = x[1], v[1]
                x[1], v[1] = target, value
                phase = ON
            else:
                side = 0 if phase == DOWN else 2
                x[side], v[side] = target, value
                phase = DOWN if phase == UP else TOP
    return best


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _top(x: NDArray[Any], v: NDArray[Any]) -> float:
    """Place of the top of the parabola through three points, the middle one if it gains less than WORTH there."""
    if not (np.isfinite(v[0]) and np.isfinite(v[2])):
        return float(x[1])
    a, b = x[0] - x[1], x[2] - x[1]
    if a == 0.0 or b == 0.0 or a == b:
        return float(x[1])
    slope_a, slope_b = (v[0] - v[1]) / a, (v[2] - v[1]) / b
    bend = (slope_a - slope_b) / (a - b)
    slope = slope_a - bend * a
    if bend >= 0.0 or slope * slope < -4.0 * bend * WORTH:
        return float(x[1])
    return float(x[1] - 0.5 * slope / bend)
