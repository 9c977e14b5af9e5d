"""Sensor hysteresis: the transmitter shows one value while PV rises and another while it falls.

The shown value rests while the true one moves inside the width w, then follows it half a width behind.

>>> p = EFFECT.pack(w=0.02)
>>> EFFECT.apply([0.50, 0.52, 0.54, 0.53, 0.51], p, interval=1.0).round(2).tolist()
[0.5, 0.51, 0.53, 0.53, 0.52]
"""

from __future__ import annotations

import numpy as np

from .backlash import start, step, whole
from .fitting import Clues, Fitting, Values
from .shape import Effect, Parameter, Stage


def propose(clues: Clues) -> list[Values]:
    """Return widths from little to a third of PV's travel."""
    travel = float(np.ptp(np.quantile(clues.output, [0.01, 0.99])))
    return [{"w": float(w), "position": place} for w in travel * np.geomspace(0.01, 0.35, 7) for place in (-0.7, 0.7)]


EFFECT = Effect(
    name="sensor_hysteresis",
    stage=Stage.SENSOR,
    sentence="Hysteresis of the sensor: PV shows a change of direction only after the true value has moved some way.",
    source="Hysteresis of transmitters, IEC 61298-2; play operator of Krasnosel'skii and Pokrovskii (1989)",
    parameters=(
        Parameter("w", "span", "width of the hysteresis", 0.0, 0.0, 0.3, (0.005, 0.02)),
        Parameter("position", "half width", "shown value at the start", 0.0, -1.0, 1.0, (0.0,), nuisance=True),
    ),
    start=start,
    step=step,
    fitting=Fitting(
        propose=propose,
        whole=whole,
        seldom=True,
        rivals=("backlash", "stiction"),
        meaning="What is measured must turn and move {w} of span before PV shows it. Check the transmitter's linkage, "
        "float or diaphragm and its filter, and compare with a second gauge.",
    ),
)
