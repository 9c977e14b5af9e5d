"""backlash compensate: what a backlash compensator would do to one loop."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..errors import LoopError
from .options import check_engine, engine_options, inputs_argument, json_option, loops_option, reading_options, working
from .terminal import emit, progress, put

if TYPE_CHECKING:
    from ..loaders import ReadOptions
    from ..record import Note, Record
    from ..results.compensation import CompensationStudy


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
@json_option
@engine_options
@reading_options
def compensate(inputs: tuple[Path, ...], loops: Path | None, loop: str, process_text: str | None,
               dead_band: str | None, html: Path | None, json_file: Path | None, engine: str, scheduler: str | None,
               reading: ReadOptions) -> int:
    """Simulate one loop without and with backlash compensation, and advise a gain or say why none.

    Uses the loop's controller settings, the dead band that the scan finds, and a process fitted to the record. The
    result is advice to a person; nothing is written to the control system.
    """
    import sys

    from ..compensate import compensate as study_of
    from ..engines.cluster import on_cluster
    from ..loaders import read
    from ..reporter.compensation import compensation_page, to_json, to_text
    from ..simulator.process_text import parse_dead_band, parse_process

    process = parse_process(process_text) if process_text else None
    size = parse_dead_band(dead_band) if dead_band else None
    check_engine(engine, scheduler)
    with working(engine, scheduler, None if scheduler else 1) as client:
        with progress("reading", None, shown=True):
            record = read(inputs, loops=loops, options=reading)[loop]
        work = partial(study_of, process=process, dead_band=size)
        study = work(record) if client is None else next(on_cluster(client, [record], work, _lost))
    if json_file is not None:
        put(json_file, to_json(study), "numbers")
    if html is not None:
        put(html, compensation_page(study), "page")
    if str(json_file) != "-":
        emit(to_text(study, colour=sys.stdout.isatty()))
    return 0


def _lost(record: Record, reason: Note) -> CompensationStudy:
    raise LoopError(reason.message, where=record.loop, code=reason.code, remedy="see the logs of the workers")
