"""Plans as text for a terminal, as JSON and as CSV."""

from __future__ import annotations

import csv
import io
import textwrap
from collections.abc import Sequence
from typing import Any

from ..results import Verdict
from ..results.plan import LoopPlan, PlanOption
from .json_report import fields_of, header, json_text
from .safe import spreadsheet, terminal
from .words import VERDICTS

WIDTH = 100
ADVICE = ("This is advice to a person. Nothing is written to the control system; whether and when to test a valve is a "
          "decision of the people who run the plant.")
KINDS = {"wait": "wait", "setpoint_steps": "setpoint steps", "manual_test": "test in manual", "logging": "logging"}


def counted(plans: Sequence[LoopPlan], loops: int) -> str:
    """How many loops are undecided, in a sentence."""
    told = sum(any(o.decides for o in p.options) for p in plans)
    return f"{len(plans)} of {loops} loop{'s' * (loops != 1)} undecided; for {told} of them a test would tell."


def headline(plan: LoopPlan) -> str:
    """The loop, its verdict and the size that matters."""
    return f"{plan.loop}: {VERDICTS[Verdict(plan.verdict)]}; the dead band that matters is {100 * plan.target:.2g} %"


def to_text(plans: Sequence[LoopPlan], loops: int) -> str:
    """Return every plan, its options one below the other, the ones that decide marked."""
    out = []
    for plan in plans:
        out += [terminal(headline(plan)), *_filled(plan.reason, "  why: ")]
        for option in plan.options:
            out += _filled(option.text, "  * " if option.decides or option.kind == "logging" else "  - ")
        out += [*_filled(plan.model, "  "), ""]
    return "\n".join([*out, counted(plans, loops), *(_filled(ADVICE, "") if plans else [])]) + "\n"


def _filled(text: str, before: str) -> list[str]:
    return textwrap.wrap(terminal(text), WIDTH, initial_indent=before, subsequent_indent=" " * len(before))


def to_json(plans: Sequence[LoopPlan]) -> str:
    """Return the plans as a JSON document; moves are shares of the spans, times in seconds."""
    return json_text({**header(), "loops": [_loop(p) for p in plans], "advice": ADVICE})


def _loop(plan: LoopPlan) -> dict[str, Any]:
    return {"loop": plan.loop, "verdict": plan.verdict, "reason": plan.reason, "target": plan.target,
            "model": plan.model, "options": [_option(o) for o in plan.options]}


def _option(option: PlanOption) -> dict[str, Any]:
    return {**fields_of(option, "worn", "healthy"), "decides": option.decides}


def to_csv(plans: Sequence[LoopPlan]) -> str:
    """Return a row per option."""
    columns = ["loop", "verdict", "target", "kind", "decides", "power", "clears", "false_alarm", "missed", "repeats",
               "duration_s", "move", "levels", "hold_s", "op_move", "pv_move", "text"]
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for plan in plans:
        for option in plan.options:
            row = {"loop": plan.loop, "verdict": plan.verdict, "target": plan.target, **_option(option)}
            row["levels"] = " ".join(f"{x:g}" for x in option.levels)
            writer.writerow({name: spreadsheet(value) for name, value in row.items()})
    return out.getvalue()
