"""Load drift: something slow, such as fouling or weather, pushes the process further and further.

>>> p = EFFECT.pack(slope=0.36)
>>> EFFECT.apply([0.0, 0.0, 0.0], p, interval=100.0).round(3).tolist()
[0.0, 0.01, 0.02]

A drift need not be straight: `bends` are what it lies off the straight line at equally spaced times within `length`.

>>> p = EFFECT.pack(slope=0.36, length=400.0, bends=[0.1])
>>> EFFECT.apply([0.0, 0.0, 0.0, 0.0, 0.0], p, interval=100.0).round(3).tolist()
[0.0, 0.06, 0.12, 0.08, 0.04]
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Effect, Parameter, Stage


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [sample number, interval in hours, pieces of the bent line per sample]."""
    pieces = (p.size - 1) * interval / p[1] if p[1] > 0.0 else 0.0
    return np.array([0.0, interval / 3600.0, pieces])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the process input with the drift added for one sample."""
    hours = state[0] * state[1]
    place = state[0] * state[2]
    state[0] += 1.0
    if p[0] != 0.0:
        value += p[0] * hours
    piece = int(place)
    share = place - piece
    bends = p.size - 2
    # bend number piece lies at the start of this piece; both ends of the line are 0
    if 0 < piece <= bends:
        value += (1.0 - share) * p[1 + piece]
    if piece < bends:
        value += share * p[2 + piece]
    return value


def propose(clues: Clues) -> list[Values]:
    """Return a straight drift and drifts with more and more bends."""
    counts = (0, 1, 3, 5, 8)
    return [{"slope": 0.0, "length": clues.duration, "bends": (0.0,) * count} for count in counts]


def plausible(values: Values, travel: Callable[[float], float]) -> bool:
    """True when the load goes mostly one way: what wanders to and fro is a random load, not a drift."""
    length, slope, bends = values["length"], values["slope"], values["bends"]
    assert isinstance(length, float) and isinstance(slope, float) and isinstance(bends, tuple)
    net = slope * length / 3600.0
    path = np.linspace(0.0, net, len(bends) + 2) + np.array([0.0, *bends, 0.0])
    return abs(net) >= 0.5 * float(np.sum(np.abs(np.diff(path))))


EFFECT = Effect(
    name="load_drift",
    stage=Stage.LOAD,
    sentence="Load drift: a slow change pushes the process steadily in one direction.",
    source="Ramp load at the process input, e.g. Astrom and Haegglund, Advanced PID Control (2006)",
    parameters=(
        Parameter("slope", "OP span/h", "mean drift of the load", 0.0, -1e3, 1e3, (-0.02, 0.02)),
        Parameter("length", "s", "length of the record", 0.0, 0.0, 1e12, nuisance=True),
        Parameter("bends", "OP span", "lies off the straight line by", 0.0, -10.0, 10.0, many=True, nuisance=True),
    ),
    start=start,
    step=step,
    fitting=Fitting(
        linear=("slope", "bends"),
        fixed=("length",),
        propose=propose,
        plausible=plausible,
        meaning="The load drifts by {slope}: the controller has to move the valve further and further. Look for "
        "fouling, a plugging filter, a falling supply pressure or the weather.",
    ),
)
