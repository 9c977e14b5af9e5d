"""The linear part of the loop: delay and first-order lags driven by samples that are held between scans.

The measurement of a scan is taken before the output of the same scan acts, so x[k+1] depends on u[k] and older.
"""

from __future__ import annotations

import numpy as np

from .. import kernels
from ..record import FloatArray


def delayed_lag(u: FloatArray, h: float, tau: float, delay: float) -> FloatArray:
    """Return how a first-order lag of time constant `tau` [s] follows the held samples u after `delay` [s].

    u: (samples,); h: sampling interval [s]. Exact for a zero-order hold, also when the delay is not a multiple of
    h. Before the first sample u is taken as constant. Formula: x[k+1] = a x[k] + (e-a) u[k-n-1] + (1-e) u[k-n]
    with delay = (n+f) h, a = exp(-h/tau), e = exp(-(1-f) h/tau) (Astrom and Wittenmark, Computer-Controlled
    Systems, section 3.2).
    """
    whole = int(delay / h)
    a, e = float(np.exp(-h / tau)), float(np.exp(-(1.0 - (delay / h - whole)) * h / tau))
    followed: FloatArray = kernels.lag(u, a, e - a, 1.0 - e, whole)
    return followed


def lag_transposed(z: FloatArray, h: float, tau: float) -> FloatArray:
    """Return the transposed lag of z (samples,): <lagged u, z> = <u, lag_transposed z> for u that starts at 0."""
    return delayed_lag(np.append(0.0, z[::-1]), h, tau, 0.0)[:0:-1]


def forgotten(samples: int, h: float, tau: float) -> FloatArray:
    """Return exp(-t/tau) at t = 0, h, 2 h ..., (samples,): how a lag forgets its start."""
    out = np.zeros(samples)
    # after 40 time constants nothing is left that a float could tell from 0
    some = min(samples, int(40.0 * tau / h) + 1)
    out[:some] = np.exp(-h / tau * np.arange(some))
    return out
