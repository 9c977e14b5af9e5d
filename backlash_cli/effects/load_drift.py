"""Load drift: something slow, such as fouling or weather, pushes the process further and further.

>>> p = EFFECT.pack(slope=0.36)
>>> EFFECT.apply([0.0, 0.0, 0.0], p, interval=100.0).round(3).tolist()
[0.0, 0.01, 0.02]
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [sample number, interval in hours]."""
    return np.array([0.0, interval / 3600.0])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the process input with the drift added for one sample."""
    hours = state[0] * state[1]
    state[0] += 1.0
    if p[0] == 0.0:
        return value
    return value + p[0] * hours


EFFECT = Effect(
    name="load_drift",
    stage=Stage.LOAD,
    sentence="Load drift: a slow change pushes the process steadily in one direction.",
    source="Ramp load at the process input, e.g. Astrom and Haegglund, Advanced PID Control (2006)",
    parameters=(Parameter("slope", "OP span/h", "drift of the load", 0.0, -1e3, 1e3, (-0.02, 0.02)),),
    start=start,
    step=step,
)
