"""backlash history, trend and report: what a history of nightly scans holds, how valves wear, and which to pull."""

import contextlib
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..errors import UsageError
from ..history.limits import Limits, read_limits
from ..history.plant import chosen, plant_history
from ..history.store import History
from ..loaders.sources import read_metadata
from ..reporter import history_report
from ..reporter.files import form_of
from ..reporter.history_report import WIDTH
from ..reporter.safe import counted
from ..reporter.tables import history_rows, write_rows
from ..reporter.templates import screen
from ..results.history import Place, day_of
from .options import TEXT_OR_JSON
from .terminal import put, refusal, say


def read_profile(limits: Path | None, loops: Path | None) -> Limits:
    """Read the limits profile; classes that a loops file names (`limit_class`) go before patterns."""
    profile = read_limits(limits)
    return profile if loops is None else profile.with_classes(read_metadata(loops), str(loops))


@contextlib.contextmanager
def worn_plant(history: Path, limits: Path | None, settings: Path | None, loop: tuple[str, ...], horizon: float
               ) -> Iterator[tuple[list[Place], History]]:
    """Give a history's order of repair, and the history itself. settings: loops file with limit classes."""
    profile = read_profile(limits, settings)
    with History(history, say=say) as store:
        yield plant_history(store, profile, loops=loop, horizon=horizon), store


def trend(form: str | None, output: Path | None, verbose: bool, **wear: Any) -> None:
    """Show how dead bands grow from night to night, when they reach their limit, and which valve to pull first."""
    form = form or form_of(output, TEXT_OR_JSON)
    with worn_plant(**wear) as (places, _):
        found = history_report.trend(places)
        put(output, found.json() if form == "json" else found.text(verbose=verbose))


def report(output: Path, **wear: Any) -> None:
    """Write the report of a history: which valves to pull, how they wear, and why."""
    with worn_plant(**wear) as (places, store):
        history_report.write_report(output, places, store.half_periods, str(wear["history"]))
    say(f"report of {counted(len(places), 'loop')} written to {output}")


def moment_of(date: str) -> float:
    """Return a day or time (UTC unless it has an offset) as epoch seconds; a day means its first moment."""
    try:
        found = datetime.fromisoformat(date.strip())
    except ValueError:
        raise UsageError(f"{date!r} is no day", where="--repair", remedy="as 2026-03-02 or 2026-03-02T14:30") from None
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


def history(db: Path | None, named: Path | None, loop: tuple[str, ...], runs: bool, target: Path | None,
            table: str | None, repair: tuple[str, str, str] | None, remove_repair: tuple[str, str] | None) -> None:
    """List what a history holds, export it, or enter repairs."""
    if (path := db or named) is None or (db and named):
        raise refusal(UsageError, "which_history")
    if target is None and table is not None:
        raise UsageError(f"--table {table}: tables go to a file", remedy=f"add --export {table}.csv")
    with History(path, say=say) as store:
        names = chosen(store, loop)
        if repair:
            pattern, date, note = repair
            if moment_of(date) > datetime.now(UTC).timestamp():
                raise refusal(UsageError, "repair_ahead", "--repair", date=date)
            for name in chosen(store, [pattern]):
                new = store.mark_repair(name, moment_of(date), note)
                say(f"repair of {name} on {date} {'entered' if new else 'was already entered'}: {note}")
        if remove_repair:
            name, date = remove_repair
            if not store.remove_repair(name, moment_of(date)):
                days = ", ".join(day_of(r.time) for r in store.repairs(name)) or "none"
                raise refusal(UsageError, "no_repair", path, loop=name, date=date, days=days)
            say(f"repair of {name} on {date} taken back")
        if target is not None:
            table = table or ("runs" if runs else "nights")
            write_rows(rows := history_rows(store, table, names), target)
            say(f"{len(rows)} rows of {table} written to {target}")
        if not (repair or remove_repair or target):
            put(None, screen("runs.txt", width=WIDTH, runs=store.runs()) if runs else history_report.loops_text(
                {n: store.nights(n) for n in names}, {n: store.repairs(n) for n in names}, len(store.runs())))
