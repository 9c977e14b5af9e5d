"""backlash check: is the data good enough, and do the controller settings agree with it?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .options import inputs_argument, loops_option, only_loops_option, reading_options, selection_options
from .terminal import emit, progress, say

if TYPE_CHECKING:
    from ..loaders import ReadOptions


@click.command(epilog="\b\nExamples:\n  backlash check sample_data/plant.csv\n"
               "  backlash check sample_data/plant.csv --loop FIC101 --verbose\n"
               "  backlash check sample_data/plant.csv --format json --output check.json")
@inputs_argument
@loops_option
@only_loops_option
@click.option("--format", "form", type=click.Choice(["table", "json"]),
              help="table for people, json for programs. Default: after the suffix of --output, else table.")
@click.option("--output", "-o", metavar="FILE", type=click.Path(path_type=Path), help="Write to this file instead.")
@click.option("--verbose", "-v", is_flag=True, help="List every finding and number of every loop.")
@reading_options
@selection_options
def check(inputs: tuple[Path, ...], loops: Path | None, form: str | None, output: Path | None, verbose: bool,
          reading: ReadOptions) -> int:
    """Check data quality and controller settings before trusting a verdict.

    For every loop: sampling against Ti, gaps, compression by the historian, rounding, manual time, motion; K, Ti and
    Td as the data show them, compared with the loop settings (minutes for seconds, proportional band for gain, gain
    in engineering units); what an oscillation looks like; and what all this means for a verdict.

    Exit status: 0 done; 2 wrong use, or nothing could be read; 3 done, but some loop could not be checked.
    """
    from ..check import check as check_plant
    from ..loaders import read
    from ..reporter.check_table import check_json, check_text
    from ..reporter.files import write_text

    plant = read(inputs, loops=loops, options=reading)
    with progress("checking", len(plant), shown=True) as step:
        result = check_plant(plant, step)
    form = form or ("json" if output is not None and output.suffix.lower() == ".json" else "table")
    if form == "json":
        text = check_json(result)
    else:
        import sys

        text = check_text(result, verbose=verbose, colour=output is None and sys.stdout.isatty())
    if output is None:
        emit(text)
    else:
        write_text(output, text)
        say(f"{len(result.loops)} loop{'s' * (len(result.loops) != 1)} checked, {form} written to {output}")
    failed = [message if (message := loop.failure.message).startswith(f"{loop.loop}:") else f"{loop.loop}: {message}"
              for loop in result.loops if loop.failure is not None]
    failed += [note.message for note in result.failures]
    if output is not None or form == "json":
        for message in failed:
            say(f"not checked: {message}")
    return 3 if failed else 0
