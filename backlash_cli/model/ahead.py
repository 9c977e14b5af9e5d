"""What is known about the load some time ahead: the part of a model's error that its past tells."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray
from .noise import Noise, whitener
from .noise_fit import fit_noise


def known_load(error: FloatArray, used: NDArray[np.bool_], h: float, noise: Noise, ahead: int) -> FloatArray:
    """Return the load in PV (samples,) as known `ahead` samples before, from what a model missed until then.

    error: (samples,) measured minus predicted PV, any number where not `used`. Harvey (1989), section 3.5.
    """
    white = whitener(noise, used, h)
    return _known(np.where(used, error, 0.0), white.gain, white.a1, white.a2, ahead)


def fitted_noise(error: FloatArray, used: NDArray[np.bool_], h: float) -> Noise:
    """Return the noise of greatest likelihood for the error (samples,) of a model that brings no noise of its own."""
    span = h * len(error)
    return fit_noise(np.where(used, error, 0.0), used, h, Noise(1.0, 0.03 * span, 0.003 * span))


@numba.njit(cache=True)
def _known(error, gain, a1, a2, ahead):
    n = len(error)
    b = 1.0 - a2
    w_at = np.zeros(n)
    l_at = np.zeros(n)
    out = np.zeros(n)
    w = 0.0
    l = 0.0  # noqa: E741
    p1 = a1**(ahead - 1)
    p2 = a2**(ahead - 1)
    # the lagged load `ahead - 1` steps on: l p2 + w b (p1 - p2) / (a1 - a2)
    cross = b * (ahead - 1) * a1**max(ahead - 2, 0) if abs(a1 - a2) < 1e-9 else b * (p1 - p2) / (a1 - a2)
    if ahead == 1:
        cross = 0.0
    for k in range(n):
        w_at[k] = w
        l_at[k] = l
        first = k - ahead + 1
        if first >= 0:
            out[k] = p2 * l_at[first] + cross * w_at[first]
        v = error[k] - l
        wn = w + gain[k, 0] * v
        l = a2 * (l + gain[k, 1] * v) + b * wn  # noqa: E741
        w = a1 * wn
    return out
