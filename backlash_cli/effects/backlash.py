"""Play and friction: what follows a command only after it has turned and moved some way.

Backlash: play between actuator and stem. The stem stays where it is while the command moves inside the gap d, then
follows it half a gap behind: x = u - d/2 while it is pushed up, x = u + d/2 while it is pulled down (source: Fig. 2).

>>> EFFECT.apply([0.5, 0.7, 0.9, 0.8, 0.6, 0.4], EFFECT.pack(d=0.2), interval=1.0).round(2).tolist()
[0.5, 0.6, 0.8, 0.8, 0.7, 0.5]

Stiction, Kano's two-parameter model: the stem sticks, jumps, then slides behind the command. S is the dead band plus
the stick band, J the slip jump. A resting stem holds while the command is within (S + J)/2 of it (static friction),
jumps to (S - J)/2 behind the command (moving friction) and slides there with slope 1 until the command turns or rests.
J = 0 is backlash with d = S. With restick = 1 it sticks again after every sample (He's model): a ramp makes steps of J.

>>> p = STICTION.pack(S=0.4, J=0.2, position=-1/3)
>>> STICTION.apply([0.0, 0.15, 0.25, 0.5, 0.45, 0.2, 0.05], p, interval=1.0).round(2).tolist()
[-0.1, -0.1, 0.15, 0.4, 0.4, 0.4, 0.15]

Sensor hysteresis is the same in a transmitter: the shown value rests while the true one moves inside the width w, then
follows it half a width behind, so that it shows one value while PV rises and another while it falls.

>>> p = SENSOR_HYSTERESIS.pack(w=0.02)
>>> SENSOR_HYSTERESIS.apply([0.50, 0.52, 0.54, 0.53, 0.51], p, interval=1.0).round(2).tolist()
[0.5, 0.51, 0.53, 0.53, 0.52]"""

from collections.abc import Callable

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Stage, effect

WIDE_SHARES = (0.55, 0.65, 0.75, 0.85, 0.93)  # gaps worth trying, in travels of the output, beside those of usual size
NEAR_STICTION = np.array([0.85, 0.92, 1.0])  # gaps in bands of the stiction that is known
LEAST_JUMP = 0.1  # a slip jump below this share of the band moves the stem as backlash does


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [stem position]."""
    return np.array([first + 0.5 * p[0] * p[1]])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    half = 0.5 * p[0]
    state[0] = value if half == 0.0 else min(max(state[0], value - half), value + half)
    return state[0]


def whole(values: FloatArray, p: FloatArray, interval: float) -> FloatArray:
    from ..kernels import play
    return np.asarray(play(values, p[0], values[0] + 0.5 * p[0] * p[1]))


def propose(clues: Clues) -> list[Values]:
    """Return gaps up to nearly the output's travel, each with the stem at either side or in the middle.

    Where the output travels little, a gap of most of its travel is told from a smaller one by a narrow valley only."""
    gaps, wide = np.geomspace(0.003, 0.2, 11), float(np.ptp(clues.output)) * np.array(WIDE_SHARES)
    # beside other effects the valley can be narrow: where the valve would stick is near it
    near = float(clues.known.get("stiction", {}).get("S", 0.0)) * NEAR_STICTION  # type: ignore[arg-type]
    gaps = np.concatenate([gaps[gaps < 0.8 * wide[0]], wide[(wide >= gaps[0]) & (wide <= gaps[-1])], near[near > 0.0]])
    return [{"d": d, "position": place} for d in gaps.tolist() for place in (-0.7, 0.0, 0.7)]


EFFECT = effect("backlash", Stage.VALVE, start, step, fitting=Fitting(propose=propose, rivals=("sensor_hysteresis",),
    whole=whole, siblings=("stiction",)))


def widths(clues: Clues) -> list[Values]:
    """Return widths from little to a third of PV's travel."""
    travel = float(np.ptp(np.quantile(clues.output, [0.01, 0.99])))
    return [{"w": float(w), "position": place} for w in travel * np.geomspace(0.01, 0.35, 7) for place in (-0.7, 0.7)]


SENSOR_HYSTERESIS = effect("sensor_hysteresis", Stage.SENSOR, start, step, fitting=Fitting(propose=widths,
    whole=whole, seldom=True, rivals=("backlash", "stiction")))


def stuck(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [stem position, direction of sliding (0 rests), last command]."""
    return np.array([first + 0.5 * (p[0] + p[1]) * p[2], 0.0, first])


def slip_step(state: FloatArray, value: float, p: FloatArray) -> float:
    if p[0] == 0.0 and p[1] == 0.0:
        state[0] = value
        state[2] = value
        return value
    stem, sliding = state[0], state[1]
    if p[3] != 0.0 or (value - state[2]) * sliding <= 0.0:
        sliding = 0.0
    if sliding == 0.0 and abs(value - stem) > 0.5 * (p[0] + p[1]):
        sliding = 1.0 if value > stem else -1.0
    if sliding != 0.0:
        stem = value - 0.5 * sliding * (p[0] - p[1])
    state[0], state[1], state[2] = stem, sliding, value
    return stem


def bands(clues: Clues) -> list[Values]:
    """Return bands around the dead band that fits best, in steps about as fine as the valleys of the error."""
    dead_band = float(clues.known.get("backlash", {}).get("d", 0.0))  # type: ignore[arg-type]
    sizes, shares = np.geomspace(0.006, 0.2, 30), np.geomspace(0.25, 1.0, 7)
    if dead_band > 0.0:
        # a physical valve of static friction Fs and moving friction Fc has S = Fs + Fc, J = Fs - Fc: mostly a tenth to
        # a third of S, which moves the stem much as backlash of a little less than S does
        sizes = dead_band * np.concatenate([np.geomspace(0.95, 1.35, 24), np.geomspace(1.4, 2.7, 11)])
        shares = np.geomspace(LEAST_JUMP, 1.0, 22)
    sizes = sizes[sizes < 0.8 * float(np.ptp(clues.output))]
    return [{"S": float(band), "J": float(share * band), "position": 0.0, "restick": restick}
            for band in sizes for share in shares for restick in (0.0, 1.0)]


def plausible(values: Values, travel: Callable[[float], float]) -> bool:
    """True when the slip jump is large enough to tell the valve from one with play."""
    return float(values["J"]) >= LEAST_JUMP * float(values["S"])  # type: ignore[arg-type]


STICTION = effect("stiction", Stage.VALVE, stuck, slip_step, fitting=Fitting(propose=bands, search="jumpy",
    plausible=plausible, rivals=("sensor_hysteresis",), siblings=("backlash",)))
