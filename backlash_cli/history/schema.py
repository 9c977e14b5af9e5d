"""Tables of the history file, their version, and the steps from older versions.

Every key is natural (loop and time) and no clock enters, so that the content depends on the scanned data alone: the
same nights give the same tables in whatever order, and however often, they came.
"""

from __future__ import annotations

import sqlite3

from ..errors import BacklashError

APPLICATION = 0x6261636B  # "back": marks the file as a backlash history
VERSION = 2

_NIGHTS_1 = """
CREATE TABLE nights (
    loop TEXT NOT NULL, start REAL NOT NULL, end REAL NOT NULL,
    digest TEXT NOT NULL, verdict TEXT NOT NULL, confidence REAL NOT NULL,
    d REAL, d_low REAL, d_high REAL, source TEXT NOT NULL, limit_of_detection REAL,
    samples INTEGER NOT NULL, interval_s REAL, half_periods INTEGER NOT NULL, detections INTEGER NOT NULL,
    settings TEXT NOT NULL, reasons TEXT NOT NULL, warnings TEXT NOT NULL,
    PRIMARY KEY (loop, start, end)
) WITHOUT ROWID
"""
_HALF_PERIODS = """
CREATE TABLE half_periods (
    loop TEXT NOT NULL, night_start REAL NOT NULL, night_end REAL NOT NULL,
    joined INTEGER NOT NULL, start REAL NOT NULL, end REAL NOT NULL,
    dt_s REAL NOT NULL, dy REAL NOT NULL, e_max REAL NOT NULL, d REAL NOT NULL,
    direction INTEGER NOT NULL, accepted INTEGER NOT NULL, why TEXT NOT NULL,
    PRIMARY KEY (loop, night_start, night_end, joined, start, end)
) WITHOUT ROWID
"""
_RUNS = """
CREATE TABLE runs (
    digest TEXT PRIMARY KEY, first REAL NOT NULL, last REAL NOT NULL, loops INTEGER NOT NULL, nights INTEGER NOT NULL,
    inputs TEXT NOT NULL, failures TEXT NOT NULL, tool TEXT NOT NULL
) WITHOUT ROWID
"""
_REPAIRS = "CREATE TABLE repairs (loop TEXT, time REAL, note TEXT NOT NULL, PRIMARY KEY (loop, time)) WITHOUT ROWID"

VERSION_1 = (_NIGHTS_1, _HALF_PERIODS, _RUNS, _REPAIRS)

# Version 2: half periods go over the cut between two nights; valve travel and details of the evidence are kept; the
# nightly job knows which exports it has scanned.
_JOINS = """
CREATE TABLE joins (
    loop TEXT NOT NULL, start REAL NOT NULL, end REAL NOT NULL,
    of TEXT NOT NULL, until REAL, tail BLOB,
    PRIMARY KEY (loop, start, end)
) WITHOUT ROWID
"""
_EXPORTS = "CREATE TABLE exports (name TEXT PRIMARY KEY, fingerprint TEXT NOT NULL) WITHOUT ROWID"
STEPS: dict[int, tuple[str, ...]] = {
    1: (
        "ALTER TABLE nights ADD COLUMN travel REAL",
        "ALTER TABLE nights ADD COLUMN details TEXT NOT NULL DEFAULT '{}'",
        "ALTER TABLE nights ADD COLUMN carry BLOB",
        _JOINS,
        _EXPORTS,
    ),
}


def version_of(db: sqlite3.Connection) -> int:
    """Return the schema version of the file, 0 where it is empty."""
    return int(db.execute("PRAGMA user_version").fetchone()[0])


def ready(db: sqlite3.Connection, where: str) -> bool:
    """Return whether the file needs no change before it is used.

    Raises BacklashError for a file of something else, or of a newer version of this tool.
    """
    application = int(db.execute("PRAGMA application_id").fetchone()[0])
    tables = int(db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0])
    if application not in (0, APPLICATION) or (application == 0 and tables):
        raise BacklashError("this SQLite file is not a backlash history", where=where, code="not_a_history",
                            remedy="give another file name to --history")
    version = version_of(db)
    if version > VERSION:
        raise BacklashError(f"the history was written by a newer version (schema {version}, this tool knows "
                            f"{VERSION})", where=where, code="newer_history", remedy="update backlash")
    return version == VERSION


def bring_up(db: sqlite3.Connection) -> None:
    """Make the tables or bring an older file up to this version; call inside a transaction."""
    version = version_of(db)
    if version == 0:
        for statement in VERSION_1:
            db.execute(statement)
        version = 1
    for step in range(version, VERSION):
        for statement in STEPS[step]:
            db.execute(statement)
    db.execute(f"PRAGMA application_id = {APPLICATION}")
    db.execute(f"PRAGMA user_version = {VERSION}")
