"""backlash history, trend and report: what a history of nightly scans holds, how valves wear, and which to pull."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import UsageError
from . import options
from .terminal import put, say, several

if TYPE_CHECKING:
    from ..history.limits import Limits
    from ..history.plant import PlantHistory
    from ..history.store import History

SCAN_FIRST = "\b\nExamples:\n  backlash scan sample_data/plant.csv --history backlash.db\n"
loop_option = click.option("--loop", metavar="NAME", multiple=True, help="Only these loops; may be repeated.")
wear_options = options.together(
    options.path("--history", metavar="DB", required=True, help="History file, made by scan --history or nightly."),
    options.path("--limits", help="Limits per class of loop (TOML). Default: the profile that comes with the tool."),
    options.path("--loops", "settings", help="Loop settings; a key limit_class names the class of a loop's limit."),
    click.option("--horizon", metavar="DAYS", type=click.FloatRange(min=0), default=90.0, show_default=True,
                 help="Days until the next shutdown, from the last night on."),
    loop_option,
)


def read_profile(limits: Path | None, loops: Path | None) -> Limits:
    """Read the limits profile; classes that a loops file names (`limit_class`) go before patterns."""
    from ..history.limits import read_limits
    from ..loaders.sources import read_metadata

    profile = read_limits(limits)
    return profile if loops is None else profile.with_classes(read_metadata(loops), str(loops))


@contextlib.contextmanager
def worn_plant(history: Path, limits: Path | None, settings: Path | None, loop: tuple[str, ...], horizon: float
               ) -> Iterator[tuple[PlantHistory, History]]:
    """Give wear and ranking of a history, and the history itself. settings: loops file with limit classes."""
    from ..history.plant import plant_history
    from ..history.store import History

    profile = read_profile(limits, settings)
    with History(history, say=say) as store:
        yield plant_history(store, profile, loops=loop, horizon=horizon), store


@click.command(short_help="Show how dead bands grow from night to night.",
               epilog=SCAN_FIRST + "  backlash trend --history backlash.db\n"
               "  backlash trend --history backlash.db --format json --horizon 60")
@wear_options
@click.option("--format", "form", type=click.Choice(["table", "json"]), default="table", show_default=True,
              help="table for people, json for programs.")
@options.output()
@options.verbose("Say for every loop why it has its place.")
def trend(form: str, output: Path | None, verbose: bool, **wear: Any) -> None:
    """Show how dead bands grow from night to night, when they reach their limit, and which valve to pull first.

    A night is one scanned export of a loop. Wear is a trend through the nights since the last repair that
    may bend; single bad nights do not pull it. --verbose says whether a straight line would do.
    """
    from ..reporter.history_report import trend as trend_report

    with worn_plant(**wear) as (plant, _):
        found = trend_report(plant.wears, plant.places)
        put(output, found.json() if form == "json" else found.text(verbose=verbose))


@click.command(short_help="Write the report page of a history.",
               epilog=SCAN_FIRST + "  backlash report --history backlash.db --output wear.html\n"
               "  backlash report --history backlash.db --output wear --limits limits.toml")
@wear_options
@options.output("Where to write. A name ending in .html is one self-contained file; another name is a folder with "
               "index.html and a page per loop, for many loops.", "FILE|DIR", required=True)
def report(output: Path, **wear: Any) -> None:
    """Write the report of a history: which valves to pull, how they wear, and why.

    It opens from disk in any browser, without a network.
    """
    from ..reporter.history_report import write_report

    with worn_plant(**wear) as (plant, store):
        write_report(output, plant.places, plant.wears, plant.nights, store.recent_half_periods)
    say(f"report of {several(len(plant.places), 'loop')} written to {output}")


@click.command(short_help="List, export and mark repairs in the history of nightly scans.",
               epilog=SCAN_FIRST + "  backlash history backlash.db\n"
               "  backlash history backlash.db --export nights.csv\n"
               "  backlash history backlash.db --repair FIC101 2026-03-02 \"new packing\"")
@click.argument("db", metavar="DB", required=False, type=click.Path(path_type=Path))
@options.path("--history", "named", metavar="DB", help="The same, as an option.")
@loop_option
@click.option("--runs", is_flag=True, help="List the runs instead of the loops.")
@options.path("--export", "target", help="Write a table to this .csv or .parquet file.")
@click.option("--table", metavar="NAME", help="What to export: nights (default), half_periods, repairs or runs.")
@click.option("--repair", nargs=3, metavar="LOOP DATE NOTE", help="Enter a repair; wear starts anew on that day.")
@click.option("--remove-repair", nargs=2, metavar="LOOP DATE", help="Take a repair back.")
def history(db: Path | None, named: Path | None, loop: tuple[str, ...], runs: bool, target: Path | None,
            table: str | None, repair: tuple[str, str, str] | None, remove_repair: tuple[str, str] | None) -> None:
    """List what a history holds, export it, or enter repairs.

    DB is the file given to scan --history. DATE is a day such as 2026-03-02, or a time in UTC such as
    2026-03-02T14:30.
    """
    from ..history.plant import chosen, mark, rows_of, unmark
    from ..history.store import History

    path = db or named
    if path is None:
        raise UsageError("which history?", remedy="name its file: backlash history backlash.db")
    if target is None and table is not None:
        raise UsageError(f"--table {table}: tables go to a file", remedy=f"add --export {table}.csv")
    with History(path, say=say) as store:
        names = chosen(store, loop)
        if repair:
            say(mark(store, *repair))
        if remove_repair:
            say(unmark(store, *remove_repair))
        if target is not None:
            from ..reporter.tables import write_rows

            rows = rows_of(store, table or "nights", names)
            write_rows(rows, target)
            say(f"{len(rows)} rows of {table or 'nights'} written to {target}")
        if not (repair or remove_repair or target):
            from ..reporter.history_report import loops_text, runs_text

            put(None, runs_text(store.runs()) if runs else loops_text(
                {name: store.nights(name) for name in names}, {name: store.repairs(name) for name in names},
                len(store.runs())))
