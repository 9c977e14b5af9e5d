"""Haegglund (2007) recomputed: every number and figure, ours beside the paper's (`published.toml`).

T. Haegglund, Automatic on-line estimation of backlash in control loops, J. Process Control 17 (2007) 489-499. Sections
2 and 3: the integrating process (Figs. 3, 4, 7) and the stable one (Figs. 5, 6, 8, 9). Sections 4 to 6: the estimator
on Example 2 (Figs. 10, 12 to 15), the default Kp, the industrial cases (Figs. 17 to 19)."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import resources
from typing import Any

import numpy as np

from ..estimator.haegglund import DEFAULT_KP, published_estimates
from ..record import BoolArray, FloatArray, Frozen, Record
from ..results import Estimate
from .controller import Compensator, Scheme
from .limit_cycle import describing_function, limit_cycle
from .loop import Trace, simulate, trace
from .scenario import Manual, Scenario, use
from .scenario_file import load_scenarios, with_dead_band, with_seed

POINTS = 1500  # of a drawn curve
QUIET = ("setpoint", "valve")  # curves drawn in grey
D, SIZES = 0.05, (0.01, 0.02, 0.05, 0.1)
SETTLED, AFTER_LOAD = (60.0, 100.0), (100.0, 200.0)  # s: the setpoint step is over, the load has not come; it has
LOADS, GRID = (0.1, 0.2), tuple(k / 100.0 for k in range(11))  # of Fig. 6
WINDOW = (100.0, 140.0)  # seconds over which the error after the load step is summed
GAIN = 0.04
QUIET_SPELL = (50.0, 100.0)  # seconds: only noise moves the loop
OSCILLATES = 3.0  # valve travel over that without compensator from which on it counts as oscillating
DETECTED = {"fig12": 0.01, "fig13": 0.03, "fig14": 0.05, "fig15": 0.1}
SEED = 0  # of the runs that are drawn and whose detections are counted
# noise draws: of Fig. 6, of Figs. 12 to 15 (a half period close to 5 Ti moves the median of one), of industrial cases
LOAD_DRAWS, DRAWS, INDUSTRIAL_DRAWS = 6, 16, 12
TRUE_INDUSTRIAL = 0.03
STEP_LENGTH = 20.0  # seconds between the operator's steps of 1 % in the manual test
SEEN = 0.004  # change of the flow [span] that a person sees in the trend: about four times its noise


class PaperRow(Frozen):
    """One number of the paper, with the tolerance within which ours must agree, and ours."""

    key: str  # name of our number
    figure: str  # the drawing it belongs to
    quantity: str
    unit: str  # "s", "%", "count" or "yes/no" (1 is yes)
    value: float
    tolerance: float
    # where we do not agree, why; and the number that we get instead (from the describing function, a closed form or an
    # independent simulation), within its own tolerance
    why: str = ""
    certified: float | None = None
    certified_tolerance: float = 0.0
    ours: float = math.nan

    @property
    def difference(self) -> float:
        """Ours minus the paper's."""
        return self.ours - self.value

    @property
    def agrees(self) -> bool:
        """True when ours lies within the row's tolerance of the paper's."""
        return bool(abs(self.difference) <= self.tolerance * (1.0 + 1e-9))


class Line(Frozen, eq=False):
    """A curve: x and y (points,)."""

    name: str
    x: FloatArray
    y: FloatArray
    dash: str = "solid"  # "dash" or "dot"
    quiet: bool = False  # drawn in grey


class Panel(Frozen):
    """One diagram."""

    lines: tuple[Line, ...]
    x_label: str
    y_label: str
    marks: tuple[tuple[float, float, str], ...] = ()  # x, y and a short text there
    square: tuple[float, float] | None = None  # visible range of both axes, which then have one scale; None: all


class PaperFigure(Frozen):
    """A figure of the paper drawn anew: panels below each other, and what to see in it."""

    key: str
    title: str
    panels: tuple[Panel, ...]
    text: str = ""
    estimates: str = ""  # [%], accepted ones, as the paper prints them


Numbers = dict[str, float]
Found = tuple[Numbers, list[PaperFigure]]
PAGE = tomllib.loads((resources.files(__package__) / "published.toml").read_text(encoding="utf-8"))
# every number of the paper with its tolerance
PUBLISHED = tuple(PaperRow(*row, **PAGE["differs"].get(row[0], {})) for row in PAGE["published"])


