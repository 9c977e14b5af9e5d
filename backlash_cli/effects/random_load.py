"""Random load: the process input wanders about its mean, as flows, pressures and compositions upstream do.

>>> p = EFFECT.pack(sd=0.01, time_constant=50.0)
>>> numbers = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
>>> EFFECT.apply([0.5, 0.5], p, interval=5.0, series=numbers).round(4).tolist()
[0.5095, 0.5086]
"""

from __future__ import annotations

from ..record import FloatArray
from .coloured_noise import coloured_start, coloured_step
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State of the coloured noise; then its normal numbers."""
    return coloured_start(2.0 * p[0] ** 2 * p[1], 1.0 / p[1], interval)


step = coloured_step

EFFECT = Effect(
    name="random_load",
    stage=Stage.LOAD,
    sentence="Random load: what flows into the process wanders about its mean.",
    source="First-order Gauss-Markov load at the process input, Astrom, Stochastic Control Theory (1970)",
    parameters=(
        Parameter("sd", "OP span", "standard deviation", 0.0, 0.0, 10.0),
        Parameter("time_constant", "s", "time over which it forgets", 60.0, 1e-6, 1e9),
    ),
    start=start,
    step=step,
    draws=2,
    fitted=False,
)
