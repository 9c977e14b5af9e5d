"""The log of the nightly job: text for people or JSON lines for programs, to a file or to standard error."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

from ..errors import BacklashError
from ..reporter.safe import terminal

LARGEST = 5_000_000  # bytes; a larger log becomes FILE.1 before a run

Log = Callable[..., None]


@contextlib.contextmanager
def open_log(path: Path | None, form: str, say: Callable[[str], None]) -> Iterator[Log]:
    """Give a function `log(event, level="info", **values)`; each call is one line.

    Without `path`, lines of text go to `say` (warnings and errors only) and JSON lines to it all.
    """
    if path is None:
        yield lambda event, level="info", **values: (
            say(json_line(event, level, values) if form == "json" else words(event, values))
            if form == "json" or level != "info" else None)
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and path.stat().st_size > LARGEST:
            path.replace(path.with_name(path.name + ".1"))
        stream = path.open("a", encoding="utf-8", errors="backslashreplace")
    except OSError as error:
        raise BacklashError(f"cannot write the log: {error.strerror}", where=str(path), code="cannot_write",
                            remedy="check `log.file` in the configuration") from None
    with stream:
        def log(event: str, level: str = "info", **values: object) -> None:
            line = json_line(event, level, values) if form == "json" else f"{now()} {level} {words(event, values)}"
            stream.write(line + "\n")
            stream.flush()

        yield log


def words(event: str, values: dict[str, object]) -> str:
    """Return an event as a line of text."""
    return terminal(" ".join([event, *(f"{key}={value}" for key, value in values.items() if value not in ("", ()))]))


def json_line(event: str, level: str, values: dict[str, object]) -> str:
    """Return an event as one line of JSON."""
    return json.dumps({"time": now(), "level": level, "event": event, **values}, ensure_ascii=False, default=str)


def now() -> str:
    """Clock time in UTC; only the log knows it."""
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
