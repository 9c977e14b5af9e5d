"""Plans as sheets to print: a loop per sheet, what to do step by step, and the trend to expect with and without."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..results.plan import Course, LoopPlan, PlanOption
from .figures import EVIDENCE, MEASUREMENT, SETPOINT, units
from .page import Cell, Section, Table, page
from .plan_text import ADVICE, KINDS, counted, headline
from .safe import shorten
from .words import duration, percent

COURSES = "One simulated course with play of the size that matters and one without."


def plan_page(plans: Sequence[LoopPlan], loops: int) -> str:
    """Return the page: what is proposed for all loops, then a sheet for each."""
    rows = [[Cell(shorten(p.loop, 80), href=f"#sheet-{i}"), percent(p.target), *_proposed(p)]
            for i, p in enumerate(plans)]
    overview = Section("What would tell", text=[counted(plans, loops), ADVICE],
                       table=Table(["Loop", "Size that matters", "Proposed", "Takes", "Finds play", "Clears"], rows))
    return page("Test plans", [overview, *(_sheet(p, f"sheet-{i}") for i, p in enumerate(plans))],
                subtitle="Simulated from the records; nothing was written to the control system")


def _proposed(plan: LoopPlan) -> list[object]:
    """The first option that decides, or what comes before any."""
    best = next((o for o in plan.options if o.decides or o.kind == "logging"), None)
    if best is None:
        return ["nothing within the limits", None, None, None]
    return [KINDS[best.kind], None if best.duration_s is None else duration(best.duration_s), _share(best.power),
            _share(best.clears)]


def _share(value: float | None) -> str | None:
    return None if value is None else percent(value, 0)


def _sheet(plan: LoopPlan, anchor: str) -> Section:
    """What fits one sheet of paper: all options in words, the steps and the trend of the one to carry out."""
    tests = [o for o in plan.options if o.move is not None]
    shown = max(tests, key=lambda o: min(o.power or 0.0, o.clears or 0.0), default=None)
    shown = next((o for o in tests if o.decides), shown)
    parts = [_part(plan, option, shown=option is shown) for option in plan.options]
    return Section(shorten(headline(plan), 160), text=[t for t in (plan.reason, plan.model) if t], parts=parts,
                   anchor=anchor)


def _part(plan: LoopPlan, option: PlanOption, *, shown: bool) -> Section:
    mark = "good" if option.decides else "warn" if option.kind == "logging" else ""
    return Section(KINDS[option.kind].capitalize() + (" (decides)" if option.decides else ""), text=[option.text],
                   table=_steps(plan, option) if shown else None, figure=_figure(plan, option) if shown else None,
                   mark=mark, note=COURSES * (shown and option.worn is not None))


def _steps(plan: LoopPlan, option: PlanOption) -> Table:
    """The steps of one round of a test, with room for what is read in each round."""
    signal, span = ("SP", plan.pv_range) if option.kind == "setpoint_steps" else ("OP", plan.op_range)
    size, hold = (option.move or 0.0) * (span[1] - span[0]), option.hold_s or 0.0
    said = [f"{signal} {level * size:+.3g} from where it stood" if level else f"{signal} to where it stood"
            for level in option.levels[: len(option.levels) // option.rounds]]
    said.append("begin again" if option.rounds > 1 else "end of the test")
    rows = [[k + 1, duration(k * hold), words, *[""] * option.rounds] for k, words in enumerate(said)]
    read = [f"PV, round {k + 1}" for k in range(option.rounds)] if option.rounds > 1 else ["PV read"]
    return Table(["Step", "After", "Set", *read], rows, sortable=False)


def _figure(plan: LoopPlan, option: PlanOption) -> dict[str, Any] | None:
    """PV above, OP below, over minutes from the start of the test."""
    if option.worn is None or option.healthy is None:
        return None
    lines = [_line(option.worn, option.worn.setpoint, plan.pv_range, "SP", SETPOINT, "", "dot")]
    for course, name, colour in ((option.healthy, "without play", MEASUREMENT), (option.worn, "with play", EVIDENCE)):
        lines += [_line(course, course.measurement, plan.pv_range, f"PV {name}", colour, ""),
                  _line(course, course.output, plan.op_range, f"OP {name}", colour, "2", "dash")]
    return {"data": lines, "layout": {
        "height": 420, "hovermode": "x", "xaxis": {"title": {"text": "time from the start of the test [min]"},
                                                   "anchor": "y2"},
        "yaxis": {"title": {"text": "SP, PV"}, "domain": [0.48, 1.0]},
        "yaxis2": {"title": {"text": "OP"}, "domain": [0.0, 0.4]}}}


def _line(course: Course, values: Sequence[float], span: tuple[float, float], name: str, colour: str, axis: str,
          dash: str = "solid") -> dict[str, Any]:
    return {"type": "scatter", "mode": "lines", "name": name, "x": [round(t / 60.0, 3) for t in course.time],
            "y": units(np.array(values), span), "yaxis": f"y{axis}", "line": {"color": colour, "width": 1.5,
                                                                              "dash": dash}}
