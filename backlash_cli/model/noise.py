"""What the model does not explain, as a random load behind two lags plus white measurement noise.

w[k+1] = a1 w[k] + v[k],  l[k+1] = a2 l[k] + (1 - a2) w[k],  error[k] = l[k] + e[k],  a = exp(-h/T).
The Kalman filter of this model whitens the error exactly, with missing samples, so that a likelihood of the
prediction error holds in closed loop too (Ljung, System Identification, chapter 4; Harvey 1989, chapter 3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray

# what wanders more slowly than this share of the record is no noise about a mean: it is a drift
SLOWEST = 0.1


@dataclass(frozen=True)
class Noise:
    """Random load with standard deviation `ratio` times that of the white noise, and its two time constants [s]."""

    ratio: float
    slow: float
    fast: float


@dataclass(frozen=True)
class Whitener:
    """Kalman gains of one Noise on one record: gain (samples, 2), weight (samples,) = 1/sqrt(innovation variance).

    Unusable samples have gain and weight 0. log_det: sum of the logarithms of the innovation variances.
    """

    a1: float
    a2: float
    gain: FloatArray
    weight: FloatArray
    log_det: float
    samples: int

    def columns(self, X: FloatArray) -> FloatArray:
        """Return the whitened columns of X (samples, columns)."""
        return _whiten(X, self.a1, self.a2, self.gain, self.weight)

    def one(self, x: FloatArray) -> FloatArray:
        """Return the whitened x (samples,)."""
        return _whiten(x.reshape(-1, 1), self.a1, self.a2, self.gain, self.weight)[:, 0]

    def adjoint(self, z: FloatArray) -> FloatArray:
        """Return the transposed whitening of z (samples,): <whitened x, z> = <x, adjoint z> for every x."""
        return _adjoint(z, self.a1, self.a2, self.gain, self.weight)

    def deviance(self, rss: float) -> float:
        """Return -2 log likelihood with the noise variance profiled out, from the whitened sum of squares."""
        return self.samples * float(np.log(max(rss, 1e-300) / self.samples)) + self.log_det


@numba.njit(cache=True)
def _gains(used, a1, a2, ratio):
    n = len(used)
    gain = np.zeros((n, 2))
    weight = np.zeros(n)
    b = 1.0 - a2
    # stationary covariance for unit variance of w, then scaled to var(l) = ratio^2
    p11 = 1.0
    p12 = a1 * b / (1.0 - a1 * a2)
    p22 = (2.0 * a2 * b * p12 + b * b) / (1.0 - a2 * a2)
    scale = ratio * ratio / p22
    p11 *= scale
    p12 *= scale
    p22 *= scale
    q = p11 * (1.0 - a1 * a1)
    log_det = 0.0
    steady = False
    g1 = g2 = s = 0.0
    for k in range(n):
        if used[k]:
            if not steady:
                s = p22 + 1.0
                new1 = p12 / s
                new2 = p22 / s
                steady = abs(new1 - g1) < 1e-11 * (1.0 + abs(g1)) and abs(new2 - g2) < 1e-11
                g1 = new1
                g2 = new2
                f11 = p11 - g1 * p12
                f12 = p12 - g1 * p22
                f22 = p22 - g2 * p22
                p11 = a1 * a1 * f11 + q
                p12 = a1 * (a2 * f12 + b * f11)
                p22 = a2 * a2 * f22 + 2.0 * a2 * b * f12 + b * b * f11
            gain[k, 0] = g1
            gain[k, 1] = g2
            weight[k] = 1.0 / np.sqrt(s)
            log_det += np.log(s)
        else:
            if steady:
                steady = False
            g1 = g2 = 0.0
            p22n = a2 * a2 * p22 + 2.0 * a2 * b * p12 + b * b * p11
            p12 = a1 * (a2 * p12 + b * p11)
            p11 = a1 * a1 * p11 + q
            p22 = p22n
    return gain, weight, log_det


@numba.njit(cache=True)
def _whiten(X, a1, a2, gain, weight):
    n, m = X.shape
    out = np.empty((n, m))
    b = 1.0 - a2
    j = 0
    while j + 4 <= m:
        wa = wb = wc = wd = la = lb = lc = ld = 0.0
        for k in range(n):
            va = X[k, j] - la
            vb = X[k, j + 1] - lb
            vc = X[k, j + 2] - lc
            vd = X[k, j + 3] - ld
            g1 = gain[k, 0]
            g2 = gain[k, 1]
            s = weight[k]
            out[k, j] = va * s
            out[k, j + 1] = vb * s
            out[k, j + 2] = vc * s
            out[k, j + 3] = vd * s
            wa += g1 * va
            wb += g1 * vb
            wc += g1 * vc
            wd += g1 * vd
            la = a2 * (la + g2 * va) + b * wa
            lb = a2 * (lb + g2 * vb) + b * wb
            lc = a2 * (lc + g2 * vc) + b * wc
            ld = a2 * (ld + g2 * vd) + b * wd
            wa *= a1
            wb *= a1
            wc *= a1
            wd *= a1
        j += 4
    while j < m:
        w = 0.0
        l = 0.0  # noqa: E741
        for k in range(n):
            v = X[k, j] - l
            out[k, j] = v * weight[k]
            w += gain[k, 0] * v
            l = a2 * (l + gain[k, 1] * v) + b * w  # noqa: E741
            w *= a1
        j += 1
    return out


@numba.njit(cache=True)
def _adjoint(z, a1, a2, gain, weight):
    n = len(z)
    out = np.empty(n)
    b = 1.0 - a2
    mw = 0.0  # sensitivities of the sum to w and l of the next sample
    ml = 0.0
    for k in range(n - 1, -1, -1):
        dw = a1 * mw + b * ml
        dl = a2 * ml
        dv = weight[k] * z[k] + gain[k, 0] * dw + gain[k, 1] * dl
        out[k] = dv
        mw = dw
        ml = dl - dv
    return out


def whitener(noise: Noise, used: NDArray[np.bool_], h: float) -> Whitener:
    """Return the whitening filter of `noise` for the samples `used` at interval h [s]."""
    a1, a2 = float(np.exp(-h / noise.slow)), float(np.exp(-h / noise.fast))
    gain, weight, log_det = _gains(used, a1, a2, noise.ratio)
    return Whitener(a1, a2, gain, weight, float(log_det), int(np.count_nonzero(used)))


def fit_noise(error: FloatArray, used: NDArray[np.bool_], h: float, first: Noise) -> Noise:
    """Return the noise of greatest likelihood for an error (samples,), searched from `first` (Nelder and Mead 1965)."""
    span = h * len(error)
    low = np.log([1e-3, 0.5 * h, 0.1 * h])
    high = np.log([1e3, SLOWEST * span, SLOWEST * span])

    def cost(x: FloatArray) -> float:
        y = np.clip(x, low, high)
        white = whitener(Noise(*np.exp(y)), used, h)
        z = white.one(error)
        return white.deviance(float(z @ z)) + 100.0 * float(np.sum((x - y) ** 2))

    x = nelder_mead(cost, np.log([first.ratio, first.slow, first.fast]), 0.4, 70)
    ratio, slow, fast = np.exp(np.clip(x, low, high))
    return Noise(float(ratio), float(max(slow, fast)), float(min(slow, fast)))


def nelder_mead(cost: Callable[[FloatArray], float], x0: FloatArray, size: float, budget: int) -> FloatArray:
    """Return the point of least cost found by a simplex of start size `size` within `budget` evaluations."""
    m = len(x0)
    X = np.vstack([x0, x0 + size * np.eye(m)])
    f = np.array([cost(x) for x in X])
    spent = m + 1
    while spent < budget:
        order = np.argsort(f, kind="stable")
        X, f = X[order], f[order]
        if f[-1] - f[0] < 0.02:
            break
        centre = X[:-1].mean(axis=0)
        reflected = centre + (centre - X[-1])
        fr = cost(reflected)
        spent += 1
        if fr < f[0]:
            wide = centre + 2.0 * (centre - X[-1])
            fw = cost(wide)
            spent += 1
            X[-1], f[-1] = (wide, fw) if fw < fr else (reflected, fr)
        elif fr < f[-2]:
            X[-1], f[-1] = reflected, fr
        else:
            near = centre + 0.5 * ((reflected if fr < f[-1] else X[-1]) - centre)
            fn = cost(near)
            spent += 1
            if fn < min(fr, f[-1]):
                X[-1], f[-1] = near, fn
            else:
                X[1:] = X[0] + 0.5 * (X[1:] - X[0])
                f[1:] = [cost(x) for x in X[1:]]
                spent += m
    best: FloatArray = X[int(np.argmin(f))]
    return best
