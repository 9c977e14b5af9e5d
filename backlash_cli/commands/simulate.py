"""backlash simulate, compensate, effects and paper: what the simulator answers, and what it is made of."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Any

import click

from ..errors import LoopError, UsageError
from . import options
from .options import Export, Workers
from .terminal import deliver, several


@click.command(short_help="Write a record from the closed-loop simulator.",
               epilog="\b\nExamples:\n  backlash simulate example-2 --dead-band 0.03 --out example.csv\n"
               "  backlash simulate example-2 --show > mine.toml\n"
               "  backlash simulate mine.toml --out mine.parquet && backlash scan mine.parquet")
@click.argument("scenario", metavar="SCENARIO")
@options.path("--out", "--output", "-o", help="Where to write: .csv, .csv.gz or .parquet. Settings go to "
             "STEM.loops.toml beside it.")
@options.path("--truth", help="Where to write what was planted. Default: STEM.truth.csv beside --out.")
@click.option("--layout", metavar="LAYOUT", type=click.Choice(["wide", "long"]), default="wide", show_default=True,
              help="wide: a column per signal; long: tag, timestamp, value.")
@click.option("--dead-band", metavar="D", type=click.FloatRange(0.0, 0.5),
              help="Dead band of every loop's valve in spans of output (0.03 = 3 %), instead of the scenario's.")
@click.option("--seed", metavar="N", type=click.IntRange(0), help="Other random numbers.")
@click.option("--resolution", metavar="R", type=click.FloatRange(1e-9, 0.1), default=1e-6, show_default=True,
              help="Round the numbers to this part of their span.")
@click.option("--show", is_flag=True, help="Print the scenario's TOML file, to start your own from.")
@click.option("--force", is_flag=True, help="Replace files that exist.")
def simulate(scenario: str, out: Path | None, truth: Path | None, layout: str, dead_band: float | None,
             seed: int | None, resolution: float, show: bool, force: bool) -> int:
    """Simulate a control loop and write its record as a historian would export it.

    \b
    SCENARIO is the path of your own TOML file, or one of these names:
    example-1, example-2, industrial-fixed, industrial-oscillating (the paper's), sample-plant,
    workbench-monday, workbench-tuesday (of the tutorial)
    """
    from ..reporter.plant_files import stem_of, write_plant, write_settings, write_truth
    from ..simulator import simulate as run
    from ..simulator.scenario import truth_rows
    from ..simulator.scenario_file import load_scenarios, scenario_text, with_dead_band, with_seed

    if show:
        click.echo(scenario_text(scenario), nl=False)
        return 0
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
    size = f"{several(len(records), 'loop')}, {sum(map(len, records))} samples"
    click.echo(f"{size} -> {out}, {settings.name}, {truth.name}", err=True)
    return 0


@click.command(short_help="Simulate a loop with and without backlash compensation.",
               epilog="\b\nExamples:\n  backlash compensate sample_data/plant.csv --loop FIC101\n"
               "  backlash compensate sample_data/plant.csv --loop FIC101 --process K=1.3,T=20,L=2 --html advice.html")
@click.option("--loop", "loop", metavar="NAME", required=True, help="The loop to look at.")
@click.option("--process", "process_text", metavar="K=..,T=..,L=..|FILE",
              help="Static gain, lag and dead time [s] of the process (more lags: T2=..), or a TOML file with gain, "
              "lags, dead_time. Default: fitted to the record.")
@click.option("--dead-band", metavar="D", help="Dead band in spans of the output (0.03 or 3%). Default: from the scan.")
@options.path("--html", help="Draw the loop before and after.")
@options.JSON
@options.ENGINE
@options.export()
def compensate(loop: str, process_text: str | None, dead_band: str | None, html: Path | None, json_file: Path | None,
               **given: Any) -> int:
    """Simulate one loop without and with backlash compensation, and advise a gain or say why none.

    Uses the loop's controller settings, the dead band that the scan finds, and a process fitted to the record. The
    result is advice to a person; nothing is written to the control system.
    """
    from ..compensate import compensate as study_of
    from ..engines.local import answers
    from ..record import Note
    from ..reporter.advice import compensation
    from ..simulator.scenario_file import parse_process

    work = partial(study_of, process=parse_process(process_text) if process_text else None,
                   dead_band=options.dead_band(dead_band))
    with Workers.of(given).client() as client:
        record = Export.of(given).read()[loop]
        study = work(record) if client is None else next(answers([record], work, client=client))
    if isinstance(study, Note):
        raise LoopError(study.message, code=study.code)
    return deliver(compensation(study), json_file, html)


@click.command(short_help="List the physical effects, each in a sentence.", epilog="Example: backlash effects")
@options.verbose("Also list the parameters, units, bounds and sources.")
def effects(verbose: bool) -> int:
    """List the physical effects, each in a sentence, in the order a signal meets them.

    Effects of installed packages (entry point group backlash.effects) are listed too.
    """
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
    return 0


@click.command(short_help="Recompute the numbers of Haegglund (2007), paper against ours.",
               epilog="\b\nExamples:\n  backlash paper\n  backlash paper --html paper.html")
@options.path("--html", help="Draw each figure beside its numbers.")
@options.JSON
def paper(html: Path | None, json_file: Path | None) -> int:
    """Recompute every number of Haegglund (2007): the paper's, ours, the difference, and why where they differ.

    Shows what the method can do and where the paper's own figures cannot be reproduced. Takes a few seconds and needs
    no input.
    """
    from ..estimator.haegglund import published_estimates
    from ..reporter.paper import paper as paper_report
    from ..simulator.paper import reproduce

    return deliver(paper_report(reproduce(published_estimates)), json_file, html)
