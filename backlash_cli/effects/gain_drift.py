"""Drifting gain: the same move of the valve does more and more, or less and less, as with fouling or a catalyst.

The signal's distance from `pivot` grows by `growth` per hour, counted from the first sample.

>>> p = EFFECT.pack(growth=0.5, pivot=0.4)
>>> EFFECT.apply([0.5, 0.5, 0.4], p, interval=3600.0).round(3).tolist()
[0.5, 0.55, 0.4]
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [sample number, interval in hours]."""
    return np.array([0.0, interval / 3600.0])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the signal for one sample, farther from the pivot with time."""
    hours = state[0] * state[1]
    state[0] += 1.0
    if p[0] == 0.0:
        return value
    return value + p[0] * hours * (value - p[1])


def whole(values: FloatArray, p: FloatArray, interval: float) -> FloatArray:
    """Return the signal for all samples."""
    if p[0] == 0.0:
        return values
    return values + p[0] * (interval / 3600.0) * np.arange(len(values)) * (values - p[1])


def propose(clues: Clues) -> list[Values]:
    """Return gains that change by a third to once over the record, about the mean of the output and about nothing."""
    hours = clues.duration / 3600.0
    places = (0.0, float(np.mean(clues.output)))
    return [{"growth": g / hours, "pivot": place} for g in (-0.6, -0.3, 0.3, 1.0) for place in places]


EFFECT = Effect(
    name="gain_drift",
    stage=Stage.PROCESS,
    sentence="Drifting gain: with time the same move of the valve does more, or less, as with fouling or wear.",
    source="Time-varying process gain, e.g. Astrom and Wittenmark, Adaptive Control (1995), section 1.4",
    parameters=(
        Parameter("growth", "1/h", "growth of the gain per hour, as a share", 0.0, -1e3, 1e3, (-0.1, 0.1)),
        Parameter("pivot", "OP span", "signal at which it does not show", 0.0, -2.0, 3.0, (0.0,), nuisance=True),
    ),
    start=start,
    step=step,
    fitting=Fitting(
        whole=whole,
        propose=propose,
        seldom=True,
        meaning="The gain of the process changes by {growth}. Look for fouling, a plugging filter, a catalyst that "
        "ages, or another product; retune or schedule the controller.",
    ),
)
