"""The noise of greatest likelihood for what a model misses: likelihood and search in one compiled piece.

The likelihood is that of `noise.whitener`, without keeping what it does to each sample.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray
from .noise import Noise, next_covariance, stationary

# what wanders more slowly than this share of the record is no noise about a mean: it is a drift
SLOWEST = 0.1
# deviances closer than this tell nothing about the noise
CLOSE_ENOUGH = 0.02


@numba.njit(cache=True, fastmath={"contract"})
def deviance(error, used, count, a1, a2, ratio):
    """Return -2 log likelihood of an error (samples,) of which `count` are `used`; the noise variance profiled out."""
    b = 1.0 - a2
    p11, p12, p22 = stationary(a1, a2, ratio)
    q = p11 * (1.0 - a1 * a1)
    steady = False
    g1 = g2 = c = e = 0.0
    s = share = 1.0
    log_det = log_s = rss = w = l = 0.0  # noqa: E741
    for k in range(len(error)):
        if used[k]:
            if not steady:
                s = p22 + 1.0
                new1 = p12 / s
                new2 = p22 / s
                steady = abs(new1 - g1) < 1e-11 * (1.0 + abs(g1)) and abs(new2 - g2) < 1e-11
                g1 = new1
                g2 = new2
                p11, p12, p22 = next_covariance(p11 - g1 * p12, p12 - g1 * p22, p22 - g2 * p22, a1, a2, q)
                c = a2 * g2 + b * g1
                e = a1 * g1
                share = 1.0 / s
                log_s = np.log(s)
            log_det += log_s
            x = error[k]
            v = x - l
            rss += v * v * share
            new = (a2 - c) * l + (b * w + c * x)
            w = (a1 * w + e * x) - e * l
            l = new  # noqa: E741
        else:
            steady = False
            g1 = g2 = 0.0
            p11, p12, p22 = next_covariance(p11, p12, p22, a1, a2, q)
            l = a2 * l + b * w  # noqa: E741
            w *= a1
    return count * np.log(max(rss, 1e-300) / count) + log_det


@numba.njit(cache=True)
def _cost(x, error, used, count, h, low, high):
    outside = 0.0
    y = np.empty(3)
    for i in range(3):
        y[i] = min(max(x[i], low[i]), high[i])
        outside += (x[i] - y[i]) ** 2
    a1, a2 = np.exp(-h / np.exp(y[1])), np.exp(-h / np.exp(y[2]))
    return deviance(error, used, count, a1, a2, np.exp(y[0])) + 100.0 * outside


@numba.njit(cache=True)
def _simplex(error, used, count, h, low, high, x0, size, budget):
    """Return the point of least cost found within `budget` evaluations (Nelder and Mead 1965)."""
    X = np.empty((4, 3))
    X[:] = x0
    for i in range(3):
        X[i + 1, i] += size
    f = np.empty(4)
    for i in range(4):
        f[i] = _cost(X[i], error, used, count, h, low, high)
    spent = 4
    while spent < budget:
        order = np.argsort(f, kind="mergesort")
        X, f = X[order], f[order]
        if f[3] - f[0] < CLOSE_ENOUGH:
            break
        centre = (X[0] + X[1] + X[2]) / 3.0
        reflected = 2.0 * centre - X[3]
        fr = _cost(reflected, error, used, count, h, low, high)
        spent += 1
        if fr < f[0]:
            wide = centre + 2.0 * (centre - X[3])
            fw = _cost(wide, error, used, count, h, low, high)
            spent += 1
            if fw < fr:
                X[3], f[3] = wide, fw
            else:
                X[3], f[3] = reflected, fr
        elif fr < f[2]:
            X[3], f[3] = reflected, fr
        else:
            near = 0.5 * (centre + (reflected if fr < f[3] else X[3]))
            fn = _cost(near, error, used, count, h, low, high)
            spent += 1
            if fn < min(fr, f[3]):
                X[3], f[3] = near, fn
            else:
                for i in range(1, 4):
                    X[i] = 0.5 * (X[0] + X[i])
                    f[i] = _cost(X[i], error, used, count, h, low, high)
                spent += 3
    return X[np.argmin(f)]


def fit_noise(error: FloatArray, used: NDArray[np.bool_], h: float, first: Noise) -> Noise:
    """Return the noise of greatest likelihood for an error (samples,), searched from `first` (Nelder and Mead 1965)."""
    span = h * len(error)
    low = np.log([1e-3, 0.5 * h, 0.1 * h])
    high = np.log([1e3, SLOWEST * span, SLOWEST * span])
    start = np.log([first.ratio, first.slow, first.fast])
    x = _simplex(error, used, int(np.count_nonzero(used)), h, low, high, start, 0.4, 70)
    ratio, slow, fast = np.exp(np.clip(x, low, high))
    return Noise(float(ratio), float(max(slow, fast)), float(min(slow, fast)))
