"""The linear part of the loop: delay and first-order lags driven by samples that are held between scans.

The measurement of a scan is taken before the output of the same scan acts, so x[k+1] depends on u[k] and older.
"""

from __future__ import annotations

import numba
import numpy as np

from ..record import FloatArray


@numba.njit(cache=True)
def delayed_lag(u: FloatArray, h: float, tau: float, delay: float) -> FloatArray:
    """Return how a first-order lag of time constant `tau` [s] follows the held samples u after `delay` [s].

    u: (samples,); h: sampling interval [s]. Exact for a zero-order hold, also when the delay is not a multiple of
    h. Before the first sample u is taken as constant. Formula: x[k+1] = a x[k] + (e-a) u[k-n-1] + (1-e) u[k-n]
    with delay = (n+f) h, a = exp(-h/tau), e = exp(-(1-f) h/tau) (Astrom and Wittenmark, Computer-Controlled
    Systems, section 3.2).
    """
    samples = len(u)
    whole = int(np.floor(delay / h))
    part = delay / h - whole
    a = np.exp(-h / tau)
    e = np.exp(-(1.0 - part) * h / tau)
    out = np.empty(samples)
    x = u[0]
    for k in range(samples):
        out[k] = x
        new = u[k - whole] if k >= whole else u[0]
        old = u[k - whole - 1] if k >= whole + 1 else u[0]
        x = a * x + (e - a) * old + (1.0 - e) * new
    return out


@numba.njit(cache=True)
def forgotten(samples: int, h: float, tau: float) -> FloatArray:
    """Return exp(-t/tau) at t = 0, h, 2 h ..., (samples,): how a lag forgets its start."""
    out = np.zeros(samples)
    decay = np.exp(-h / tau)
    for first in range(0, samples, 256):
        # exact again at every block, so that rounding does not add up
        now = np.exp(-h * first / tau)
        if now < 1e-300:
            break
        for k in range(first, min(first + 256, samples)):
            out[k] = now
            now *= decay
    return out


@numba.njit(cache=True)
def whitened_gains(moved, h, tau, delay, a1, a2, gain, weight, Q, rest):
    """Return by how much each moved output (rows of `moved`) would lower the whitened sum of squares, (rows,).

    Each row goes through delay, lag and whitening as one column beside the columns Q (samples, columns), which are
    orthonormal; `rest` (samples,) is what they leave. Nothing is stored, so that thousands of starts can be tried.
    """
    rows, n = moved.shape
    m = Q.shape[1]
    out = np.zeros(rows)
    whole = int(np.floor(delay / h))
    part = delay / h - whole
    a = np.exp(-h / tau)
    e = np.exp(-(1.0 - part) * h / tau)
    ca, cb = e - a, 1.0 - e
    b = 1.0 - a2
    dots = np.zeros(m)
    for r in range(rows):
        u = moved[r]
        x = u[0]
        w = 0.0
        l = 0.0  # noqa: E741
        own = 0.0
        with_rest = 0.0
        dots[:] = 0.0
        for k in range(n):
            g1 = gain[k, 0]
            v = x - l
            z = v * weight[k]
            own += z * z
            with_rest += z * rest[k]
            for j in range(m):
                dots[j] += z * Q[k, j]
            wn = w + g1 * v
            l = a2 * l + a2 * gain[k, 1] * v + b * wn  # noqa: E741
            w = a1 * wn
            new = u[k - whole] if k >= whole else u[0]
            old = u[k - whole - 1] if k >= whole + 1 else u[0]
            x = a * x + ca * old + cb * new
        new_part = own
        for j in range(m):
            new_part -= dots[j] * dots[j]
        if new_part > 1e-9 * own:
            out[r] = with_rest * with_rest / new_part
    return out
