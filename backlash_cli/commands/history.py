"""backlash history: list, export, and mark repairs."""

from __future__ import annotations

from pathlib import Path

import click
from click.core import ParameterSource

from .history_options import loop_option
from .terminal import emit, say


@click.command(epilog="\b\nExamples:\n  backlash scan sample_data/plant.csv --history backlash.db\n"
               "  backlash history backlash.db\n"
               "  backlash history backlash.db --export nights.csv\n"
               "  backlash history backlash.db --repair FIC101 2026-03-02 \"new packing\"")
@click.argument("db", metavar="DB", required=False, type=click.Path(path_type=Path))
@click.option("--history", "named", metavar="DB", type=click.Path(path_type=Path), help="The same, as an option.")
@loop_option
@click.option("--runs", is_flag=True, help="List the runs instead of the loops.")
@click.option("--export", "target", metavar="FILE", type=click.Path(path_type=Path),
              help="Write a table to this .csv or .parquet file.")
@click.option("--table", metavar="NAME", default="nights", show_default=True,
              help="What to export: nights, half_periods, repairs or runs.")
@click.option("--repair", nargs=3, metavar="LOOP DATE NOTE", help="Enter a repair; wear starts anew on that day.")
@click.option("--remove-repair", nargs=2, metavar="LOOP DATE", help="Take a repair back.")
def history(db: Path | None, named: Path | None, loop: tuple[str, ...], runs: bool, target: Path | None, table: str,
            repair: tuple[str, str, str] | None, remove_repair: tuple[str, str] | None) -> None:
    """List what a history holds, export it, or enter repairs.

    DB is the file given to scan --history. DATE is a day such as 2026-03-02, or a time in UTC such as
    2026-03-02T14:30.
    """
    from ..errors import UsageError
    from ..history.plant import chosen, mark, rows_of, unmark
    from ..history.store import History

    path = db or named
    if path is None:
        raise UsageError("which history?", remedy="name its file: backlash history backlash.db")
    if target is None and click.get_current_context().get_parameter_source("table") != ParameterSource.DEFAULT:
        raise UsageError(f"--table {table}: tables go to a file", remedy=f"add --export {table}.csv")
    with History(path, say=say) as store:
        names = chosen(store, loop)
        if repair is not None:
            say(mark(store, *repair))
        if remove_repair is not None:
            say(unmark(store, *remove_repair))
        if target is not None:
            from ..reporter.tables import write_rows

            rows = rows_of(store, table, names)
            write_rows(rows, target)
            say(f"{len(rows)} rows of {table} written to {target}")
        if repair is None and remove_repair is None and target is None:
            from ..reporter.history_report import loops_text, runs_text

            emit(runs_text(store.runs()) if runs else loops_text(
                {name: store.nights(name) for name in names}, {name: store.repairs(name) for name in names},
                len(store.runs())))