def reproduce() -> tuple[list[PaperRow], list[PaperFigure], dict[str, tuple[str, str]]]:
    """Recompute the paper: all rows and figures, and by key of a figure the single estimates, paper's and ours."""
    values: Numbers = {}
    figures: list[PaperFigure] = []
    for more, drawn in (integrating_process(), stable_process(), default_gain(), detections(), industrial()):
        values |= more
        figures += drawn
    order = list(PAGE["figures"])
    return ([replace(row, ours=values[row.key]) for row in PUBLISHED],
            sorted(figures, key=lambda f: order.index(f.key)),
            {f.key: (PAGE["estimates"][f.key], f.estimates) for f in figures if f.key in PAGE["estimates"]})


def figure(key: str, *panels: Panel) -> PaperFigure:
    """Return the panels under the figure's own title and words."""
    title, text = PAGE["figures"][key]
    counts = {"load_draws": LOAD_DRAWS, "draws": DRAWS, "industrial_draws": INDUSTRIAL_DRAWS}
    return PaperFigure(key, title, panels, text.format(window=WINDOW, **counts))


def diagrams(key: str, time: FloatArray, pick: Any, above: Mapping[str, FloatArray], below: Mapping[str, FloatArray],
             marks: Sequence[tuple[float, float, str]] = ()) -> PaperFigure:
    """Return two diagrams of named curves (samples,) over time, where picked: measured signals above, output below."""
    above_lines, below_lines = (tuple(Line(name, time[pick], y[pick], *(("dot", True) if name in QUIET else ()))
        for name, y in curves.items()) for curves in (above, below))
    return figure(key, Panel(above_lines, "", "flow" if "flow" in above else "y", tuple(marks)),
                  Panel(below_lines, "time [s]", "u"))


