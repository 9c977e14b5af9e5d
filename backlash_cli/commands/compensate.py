"""backlash compensate: what a backlash compensator would do to one loop."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .engine import check_engine, engine_options, working
from .options import inputs_argument, loops_option, reading_options
from .terminal import emit, progress, say

if TYPE_CHECKING:
    from distributed import Client

    from ..loaders import ReadOptions
    from ..results.compensation import CompensationStudy
    from ..simulator.process import Process


@click.command(epilog="\b\nExamples:\n  backlash compensate sample_data/plant.csv --loop FIC101\n"
               "  backlash compensate sample_data/plant.csv --loop FIC101 --process K=1.3,T=20,L=2 --html advice.html")
@inputs_argument
@loops_option
@click.option("--loop", "loop", metavar="NAME", required=True, help="The loop to look at.")
@click.option("--process", "process_text", metavar="K=..,T=..,L=..|FILE",
              help="Static gain, lag and dead time [s] of the process (more lags: T2=..), or a TOML file with gain, "
              "lags, dead_time. Default: fitted to the record.")
@click.option("--dead-band", metavar="D", help="Dead band in spans of the output (0.03 or 3%). Default: from the scan.")
@click.option("--html", metavar="FILE", type=click.Path(path_type=Path), help="Draw the loop before and after.")
@click.option("--json", "json_file", metavar="FILE", type=click.Path(path_type=Path),
              help="Write the numbers as JSON; - is standard output.")
@engine_options
@reading_options
def compensate(inputs: tuple[Path, ...], loops: Path | None, loop: str, process_text: str | None,
               dead_band: str | None, html: Path | None, json_file: Path | None, engine: str, scheduler: str | None,
               reading: ReadOptions) -> int:
    """Simulate one loop without and with backlash compensation, and advise a gain or say why none.

    Uses the loop's controller settings, the dead band that the scan finds, and a process fitted to the record. The
    result is advice to a person; nothing is written to the control system.
    """
    import json
    import sys

    from ..reporter.compensation import compensation_page, to_document, to_text
    from ..reporter.files import write_text
    from ..simulator.process_text import parse_dead_band, parse_process

    process = parse_process(process_text) if process_text else None
    size = parse_dead_band(dead_band) if dead_band else None
    check_engine(engine, scheduler)
    with working(engine, scheduler, None if scheduler else 1) as client:
        study = _study(client, inputs, loops, reading, loop, process, size, absolute=scheduler is not None)
    document = json.dumps(to_document(study), indent=2, allow_nan=False) + "\n"
    if json_file is not None and str(json_file) == "-":
        emit(document)
        return 0
    if json_file is not None:
        write_text(json_file, document)
        say(f"numbers written to {json_file}")
    if html is not None:
        write_text(html, compensation_page(study))
        say(f"page written to {html}")
    emit(to_text(study, colour=sys.stdout.isatty()))
    return 0


def _study(client: Client | None, inputs: tuple[Path, ...], loops: Path | None, reading: ReadOptions, loop: str,
           process: Process | None, dead_band: float | None, *, absolute: bool) -> CompensationStudy:
    """Study the loop in this process, or on a worker of the cluster."""
    if client is None:
        from ..compensate import compensate as study_of
        from ..loaders import read

        with progress("reading", None, shown=True):
            record = read(inputs, loops=loops, options=reading)[loop]
        return study_of(record, process=process, dead_band=dead_band)
    from ..engines.compensate import compensate_on_cluster
    from ..engines.plant import DaskPlant

    with progress("looking at the files", None, shown=True):
        plant = DaskPlant(client, inputs, loops=loops, reading=reading, absolute=absolute)
    return compensate_on_cluster(plant, loop, process=process, dead_band=dead_band)
