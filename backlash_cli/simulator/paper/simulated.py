"""Sections 2 and 3: the integrating process (Figs. 3, 4, 7) and the stable one (Figs. 5, 6, 8, 9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...record import FloatArray, Record
from ...results import Estimate
from ...results.paper import Line, Mark, Panel, PaperFigure
from ..controller import Compensator, Controller, Scheme
from ..limit_cycle import limit_cycle, negative_inverse
from ..loop import Trace, trace
from ..process import Process
from ..scenario import Scenario, use
from ..scenario_file import load_scenarios, with_dead_band, with_seed

POINTS = 1500
D = 0.05
SIZES = (0.01, 0.02, 0.05, 0.1)
SETTLED = (60.0, 100.0)  # seconds: the setpoint step is over, the load has not come
AFTER_LOAD = (100.0, 200.0)
Numbers = dict[str, float]
LOADS = (0.1, 0.2)
GRID = tuple(k / 100.0 for k in range(11))
WINDOW = (100.0, 140.0)  # seconds over which the error after the load step is summed
DRAWS = 6  # noise draws over which Fig. 6 is averaged
GAIN = 0.04
QUIET_SPELL = (50.0, 100.0)  # seconds: only noise moves the loop
OSCILLATES = 3.0  # valve travel over that without compensator from which on it counts as oscillating


def trend(key: str, title: str, run: Trace, text: str = "", marks: Sequence[Mark] = ()) -> PaperFigure:
    """Return the two diagrams of a simulation: y and setpoint, u and valve position."""
    thin = slice(None, None, max(1, len(run.setpoint) // POINTS))
    t = run.time[thin]
    above = Panel((Line("setpoint", t, run.setpoint[thin], "dot", quiet=True), Line("y", t, run.measurement[thin])),
                  "", "y", tuple(marks))
    below = Panel((Line("valve", t, run.valve[thin], "dot", quiet=True), Line("u", t, run.output[thin])),
                  "time [s]", "u")
    return PaperFigure(key, title, (above, below), text)


def recording(key: str, title: str, record: Record, found: Sequence[Estimate], text: str = "") -> PaperFigure:
    """Return a record with its estimates [%] written where they were made; refused ones in brackets."""
    assert record.output is not None
    thin = slice(None, None, max(1, len(record) // POINTS))
    t = record.time[thin] - record.start
    top = float(np.max(record.measurement))
    marks = tuple(
        Mark(e.end - record.start, top, f"{100 * e.d:.1f}" if e.accepted else f"({100 * e.d:.1f})") for e in found
    )
    above = Panel((Line("setpoint", t, record.setpoint[thin], "dot", quiet=True),
                   Line("y", t, record.measurement[thin])), "", "y", marks)
    below = Panel((Line("u", t, record.output[thin]),), "time [s]", "u")
    return PaperFigure(key, title, (above, below), text)


def listed(found: Sequence[Estimate]) -> str:
    """Return accepted estimates in % as the paper prints them."""
    return " ".join(f"{100 * e.d:.1f}" for e in found if e.accepted)


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


def integrating_process() -> tuple[Numbers, list[PaperFigure]]:
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
    values = {"fig3_integrating": float(predicted is not None),
              "fig3_stable": float(limit_cycle(stable.controller, stable.process, D) is not None),
              "period_spread": float(np.ptp([p for p, _ in cycles])),
              "amplitude_spread": 100.0 * float(np.ptp(shares)) / shares[SIZES.index(D)],
              "ex1_predicted_period": predicted.period, "ex1_predicted_u": 100.0 * predicted.amplitude_u,
              "ex1_predicted_y": 100.0 * predicted.amplitude_y, "ex1_period": period, "ex1_y": 100.0 * amplitude,
              "ex3_iae": 100.0 * (left / ideal - 1.0)}
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


def example_2(d: float = 0.05, *, load: float = 0.2, gain: float = 0.0, seed: int = 1, noise: bool = True) -> Scenario:
    """Return Example 2: four lags, setpoint step at 0 s, load step at 100 s, compensator (9) with `gain`."""
    s = with_seed(with_dead_band(load_scenarios("example-2"), d), seed)[0]
    keep = [a for a in s.effects if a.effect.name == "backlash" or (noise and a.effect.name == "measurement_noise")]
    step = use("load_step", times=[100.0], sizes=[load])
    return replace(s, effects=(*keep, step), compensator=Compensator(gain))


def stable_process() -> tuple[Numbers, list[PaperFigure]]:
    """Return our numbers of Example 2, Fig. 6 and Example 4, and their figures."""
    iae, peak = rises()
    at = GRID.index
    plain, full, less = (trace(example_2(gain=gain)) for gain in (0.0, 0.05, GAIN))
    left = mean_errors(0.05, 0.2, GAIN)[0] / mean_errors(0.0, 0.2, 0.0)[0]
    still = trace(example_2(noise=False))
    values = {"ex2_cycle": float(amplitude(still, (150.0, 200.0)) > 0.2 * 0.05), "fig6_iae": iae[0.2][at(0.05)],
              "fig6_smaller_load": float(all(x[0.1][at(d)] > x[0.2][at(d)] for x in (iae, peak) for d in (0.05, 0.1))),
              "sec1_iae": iae[0.2][at(0.1)], "sec1_peak": peak[0.2][at(0.1)],
              "ex4_full": float(travel(full) > OSCILLATES * travel(plain)),
              "ex4_less": float(travel(less) > OSCILLATES * travel(plain)), "ex4_iae": 100.0 * (left - 1.0)}
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
