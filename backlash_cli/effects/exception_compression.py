"""Exception compression: the recorder keeps the old value until the signal has moved by more than a deviation.

The step holds the last value that was kept. A historian that draws straight lines between kept values instead is
`simulator.recorder.draw_lines`, which needs the next kept value and therefore the whole record.

>>> p = EFFECT.pack(deviation=0.01)
>>> EFFECT.apply([0.5, 0.505, 0.511, 0.515, 0.5], p, interval=1.0).tolist()
[0.5, 0.5, 0.511, 0.511, 0.5]
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .quantization import held_bounds, recorded_steps
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [value kept last]; nothing has been kept before the first sample."""
    return np.array([np.inf])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return what the recorder shows for one sample."""
    if p[0] == 0.0 or abs(value - state[0]) > p[0]:
        state[0] = value
        return value
    return state[0]


def propose(clues: Clues) -> list[Values]:
    """Return the deviation that the reports show: none of them is smaller."""
    deviation, how = recorded_steps(clues)
    return [{"deviation": deviation}] if how == "reported" else []


EFFECT = Effect(
    name="exception_compression",
    stage=Stage.SENSOR,
    sentence="Exception reporting: the recorder repeats the old value until the signal has moved far enough.",
    source="Exception test of plant historians: report when the change exceeds a deviation",
    parameters=(Parameter("deviation", "span", "change below which nothing is recorded", 0.0, 0.0, 1.0),),
    start=start,
    step=step,
    fitting=Fitting(
        propose=propose,
        fixed=("deviation",),
        bounds=held_bounds,
        meaning="PV is recorded only when it has moved by {deviation}: what is smaller cannot be seen. Set the "
        "historian's exception deviation to a fraction of the noise, or store every sample for a day.",
    ),
)
