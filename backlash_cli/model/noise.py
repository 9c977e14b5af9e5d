"""What the model does not explain, as a random load behind two lags plus white measurement noise.

w[k+1] = a1 w[k] + v[k],  l[k+1] = a2 l[k] + (1 - a2) w[k],  error[k] = l[k] + e[k],  a = exp(-h/T).
The Kalman filter of this model whitens the error exactly, with missing samples, so that a likelihood of the
prediction error holds in closed loop too (Ljung, System Identification, chapter 4; Harvey 1989, chapter 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray


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
def stationary(a1, a2, ratio):
    """Return the covariance (p11, p12, p22) of (w, l) at rest, for a standard deviation `ratio` of l."""
    b = 1.0 - a2
    p12 = a1 * b / (1.0 - a1 * a2)
    p22 = (2.0 * a2 * b * p12 + b * b) / (1.0 - a2 * a2)
    scale = ratio * ratio / p22
    return scale, p12 * scale, p22 * scale


@numba.njit(cache=True)
def next_covariance(p11, p12, p22, a1, a2, q):
    """Return the covariance of (w, l) one sample later; q: variance that comes to w."""
    b = 1.0 - a2
    return a1 * a1 * p11 + q, a1 * (a2 * p12 + b * p11), a2 * a2 * p22 + 2.0 * a2 * b * p12 + b * b * p11


@numba.njit(cache=True)
def _gains(used, a1, a2, ratio):
    n = len(used)
    gain = np.zeros((n, 2))
    weight = np.zeros(n)
    p11, p12, p22 = stationary(a1, a2, ratio)
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
                p11, p12, p22 = next_covariance(p11 - g1 * p12, p12 - g1 * p22, p22 - g2 * p22, a1, a2, q)
            gain[k, 0] = g1
            gain[k, 1] = g2
            weight[k] = 1.0 / np.sqrt(s)
            log_det += np.log(s)
        else:
            steady = False
            g1 = g2 = 0.0
            p11, p12, p22 = next_covariance(p11, p12, p22, a1, a2, q)
    return gain, weight, log_det


@numba.njit(cache=True, fastmath={"contract"})
def _whiten(X, a1, a2, gain, weight):
    # written for the shortest way from one sample to the next: l' = (a2 - c) l + (b w + c x), w' = a1 w + e (x - l)
    n, m = X.shape
    out = np.empty((m, n)).T
    b = 1.0 - a2
    j = 0
    while j + 4 <= m:
        wa = wb = wc = wd = la = lb = lc = ld = 0.0
        for k in range(n):
            g1 = gain[k, 0]
            c = a2 * gain[k, 1] + b * g1
            rest = a2 - c
            e = a1 * g1
            s = weight[k]
            xa = X[k, j]
            xb = X[k, j + 1]
            xc = X[k, j + 2]
            xd = X[k, j + 3]
            out[k, j] = (xa - la) * s
            out[k, j + 1] = (xb - lb) * s
            out[k, j + 2] = (xc - lc) * s
            out[k, j + 3] = (xd - ld) * s
            na = rest * la + (b * wa + c * xa)
            nb = rest * lb + (b * wb + c * xb)
            nc = rest * lc + (b * wc + c * xc)
            nd = rest * ld + (b * wd + c * xd)
            wa = (a1 * wa + e * xa) - e * la
            wb = (a1 * wb + e * xb) - e * lb
            wc = (a1 * wc + e * xc) - e * lc
            wd = (a1 * wd + e * xd) - e * ld
            la = na
            lb = nb
            lc = nc
            ld = nd
        j += 4
    while j < m:
        w = 0.0
        l = 0.0  # noqa: E741
        for k in range(n):
            g1 = gain[k, 0]
            c = a2 * gain[k, 1] + b * g1
            e = a1 * g1
            x = X[k, j]
            out[k, j] = (x - l) * weight[k]
            new = (a2 - c) * l + (b * w + c * x)
            w = (a1 * w + e * x) - e * l
            l = new  # noqa: E741
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
