"""Valve characteristic: the flow through the valve is not proportional to its travel.

flow = (exp(c x) - 1) / (exp(c) - 1) maps travel 0..1 to flow 0..1. The slope grows or falls by exp(c) over the
travel: c > 0 is equal percentage with rangeability R = exp(c), c < 0 is quick opening, c = 0 is linear. In series
with a pipe the flow becomes q / sqrt(a + (1 - a) q^2), a the share of the pressure drop over the open valve.

>>> p = EFFECT.pack(curvature=3.0)
>>> EFFECT.apply([0.0, 0.5, 1.0], p, interval=1.0).round(3).tolist()
[0.0, 0.182, 1.0]
>>> EFFECT.apply([0.0, 0.5, 1.0], EFFECT.pack(curvature=-3.0), interval=1.0).round(3).tolist()
[0.0, 0.818, 1.0]
"""

from __future__ import annotations

import math

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """No memory."""
    return np.empty(0)


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the flow for one sample of travel."""
    flow = value if p[0] == 0.0 else math.expm1(p[0] * value) / math.expm1(p[0])
    if p[1] == 1.0:
        return flow
    return flow / math.sqrt(p[1] + (1.0 - p[1]) * flow * flow)


def whole(values: FloatArray, p: FloatArray, interval: float) -> FloatArray:
    """Return the flow for all samples."""
    flow = values if p[0] == 0.0 else np.expm1(p[0] * values) / math.expm1(p[0])
    return flow if p[1] == 1.0 else flow / np.sqrt(p[1] + (1.0 - p[1]) * flow * flow)


def propose(clues: Clues) -> list[Values]:
    """Return gentle to strong curves, bent either way, and linear valves with little to much pipe in series."""
    curved = [{"curvature": c} for c in (-4.0, -2.0, -0.8, 0.8, 2.0, 4.0)]
    return [*curved, *({"authority": a} for a in (0.1, 0.3, 0.6))]


EFFECT = Effect(
    name="valve_characteristic",
    stage=Stage.VALVE,
    sentence="Curved valve characteristic: the gain from output to flow changes with the opening.",
    source="Equal percentage dq/dx = ln(R) q, IEC 60534-2-4, shifted through 0; quick opening mirrors it",
    parameters=(
        Parameter("curvature", "1", "ln of slope at full over slope at closed", 0.0, -6.0, 6.0, (-2.0, -1.0, 1.0, 2.0)),
        Parameter("authority", "1", "share of the pressure drop over the open valve", 1.0, 0.02, 1.0, (0.2,)),
    ),
    start=start,
    step=step,
    fitting=Fitting(
        whole=whole,
        propose=propose,
        rivals=("sensor_curve",),
        meaning="The gain changes with the opening (curvature {curvature}): the loop is tuned right at one end only. "
        "Linearise it with a characteriser in the controller or positioner, or schedule the gain.",
    ),
)
