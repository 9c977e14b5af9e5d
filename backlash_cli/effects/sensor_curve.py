"""Curved sensor: PV is not proportional to what is measured, for example a flow whose root was never taken.

shown = x + c x (1 - x) for a true value x within its span: c > 0 is steep at the low end, as a root is (sqrt(x) is
about c = 0.9 above a tenth of the span), c < 0 at the high end, as a square is.

>>> EFFECT.apply([0.0, 0.25, 0.5, 1.0], EFFECT.pack(curvature=0.8), interval=1.0).round(3).tolist()
[0.0, 0.4, 0.7, 1.0]
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray
from .fitting import Fitting
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """No memory."""
    return np.empty(0)


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return what the sensor shows for one sample."""
    return value + p[0] * value * (1.0 - value)


def whole(values: FloatArray, p: FloatArray, interval: float) -> FloatArray:
    """Return what the sensor shows for all samples."""
    return values + p[0] * values * (1.0 - values)


EFFECT = Effect(
    name="sensor_curve",
    stage=Stage.SENSOR,
    sentence="Curved sensor: PV is not proportional to what is measured, as where a root was not taken.",
    source="Differential pressure over an orifice goes with the square of the flow, ISO 5167-1",
    parameters=(
        Parameter("curvature", "1", "bend of the scale, 0 is straight", 0.0, -0.95, 0.95, (-0.7, -0.3, 0.3, 0.7)),
    ),
    start=start,
    step=step,
    fitting=Fitting(
        whole=whole,
        seldom=True,
        rivals=("valve_characteristic",),
        meaning="PV's scale is bent (curvature {curvature}): the loop answers differently at its ends whatever the "
        "valve does. Check root extraction, the range and the strapping table of the transmitter.",
    ),
)
