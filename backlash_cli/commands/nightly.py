"""backlash nightly: the job that cron runs."""

from __future__ import annotations

from pathlib import Path

import click

from .terminal import emit, say


@click.command(epilog="\b\nExample configuration (nightly.toml):\n  inputs = [\"sample_data/plant.csv\"]\n"
               "  history = \"backlash.db\"\n  [outputs]\n  report = \"wear.html\"\n\n\b\nExamples:\n"
               "  backlash nightly nightly.toml\n  backlash nightly nightly.toml --check")
@click.argument("config", metavar="CONFIG.toml", type=click.Path(path_type=Path))
@click.option("--check", is_flag=True, help="Only read the configuration and list the exports that would be scanned.")
def nightly(config: Path, check: bool) -> int:
    """Scan the new exports, add them to the history and write the reports, as a configuration file says.

    Prints one line for the cron mail. Late, missing and repeated exports are named; what is known is not scanned
    again.

    Exit status: 0 done; 1 a fail_on rule was met; 2 wrong use, another job works, or nothing could be read; 3 done,
    but some export or loop could not be analysed.
    """
    from ..history.nightly import read_config
    from .nightly_run import list_exports, open_log, run

    settings = read_config(config)
    if check:
        emit(list_exports(settings))
        return 0
    with open_log(settings.log.file, settings.log.format, say) as log:
        summary, status = run(settings, log)
    emit(summary + "\n")
    return status
