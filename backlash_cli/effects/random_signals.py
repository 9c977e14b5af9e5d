"""Random signals with a limited bandwidth, exact for any sample interval: measurement noise and random load.

dx = -b x dt + b sqrt(S) dW has corner frequency b [rad/s], variance S b / 2 and two-sided density S [span^2 s] at low
frequency. A sample is the mean of x over its interval, so what a slower process sees does not depend on the interval;
b = inf is white noise, whose mean over h has variance S / h. Given x at the start of an interval, its mean and its
end value are jointly normal with closed-form moments (Gillespie, Phys. Rev. E 54 (1996) 2084).

Measurement noise: the transmitter's random error, given by density and bandwidth.
A standard deviation alone says nothing without the time over which the noise holds: white noise of standard
deviation s held over h seconds has density s^2 h, and it is the density that a filter or a controller feels.

>>> p = MEASUREMENT_NOISE.pack(density=4e-8)
>>> MEASUREMENT_NOISE.apply([0.5, 0.5], p, interval=0.01, series=[0.0, 0.0, 0.0, 1.0, 0.0, -1.0]).round(4).tolist()
[0.502, 0.498]

Random load: the process input wanders about its mean, as flows, pressures and compositions upstream do.

>>> p = RANDOM_LOAD.pack(sd=0.01, time_constant=50.0)
>>> numbers = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
>>> RANDOM_LOAD.apply([0.5, 0.5], p, interval=5.0, series=numbers).round(4).tolist()
[0.5095, 0.5086]
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray
from .shape import Effect, Parameter, Stage


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


MEASUREMENT_NOISE = Effect(
    "measurement_noise", Stage.SENSOR,
    "Measurement noise: the transmitter's random error, with a density and a bandwidth.",
    "First-order Gauss-Markov noise; density of the examples of Haegglund (2007): 0.002^2 x 0.01 s = 4e-8",
    (Parameter("density", "span^2 s", "two-sided density at low frequency (sd^2 x hold time)", 0.0, 0.0, 1.0),
     Parameter("bandwidth", "rad/s", "corner frequency, inf is white", np.inf, 1e-9, np.inf)),
    lambda p, interval, first: coloured_start(p[0], p[1], interval), coloured_step,
    draws=2, fitted=False)

RANDOM_LOAD = Effect(
    "random_load", Stage.LOAD,
    "Random load: what flows into the process wanders about its mean.",
    "First-order Gauss-Markov load at the process input, Astrom, Stochastic Control Theory (1970)",
    (Parameter("sd", "OP span", "standard deviation", 0.0, 0.0, 10.0),
     Parameter("time_constant", "s", "time over which it forgets", 60.0, 1e-6, 1e9)),
    lambda p, interval, first: coloured_start(2.0 * p[0] ** 2 * p[1], 1.0 / p[1], interval), coloured_step,
    draws=2, fitted=False)
