"""Unequal speed: the actuator opens at one speed and closes at another, as a spring return or a blocked vent makes it.

As `rate_limit`, with a speed of its own for each direction; the output sample is the mean position over the sample.

>>> p = EFFECT.pack(opening=0.2, closing=0.1)
>>> EFFECT.apply([0.0, 0.2, 0.2, 0.0, 0.0], p, interval=1.0).round(3).tolist()
[0.0, 0.1, 0.2, 0.15, 0.05]
"""

from __future__ import annotations

import numpy as np

from .fitting import Clues, Fitting, Values
from .rate_limit import propose as equal_speeds
from .rate_limit import start, step, whole
from .shape import Effect, Parameter, Stage


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
