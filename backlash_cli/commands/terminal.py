"""What commands say: reports on standard output as bytes, everything else on standard error."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from ..errors import BacklashError
from ..reporter.safe import terminal

if TYPE_CHECKING:
    from ..reporter.report import Report

Refused = TypeVar("Refused", bound=BacklashError)
COMPILING = 4  # seconds of CPU that the first command spends on it at most, on a machine of 2026; a scan 1


def emit(text: str) -> None:
    """Write a report to standard output: UTF-8, on a terminal in its encoding; `main` says where it cannot be."""
    foreign = sys.stdout.isatty() and (sys.stdout.encoding or "").lower().replace("-", "") != "utf8"
    encoding = (sys.stdout.encoding or "ascii", "replace") if foreign else ("utf-8", "backslashreplace")
    with contextlib.suppress(BrokenPipeError):  # the reader has gone (`| head`): the exit status is that of the work
        sys.stdout.buffer.write(text.encode(*encoding))
        sys.stdout.buffer.flush()


def put(path: Path | None, text: str, what: str = "") -> None:
    """Write a result to a file and say so, or to standard output where there is no file or it is called -."""
    if path is None or str(path) == "-":
        emit(text)
        return
    from ..reporter.files import write_text

    write_text(path, text)
    if what:
        say(f"{what} written to {path}")


def deliver(report: Report, json_file: Path | None, html: Path | None, *, verbose: bool = False) -> int:
    """Write numbers and page where they were asked for, and show the text unless the numbers go to standard output."""
    if json_file is not None:
        put(json_file, report.json(), "numbers")
    if html is not None:
        put(html, report.page(), "page")
    if str(json_file) != "-":
        put(None, report.text(verbose=verbose, colour=sys.stdout.isatty()))
    return 0


def refusal(kind: type[Refused], name: str, where: object = "", **shown: object) -> Refused:
    """Return the error of that name in words.toml; where: the option or file. Words are loaded only when needed."""
    from ..words import explained

    return kind(**explained(name, **shown), where=str(where))


def say(text: str) -> None:
    """Write one line to standard error, with foreign control characters made visible."""
    click.echo(f"backlash: {terminal(text)}", err=True)


def say_failures(words: str, messages: Sequence[str], *, shown: bool = True) -> int:
    """Say, unless the report shows them, what was "not analysed" or the like; return the exit status: 3, 0 for none."""
    for message in messages if shown else ():
        say(f"{words}: {message}")
    return 3 if messages else 0


def say_if_first_run() -> None:
    """Say what the first command after installation waits for: loops over samples are compiled once and kept."""
    own = Path(__file__).resolve().parents[1]
    kept = Path(os.environ.get("NUMBA_CACHE_DIR") or own)
    if os.access(own, os.W_OK) and not any(kept.rglob("*.nbi")):
        say(f"first run after installation: compiling for up to {COMPILING} s; later runs start at once")


@contextlib.contextmanager
def progress(words: str, total: int | None, *, shown: bool = True, of_bytes: bool = False, stopped: str = ""
             ) -> Iterator[Callable[..., None]]:
    """A bar on standard error while the block runs, only on a terminal; gives what counts one more done, or so many.

    of_bytes: what is counted are bytes. stopped: said behind the count when the work is stopped."""
    from rich import progress as rich_progress
    from rich.console import Console

    count_column = rich_progress.DownloadColumn() if of_bytes else rich_progress.MofNCompleteColumn()
    columns = (rich_progress.TextColumn("{task.description}"), rich_progress.BarColumn(), count_column,
               rich_progress.TimeRemainingColumn())
    with rich_progress.Progress(*columns, console=Console(stderr=True), transient=True,
                                disable=not (shown and sys.stderr.isatty())) as bar:
        task = bar.add_task(words, total=total)
        try:
            yield lambda count=1: bar.advance(task, count)
        except KeyboardInterrupt as stop:
            if stopped:
                stop.add_note(f"{bar.tasks[0].completed:.0f} of {total} {stopped}")
            raise
