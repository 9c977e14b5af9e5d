"""backlash compensate: what a backlash compensator would do to one loop."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from ..errors import LoopError
from . import options
from .options import Export, Workers
from .terminal import deliver


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
@options.engine()
@options.export()
def compensate(export: Export, loop: str, process_text: str | None, dead_band: str | None, html: Path | None,
               json_file: Path | None, workers: Workers) -> int:
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
    with workers.client() as client:
        record = export.read()[loop]
        study = work(record) if client is None else next(answers([record], work, client=client))
    if isinstance(study, Note):
        raise LoopError(study.message, code=study.code)
    deliver(compensation(study), json_file, html)
    return 0
