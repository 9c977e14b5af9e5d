"""Backlash: play between actuator and stem; after a reversal the stem waits until the command has crossed the gap.

The stem stays where it is while the command moves inside the gap d, then follows it half a gap behind:
x = u - d/2 while it is pushed up, x = u + d/2 while it is pulled down (Fig. 2 of the source).

>>> EFFECT.apply([0.5, 0.7, 0.9, 0.8, 0.6, 0.4], EFFECT.pack(d=0.2), interval=1.0).round(2).tolist()
[0.5, 0.6, 0.8, 0.8, 0.7, 0.5]

Sensor hysteresis is the same in a transmitter: the shown value rests while the true one moves inside the width w, then
follows it half a width behind, so that it shows one value while PV rises and another while it falls.

>>> p = SENSOR_HYSTERESIS.pack(w=0.02)
>>> SENSOR_HYSTERESIS.apply([0.50, 0.52, 0.54, 0.53, 0.51], p, interval=1.0).round(2).tolist()
[0.5, 0.51, 0.53, 0.53, 0.52]
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Effect, Parameter, Stage

# gaps worth trying as shares of the output's travel, beside those of usual size
WIDE_SHARES = (0.55, 0.65, 0.75, 0.85, 0.93)


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [stem position]."""
    return np.array([first + 0.5 * p[0] * p[1]])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    half = 0.5 * p[0]
    if half == 0.0:
        state[0] = value
        return value
    stem = state[0]
    if value - half > stem:
        stem = value - half
    elif value + half < stem:
        stem = value + half
    state[0] = stem
    return stem


def whole(values: FloatArray, p: FloatArray, interval: float) -> FloatArray:
    from ..kernels import play

    return np.asarray(play(values, p[0], values[0] + 0.5 * p[0] * p[1]))


def propose(clues: Clues) -> list[Values]:
    """Return gaps up to nearly the output's travel, each with the stem at either side or in the middle.

    Where the output travels little, a gap of most of its travel is told from a smaller one by a narrow valley only.
    """
    gaps, wide = np.geomspace(0.003, 0.2, 11), float(np.ptp(clues.output)) * np.array(WIDE_SHARES)
    gaps = np.concatenate([gaps[gaps < 0.8 * wide[0]], wide[(wide >= gaps[0]) & (wide <= gaps[-1])]])
    return [{"d": d, "position": place} for d in gaps.tolist() for place in (-0.7, 0.0, 0.7)]


EFFECT = Effect(
    "backlash", Stage.VALVE,
    "Play in the valve linkage: after a reversal the stem does not move until the output has crossed a gap.",
    "Haegglund, J. Process Control 17 (2007) 489, Fig. 2; play operator of Krasnosel'skii and Pokrovskii (1989)",
    (Parameter("d", "span", "dead band", 0.0, 0.0, 0.5, (0.005, 0.01, 0.02, 0.04, 0.08)),
     Parameter("position", "half gap", "stem in the gap at the start", 0.0, -1.0, 1.0, (0.0,), nuisance=True)),
    start, step,
    fitting=Fitting(
        propose=propose, rivals=("sensor_hysteresis",), whole=whole, siblings=("stiction",),
        meaning="The linkage or actuator has {d} of play: at every reversal the output travels that far before the "
        "stem moves. Check the linkage, the actuator's coupling and the positioner."))


def widths(clues: Clues) -> list[Values]:
    """Return widths from little to a third of PV's travel."""
    travel = float(np.ptp(np.quantile(clues.output, [0.01, 0.99])))
    return [{"w": float(w), "position": place} for w in travel * np.geomspace(0.01, 0.35, 7) for place in (-0.7, 0.7)]


SENSOR_HYSTERESIS = Effect(
    "sensor_hysteresis", Stage.SENSOR,
    "Hysteresis of the sensor: PV shows a change of direction only after the true value has moved some way.",
    "Hysteresis of transmitters, IEC 61298-2; play operator of Krasnosel'skii and Pokrovskii (1989)",
    (Parameter("w", "span", "width of the hysteresis", 0.0, 0.0, 0.3, (0.005, 0.02)),
     Parameter("position", "half width", "shown value at the start", 0.0, -1.0, 1.0, (0.0,), nuisance=True)),
    start, step,
    fitting=Fitting(
        propose=widths, whole=whole, seldom=True, rivals=("backlash", "stiction"),
        meaning="What is measured must turn and move {w} of span before PV shows it. Check the transmitter's linkage, "
        "float or diaphragm and its filter, and compare with a second gauge."))
