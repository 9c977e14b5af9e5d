"""backlash report: the page that a maintenance planner opens."""

from __future__ import annotations

from pathlib import Path

import click

from .history_options import history_option, horizon_option, limits_option, loop_option, read_profile, settings_option
from .terminal import say


@click.command(epilog="\b\nExamples:\n  backlash scan sample_data/plant.csv --history backlash.db\n"
               "  backlash report --history backlash.db --output wear.html\n"
               "  backlash report --history backlash.db --output wear --limits limits.toml")
@history_option
@click.option("--output", "-o", metavar="FILE|DIR", required=True, type=click.Path(path_type=Path),
              help="Where to write. A name ending in .html is one self-contained file; another name is a folder with "
              "index.html and a page per loop, for many loops.")
@limits_option
@settings_option
@horizon_option
@loop_option
def report(history: Path, output: Path, limits: Path | None, settings: Path | None, horizon: float,
           loop: tuple[str, ...]) -> None:
    """Write the report of a history: which valves to pull, how they wear, and why.

    It opens from disk in any browser, without a network.
    """
    from ..history.plant import plant_history
    from ..history.store import History
    from ..reporter.history_report import write_report

    profile = read_profile(limits, settings)
    with History(history, say=say) as store:
        plant = plant_history(store, profile, loops=loop, horizon=horizon)
        write_report(output, plant.places, plant.wears, plant.nights, store.recent_half_periods)
    say(f"report of {len(plant.places)} loop{'s' * (len(plant.places) != 1)} written to {output}")
