"""Sections 4 to 6: the estimator on Example 2 (Figs. 10, 12 to 15), the default Kp, the industrial cases (17 to 19)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...record import Record
from ...results import Estimate
from ...results.paper import Line, Panel, PaperFigure
from ..loop import Trace, simulate, trace
from ..scenario import Manual, Scenario
from ..scenario_file import load_scenarios, with_seed
from .simulated import Numbers, example_2, listed, recording

SIZES = {"fig12": 0.01, "fig13": 0.03, "fig14": 0.05, "fig15": 0.1}
SEED = 0  # of the runs that are drawn and whose detections are counted
DRAWS = 16  # noise draws; whether a half period close to 5 Ti passes the gate moves the median of a single draw
INDUSTRIAL_DRAWS = 12
TRUE_INDUSTRIAL = 0.03
DEFAULT_KP = 1.5
STEP_LENGTH = 20.0  # seconds between the operator's steps of 1 % in the manual test
SEEN = 0.004  # change of the flow [span] that a person sees in the trend: about four times its noise

Estimator = Callable[[Record], Sequence[Estimate]]
Found = tuple[Numbers, list[PaperFigure], dict[str, str]]


def numbers(estimator: Estimator) -> Found:
    """Return our numbers of Figs. 10 to 19, their figures, and the single estimates of each figure."""
    values, figures, lists = simulated(estimator)
    more_values, more_figures, more_lists = industrial(estimator)
    kp_values, kp_figure = default_gain()
    return values | kp_values | more_values, [*figures, kp_figure, *more_figures], lists | more_lists


def simulated(estimator: Estimator) -> Found:
    """Figs. 10 and 12 to 15."""
    values: Numbers = {}
    figures, lists, below = [close_look()], {}, []
    for key, d in SIZES.items():
        records = [simulate(example_2(d, seed=SEED + k)) for k in range(DRAWS)]
        drawn = [[e for e in estimator(record) if e.accepted] for record in records]
        medians = [np.median([e.d for e in found]) for found in drawn if found]
        below += [e.d < d for found in drawn for e in found]
        record, found = records[0], drawn[0]
        values[f"{key}_median"] = 100.0 * float(np.mean(medians)) if medians else float("nan")
        values[f"{key}_count"] = float(len(found))
        lists[key] = listed(found)
        figures.append(recording(key, f"Fig. {key[3:]}: the estimator at work, d = {100 * d:g} %", record, found,
                                 f"Estimates [%] where they were made. The median below is the mean of {DRAWS} draws."))
    values["mostly_below"] = float(np.mean(below) > 0.5)
    return values, figures, lists


def close_look() -> PaperFigure:
    """Return Fig. 10: half periods of the error at 5 % of dead band, close up."""
    run = trace(example_2(0.05, seed=SEED))
    near = (run.time >= 35.0) & (run.time < 65.0)
    t = run.time[near][::5]
    above = Panel((Line("setpoint", t, run.setpoint[near][::5], "dot", quiet=True),
                   Line("y filtered", t, (run.setpoint - run.error)[near][::5])), "", "y")
    below = Panel((Line("valve", t, run.valve[near][::5], "dot", quiet=True), Line("u", t, run.output[near][::5])),
                  "time [s]", "u")
    return PaperFigure("fig10", "Fig. 10: what the estimator uses", (above, below),
                       "While u crosses the gap the valve rests and the error stays on one side.")


def default_gain() -> tuple[Numbers, PaperFigure]:
    """Return the error of d that the default Kp makes at the shortest half period, dt = 5 Ti and K = 1 (17)."""
    true = np.linspace(0.8, 4.0, 161)
    error = 100.0 * ((5.0 - 1.0 / (0.5 * DEFAULT_KP)) / (5.0 - 1.0 / (0.5 * true)) - 1.0)
    at_ends = np.interp([1.0, 3.4], true, error)
    panel = Panel((Line("error of d", true, error),), "true Kp", "error of d [%]")
    figure = PaperFigure("kp", "Section 4: how far a wrong process gain moves the estimate", (panel,),
                         "Worst case of (17): half periods of 5 Ti and a controller gain of 0.5 / Kp.")
    return {"kp_low": float(at_ends[0]), "kp_high": float(at_ends[1])}, figure


def industrial(estimator: Estimator) -> Found:
    """Figs. 17 to 19, each number over several draws of noise and load."""
    swinging, fixed = (load_scenarios(name)[0] for name in ("industrial-oscillating", "industrial-fixed"))
    swing, rest = (_over_draws(s, estimator) for s in (swinging, fixed))
    run = manual_test(fixed)
    accepted = [e for e in swing if e.accepted]
    median_swing = float(np.median([e.d for e in accepted]))
    median_rest = float(np.median([e.d for e in rest if e.accepted]))
    values = {"fig17_d": 100.0 * read_manual_test(run), "fig18_median": 100.0 * median_swing,
              "fig18_count": len(accepted) / INDUSTRIAL_DRAWS,
              "fig18_removed": 100.0 * (1.0 - len(accepted) / len(swing)),
              "fig18_largest": float(max(e.d for e in swing if not e.accepted) > 2.0 * TRUE_INDUSTRIAL),
              "fig19_median": 100.0 * median_rest, "fig19_count": sum(e.accepted for e in rest) / INDUSTRIAL_DRAWS,
              "fig19_lower": float(median_rest < median_swing)}
    records = [simulate(s) for s in (swinging, fixed)]
    found = [list(estimator(record)) for record in records]
    note = "In brackets: refused by the gate e_max < 2 dy. " + f"Numbers: {INDUSTRIAL_DRAWS} draws of noise and load."
    figures = [manual_figure(run),
               recording("fig18", "Fig. 18: pulp flow with an external, swinging setpoint", records[0], found[0], note),
               recording("fig19", "Fig. 19: pulp flow with a fixed setpoint", records[1], found[1], note)]
    return values, figures, {"fig18": listed(found[0]), "fig19": listed(found[1])}


def _over_draws(s: Scenario, estimator: Estimator) -> list[Estimate]:
    return [e for k in range(INDUSTRIAL_DRAWS) for e in estimator(simulate(with_seed((s,), k)[0]))]


def manual_test(s: Scenario) -> Trace:
    """Return the operator's test: up to 39 % to close the gap, then back in steps of 1 %."""
    levels = [0.34, 0.35, 0.36, 0.37, 0.38, 0.39, 0.38, 0.37, 0.36, 0.35, 0.34]
    spells = [Manual(k * STEP_LENGTH, (k + 1) * STEP_LENGTH, u) for k, u in enumerate(levels)]
    quiet = tuple(a for a in s.effects if a.effect.name in ("backlash", "measurement_noise"))
    process = replace(s.process, lags=s.process.lags[1:])  # the 20 s filter is not in the way of an operator's steps
    return trace(replace(s, output=0.34, manual=tuple(spells), duration=len(levels) * STEP_LENGTH, effects=quiet,
                         process=process))


def read_manual_test(run: Trace) -> float:
    """Return how far the output came back before the flow fell, as a person reads it from the trend [span]."""
    per = round(STEP_LENGTH / run.scenario.step)
    ends = np.array([np.mean(run.measurement[k * per + per // 2 : (k + 1) * per])
                     for k in range(len(run.measurement) // per)])
    outputs = run.output[per // 2 :: per]
    top = int(np.argmax(outputs))
    fell = np.flatnonzero(ends[top:] < ends[top] - SEEN)
    return float(outputs[top] - outputs[top + fell[0]]) if len(fell) else float("nan")


def manual_figure(run: Trace) -> PaperFigure:
    thin = slice(None, None, 5)
    t = run.time[thin]
    above = Panel((Line("flow", t, run.measurement[thin]),), "", "flow")
    lines = (Line("valve", t, run.valve[thin], "dot", quiet=True), Line("u", t, run.output[thin]))
    below = Panel(lines, "time [s]", "u")
    return PaperFigure("fig17", "Fig. 17: manual test of the valve", (above, below),
                       "The flow falls only after the output has come back through the gap.")