def trend(key: str, run: Trace) -> PaperFigure:
    """Return the two diagrams of a simulation: y and setpoint, u and valve position."""
    thin = slice(None, None, max(1, len(run.setpoint) // POINTS))
    return diagrams(key, run.time, thin, {"setpoint": run.setpoint, "y": run.measurement},
                    {"valve": run.valve, "u": run.output})


def recording(key: str, record: Record, found: Sequence[Estimate]) -> PaperFigure:
    """Return a record with its estimates [%] written where they were made, refused ones in brackets."""
    assert record.output is not None
    top = float(np.max(record.measurement))
    marks = [(e.end - record.start, top, f"{100 * e.d:.1f}" if e.accepted else f"({100 * e.d:.1f})") for e in found]
    drawn = diagrams(key, record.time - record.start, slice(None, None, max(1, len(record) // POINTS)),
                     {"setpoint": record.setpoint, "y": record.measurement}, {"u": record.output}, marks)
    return replace(drawn, estimates=" ".join(f"{100 * e.d:.1f}" for e in found if e.accepted))


def within(run: Trace, window: tuple[float, float]) -> BoolArray:
    """Return (samples,) True within a window of seconds."""
    return (run.time >= window[0]) & (run.time < window[1])


def example_1(d: float = D) -> Scenario:
    """Return Example 1: integrating process, setpoint step at 0 s, load step at 100 s."""
    return with_dead_band(load_scenarios("example-1"), d)[0]


def cycle_of(run: Trace) -> tuple[float, float]:
    """Return period [s] and amplitude [span] of the process output once the setpoint step is over."""
    y = (run.process_output - run.setpoint)[within(run, SETTLED)]
    rises = np.flatnonzero((y[:-1] < 0.0) & (y[1:] >= 0.0))
    # position of each crossing between its two samples
    at = (rises + y[rises] / (y[rises] - y[rises + 1])) * run.scenario.step
    return float(np.mean(np.diff(at))), float(np.ptp(y) / 2.0)


def absolute_error(run: Trace, window: tuple[float, float]) -> float:
    """Return IAE, the integral of |setpoint - process output| over a window of seconds [span s]."""
    return float(np.sum(np.abs(run.setpoint - run.process_output)[within(run, window)]) * run.scenario.step)


def integrating_process() -> Found:
    """Return our numbers of Fig. 3, Example 1 and Example 3, and their figures."""
    stable, s = load_scenarios("example-2")[0], example_1()
    predicted = limit_cycle(s.controller, s.process, D)
    assert predicted is not None  # an integrating process with integral action always has one
    runs = [trace(example_1(d)) for d in SIZES]
    cycles = [cycle_of(run) for run in runs]
    period, amplitude = cycles[SIZES.index(D)]
    shares = [a / d for (_, a), d in zip(cycles, SIZES, strict=True)]
    compensated = trace(replace(s, compensator=Compensator(D, Scheme.FILTERED_OUTPUT)))
    ideal, left = (absolute_error(run, AFTER_LOAD) for run in (trace(example_1(0.0)), compensated))
    values = {"fig3_integrating": float(predicted is not None),
              "fig3_stable": float(limit_cycle(stable.controller, stable.process, D) is not None),
              "period_spread": float(np.ptp([p for p, _ in cycles])),
              "amplitude_spread": 100.0 * float(np.ptp(shares)) / shares[SIZES.index(D)],
              "ex1_predicted_period": predicted.period, "ex1_predicted_u": 100.0 * predicted.amplitude_u,
              "ex1_predicted_y": 100.0 * predicted.amplitude_y, "ex1_period": period, "ex1_y": 100.0 * amplitude,
              "ex3_iae": 100.0 * (left / ideal - 1.0)}
    return values, [nyquist(s, stable), scaling(runs), trend("fig4", runs[SIZES.index(D)]), trend("fig7", compensated)]


def nyquist(integrating: Scenario, stable: Scenario) -> PaperFigure:
    """Return Fig. 3: negative inverse of the describing function and both open loops."""
    curve = -1.0 / describing_function(np.linspace(0.0, 1.99, 400))
    lines, omega = [Line("-1/N, backlash", curve.real, curve.imag)], np.logspace(-1.5, 1.5, 600)
    for name, s, dash in (("integrating process", integrating, "dash"), ("stable process", stable, "dot")):
        loop = s.controller.response(omega) * s.process.response(omega)
        near = loop[np.abs(loop) < 8.0]
        lines.append(Line(name, near.real, near.imag, dash))
    return figure("fig3", Panel(tuple(lines), "real part", "imaginary part", square=(-3.0, 1.0)))


def scaling(runs: Sequence[Trace]) -> PaperFigure:
    """Return the limit cycles for several dead bands, each divided by its d."""
    lines = []
    for run, d in zip(runs, SIZES, strict=True):
        y = run.process_output - run.setpoint
        first = int(np.argmax((run.time[:-1] >= SETTLED[0]) & (y[:-1] < 0.0) & (y[1:] >= 0.0)))
        part = slice(first, first + 2400, 10)
        lines.append(Line(f"d = {100 * d:g} %", run.time[part] - run.time[first], y[part] / d))
    return figure("scaling", Panel(tuple(lines), "time since a crossing of the setpoint [s]", "(y - setpoint) / d"))


def example_2(d: float = 0.05, *, load: float = 0.2, gain: float = 0.0, seed: int = 1, noise: bool = True) -> Scenario:
    """Return Example 2: four lags, setpoint step at 0 s, load step at 100 s, compensator (9) with `gain`."""
    s = with_seed(with_dead_band(load_scenarios("example-2"), d), seed)[0]
    keep = [a for a in s.effects if a.effect.name == "backlash" or (noise and a.effect.name == "measurement_noise")]
    return replace(s, effects=(*keep, use("load_step", times=[100.0], sizes=[load])), compensator=Compensator(gain))


def stable_process() -> Found:
    """Return our numbers of Example 2, Fig. 6 and Example 4, and their figures."""
    after = {load: np.array([mean_errors(d, load, 0.0) for d in GRID]) for load in LOADS}
    rise = {load: 100.0 * (found / found[0] - 1.0) for load, found in after.items()}  # of IAE and peak [%], by d
    at = GRID.index
    plain, full, less = (trace(example_2(gain=gain)) for gain in (0.0, 0.05, GAIN))
    left = 100.0 * (mean_errors(0.05, 0.2, GAIN)[0] / after[0.2][0, 0] - 1.0)
    still = trace(example_2(noise=False))
    cycles = np.ptp(still.valve[within(still, (150.0, 200.0))]) / 2.0 > 0.2 * 0.05
    travel = [float(np.sum(np.abs(np.diff(run.valve[within(run, QUIET_SPELL)])))) for run in (plain, full, less)]
    values = {"ex2_cycle": float(cycles), "fig6_iae": float(rise[0.2][at(0.05), 0]),
              "fig6_smaller_load": float(np.all((rise[0.1] > rise[0.2])[[at(0.05), at(0.1)]])),
              "sec1_iae": float(rise[0.2][at(0.1), 0]), "sec1_peak": float(rise[0.2][at(0.1), 1]),
              "ex4_full": float(travel[1] > OSCILLATES * travel[0]),
              "ex4_less": float(travel[2] > OSCILLATES * travel[0]), "ex4_iae": left}
    return values, [trend("fig5", plain), figure_6(rise, left), trend("fig8", full), trend("fig9", less)]


def mean_errors(d: float, load: float, gain: float) -> FloatArray:
    """Return IAE [span s] and peak error [span] after the load step, mean over the noise draws."""
    runs = [trace(replace(example_2(d, load=load, gain=gain, seed=k), duration=WINDOW[1])) for k in range(LOAD_DRAWS)]
    peaks = [np.max(np.abs(run.setpoint - run.process_output)[run.time >= WINDOW[0]]) for run in runs]
    return np.mean([[absolute_error(run, WINDOW), peak] for run, peak in zip(runs, peaks, strict=True)], axis=0)


def figure_6(rise: Mapping[float, FloatArray], left: float) -> PaperFigure:
    d = 100.0 * np.array(GRID)
    panels = []
    for k, label in enumerate(("IAE rise [%]", "peak error rise [%]")):
        lines = [Line(f"load {100 * load:g} %", d, rise[load][:, k], dash)
                 for load, dash in zip(LOADS, ("solid", "dash"), strict=True)]
        if k == 0:
            lines.append(Line("load 20 %, compensated with 0.04", np.array([5.0]), np.array([left]), "dot"))
        panels.append(Panel(tuple(lines), "dead band d [%]", label))
    return figure("fig6", *panels)


def detections() -> Found:
    """Return Figs. 10 and 12 to 15."""
    values: Numbers = {}
    run = trace(example_2(0.05, seed=SEED))
    near = np.flatnonzero(within(run, (35.0, 65.0)))[::5]
    figures = [diagrams("fig10", run.time, near, {"setpoint": run.setpoint, "y filtered": run.setpoint - run.error},
                        {"valve": run.valve, "u": run.output})]
    below: list[bool] = []
    for key, d in DETECTED.items():
        records = [simulate(example_2(d, seed=SEED + k)) for k in range(DRAWS)]
        drawn = [[e for e in published_estimates(record) if e.accepted] for record in records]
        medians = [np.median([e.d for e in found]) for found in drawn if found]
        below += [e.d < d for found in drawn for e in found]
        values[f"{key}_median"] = 100.0 * float(np.mean(medians)) if medians else float("nan")
        values[f"{key}_count"] = float(len(drawn[0]))
        figures.append(recording(key, records[0], drawn[0]))
    return {**values, "mostly_below": float(np.mean(below) > 0.5)}, figures


def default_gain() -> Found:
    """Return the error of d that the default Kp makes at the shortest half period, dt = 5 Ti and K = 1 (17)."""
    true = np.linspace(0.8, 4.0, 161)
    error = 100.0 * ((5.0 - 1.0 / (0.5 * DEFAULT_KP)) / (5.0 - 1.0 / (0.5 * true)) - 1.0)
    at_ends = np.interp([1.0, 3.4], true, error)
    panel = Panel((Line("error of d", true, error),), "true Kp", "error of d [%]")
    return {"kp_low": float(at_ends[0]), "kp_high": float(at_ends[1])}, [figure("kp", panel)]


def industrial() -> Found:
    """Return Figs. 17 to 19, each number over several draws of noise and load."""
    swinging, fixed = (load_scenarios(name)[0] for name in ("industrial-oscillating", "industrial-fixed"))
    swing, rest = ([e for k in range(INDUSTRIAL_DRAWS) for e in published_estimates(simulate(with_seed((s,), k)[0]))]
                   for s in (swinging, fixed))
    accepted, calm = ([e.d for e in found if e.accepted] for found in (swing, rest))
    values = {"fig18_median": 100.0 * float(np.median(accepted)), "fig18_count": len(accepted) / INDUSTRIAL_DRAWS,
              "fig18_removed": 100.0 * (1.0 - len(accepted) / len(swing)),
              "fig18_largest": float(max(e.d for e in swing if not e.accepted) > 2.0 * TRUE_INDUSTRIAL),
              "fig19_median": 100.0 * float(np.median(calm)), "fig19_count": len(calm) / INDUSTRIAL_DRAWS,
              "fig19_lower": float(np.median(calm) < np.median(accepted))}
    run = manual_test(fixed)
    figures = [diagrams("fig17", run.time, slice(None, None, 5), {"flow": run.measurement},
                        {"valve": run.valve, "u": run.output})]
    for key, s in (("fig18", swinging), ("fig19", fixed)):
        figures.append(recording(key, record := simulate(s), published_estimates(record)))
    return {**values, "fig17_d": 100.0 * read_manual_test(run)}, figures


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
    ends = run.measurement[: len(run.measurement) // per * per].reshape(-1, per)[:, per // 2 :].mean(axis=1)
    outputs = run.output[per // 2 :: per]
    top = int(np.argmax(outputs))
    fell = np.flatnonzero(ends[top:] < ends[top] - SEEN)
    return float(outputs[top] - outputs[top + fell[0]]) if len(fell) else float("nan")
