"""The history file: its tables and their version, opening it, waiting for another run, words for what can go wrong.

Every key is natural (loop and time) and no clock enters, so that the content depends on the scanned data alone: the
same nights give the same tables in whatever order, and however often, they came. The rollback journal (not WAL) keeps
the history one single file that also works on a network drive; a killed run leaves a journal that the next one plays
back, so that either all of a run is in the file or nothing of it.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from ..errors import BacklashError

PATIENCE = 60.0  # seconds to wait for another run before giving up
QUIET = 1.0  # seconds to wait before saying so
APPLICATION = 0x6261636B  # "back": marks the file as a backlash history
STEPS = (  # statements from each version to the next; an empty file has version 0
    ("""CREATE TABLE nights (
        loop TEXT NOT NULL, start REAL NOT NULL, end REAL NOT NULL,
        digest TEXT NOT NULL, verdict TEXT NOT NULL, confidence REAL NOT NULL,
        d REAL, d_low REAL, d_high REAL, source TEXT NOT NULL, limit_of_detection REAL,
        samples INTEGER NOT NULL, interval_s REAL, half_periods INTEGER NOT NULL, detections INTEGER NOT NULL,
        settings TEXT NOT NULL, reasons TEXT NOT NULL, warnings TEXT NOT NULL,
        PRIMARY KEY (loop, start, end)) WITHOUT ROWID""",
     """CREATE TABLE half_periods (
        loop TEXT NOT NULL, night_start REAL NOT NULL, night_end REAL NOT NULL,
        joined INTEGER NOT NULL, start REAL NOT NULL, end REAL NOT NULL,
        dt_s REAL NOT NULL, dy REAL NOT NULL, e_max REAL NOT NULL, d REAL NOT NULL,
        direction INTEGER NOT NULL, accepted INTEGER NOT NULL, why TEXT NOT NULL,
        PRIMARY KEY (loop, night_start, night_end, joined, start, end)) WITHOUT ROWID""",
     """CREATE TABLE runs (
        digest TEXT PRIMARY KEY, first REAL NOT NULL, last REAL NOT NULL, loops INTEGER NOT NULL,
        nights INTEGER NOT NULL, inputs TEXT NOT NULL, failures TEXT NOT NULL, tool TEXT NOT NULL) WITHOUT ROWID""",
     "CREATE TABLE repairs (loop TEXT, time REAL, note TEXT NOT NULL, PRIMARY KEY (loop, time)) WITHOUT ROWID"),
    # a night says what it leaves to the next one, valve travel and details of the evidence; the nightly job knows which
    # exports it has scanned
    ("ALTER TABLE nights ADD COLUMN travel REAL",
     "ALTER TABLE nights ADD COLUMN details TEXT NOT NULL DEFAULT '{}'",
     "ALTER TABLE nights ADD COLUMN carry BLOB",
     "CREATE TABLE exports (name TEXT PRIMARY KEY, fingerprint TEXT NOT NULL) WITHOUT ROWID"),
    # half periods over the cut are worked out when they are asked for
    ("DROP TABLE IF EXISTS joins", "DELETE FROM half_periods WHERE joined"),
)
AS_JSON = ("settings", "reasons", "warnings", "details", "inputs", "failures")  # columns
_BUSY = ("another run is still writing to the history", "run again when it has finished")
_WRONG = {
    sqlite3.SQLITE_BUSY: _BUSY, sqlite3.SQLITE_LOCKED: _BUSY,
    sqlite3.SQLITE_NOTADB: ("this file is not a SQLite file", "give another file name to --history"),
    sqlite3.SQLITE_CORRUPT: ("the history file is damaged",
                             "restore it from a backup, or move it away and scan the exports again"),
    sqlite3.SQLITE_READONLY: ("the history may not be written", "check the rights of the file and its folder"),
    sqlite3.SQLITE_CANTOPEN: ("the history cannot be opened", "check the path and the rights of its folder"),
    sqlite3.SQLITE_FULL: ("the disk is full", "free some space; the history holds what it held before"),
    sqlite3.SQLITE_IOERR: ("the disk reports an error", "check the disk; the history holds what it held before"),
}


class Database:
    """An open history file; use it in a `with` block.

    path: the SQLite file. create: make it where it does not exist; an older one is brought up to date. patience:
    seconds to wait for another run. say: is told, once, when this run waits for another one. Raises BacklashError with
    the remedy for all that can go wrong.
    """

    def __init__(self, path: str | Path, *, create: bool = False, patience: float = PATIENCE,
                 say: Callable[[str], object] = lambda text: None) -> None:
        self.path, self.patience, self.say = Path(path), patience, say
        if create:
            check_folder(self.path)
        elif not self.path.is_file():
            raise BacklashError("there is no history at this place", where=str(path), code="no_history",
                                remedy="make one with: backlash scan EXPORT --history FILE")
        with self._in_words(), contextlib.ExitStack() as opening:
            self.db = sqlite3.connect(path, timeout=QUIET, isolation_level=None)
            opening.callback(self.db.close)
            self.db.row_factory = sqlite3.Row
            self.db.execute("PRAGMA synchronous = FULL")
            if self._patiently(self._version) < len(STEPS):
                with self.transaction():
                    # another run may have done it while this one waited
                    for statement in (s for step in STEPS[self._version() :] for s in step):
                        self.db.execute(statement)
                    self.db.execute(f"PRAGMA application_id = {APPLICATION}")
                    self.db.execute(f"PRAGMA user_version = {len(STEPS)}")
            opening.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.db.close()

    def rows(self, query: str, values: Sequence[object] | Mapping[str, object] = ()) -> list[dict[str, Any]]:
        """Return the answer to a query with its values."""
        with self._in_words():
            return [{name: json.loads(value) if name in AS_JSON else value for name, value in dict(row).items()}
                    for row in self.db.execute(query, values)]

    def insert(self, table: str, rows: Sequence[Mapping[str, Any]], known: str = "REPLACE") -> None:
        """Write rows of the same columns; one that is known is replaced, or with `known="IGNORE"` left as it is."""
        if rows:
            values = ", ".join(f":{name}" for name in rows[0])
            self.db.executemany(f"INSERT OR {known} INTO {table} ({', '.join(rows[0])}) VALUES ({values})",
                                map(stored, rows))

    @contextlib.contextmanager
    def transaction(self) -> Iterator[None]:
        """All or nothing: what happens inside is in the file after the block, or not at all."""
        with self._in_words():
            self._patiently(lambda: self.db.execute("BEGIN IMMEDIATE"))
            with self.db:
                yield

    def _version(self) -> int:
        """Return the version of the tables, 0 for an empty file; refuse what is no history or a newer one."""
        application, version, tables = (int(self.db.execute(query).fetchone()[0]) for query in (
            "PRAGMA application_id", "PRAGMA user_version", "SELECT count(*) FROM sqlite_master"))
        if application not in (0, APPLICATION) or (application == 0 and tables):
            raise BacklashError("this SQLite file is not a backlash history", where=str(self.path),
                                code="not_a_history", remedy="give another file name to --history")
        if version > len(STEPS):
            raise BacklashError(f"the history was written by a newer version (schema {version}, this tool knows "
                                f"{len(STEPS)})", where=str(self.path), code="newer_history", remedy="update backlash")
        return version

    def _patiently(self, action: Callable[[], Any]) -> Any:
        """Run `action`; when another run holds the file, say so and wait for it."""
        try:
            return action()
        except sqlite3.OperationalError as error:
            if _wrong(error) != _BUSY:
                raise
        self.say(f"another run is writing to {self.path}; waiting up to {self.patience:g} s")
        self.db.execute(f"PRAGMA busy_timeout = {int(1000 * self.patience)}")
        return action()

    @contextlib.contextmanager
    def _in_words(self) -> Iterator[None]:
        """Turn the database's errors into messages that say what to do."""
        try:
            yield
        except sqlite3.Error as error:
            what, remedy = _wrong(error)
            raise BacklashError(what, where=str(self.path), remedy=remedy, code="history_busy" if what == _BUSY[0]
                                else "history_unusable") from error


def as_json(value: object) -> str:
    """Return JSON that is the same for the same value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)


def stored(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row as its table holds it."""
    return {name: as_json(value) if name in AS_JSON else value for name, value in row.items()}


def check_folder(path: Path) -> None:
    """Raises BacklashError where the folder in which a history would be made does not exist."""
    if not path.parent.is_dir():
        raise BacklashError("the folder of the history does not exist", where=str(path.parent), code="no_history",
                            remedy="make the folder first")


def _wrong(error: sqlite3.Error) -> tuple[str, str]:
    """Return what is wrong and the remedy."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    return _WRONG.get(code, (f"the history cannot be used: {error}", "check the file"))
