"""Sections 2 and 3 for the stable process: Example 2 (Fig. 5), Fig. 6, Example 4 (Figs. 8 and 9)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...results.paper import Line, Panel, PaperFigure
from ..applied import use
from ..controller import Compensator
from ..loop import Trace, trace
from ..named import load_scenarios, with_dead_band, with_seed
from ..scenario import Scenario
from .drawing import trend
from .limit_cycles import Numbers, absolute_error

LOADS = (0.1, 0.2)
GRID = tuple(k / 100.0 for k in range(11))
WINDOW = (100.0, 140.0)  # seconds over which the error after the load step is summed
DRAWS = 6  # noise draws over which Fig. 6 is averaged
GAIN = 0.04
QUIET_SPELL = (50.0, 100.0)  # seconds: only noise moves the loop
OSCILLATES = 3.0  # valve travel over that without compensator from which on it counts as oscillating


def example_2(d: float = 0.05, *, load: float = 0.2, gain: float = 0.0, seed: int = 1, noise: bool = True) -> Scenario:
    """Return Example 2: four lags, setpoint step at 0 s, load step at 100 s, compensator (9) with `gain`."""
    s = with_seed(with_dead_band(load_scenarios("example-2"), d), seed)[0]
    keep = [a for a in s.effects if a.effect.name == "backlash" or (noise and a.effect.name == "measurement_noise")]
    step = use("load_step", times=[100.0], sizes=[load])
    return replace(s, effects=(*keep, step), compensator=Compensator(gain))


def numbers() -> tuple[Numbers, list[PaperFigure]]:
    """Return our numbers of Example 2, Fig. 6 and Example 4, and their figures."""
    iae, peak = rises()
    at = GRID.index
    plain, full, less = (trace(example_2(gain=gain)) for gain in (0.0, 0.05, GAIN))
    left = mean_errors(0.05, 0.2, GAIN)[0] / mean_errors(0.0, 0.2, 0.0)[0]
    still = trace(example_2(noise=False))
    values = {
        "ex2_cycle": float(amplitude(still, (150.0, 200.0)) > 0.2 * 0.05),
        "fig6_iae": iae[0.2][at(0.05)],
        "fig6_smaller_load": float(all(x[0.1][at(d)] > x[0.2][at(d)] for x in (iae, peak) for d in (0.05, 0.1))),
        "sec1_iae": iae[0.2][at(0.1)],
        "sec1_peak": peak[0.2][at(0.1)],
        "ex4_full": float(travel(full) > OSCILLATES * travel(plain)),
        "ex4_less": float(travel(less) > OSCILLATES * travel(plain)),
        "ex4_iae": 100.0 * (left - 1.0),
    }
    figures = [
        trend("fig5", "Fig. 5: Example 2, stable process with 5 % of dead band", plain,
              "No limit cycle, but the error stays on one side for long and never settles."),
        figure_6(iae, peak, values["ex4_iae"]),
        trend("fig8", "Fig. 8: Example 4, compensator (9) with gain 0.05 = d", full,
              "The gain is too high: noise makes the valve move at every change of sign."),
        trend("fig9", "Fig. 9: Example 4, compensator (9) with gain 0.04", less,
              "u jumps, but mostly inside the gap, so the valve hardly notices."),
    ]
    return values, figures


def travel(run: Trace) -> float:
    """Return how far the valve moved in the quiet spell before the load [span]."""
    inside = (run.time >= QUIET_SPELL[0]) & (run.time < QUIET_SPELL[1])
    return float(np.sum(np.abs(np.diff(run.valve[inside]))))


def amplitude(run: Trace, window: tuple[float, float]) -> float:
    """Return half of peak to peak of the valve position within a window of seconds [span]."""
    inside = (run.time >= window[0]) & (run.time < window[1])
    return float(np.ptp(run.valve[inside]) / 2.0)


def mean_errors(d: float, load: float, gain: float) -> tuple[float, float]:
    """Return IAE [span s] and peak error [span] after the load step, mean over the noise draws."""
    runs = [trace(replace(example_2(d, load=load, gain=gain, seed=k), duration=WINDOW[1])) for k in range(DRAWS)]
    after = [run.time >= WINDOW[0] for run in runs]
    peaks = [np.max(np.abs(run.setpoint - run.process_output)[now]) for run, now in zip(runs, after, strict=True)]
    return float(np.mean([absolute_error(run, WINDOW) for run in runs])), float(np.mean(peaks))


def rises() -> tuple[dict[float, list[float]], dict[float, list[float]]]:
    """Return for each load the rise of IAE and of the peak error [%] over the dead bands of the grid."""
    iae: dict[float, list[float]] = {}
    peak: dict[float, list[float]] = {}
    for load in LOADS:
        found = [mean_errors(d, load, 0.0) for d in GRID]
        iae[load] = [100.0 * (a / found[0][0] - 1.0) for a, _ in found]
        peak[load] = [100.0 * (p / found[0][1] - 1.0) for _, p in found]
    return iae, peak


def figure_6(iae: dict[float, list[float]], peak: dict[float, list[float]], left: float) -> PaperFigure:
    d = 100.0 * np.array(GRID)
    panels = []
    for label, rise in (("IAE rise [%]", iae), ("peak error rise [%]", peak)):
        lines = [Line(f"load {100 * load:g} %", d, np.array(rise[load]), dash)
                 for load, dash in zip(LOADS, ("solid", "dash"), strict=True)]
        if rise is iae:
            lines.append(Line("load 20 %, compensated with 0.04", np.array([5.0]), np.array([left]), "dot"))
        panels.append(Panel(tuple(lines), "dead band d [%]", label))
    return PaperFigure("fig6", "Fig. 6: what dead band costs at load disturbances", tuple(panels),
                       f"Mean of {DRAWS} noise draws; error summed from {WINDOW[0]:g} to {WINDOW[1]:g} s.")
