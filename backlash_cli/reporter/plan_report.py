"""Plans as text for a terminal, as JSON and CSV, and as sheets to print: what to do step by step, what to expect."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..results.plan import Course, LoopPlan, PlanOption
from .console import screen
from .figures import EVIDENCE, MEASUREMENT, SETPOINT, Figure, axis, trace, units
from .json_report import fields_of, header, json_text, strict
from .page import page
from .tables import csv_text

ADVICE = ("This is advice to a person. Nothing is written to the control system; whether and when to test a valve is a "
          "decision of the people who run the plant.")
KINDS = {"wait": "wait", "setpoint_steps": "setpoint steps", "manual_test": "test in manual", "logging": "logging"}
COLUMNS = ("loop", "verdict", "target", "kind", "decides", "power", "clears", "false_alarm", "missed", "repeats",
           "duration_s", "move", "levels", "hold_s", "op_move", "pv_move", "text")


def to_text(plans: Sequence[LoopPlan], loops: int) -> str:
    """Return every plan, its options one below the other, the ones that decide marked."""
    return screen("plan.txt", **_content(plans, loops))


def _content(plans: Sequence[LoopPlan], loops: int) -> dict[str, Any]:
    told = sum(any(o.decides for o in p.options) for p in plans)
    return {"plans": plans, "told": told, "loops": loops, "advice": ADVICE, "kinds": KINDS}


def to_json(plans: Sequence[LoopPlan]) -> str:
    """Return the plans as a JSON document; moves are shares of the spans, times in seconds."""
    return json_text({**header(), "advice": ADVICE, "loops": [
        {**fields_of(p, "pv_range", "op_range"), "options": [_option(o) for o in p.options]} for p in plans]})


def _option(option: PlanOption) -> dict[str, Any]:
    return {**fields_of(option, "worn", "healthy"), "decides": option.decides}


def to_csv(plans: Sequence[LoopPlan]) -> str:
    """Return a row per option."""
    rows = [{**fields_of(p), **_option(o), "levels": " ".join(f"{x:g}" for x in o.levels)}
            for p in plans for o in p.options]
    return csv_text([COLUMNS, *(strict([row[name] for name in COLUMNS]) for row in rows)])


def plan_page(plans: Sequence[LoopPlan], loops: int) -> str:
    """Return the page: what is proposed for all loops, then a sheet for each."""
    return page("plan.html", "Test plans",
                subtitle="Simulated from the records; nothing was written to the control system",
                sheets=[_sheet(p, f"sheet-{i}") for i, p in enumerate(plans)], **_content(plans, loops))


def _sheet(plan: LoopPlan, anchor: str) -> dict[str, Any]:
    """What fits one sheet of paper: all options in words, the steps and the trend of the one to carry out.

    best: the first option that decides, or what comes before any.
    """
    tests = [o for o in plan.options if o.move is not None]
    shown = max(tests, key=lambda o: min(o.power or 0.0, o.clears or 0.0), default=None)
    shown = next((o for o in tests if o.decides), shown)
    return {"plan": plan, "anchor": anchor, "shown": shown, "figure": None if shown is None else _figure(plan, shown),
            "best": next((o for o in plan.options if o.decides or o.kind == "logging"), None)}


def _figure(plan: LoopPlan, option: PlanOption) -> Figure | None:
    """PV above, OP below, over minutes from the start of the test."""
    if option.worn is None or option.healthy is None:
        return None

    def line(course: Course, values: Sequence[float], span: tuple[float, float], *words: str, **more: Any) -> Figure:
        return trace([round(t / 60.0, 3) for t in course.time], units(np.array(values), span), *words, **more)

    lines = [line(option.worn, option.worn.setpoint, plan.pv_range, "SP", SETPOINT, dash="dot")]
    for one, name, colour in ((option.healthy, "without play", MEASUREMENT), (option.worn, "with play", EVIDENCE)):
        lines += [line(one, one.measurement, plan.pv_range, f"PV {name}", colour),
                  line(one, one.output, plan.op_range, f"OP {name}", colour, dash="dash", yaxis="y2")]
    return {"data": lines, "layout": {
        "height": 420, "hovermode": "x", "xaxis": axis("time from the start of the test [min]", anchor="y2"),
        "yaxis": axis("SP, PV", domain=[0.48, 1.0]), "yaxis2": axis("OP", domain=[0.0, 0.4])}}
