"""backlash trend: how dead bands grow from night to night, and which valve to pull."""

from __future__ import annotations

from pathlib import Path

import click

from .history_options import history_option, horizon_option, limits_option, loop_option, open_plant, settings_option
from .terminal import emit


@click.command(epilog="\b\nExamples:\n  backlash scan sample_data/plant.csv --history backlash.db\n"
               "  backlash trend --history backlash.db\n"
               "  backlash trend --history backlash.db --format json --horizon 60")
@history_option
@limits_option
@settings_option
@horizon_option
@loop_option
@click.option("--format", "form", type=click.Choice(["table", "json"]), default="table", show_default=True,
              help="table for people, json for programs.")
@click.option("--output", "-o", metavar="FILE", type=click.Path(path_type=Path), help="Write to this file instead.")
@click.option("--verbose", "-v", is_flag=True, help="Say for every loop why it has its place.")
def trend(history: Path, limits: Path | None, settings: Path | None, horizon: float, loop: tuple[str, ...], form: str,
          output: Path | None, verbose: bool) -> None:
    """Show how dead bands grow from night to night, when they reach their limit, and which valve to pull first.

    A night is one scanned export of a loop. Wear is a trend through the nights since the last repair that
    may bend; single bad nights do not pull it. --verbose says whether a straight line would do.
    """
    from ..reporter.files import write_text
    from ..reporter.history_report import trend_json, trend_text

    plant = open_plant(history, limits, settings, loop, horizon)
    if form == "json":
        text = trend_json(plant.wears, plant.places)
    else:
        text = trend_text(plant.wears, plant.places, verbose=verbose)
    if output is None:
        emit(text)
    else:
        write_text(output, text)
