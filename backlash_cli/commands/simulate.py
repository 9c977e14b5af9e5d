"""backlash simulate, plan, compensate, effects and paper: what the simulator answers, and what it is made of."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import click

from ..errors import LoopError, UsageError
from ..reporter.safe import counted
from . import options
from .options import Export, cluster, command
from .terminal import deliver, progress, put, say_failures

if TYPE_CHECKING:
    from ..results.advice import LoopPlan

PLANS = {".txt": "text", ".json": "json", ".csv": "csv", ".html": "html", ".htm": "html"}
MOVE = "a number in units of the loop such as 12.5, or a share of its span such as 5%"


@command
def simulate(scenario: str, out: Path | None, truth: Path | None, layout: str, dead_band: float | None,
             seed: int | None, resolution: float, show: bool, force: bool) -> None:
    """Simulate a control loop and write its record as a historian would export it."""
    from ..reporter.plant_files import stem_of, write_plant, write_settings, write_truth
    from ..simulator import simulate as run
    from ..simulator.scenario import truth_rows
    from ..simulator.scenario_file import load_scenarios, scenario_text, with_dead_band, with_seed

    if show:
        click.echo(scenario_text(scenario), nl=False)
        return
    if out is None:
        raise UsageError("nothing says where to write", remedy="add --out FILE, for example --out plant.csv")
    settings = out.with_name(f"{stem_of(out)}.loops.toml")
    truth = truth or out.with_name(f"{stem_of(out)}.truth.csv")
    there = [str(path) for path in (out, settings, truth) if path.exists()]
    if there and not force:
        raise UsageError(f"{', '.join(there)} exists", remedy="choose another --out, or add --force to replace it")
    loops = with_seed(with_dead_band(load_scenarios(scenario), dead_band), seed)
    records = [run(loop) for loop in loops]
    write_plant(out, records, layout=layout, finest=resolution)
    write_settings(settings, records)
    write_truth(truth, truth_rows(loops))
    size = f"{counted(len(records), 'loop')}, {sum(map(len, records))} samples"
    click.echo(f"{size} -> {out}, {settings.name}, {truth.name}", err=True)


@command
def plan(target: str | None, max_pv_move: str, max_op_move: str, form: str | None, output: Path | None, repeats: int,
         seed: int, jobs: int | None, no_cache: bool, **given: Any) -> int:
    """Work out the least that would decide each loop that a scan leaves undecided, by simulating it."""
    from ..engines.local import answers
    from ..engines.plan import kept_plan
    from ..plan import Move, PlanOptions
    from ..record import Note
    from ..reporter import advice
    from ..reporter.files import form_of

    pv_move, op_move = (Move(*options.size(text, where, "move", MOVE))
                        for text, where in ((max_pv_move, "--max-pv-move"), (max_op_move, "--max-op-move")))
    wanted = PlanOptions(options.dead_band(target, "--target"), pv_move, op_move, repeats, seed)
    form = form or form_of(output, PLANS)
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
    report = advice.plans(plans, len(plant), plant.inputs)
    made = {"html": report.page, "text": report.text, "json": report.json, "csv": lambda: advice.plans_csv(plans)}
    put(output, made[form](), counted(len(plans), "plan"))
    return say_failures("not planned", failures)


@command
def compensate(loop: str, process_text: str | None, dead_band: str | None, html: Path | None, json_file: Path | None,
               **given: Any) -> int:
    """Simulate one loop without and with backlash compensation, and advise a gain or say why none."""
    from ..engines.local import answers
    from ..record import Note
    from ..reporter.advice import compensation
    from ..simulator.compensation import compensate as study_of
    from ..simulator.scenario_file import parse_process

    work = partial(study_of, process=parse_process(process_text) if process_text else None,
                   dead_band=options.dead_band(dead_band))
    with cluster(given) as client:
        record = Export.of(given).read()[loop]
        study = work(record) if client is None else next(answers([record], work, client=client))
    if isinstance(study, Note):
        raise LoopError(study.message, code=study.code)
    return deliver(compensation(study), json_file, html)


@command
def effects(verbose: bool) -> None:
    """List the physical effects, each in a sentence, in the order a signal meets them."""
    from ..effects.registry import all_effects

    for effect in all_effects():
        names = ", ".join(f"{q.name} [{q.unit}]" for q in effect.parameters if not q.nuisance)
        click.echo(f"{effect.name} ({effect.stage}): {'column, ' * effect.column}{names}")
        click.echo(fill(effect.sentence, 100, initial_indent="    ", subsequent_indent="    "))
        if verbose:
            for q in effect.parameters:
                click.echo(f"    {q.name}: {q.meaning}, {q.low:g} to {q.high:g}, neutral {q.neutral:g}")
            use = "models and simulations" if effect.fitted else "simulations only"
            click.echo(f"    For {use}. Source: {effect.source}.")


@command
def paper(html: Path | None, json_file: Path | None) -> int:
    """Recompute every number of Haegglund (2007): the paper's, ours, the difference, and why where they differ."""
    from ..reporter.paper import paper as paper_report
    from ..simulator.paper import reproduce

    return deliver(paper_report(*reproduce()), json_file, html)
