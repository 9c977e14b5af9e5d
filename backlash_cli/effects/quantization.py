"""Quantization: transmitter or recorder rounds to a step, so small changes cannot be seen.

>>> EFFECT.apply([0.500, 0.503, 0.508], EFFECT.pack(step=0.005), interval=1.0).round(3).tolist()
[0.5, 0.505, 0.51]
>>> EFFECT.apply([0.500, 0.503, 0.508], EFFECT.neutral, interval=1.0).tolist()
[0.5, 0.503, 0.508]
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """No memory."""
    return np.empty(0)


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the rounded value of one sample."""
    if p[0] == 0.0:
        return value
    return float(np.rint(value / p[0])) * p[0]


EFFECT = Effect(
    name="quantization",
    stage=Stage.SENSOR,
    sentence="Coarse recording: values are rounded to a step, so small changes are lost.",
    source="Mid-tread quantizer, e.g. Widrow and Kollar, Quantization Noise (2008)",
    parameters=(Parameter("step", "span", "smallest recorded change", 0.0, 0.0, 1.0, (0.001, 0.005, 0.02)),),
    start=start,
    step=step,
)
