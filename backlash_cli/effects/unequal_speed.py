"""Unequal speed: the actuator opens at one speed and closes at another, as a spring return or a blocked vent makes it.

As `rate_limit`, with a speed of its own for each direction; the output sample is the mean position over the sample.

>>> p = EFFECT.pack(opening=0.2, closing=0.1)
>>> EFFECT.apply([0.0, 0.2, 0.2, 0.0, 0.0], p, interval=1.0).round(3).tolist()
[0.0, 0.1, 0.2, 0.15, 0.05]
"""

from __future__ import annotations

import numba
import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .rate_limit import propose as equal_speeds
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [position at the start of the sample, largest rise and largest fall in one sample]."""
    return np.array([first, p[0] * interval, p[1] * interval])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the mean position over one sample."""
    position = state[0]
    move = value - position
    reach = state[1] if move > 0.0 else state[2]
    if abs(move) <= reach:
        state[0] = value
        if move == 0.0 or reach == np.inf:
            return value
        return value - move * abs(move) / (2.0 * reach)
    end = position + reach if move > 0.0 else position - reach
    state[0] = end
    return 0.5 * (position + end)


@numba.njit(cache=True)
def _moved(values: FloatArray, rise: float, fall: float) -> FloatArray:
    out = np.empty_like(values)
    position = values[0]
    for k in range(len(values)):
        move = values[k] - position
        reach = rise if move > 0.0 else fall
        if abs(move) <= reach:
            out[k] = values[k] if move == 0.0 else values[k] - move * abs(move) / (2.0 * reach)
            position = values[k]
        else:
            end = position + reach if move > 0.0 else position - reach
            out[k] = 0.5 * (position + end)
            position = end
    return out


def whole(values: FloatArray, p: FloatArray, interval: float) -> FloatArray:
    """Return the mean positions for all samples."""
    return np.asarray(_moved(values, p[0] * interval, p[1] * interval))


def propose(clues: Clues) -> list[Values]:
    """Return slow speeds one way, with the other way free or three times as fast."""
    slow = [float(v["rate"]) for v in equal_speeds(clues)]  # type: ignore[arg-type]
    both = [(a, b) for a in slow for b in (3.0 * a, 1e3 * a)]
    return [{"opening": a, "closing": b} for pair in both for a, b in (pair, pair[::-1])]


EFFECT = Effect(
    name="unequal_speed",
    stage=Stage.VALVE,
    sentence="Unequal speed: the actuator opens faster than it closes, or closes faster than it opens.",
    source="Slew limits of spring-return actuators, e.g. Smith and Corripio, Automatic Process Control (2005)",
    parameters=(
        Parameter("opening", "1/s", "largest speed upwards, spans per second", np.inf, 1e-6, np.inf, (0.005, 0.05)),
        Parameter("closing", "1/s", "largest speed downwards, spans per second", np.inf, 1e-6, np.inf, (0.05, 0.005)),
    ),
    start=start,
    step=step,
    fitting=Fitting(
        whole=whole,
        propose=propose,
        seldom=True,
        siblings=("rate_limit",),
        meaning="The actuator opens with at most {opening} and closes with at most {closing}. Check its vent, the "
        "quick exhaust, the spring and the air supply.",
    ),
)
