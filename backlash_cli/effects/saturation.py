"""Saturation: the valve meets a stop before the end of the output's range.

>>> p = EFFECT.pack(low=0.2)
>>> EFFECT.apply([0.1, 0.3, 0.15, 0.9], p, interval=1.0).tolist()
[0.2, 0.3, 0.2, 0.9]
>>> EFFECT.apply([0.1, 0.9], EFFECT.pack(low=0.2, high=0.8), interval=1.0).tolist()
[0.2, 0.8]
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """No memory."""
    return np.empty(0)


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the position within the stops for one sample."""
    if value < p[0]:
        return p[0]
    if value > p[1]:
        return p[1]
    return value


def whole(values: FloatArray, p: FloatArray, interval: float) -> FloatArray:
    """Return the positions within the stops for all samples."""
    return np.clip(values, p[0], p[1])


def propose(clues: Clues) -> list[Values]:
    """Return stops at either side that the output passes for a small up to a large share of the time."""
    shares = (0.02, 0.06, 0.12, 0.2, 0.3, 0.45)
    low = [{"low": float(np.quantile(clues.output, share))} for share in shares]
    high = [{"high": float(np.quantile(clues.output, 1.0 - share))} for share in shares]
    return [*low, *high]


EFFECT = Effect(
    name="saturation",
    stage=Stage.VALVE,
    sentence="Valve stop: beyond a certain output the valve does not open or close any further.",
    source="Mechanical stop or limited travel; ideal saturation, e.g. Khalil, Nonlinear Systems (2002)",
    parameters=(
        Parameter("low", "span", "lower stop", -np.inf, -np.inf, np.inf, (0.1, 0.3)),
        Parameter("high", "span", "upper stop", np.inf, -np.inf, np.inf, (0.9, 0.7)),
    ),
    start=start,
    step=step,
    fitting=Fitting(
        whole=whole,
        propose=propose,
        meaning="The valve meets a stop ({low} to {high}): beyond it the output has no effect. Check the mechanical "
        "stops, the positioner's calibration and the size of the valve.",
    ),
)
