"""Measured disturbance: a further recorded signal pushes the process.

The column's samples follow the state, in its own units; `gain` turns them into output span.

>>> p = EFFECT.pack(gain=0.01)
>>> EFFECT.apply([0.5, 0.5, 0.5], p, interval=1.0, series=[0.0, 10.0, -10.0]).tolist()
[0.5, 0.6, 0.4]
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [sample number], then the samples of the column."""
    return np.array([0.0])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the process input with the disturbance added for one sample."""
    k = int(state[0])
    state[0] += 1.0
    if p[0] == 0.0:
        return value
    return value + p[0] * state[1 + k]


def propose(clues: Clues) -> list[Values]:
    """Return the one start that a linear effect needs."""
    return [{"gain": 0.0}]


EFFECT = Effect(
    name="measured_disturbance",
    stage=Stage.LOAD,
    sentence="Measured disturbance: another recorded signal, such as a feed flow or a pressure, pushes the process.",
    source="Additive load at the process input, linear in a measured signal (the model behind feedforward control)",
    parameters=(Parameter("gain", "OP span per column unit", "how strongly the column pushes", 0.0, -1e9, 1e9),),
    start=start,
    step=step,
    column=True,
    fitting=Fitting(
        linear=("gain",),
        propose=propose,
        meaning="The measured column pushes the process by {gain}. Feedforward from this column would take it away.",
    ),
)
