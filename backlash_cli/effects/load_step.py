"""Load steps: sudden changes at the process input that the controller must make up for.

Each size is in output span: a load step of 0.05 pushes the process like 5 % more output. Time counts from the first
sample; a step counts from the first sample at or after its time.

>>> p = EFFECT.pack(times=[2.0, 3.0], sizes=[0.5, -0.25])
>>> EFFECT.apply([0.0, 0.0, 0.0, 0.0, 0.0], p, interval=1.0).tolist()
[0.0, 0.0, 0.5, 0.25, 0.25]
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Effect, Parameter, Stage

# a step may be this many times larger than what OP travelled around it: a slow loop may not be through yet
UNANSWERED = 1.5


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [sample number, interval]."""
    return np.array([0.0, interval])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the process input with the steps added for one sample."""
    # half a nanosecond of slack: 0.3 s is the third sample of 0.1 s, whatever the floating point
    now = state[0] * state[1] + 5e-10
    state[0] += 1.0
    count = p.size // 2
    for i in range(count):
        if now >= p[i]:
            value += p[count + i]
    return value


def propose(clues: Clues) -> list[Values]:
    """Return one to five step times where steps explain most of what is missed."""
    return [{"times": times, "sizes": tuple(0.0 for _ in times)} for times in clues.step_times(5)]


def plausible(values: Values, travel: Callable[[float], float]) -> bool:
    """True when OP answered each step: the controller makes up for a load by as much output, wherever it is free to."""
    pairs = zip(np.atleast_1d(values["times"]), np.atleast_1d(values["sizes"]), strict=True)
    return all(abs(size) <= UNANSWERED * travel(float(time)) for time, size in pairs)


EFFECT = Effect(
    name="load_step",
    stage=Stage.LOAD,
    sentence="Load steps: at certain times something other than the valve pushed the process by a fixed amount.",
    source="Step load at the process input, the disturbance of Haegglund (2007), Examples 1 to 4",
    parameters=(
        Parameter("times", "s", "times of the steps from the first sample", 0.0, 0.0, 1e12, many=True),
        Parameter("sizes", "OP span", "sizes of the steps", 0.0, -10.0, 10.0, (0.02, -0.02), many=True),
    ),
    start=start,
    step=step,
    fitting=Fitting(
        linear=("sizes",),
        fixed=("times",),
        dear=("times",),
        propose=propose,
        plausible=plausible,
        meaning="At {times} something other than the valve pushed the process by {sizes}. Look at what was switched, "
        "opened or changed over at that time.",
    ),
)
