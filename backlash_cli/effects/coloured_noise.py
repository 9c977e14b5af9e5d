"""Random signal with a limited bandwidth, exact for any sample interval; shared by measurement noise and random load.

dx = -b x dt + b sqrt(S) dW has corner frequency b [rad/s], variance S b / 2 and two-sided density S [span^2 s] at low
frequency. A sample is the mean of x over its interval, so what a slower process sees does not depend on the interval;
b = inf is white noise, whose mean over h has variance S / h. Given x at the start of an interval, its mean and its
end value are jointly normal with closed-form moments (Gillespie, Phys. Rev. E 54 (1996) 2084).
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray


def coloured_start(density: float, bandwidth: float, interval: float) -> FloatArray:
    """State: [place in the numbers, x, decay of x, weight of x in the mean, L11, L21, L22], then normal numbers.

    x is in standard deviations until the first sample. L is the Cholesky factor of (end value, mean) given x.
    """
    if np.isinf(bandwidth):
        return np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.sqrt(density / interval)])
    n, variance = bandwidth * interval, 0.5 * density * bandwidth
    decay = np.exp(-n)
    # the closed form cancels to nothing for short intervals; the first term of its series is exact enough there
    shape = n**3 / 3.0 if n < 1e-3 else n - 2.0 * (1.0 - decay) + 0.5 * (1.0 - decay * decay)
    end_sd = np.sqrt(variance * -np.expm1(-2.0 * n))
    shared = variance * np.expm1(-n) ** 2 / (n * end_sd) if end_sd > 0.0 else 0.0
    rest = np.sqrt(max(2.0 * variance * shape / n**2 - shared**2, 0.0))
    return np.array([0.0, np.sqrt(variance), decay, -np.expm1(-n) / n, end_sd, shared, rest])


def coloured_step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the signal with the mean of x over one sample added; p[0] = 0 switches it off."""
    if p[0] == 0.0:
        return value
    place = 7 + int(state[0])
    if place == 7:
        state[1] *= state[place]
        place += 2
    x, first, second = state[1], state[place], state[place + 1]
    state[0] = place - 5
    state[1] = state[2] * x + state[4] * first
    return value + state[3] * x + state[5] * first + state[6] * second
