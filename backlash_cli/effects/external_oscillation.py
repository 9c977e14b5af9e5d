"""External oscillation: another loop or machine swings and shakes this process with it.

>>> p = EFFECT.pack(period=4.0, amplitude=0.1)
>>> EFFECT.apply([0.5, 0.5, 0.5, 0.5], p, interval=1.0).round(3).tolist()
[0.5, 0.6, 0.5, 0.4]
"""

from __future__ import annotations

import math

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [sample number, interval]."""
    return np.array([0.0, interval])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the process input with the oscillation added for one sample."""
    now = state[0] * state[1]
    state[0] += 1.0
    if p[1] == 0.0:
        return value
    return value + p[1] * math.sin(2.0 * math.pi * now / p[0] + p[2])


def propose(clues: Clues) -> list[Values]:
    """Return the periods of the strongest lines in what is missed."""
    return [{"period": period, "amplitude": 0.0, "phase": 0.0} for period in clues.periods(3)]


EFFECT = Effect(
    name="external_oscillation",
    stage=Stage.LOAD,
    sentence="External oscillation: a swing from outside the loop, with its own period, shakes the process.",
    source="Sinusoidal load at the process input, e.g. Haegglund, Control Eng. Practice 3 (1995) 1543",
    parameters=(
        Parameter("period", "s", "period of the swing", 60.0, 1e-6, 1e9, (10.0, 60.0, 300.0)),
        Parameter("amplitude", "span", "amplitude of the swing", 0.0, 0.0, 10.0, (0.01,)),
        Parameter("phase", "rad", "phase at the first sample", 0.0, -7.0, 7.0, (0.0,), nuisance=True),
    ),
    start=start,
    step=step,
    fitting=Fitting(
        linear=("amplitude",),
        phase="phase",
        dear=("period",),
        propose=propose,
        meaning="A swing with a period of {period} comes from outside this loop. Look for another loop, a pump or a "
        "compressor that swings with the same period.",
    ),
)
