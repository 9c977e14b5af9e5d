"""Stiction: the stem sticks until the command is far enough away, jumps, then slides behind the command.

Kano's two-parameter model. S is the dead band plus the stick band, J the slip jump. A resting stem holds while the
command is within (S + J)/2 of it (static friction), jumps to (S - J)/2 behind the command (moving friction) and
slides there with slope 1 until the command turns or rests. J = 0 is backlash with d = S. With restick = 1 the stem
sticks again after every sample (He's model), so a ramp makes a staircase of steps J.

>>> p = EFFECT.pack(S=0.4, J=0.2, position=-1/3)
>>> EFFECT.apply([0.0, 0.15, 0.25, 0.5, 0.45, 0.2, 0.05], p, interval=1.0).round(2).tolist()
[-0.1, -0.1, 0.15, 0.4, 0.4, 0.4, 0.15]
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Effect, Parameter, Stage

# a slip jump below this share of the band moves the stem as backlash does
LEAST_JUMP = 0.1


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [stem position, direction of sliding (0 rests), last command]."""
    return np.array([first + 0.5 * (p[0] + p[1]) * p[2], 0.0, first])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    if p[0] == 0.0 and p[1] == 0.0:
        state[0] = value
        state[2] = value
        return value
    stem, sliding = state[0], state[1]
    if p[3] != 0.0 or (value - state[2]) * sliding <= 0.0:
        sliding = 0.0
    hold = 0.5 * (p[0] + p[1])
    if sliding == 0.0:
        if value - stem > hold:
            sliding = 1.0
        elif stem - value > hold:
            sliding = -1.0
    if sliding != 0.0:
        stem = value - 0.5 * sliding * (p[0] - p[1])
    state[0], state[1], state[2] = stem, sliding, value
    return stem


def propose(clues: Clues) -> list[Values]:
    """Return bands around the dead band that fits best, in steps about as fine as the valleys of the error."""
    dead_band = float(clues.known.get("backlash", {}).get("d", 0.0))  # type: ignore[arg-type]
    bands, shares = np.geomspace(0.006, 0.2, 30), np.geomspace(0.25, 1.0, 7)
    if dead_band > 0.0:
        # a physical valve of static friction Fs and moving friction Fc has S = Fs + Fc, J = Fs - Fc: mostly a tenth to
        # a third of S, which moves the stem much as backlash of a little less than S does
        bands = dead_band * np.concatenate([np.geomspace(0.95, 1.35, 24), np.geomspace(1.4, 2.7, 11)])
        shares = np.geomspace(LEAST_JUMP, 1.0, 22)
    bands = bands[bands < 0.8 * float(np.ptp(clues.output))]
    return [{"S": float(band), "J": float(share * band), "position": 0.0, "restick": restick}
            for band in bands for share in shares for restick in (0.0, 1.0)]


def plausible(values: Values, travel: Callable[[float], float]) -> bool:
    """True when the slip jump is large enough to tell the valve from one with play."""
    return float(values["J"]) >= LEAST_JUMP * float(values["S"])  # type: ignore[arg-type]


EFFECT = Effect(
    "stiction", Stage.VALVE,
    "Sticky packing: the stem stays stuck, then jumps and slides, so corrections come late and too large.",
    "Kano et al., IFAC DYCOPS, Cambridge MA (2004); restick: He et al., Ind. Eng. Chem. Res. 46 (2007)",
    (Parameter("S", "span", "dead band plus stick band", 0.0, 0.0, 0.5, (0.01, 0.02, 0.05)),
     Parameter("J", "span", "slip jump", 0.0, 0.0, 0.5, (0.005, 0.01, 0.03)),
     Parameter("position", "half band", "place of the stem at the start", 0.0, -1.0, 1.0, (0.0,), nuisance=True),
     Parameter("restick", "0 or 1", "1: sticks again after each sample", 0.0, 0.0, 1.0, choices=(0.0, 1.0))),
    start, step,
    fitting=Fitting(
        propose=propose, search="jumpy", plausible=plausible, rivals=("sensor_hysteresis",), siblings=("backlash",),
        meaning="The valve sticks: the output must move {S} before the stem moves, and then it jumps by {J}. "
        "Check the packing, the seat and the actuator's size."))
