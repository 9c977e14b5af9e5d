"""Sections 2 and 3 for the integrating process: Fig. 3, Example 1 (Fig. 4), Example 3 (Fig. 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...record import FloatArray
from ...results.paper import Line, Panel, PaperFigure
from ..controller import Compensator, Controller, Scheme
from ..describing_function import negative_inverse
from ..limit_cycle import limit_cycle
from ..loop import Trace, trace
from ..named import load_scenarios, with_dead_band
from ..process import Process
from ..scenario import Scenario
from .drawing import trend

D = 0.05
SIZES = (0.01, 0.02, 0.05, 0.1)
SETTLED = (60.0, 100.0)  # seconds: the setpoint step is over, the load has not come
AFTER_LOAD = (100.0, 200.0)

Numbers = dict[str, float]


def example_1(d: float = D, compensator: Compensator | None = None) -> Scenario:
    """Return Example 1: integrating process, setpoint step at 0 s, load step at 100 s."""
    s = with_dead_band(load_scenarios("example-1"), d)[0]
    return s if compensator is None else replace(s, compensator=compensator)


def cycle_of(run: Trace, window: tuple[float, float] = SETTLED) -> tuple[float, float]:
    """Return period [s] and amplitude [span] of the process output within a window of seconds."""
    inside = (run.time >= window[0]) & (run.time < window[1])
    y = run.process_output[inside] - run.setpoint[inside]
    rises = np.flatnonzero((y[:-1] < 0.0) & (y[1:] >= 0.0))
    # position of each crossing between its two samples
    at = (rises + y[rises] / (y[rises] - y[rises + 1])) * run.scenario.step
    return float(np.mean(np.diff(at))), float(np.ptp(y) / 2.0)


def absolute_error(run: Trace, window: tuple[float, float]) -> float:
    """Return IAE, the integral of |setpoint - process output| over a window of seconds [span s]."""
    inside = (run.time >= window[0]) & (run.time < window[1])
    return float(np.sum(np.abs(run.setpoint[inside] - run.process_output[inside])) * run.scenario.step)


def numbers() -> tuple[Numbers, list[PaperFigure]]:
    """Return our numbers of Fig. 3, Example 1 and Example 3, and their figures."""
    stable = load_scenarios("example-2")[0]
    s = example_1()
    predicted = limit_cycle(s.controller, s.process, D)
    assert predicted is not None  # an integrating process with integral action always has one
    runs = [trace(example_1(d)) for d in SIZES]
    cycles = [cycle_of(run) for run in runs]
    period, amplitude = cycles[SIZES.index(D)]
    shares = [a / d for (_, a), d in zip(cycles, SIZES, strict=True)]
    perfect = trace(example_1(0.0))
    compensated = trace(example_1(D, Compensator(D, Scheme.FILTERED_OUTPUT)))
    ideal, left = (absolute_error(run, AFTER_LOAD) for run in (perfect, compensated))
    values = {
        "fig3_integrating": float(predicted is not None),
        "fig3_stable": float(limit_cycle(stable.controller, stable.process, D) is not None),
        "period_spread": float(np.ptp([p for p, _ in cycles])),
        "amplitude_spread": 100.0 * float(np.ptp(shares)) / shares[SIZES.index(D)],
        "ex1_predicted_period": predicted.period,
        "ex1_predicted_u": 100.0 * predicted.amplitude_u,
        "ex1_predicted_y": 100.0 * predicted.amplitude_y,
        "ex1_period": period,
        "ex1_y": 100.0 * amplitude,
        "ex3_iae": 100.0 * (left / ideal - 1.0),
    }
    uncompensated = runs[SIZES.index(D)]
    figures = [
        nyquist(s, stable),
        scaling(runs),
        trend("fig4", "Fig. 4: Example 1, integrating process with 5 % of dead band", uncompensated,
              "The loop oscillates for ever, before and after the load step."),
        trend("fig7", "Fig. 7: Example 3, the same loop with compensator (8), gain 5 %", compensated,
              "Without noise a gain equal to the dead band takes the oscillation away."),
    ]
    return values, figures


def nyquist(integrating: Scenario, stable: Scenario) -> PaperFigure:
    """Return Fig. 3: negative inverse of the describing function and both open loops."""
    ratio = np.linspace(0.0, 1.99, 400)
    curve = negative_inverse(ratio)
    lines = [Line("-1/N, backlash", curve.real, curve.imag)]
    for name, s, dash in (("integrating process", integrating, "dash"), ("stable process", stable, "dot")):
        x, y = open_loop(s.controller, s.process)
        lines.append(Line(name, x, y, dash))
    panel = Panel(tuple(lines), "real part", "imaginary part", x_limits=(-3.0, 1.0), y_limits=(-3.0, 1.0),
                  equal_scales=True)
    return PaperFigure("fig3", "Fig. 3: limit cycle or not", (panel,), "Where the curve of the open loop crosses "
                       "that of the backlash, the loop oscillates by itself.")


def open_loop(controller: Controller, process: Process) -> tuple[FloatArray, FloatArray]:
    """Return the Nyquist curve of controller and process, real and imaginary part (points,)."""
    value = controller.response(omega := np.logspace(-1.5, 1.5, 600)) * process.response(omega)
    near = np.abs(value) < 8.0
    return value.real[near], value.imag[near]


def scaling(runs: Sequence[Trace]) -> PaperFigure:
    """Return the limit cycles for several dead bands, each divided by its d."""
    lines = []
    for run, d in zip(runs, SIZES, strict=True):
        y = run.process_output - run.setpoint
        first = int(np.argmax((run.time[:-1] >= SETTLED[0]) & (y[:-1] < 0.0) & (y[1:] >= 0.0)))
        part = slice(first, first + 2400, 10)
        lines.append(Line(f"d = {100 * d:g} %", run.time[part] - run.time[first], y[part] / d))
    return PaperFigure("scaling", "Section 2: the size of the dead band sets the amplitude, not the period",
                       (Panel(tuple(lines), "time since a crossing of the setpoint [s]", "(y - setpoint) / d"),),
                       "Divided by its dead band, every oscillation is the same curve.")
