"""Search for the numbers that shape the noise, by Gauss and Newton's steps on the residuals.

The slopes of the residuals over the shape numbers are found by differences, for both valve positions together, and
from then on corrected by every step that is taken (Broyden, Mathematics of Computation 19 (1965) 577-593). A step then
costs one evaluation of the likelihood instead of four, and a search that goes on after a small change of the model
begins with what is known already.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from .lane_loops import sums_of_products
from .likelihood import HIGHEST, LOWEST, STEPS, T_FREEDOM, pair
from .step_response import solve_free
from .whitening import LAGS

PROBE = (0.02, 0.06, 0.08)  # differences of ln lag, ln ratio, logit phi that the slopes are taken over
FURTHEST = (1.0, 3.5, 3.5)  # one step changes them by no more
FLAT = 0.05  # curvature [nats] over one of STEPS that is assumed besides: some are without effect at times
MOST = 20  # steps
STALE = 3.0  # STEPS that p may be from where the slopes were taken if they are to say that a top is reached
LOST = 6.0  # and if they are to be of any use


@numba.njit(cache=True, nogil=True, error_model="numpy")
def normal_equations(r: NDArray[Any], s2: float, slopes: NDArray[Any], H: NDArray[Any], g: NDArray[Any]) -> None:
    """Write the gradient g (3,) of the log-likelihood and its expected curvature H (3, 3).

    r (rows + lags,): residuals of Student's t with the squared scale s2, which is the most likely one and goes with
    them; the last, one for each lag, are normal (see `_laid_out`). slopes (3, rows + lags): how r changes with each
    number.
    """
    q = 1.0 / s2
    n = len(r) - len(LAGS)
    least, freedom, both = np.float32(q), np.float32(T_FREEDOM), np.float32(T_FREEDOM + 1.0)
    e = r[:n]
    weighted, sums = np.empty((4, n), dtype=np.float32), np.zeros(10)
    roots = weighted[3]
    for k in range(n):
        roots[k] = np.sqrt(both / (freedom + e[k] * e[k] * least))
    for i in range(3):
        of, to = slopes[i], weighted[i]
        for k in range(n):
            to[k] = roots[k] * of[k]
    for k in range(n):
        roots[k] *= e[k]
    sums_of_products(weighted, (0, 1, 2, 3), sums)
    a00, a01, a11, a02, a12, a22 = sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]
    b0, b1, b2, rr = sums[6], sums[7], sums[8], max(sums[9], 1e-300)
    H[0, 0], H[1, 1], H[2, 2] = q * (a00 - b0 * b0 / rr), q * (a11 - b1 * b1 / rr), q * (a22 - b2 * b2 / rr)
    H[0, 1], H[0, 2], H[1, 2] = q * (a01 - b0 * b1 / rr), q * (a02 - b0 * b2 / rr), q * (a12 - b1 * b2 / rr)
    g[0], g[1], g[2] = -b0 * q, -b1 * q, -b2 * q
    for i in range(3):
        for k in range(n, len(r)):
            g[i] -= q * slopes[i, k] * r[k]
            for j in range(i, 3):
                H[i, j] += q * slopes[i, k] * slopes[j, k]
        for j in range(i):
            H[i, j] = H[j, i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _laid_out(R: NDArray[Any], mean: float, b: NDArray[Any], ridge: float, out: NDArray[Any]) -> None:
    """Write to out (2, rows + lags) the residuals R (2, rows) and, behind them, what the prior makes of b (2, lags).

    All are multiplied by the geometric mean of the deviations by which the residuals have been divided, so that their
    scale says how likely they are. mean: that of the variances, its square.
    """
    n = R.shape[1]
    unit, prior = np.float32(np.sqrt(mean)), np.sqrt(ridge * mean)
    for c in range(2):
        laid, residuals = out[c], R[c]
        for k in range(n):
            laid[k] = unit * residuals[k]
        for i in range(len(LAGS)):
            laid[n + i] = prior * b[c, i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def bounded_step(p: NDArray[Any], H: NDArray[Any], g: NDArray[Any], damping: float, d: NDArray[Any]) -> float:
    """Write the step d (3,) from p within the bounds of the numbers; return the gain [nats] expected of it."""
    A, free, room = H.copy(), np.ones(3), np.empty((3, 4))
    for i in range(3):
        A[i, i] = A[i, i] * (1.0 + damping) + FLAT / STEPS[i] ** 2
    for _ in range(4):
        solve_free(A, g, free, d, room)
        share = 1.0
        for i in range(3):
            share = min(share, FURTHEST[i] / max(abs(d[i]), 1e-300))
        shut = -1
        for i in range(3):
            low, high = LOWEST[i] - p[i], HIGHEST[i] - p[i]
            d[i] *= share
            if free[i] > 0.0 and ((d[i] < low and low > -1e-9) or (d[i] > high and high < 1e-9)):
                shut = i
            d[i] = min(max(d[i], low), high)
        if shut < 0:
            break
        free[shut] = 0.0
    gain = 0.0
    for i in range(3):
        gain += g[i] * d[i]
        for j in range(3):
            gain -= 0.5 * d[i] * H[i, j] * d[j]
    return gain


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _apart(p: NDArray[Any], q: NDArray[Any]) -> float:
    """Distance of two points in STEPS."""
    v = 0.0
    for i in range(3):
        v += ((p[i] - q[i]) / STEPS[i]) ** 2
    return float(np.sqrt(v))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _keep(found: NDArray[Any], p: NDArray[Any], ll: NDArray[Any]) -> None:
    for c in range(2):
        if ll[c] > found[c, 3]:
            found[c, 0], found[c, 1], found[c, 2], found[c, 3] = p[0], p[1], p[2], ll[c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _put(to: NDArray[Any], p: NDArray[Any]) -> None:
    """Copy three numbers; the compiler takes seconds for what copies any array."""
    for i in range(3):
        to[i] = p[i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _difference(r: NDArray[Any], now: NDArray[Any], h: float, slope: NDArray[Any]) -> None:
    """Write the slope (rows,) between the residuals r and `now`, h apart."""
    share = np.float32(1.0 / h)
    for k in range(len(r)):
        slope[k] = (now[k] - r[k]) * share


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _corrected(slopes: NDArray[Any], r: NDArray[Any], now: NDArray[Any], d: NDArray[Any]) -> None:
    """Correct slopes (3, rows) so that the step d leads from the residuals r (rows,) to `now`; the least change."""
    length = (d[0] / STEPS[0]) ** 2 + (d[1] / STEPS[1]) ** 2 + (d[2] / STEPS[2]) ** 2
    d0, d1, d2 = np.float32(d[0]), np.float32(d[1]), np.float32(d[2])
    f0 = np.float32(d[0] / (STEPS[0] ** 2 * length))
    f1 = np.float32(d[1] / (STEPS[1] ** 2 * length))
    f2 = np.float32(d[2] / (STEPS[2] ** 2 * length))
    for k in range(len(r)):
        v = now[k] - r[k] - slopes[0, k] * d0 - slopes[1, k] * d1 - slopes[2, k] * d2
        slopes[0, k] += v * f0
        slopes[1, k] += v * f1
        slopes[2, k] += v * f2


@numba.njit(cache=True, nogil=True, error_model="numpy")
def ascend(found: NDArray[Any], which: int, worth: float, slopes: NDArray[Any], taken: NDArray[Any],
           xa: NDArray[Any], xb: NDArray[Any], y: NDArray[Any], line: NDArray[Any], first: NDArray[Any],
           use: NDArray[Any], ridge: float, shock: NDArray[Any], G: NDArray[Any], S: NDArray[Any], T: NDArray[Any],
           E: NDArray[Any], R: NDArray[Any]) -> None:
    """Raise the likelihood of xa (which = 0) or xb (1) over p until a step gains less than `worth` [nats].

    found (2, 4): best p of xa and of xb and its log-likelihood, brought up to date by every evaluation. slopes
    (2, 3, rows + lags): of the residuals of both (see `_laid_out`); taken (2, 4): at which p they hold, and how far in
    STEPS it is from where they were taken by differences (infinite: not at all). The others as in `likelihood.pair`.
    """
    two = len(found) == 2  # always; a plain True would be compiled for itself
    p, H, g, d, trial = np.empty(3), np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    _put(p, found[which])
    r, now = np.empty((2, len(y) + len(LAGS)), dtype=np.float32), np.empty((2, len(y) + len(LAGS)), dtype=np.float32)
    ll, noise, b, mean = pair(p, xa, xb, two, y, line, first, use, ridge, shock, G, S, T, E, R)
    _keep(found, p, ll)
    _laid_out(R, mean, b, ridge, r)
    level, s2 = ll[which], noise[which] * mean
    damping, failed = 0.0, 0
    taken[which, 3] += _apart(p, taken[which])
    _put(taken[which], p)
    for _ in range(MOST):
        if taken[which, 3] > LOST:
            for i in range(3):
                h = PROBE[i] if p[i] + PROBE[i] <= HIGHEST[i] else -PROBE[i]
                _put(trial, p)
                trial[i] += h
                ll, noise, b, mean = pair(trial, xa, xb, two, y, line, first, use, ridge, shock, G, S, T, E, R)
                _keep(found, trial, ll)
                _laid_out(R, mean, b, ridge, now)
                for c in range(2):
                    _difference(r[c], now[c], h, slopes[c, i])
            for c in range(2):
                _put(taken[c], p)
                taken[c, 3] = 0.0
        normal_equations(r[which], s2, slopes[which], H, g)
        if bounded_step(p, H, g, damping, d) < 0.5 * worth:
            if taken[which, 3] < STALE:
                break
            taken[which, 3] = np.inf
            damping, failed = 0.0, 0
            continue
        for i in range(3):
            trial[i] = p[i] + d[i]
        ll, noise, b, mean = pair(trial, xa, xb, two, y, line, first, use, ridge, shock, G, S, T, E, R)
        _keep(found, trial, ll)
        _laid_out(R, mean, b, ridge, now)
        _corrected(slopes[which], r[which], now[which], d)
        if ll[which] > level:
            gained = ll[which] - level
            taken[which, 3] += _apart(trial, p)
            _put(taken[which], trial)
            _put(p, trial)
            r, now = now, r
            level, s2 = ll[which], noise[which] * mean
            damping = 0.0 if damping < 1.0 else 0.1 * damping
            failed = 0
            if gained < worth:
                if taken[which, 3] < STALE:
                    break
                taken[which, 3] = np.inf
        else:
            damping = max(4.0 * damping, 1.0)
            failed += 1
            if failed == 2:
                if taken[which, 3] == 0.0:
                    break
                taken[which, 3] = np.inf
                damping, failed = 0.0, 0
