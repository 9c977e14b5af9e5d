"""backlash check: is the data good enough, and do the controller settings agree with it?"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from . import options
from .options import Export
from .terminal import progress, put, say_failures, several


@click.command(short_help="Check data quality and controller settings of every loop.",
               epilog="\b\nExamples:\n  backlash check sample_data/plant.csv\n"
               "  backlash check sample_data/plant.csv --loop FIC101 --verbose\n"
               "  backlash check sample_data/plant.csv --format json --output check.json")
@click.option("--format", "form", type=click.Choice(["table", "json"]),
              help="table for people, json for programs. Default: after the suffix of --output, else table.")
@options.output()
@options.verbose("List every finding and number of every loop.")
@options.export(options.ONLY_LOOPS, *options.SELECTION)
def check(form: str | None, output: Path | None, verbose: bool, **given: Any) -> int:
    """Check data quality and controller settings before trusting a verdict.

    For every loop: sampling against Ti, gaps, compression by the historian, rounding, manual time, motion; K, Ti and
    Td as the data show them, compared with the loop settings (minutes for seconds, proportional band for gain, gain
    in engineering units); what an oscillation looks like; and what all this means for a verdict.

    Exit status: 0 done; 2 wrong use, or nothing could be read; 3 done, but some loop could not be checked.
    """
    from ..check import check as check_plant
    from ..reporter.check_table import checked

    plant = Export.of(given).read(compiles=False)
    with progress("checking", len(plant), stopped="loops were checked; no report was written") as step:
        result = check_plant(plant, step)
    form = form or ("json" if output is not None and output.suffix.lower() == ".json" else "table")
    report = checked(result)
    text = report.json() if form == "json" else report.text(
        verbose=verbose, colour=output is None and sys.stdout.isatty())
    put(output, text, f"{several(len(result.loops), 'loop')} checked, {form}")
    failed = [f"{loop.loop}: {loop.failure.message.removeprefix(f'{loop.loop}: ')}" for loop in result.loops
              if loop.failure is not None]
    return say_failures("not checked", failed + [note.message for note in result.failures],
                        shown=output is not None or form == "json")
