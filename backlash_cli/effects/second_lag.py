"""Second lag: a further first-order lag in series, for example a thermowell, an actuator or a filter.

dx/dt = (u - x) / tau2 with u held over the sample. The output sample is the mean of x over the interval, so that a
lag behind it sees the right area.

>>> p = EFFECT.pack(tau2=2.0)
>>> EFFECT.apply([0.0, 1.0, 1.0, 1.0], p, interval=1.0).round(4).tolist()
[0.0, 0.2131, 0.5227, 0.7105]
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [x at the start of the sample, decay over one sample, mean weight of the old x]."""
    ratio = interval / p[0] if p[0] > 0.0 else np.inf
    return np.array([first, np.exp(-ratio), -np.expm1(-ratio) / ratio])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the mean of the lagged signal over one sample."""
    away = state[0] - value
    if p[0] == 0.0 or away == 0.0:
        state[0] = value
        return value
    state[0] = value + away * state[1]
    return value + away * state[2]


def whole(values: FloatArray, p: FloatArray, interval: float) -> FloatArray:
    """Return the lagged signal for all samples."""
    from ..kernels import lag

    if p[0] == 0.0:
        return values
    ratio = interval / p[0]
    decay = np.exp(-ratio)
    # its mean over each sample, from where it stands at the sample's start
    return values - np.expm1(-ratio) / ratio * (np.asarray(lag(values, decay, 0.0, 1.0 - decay, 0)) - values)


def propose(clues: Clues) -> list[Values]:
    """Return further lags from a tenth of the process lag up to the same size."""
    return [{"tau2": share * clues.lag} for share in (0.1, 0.25, 0.5, 0.9)]


EFFECT = Effect(
    name="second_lag",
    stage=Stage.PROCESS,
    sentence="Second lag: the process has a further time constant that makes its answer start slowly.",
    source="First-order lag 1/(1 + s tau2), exact for held input (Astrom and Wittenmark 1997)",
    parameters=(Parameter("tau2", "s", "time constant of the second lag", 0.0, 0.0, 1e6, (1.0, 5.0, 20.0, 60.0)),),
    start=start,
    step=step,
    fitting=Fitting(
        whole=whole,
        propose=propose,
        on_loads=True,
        siblings=("dead_time",),
        meaning="The process has a second lag of {tau2}, for example a thermowell, a heavy filter or the actuator. "
        "Derivative action or faster hardware helps.",
    ),
)
