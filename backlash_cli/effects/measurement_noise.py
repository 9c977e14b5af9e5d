"""Measurement noise: the transmitter's random error, given by density and bandwidth.

A standard deviation alone says nothing without the time over which the noise holds: white noise of standard
deviation s held over h seconds has density s^2 h, and it is the density that a filter or a controller feels.

>>> p = EFFECT.pack(density=4e-8)
>>> EFFECT.apply([0.5, 0.5], p, interval=0.01, series=[0.0, 0.0, 0.0, 1.0, 0.0, -1.0]).round(4).tolist()
[0.502, 0.498]
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray
from .coloured_noise import coloured_start, coloured_step
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State of the coloured noise; then its normal numbers."""
    return coloured_start(p[0], p[1], interval)


step = coloured_step

EFFECT = Effect(
    name="measurement_noise",
    stage=Stage.SENSOR,
    sentence="Measurement noise: the transmitter's random error, with a density and a bandwidth.",
    source="First-order Gauss-Markov noise; density of the examples of Haegglund (2007): 0.002^2 x 0.01 s = 4e-8",
    parameters=(
        Parameter("density", "span^2 s", "two-sided density at low frequency (sd^2 x hold time)", 0.0, 0.0, 1.0),
        Parameter("bandwidth", "rad/s", "corner frequency, inf is white", np.inf, 1e-9, np.inf),
    ),
    start=start,
    step=step,
    draws=2,
    fitted=False,
)
