"""What commands say: reports on standard output as bytes, everything else on standard error."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import click

from ..errors import BacklashError
from ..reporter.safe import terminal


def emit(text: str) -> None:
    """Write a report to standard output: UTF-8, on a terminal in its encoding; a full disk is one clear message."""
    data = text.encode("utf-8", "backslashreplace")
    if sys.stdout.isatty() and (sys.stdout.encoding or "").lower().replace("-", "") != "utf8":
        data = text.encode(sys.stdout.encoding or "ascii", "replace")
    try:
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise BacklashError(f"cannot write: {error.strerror}", where="standard output",
                            remedy="write to another place with --output", code="cannot_write") from error


def say(text: str) -> None:
    """Write one line to standard error, with foreign control characters made visible."""
    click.echo(f"backlash: {terminal(text)}", err=True)


def say_if_first_run() -> None:
    """Say what the first command after installation waits for: loops over samples are compiled once and kept."""
    own = Path(__file__).resolve().parents[1]
    kept = Path(os.environ.get("NUMBA_CACHE_DIR") or own)
    if os.access(own, os.W_OK) and not any(kept.rglob("*.nbi")):
        say("first run after installation: compiling for a few seconds; later runs start at once")


def put(path: Path, text: str, what: str = "") -> None:
    """Write a result to a file, or to standard output when the file is called -."""
    from ..reporter.files import write_text

    if str(path) == "-":
        emit(text)
        return
    write_text(path, text)
    say(f"{what} written to {path}")


@contextlib.contextmanager
def progress(words: str, total: int | None, *, shown: bool, of_bytes: bool = False) -> Iterator[Callable[..., None]]:
    """A bar on standard error while the block runs, only on a terminal; gives what counts one more done, or so many.

    of_bytes: what is counted are bytes.
    """
    if not (shown and sys.stderr.isatty()):
        yield lambda count=1: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    done = DownloadColumn() if of_bytes else MofNCompleteColumn()
    columns = (TextColumn("{task.description}"), BarColumn(), done, TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(words, total=total)
        yield lambda count=1: bar.advance(task, count)
