"""backlash simulate, effects and paper: a simulated loop, what it can be made of, and the paper recomputed."""

from pathlib import Path
from textwrap import fill

import click

from ..effects.registry import all_effects
from ..errors import UsageError
from ..reporter.plant_files import stem_of, write_plant, write_settings, write_truth
from ..reporter.safe import counted
from ..simulator import simulate as run
from ..simulator.scenario import truth_rows
from ..simulator.scenario_file import load_scenarios, scenario_text, with_dead_band, with_seed
from .terminal import deliver


def simulate(scenario: str, out: Path | None, truth: Path | None, layout: str, dead_band: float | None,
             seed: int | None, resolution: float, show: bool, force: bool) -> None:
    """Simulate a control loop and write its record as a historian would export it."""
    if show:
        click.echo(scenario_text(scenario), nl=False)
        return
    if out is None:
        raise UsageError("nothing says where to write", remedy="add --out FILE, for example --out plant.csv")
    settings, truth = out.with_name(f"{stem_of(out)}.loops.toml"), truth or out.with_name(f"{stem_of(out)}.truth.csv")
    ways = [path.resolve() for path in (out, settings, truth, Path(scenario))]
    if twice := next((path for path in ways if ways.count(path) > 1), None):
        raise UsageError("this file is named for two things", where=twice.name, remedy="choose another --out, --truth")
    there = [str(path) for path in (out, settings, truth) if path.exists()]
    if there and not force:
        raise UsageError(f"{', '.join(there)} exists", remedy="choose another --out, or add --force to replace it")
    loops = with_seed(with_dead_band(load_scenarios(scenario), dead_band), seed)
    records = [run(loop) for loop in loops]
    write_plant(out, records, layout=layout, finest=resolution)
    write_settings(settings, records)
    write_truth(truth, truth_rows(loops))
    size = counted(len(records), "loop")
    click.echo(f"{size}, {sum(map(len, records))} samples -> {out}, {settings.name}, {truth.name}", err=True)


def effects(verbose: bool) -> None:
    """List the physical effects, each in a sentence, in the order a signal meets them."""
    for effect in all_effects():
        names = ", ".join(f"{q.name} [{q.unit}]" for q in effect.parameters if not q.nuisance)
        click.echo(f"{effect.name} ({effect.stage}): {'column, ' * effect.column}{names}")
        click.echo(fill(effect.sentence, 100, initial_indent="    ", subsequent_indent="    "))
        if verbose:
            for q in effect.parameters:
                click.echo(f"    {q.name}: {q.meaning}, {q.low:g} to {q.high:g}, neutral {q.neutral:g}")
            click.echo(f"    For {'models and ' * effect.fitted}simulations. Source: {effect.source}.")


def paper(html: Path | None, json_file: Path | None) -> int:
    """Recompute every number of Haegglund (2007): the paper's, ours, the difference, and why where they differ."""
    from ..reporter.paper import paper as paper_report
    from ..simulator.paper import reproduce

    return deliver(paper_report(*reproduce()), json_file, html)
