"""Advice to a person: what a compensator would do to a loop; what would decide undecided loops, as sheets to print."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..results.advice import Course, LoopPlan, PlanOption
from ..words import WORDS
from . import figures
from .figures import EVIDENCE, GREEN, MEASUREMENT, OUTPUT, QUIET, SETPOINT, Figure, across, axis, figure, trace, written
from .figures import units as in_units
from .json_report import fields_of
from .report import Report
from .safe import entitled, shorten
from .tables import csv_table
from .words import percent

if TYPE_CHECKING:
    from ..simulator.compensation import CompensationStudy

ADVICE, TEST = WORDS["advice"]["simulated"], WORDS["advice"]["planned"]
COLUMNS = tuple(WORDS["rows"]["plan"])


def compensation(study: CompensationStudy) -> Report:
    """Return what was assumed, the table of gains, the recommendation, and the loop before and after."""
    def document() -> dict[str, Any]:
        recommended = {"gain": study.recommended, "scheme": "error-sign (9)", "hysteresis": study.hysteresis}
        k = study.controller
        told = ("loop", "output_noise", "load", "reason", "rule_gain", "refusals", "warnings")
        return {**{name: getattr(study, name) for name in told}, "process": study.process,
            "settings": {"K": k.K, "Ti": k.Ti, "Td": k.Td, "Tf": k.filter_time},
            "dead_band": {"d": study.d, "ci95": study.interval, "source": study.d_source},
            "recommended": None if study.recommended is None else recommended, "trials": study.trials, "advice": ADVICE}

    return Report("compensate", f"Backlash compensation: {shorten(study.loop, 80)}",
                  {"study": study}, document, lambda: {"gains": _gains(study), "trends": _trends(study)},
                  "Simulated; nothing was written to the control system")


def _line(run: Course, values: Sequence[float], span: tuple[float, float], name: str, colour: str, *, unit: float = 1.0,
          digits: int = 4, **more: Any) -> Figure:
    """A signal of a simulation over its time, shown in units of so many seconds."""
    return trace([round(t / unit, 3) for t in run.time], in_units(np.array(values), span, digits), name, colour, **more)


def _trends(study: CompensationStudy) -> Figure | None:
    if study.before is None:
        return None
    looks: Figure = {"hover": "%{y:.2f}", "width": 1.4, "digits": 6}
    data = [_line(study.before, study.before.setpoint, (0.0, 100.0), "setpoint", QUIET, dash="dot", **looks)]
    runs = [(study.before, "without", OUTPUT)]
    if study.after is not None:
        runs.append((study.after, f"gain {percent(study.recommended)}", MEASUREMENT))
    for run, name, colour in runs:
        for what, y, values in (("PV", "y", run.measurement), ("OP", "y2", run.output), ("valve", "y3", run.valve)):
            data.append(_line(run, values, (0.0, 100.0), f"{what}, {name}", colour, yaxis=y, **looks))
    panels = (("PV, deviation", [0.7, 1.0]), ("OP, change", [0.36, 0.64]), ("valve, change", [0.0, 0.3]))
    return figure(data, axis("time [s]"), *(axis(f"{what} [%]", domain=domain) for what, domain in panels),
                  height=620, hovermode="x")


def _gains(study: CompensationStudy) -> Figure:
    x, data = [100.0 * t.gain for t in study.trials], []
    lines = (("mean error", "iae", MEASUREMENT), ("peak error", "peak", QUIET),
             ("valve travel", "valve_travel_per_hour", EVIDENCE))
    for name, key, colour in lines:
        first = getattr(study.base, key)
        y = [getattr(t, key) / first if first > 0 else None for t in study.trials]
        data.append(trace(x, y, name, colour, mode="lines+markers", size=6, hover="%{y:.2f}"))
    marks = [(100 * study.d, "dead band", "left", QUIET, "dot")]
    if study.recommended is not None:
        marks.append((100 * study.recommended, "advice", "right", GREEN, "solid"))
    top = min(max(3.0, 1.1 * max((t.iae / study.base.iae for t in study.trials), default=1.0)), 6.0)
    return figure(
        data, axis("compensator gain [% of output span]"), axis("times the value without compensator", range=[0, top]),
        height=380, shapes=[across("x", at, colour, width=2, dash=dash) for at, _, _, colour, dash in marks],
        annotations=[written(text, at, 1.0, yref="paper", xanchor=side) for at, text, side, _, _ in marks])


def plans(found: Sequence[LoopPlan], loops: int, inputs: Sequence[str] = ()) -> Report:
    """Return every plan, its options one below the other, the ones that decide marked; a sheet for each loop. loops: so
    many were scanned. inputs: what was read."""
    told, kept = (sum(any(o.decides and o.within_limits >= w for o in p.options) for p in found) for w in (False, True))
    return Report(
        "plan", entitled("Test plans", inputs), {"plans": found, "told": told, "beyond": told - kept, "loops": loops},
        lambda: {"advice": TEST, "loops": [{**fields_of(p), "options": [*map(_option, p.options)]} for p in found]},
        lambda: {"sheets": [_sheet(p, f"sheet-{i}") for i, p in enumerate(found)]},
        "Simulated from the records; nothing was written to the control system")


def _option(option: PlanOption) -> dict[str, Any]:
    return {**fields_of(option), "decides": option.decides}


def plans_csv(found: Sequence[LoopPlan]) -> str:
    """Return a row per option."""
    return csv_table(COLUMNS, ({**fields_of(p), **_option(o), "levels": " ".join(f"{x:g}" for x in o.levels)}
                               for p in found for o in p.options))


def _sheet(plan: LoopPlan, anchor: str) -> dict[str, Any]:
    """What fits one sheet of paper: all options in words, the steps and the trend of the one to carry out; best: the
    first that decides, or what comes before any."""
    tests = [o for o in plan.options if o.move is not None]
    shown = max(tests, key=lambda o: 1.0 if o.decides else min(o.power or 0.0, o.clears or 0.0), default=None)
    return {"plan": plan, "anchor": anchor, "shown": shown, "figure": None if shown is None else _expected(plan, shown),
            "best": next((o for o in plan.options if o.decides or o.kind == "logging"), None)}


def _expected(plan: LoopPlan, option: PlanOption) -> Figure | None:
    """PV above, OP below, over minutes from the start of the test."""
    if option.worn is None or option.healthy is None:
        return None
    (pv_span, pv_unit), (op_span, op_unit) = figures.shown(plan.pv_range), figures.shown(plan.op_range)
    lines = [_line(option.worn, option.worn.setpoint, pv_span, "SP", SETPOINT, unit=60.0, dash="dot")]
    for one, name, colour in ((option.healthy, "without play", MEASUREMENT), (option.worn, "with play", EVIDENCE)):
        lines += [_line(one, one.measurement, pv_span, f"PV {name}", colour, unit=60.0),
                  _line(one, one.output, op_span, f"OP {name}", colour, unit=60.0, dash="dash", yaxis="y2")]
    return figure(lines, axis("time from the start of the test [min]"), axis(f"SP, PV [{pv_unit}]", domain=[0.48, 1.0]),
                  axis(f"OP [{op_unit}]", domain=[0.0, 0.4]), height=420, hovermode="x")
