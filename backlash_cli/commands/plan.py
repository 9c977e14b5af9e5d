"""backlash plan: for every loop that a scan leaves undecided, the least that would decide it."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from . import options
from .options import Export
from .terminal import progress, put, say_failures, several

if TYPE_CHECKING:
    from ..plan import Move
    from ..results.plan import LoopPlan

FORMATS = {".json": "json", ".csv": "csv", ".html": "html", ".htm": "html"}


@click.command(short_help="Work out the least that would decide each undecided loop.",
               epilog="\b\nExamples:\n  backlash plan sample_data/plant.csv --loop TIC207\n"
               "  backlash plan sample_data/plant.csv --target 2% --max-pv-move 5% --format html --output sheets.html")
@click.option("--target", metavar="SIZE",
              help="Dead band that matters, in spans of the output (0.02 or 2%). Default: what this record could have "
              "shown (its limit of detection, 2 % at most), else 2 %.")
@click.option("--max-pv-move", metavar="X", default="10%",
              help="How far a test may move PV: units of the loop, or a share of its span (5%). Default: 10%.")
@click.option("--max-op-move", metavar="X", default="10%", help="The same for OP. Default: 10%.")
@click.option("--format", "form", metavar="FORMAT", type=click.Choice(["text", "json", "csv", "html"]),
              help="text, json, csv or html (a sheet per loop, to print). Default: after the suffix of --output, else "
              "text.")
@options.output("Write the plans here.")
@click.option("--repeats", metavar="N", type=click.IntRange(min=2), default=100,
              help="Simulated repeats of each candidate with a worn and with a healthy valve. Default: 100.")
@click.option("--seed", metavar="N", type=click.IntRange(min=0), default=0, help="Another number draws other repeats.")
@options.JOBS
@click.option("--no-cache", is_flag=True, help="Make the plans anew, also where the same were made before.")
@options.export(options.ONLY_LOOPS)
def plan(target: str | None, max_pv_move: str, max_op_move: str, form: str | None, output: Path | None, repeats: int,
         seed: int, jobs: int | None, no_cache: bool, **given: Any) -> int:
    """Work out the least that would decide each undecided loop, by simulating the loop with a worn and a healthy valve.

    Candidates are waiting, setpoint steps in automatic, steps of the output in manual, and better logging; each comes
    with its chance. A plan is advice to a person; nothing is written to the control system.
    """
    from ..engines.local import answers
    from ..engines.plan import kept_plan
    from ..plan import PlanOptions
    from ..record import Note
    from ..reporter import advice

    moves = _move(max_pv_move, "--max-pv-move"), _move(max_op_move, "--max-op-move")
    wanted = PlanOptions(options.dead_band(target, "--target"), *moves, repeats, seed)
    form = form or FORMATS.get(output.suffix.lower() if output else "", "text")
    plant = Export.of(given).read()
    plans: list[LoopPlan] = []
    failures = [note.message for note in plant.failures]
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "backlash" / "plans"
    with progress("planning", len(plant), stopped="loops were planned; no plan was written") as step:
        work = partial(kept_plan, options=wanted, folder=None if no_cache else folder)
        for found in answers(plant.records, work, jobs=jobs):
            if isinstance(found, Note):
                failures.append(found.message)
            elif found is not None:
                plans.append(found)
            step()
    report = advice.plans(plans, len(plant))
    made = {"html": report.page, "text": report.text, "json": report.json, "csv": lambda: advice.plans_csv(plans)}
    put(output, made[form](), several(len(plans), "plan"))
    return say_failures("not planned", failures)


def _move(text: str, where: str) -> Move:
    """Read a limit on a move, `12.5` in units of the loop or `5%` of its span."""
    from ..plan import Move

    return Move(*options.size(text, where, "move",
                             "a number in units of the loop such as 12.5, or a share of its span such as 5%"))
