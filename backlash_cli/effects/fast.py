"""Effects over a whole record at once: the same numbers as their steps, without a call for each sample.

Imported by the effects only when a fit needs them.
"""

from __future__ import annotations

import numba
import numpy as np

from ..record import FloatArray


@numba.njit(cache=True)
def slew(values: FloatArray, rise: float, fall: float) -> FloatArray:
    """Return the mean position (samples,) behind a command that may rise and fall by so much per sample."""
    out = np.empty_like(values)
    position = values[0]
    for k in range(len(values)):
        value = values[k]
        move = value - position
        reach = rise if move > 0.0 else fall
        if abs(move) <= reach:
            out[k] = value if move == 0.0 else value - move * abs(move) / (2.0 * reach)
            position = value
        else:
            end = position + reach if move > 0.0 else position - reach
            out[k] = 0.5 * (position + end)
            position = end
    return out


@numba.njit(cache=True)
def mean_lag(values: FloatArray, ratio: float) -> FloatArray:
    """Return the mean in each interval of a first-order lag (samples,); ratio: interval over time constant."""
    out = np.empty_like(values)
    decay, weight = np.exp(-ratio), -np.expm1(-ratio) / ratio
    x = values[0]
    for k in range(len(values)):
        value = values[k]
        away = x - value
        out[k] = value + away * weight
        x = value + away * decay
    return out


def late(values: FloatArray, samples: float) -> FloatArray:
    """Return a signal (samples,) delayed by any number of samples; before the first it was constant."""
    whole = int(np.floor(samples + 1e-9))
    part = max(samples - whole, 0.0)
    n = len(values)
    out = np.full(n, values[0])
    if whole < n:
        out[whole:] = values[: n - whole]
    if part > 0.0 and whole + 1 < n:
        out[whole + 1 :] += part * (values[: n - whole - 1] - values[1 : n - whole])
    return out
