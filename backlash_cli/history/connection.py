"""Opening the history file: rollback journal, waiting for another run, and words for what can go wrong.

The rollback journal (not WAL) keeps the history one single file that also works on a network drive; a killed run
leaves a journal that the next one plays back, so that either all of a run is in the file or nothing of it.
"""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from ..errors import BacklashError
from .schema import bring_up, ready

PATIENCE = 60.0  # seconds to wait for another run before giving up
QUIET = 1.0  # seconds to wait before saying so

Say = Callable[[str], None]
T = TypeVar("T")


def connect(path: Path, *, create: bool, patience: float, say: Say) -> sqlite3.Connection:
    """Open the history at `path`, made or brought up to the present version where needed.

    Raises BacklashError when it does not exist (and may not be made), is no history, or stays busy.
    """
    if not create and not path.is_file():
        raise BacklashError("there is no history at this place", where=str(path), code="no_history",
                            remedy="make one with: backlash scan EXPORT --history FILE")
    if create and not path.parent.is_dir():
        raise BacklashError("the folder of the history does not exist", where=str(path.parent), code="no_history",
                            remedy="make the folder first")
    with in_words(path):
        db = sqlite3.connect(path, timeout=QUIET, isolation_level=None)
        try:
            db.execute("PRAGMA synchronous = FULL")
            usable = patiently(lambda: ready(db, str(path)), db, path, patience, say)
            if not usable:
                with transaction(db, path, patience, say):
                    # another run may have done it while this one waited
                    if not ready(db, str(path)):
                        bring_up(db)
        except BaseException:
            db.close()
            raise
    return db


@contextlib.contextmanager
def transaction(db: sqlite3.Connection, path: Path, patience: float, say: Say) -> Iterator[None]:
    """All or nothing: what happens inside is in the file after the block, or not at all."""
    with in_words(path):
        patiently(lambda: db.execute("BEGIN IMMEDIATE"), db, path, patience, say)
        try:
            yield
            db.execute("COMMIT")
        except BaseException:
            if db.in_transaction:
                db.execute("ROLLBACK")
            raise


def patiently(action: Callable[[], T], db: sqlite3.Connection, path: Path, patience: float, say: Say) -> T:
    """Run `action`; when another run holds the file, say so and wait up to `patience` seconds."""
    try:
        return action()
    except sqlite3.OperationalError as error:
        if not _busy(error):
            raise
    say(f"another run is writing to {path}; waiting up to {patience:g} s")
    db.execute(f"PRAGMA busy_timeout = {int(1000 * patience)}")
    try:
        return action()
    finally:
        db.execute(f"PRAGMA busy_timeout = {int(1000 * QUIET)}")


@contextlib.contextmanager
def in_words(path: Path) -> Iterator[None]:
    """Turn the database's errors into messages that say what to do."""
    try:
        yield
    except sqlite3.Error as error:
        raise _explained(error, path) from error


def _busy(error: sqlite3.Error) -> bool:
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


def _explained(error: sqlite3.Error, path: Path) -> BacklashError:
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    what, remedy = {
        sqlite3.SQLITE_BUSY: ("another run is still writing to the history", "run again when it has finished"),
        sqlite3.SQLITE_LOCKED: ("another run is still writing to the history", "run again when it has finished"),
        sqlite3.SQLITE_NOTADB: ("this file is not a SQLite file", "give another file name to --history"),
        sqlite3.SQLITE_CORRUPT: ("the history file is damaged", "restore it from a backup, or move it away and scan "
                                 "the exports again"),
        sqlite3.SQLITE_READONLY: ("the history may not be written", "check the rights of the file and its folder"),
        sqlite3.SQLITE_CANTOPEN: ("the history cannot be opened", "check the path and the rights of its folder"),
        sqlite3.SQLITE_FULL: ("the disk is full", "free some space; the history holds what it held before"),
        sqlite3.SQLITE_IOERR: ("the disk reports an error", "check the disk; the history holds what it held before"),
    }.get(code, (f"the history cannot be used: {error}", "check the file"))
    busy = code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
    return BacklashError(what, where=str(path), remedy=remedy, code="history_busy" if busy else "history_unusable")
