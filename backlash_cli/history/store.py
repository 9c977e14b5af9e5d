"""The history of a plant in one SQLite file: what every scanned export said about every loop.

The content is a function of the scanned data: scanning the same export again changes nothing, nights may come in any
order, and a run is in the file as a whole or not at all.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from .. import __version__
from ..record import Note
from ..results import LoopReport, ScanResult
from ..results.history import DAY, HalfPeriod, Night, Outcome, Repair, Run, day_of
from .connection import PATIENCE, Say, connect, in_words, transaction
from .joins import active, distinct, rejoin
from .rows import (
    HALF_PERIOD_COLUMNS,
    NIGHT_COLUMNS,
    as_json,
    half_period_of,
    half_period_row,
    insert,
    night_of,
    night_row,
    timed,
)


def _silent(text: str) -> None:
    """Say nothing."""


class History:
    """An open history file; use it in a `with` block.

    path: the SQLite file. create: make it where it does not exist. patience: seconds to wait for another run.
    say: is told when this run waits for another one. Raises BacklashError with the remedy for all that can go wrong.
    """

    def __init__(self, path: str | Path, *, create: bool = False, patience: float = PATIENCE,
                 say: Say = _silent) -> None:
        self.path, self.patience, self.say = Path(path), patience, say
        self.db = connect(self.path, create=create, patience=patience, say=say)
        self.db.row_factory = sqlite3.Row

    def __enter__(self) -> History:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.db.close()

    def add(self, result: ScanResult) -> Outcome:
        """Store a scan; nights that are known with the same content stay untouched."""
        return self.add_all([result])

    def add_all(self, results: Sequence[ScanResult], *, export: tuple[str, str] | None = None) -> Outcome:
        """Store several scans at once: all of them are in the file afterwards, or none.

        export: name and fingerprint of the export they come from, for the nightly job to know it again.
        """
        new: list[tuple[str, str]] = []
        unchanged: list[tuple[str, str]] = []
        revised: list[tuple[str, str]] = []
        untimed: list[str] = []
        with transaction(self.db, self.path, self.patience, self.say):
            for result in results:
                rows = []
                for report in result.loops:
                    if not timed(report):
                        untimed.append(report.loop)
                        continue
                    rows.append(row := night_row(report))
                    known = self._digest(row)
                    entry = (row["loop"], day_of(0.5 * (row["start"] + row["end"])).isoformat())
                    (new if known is None else unchanged if known == row["digest"] else revised).append(entry)
                    if known != row["digest"]:
                        self._write(row, report)
                if rows:
                    self._write_run(rows, result)
            for loop in dict.fromkeys(loop for loop, _ in (*new, *revised)):
                rejoin(self.db, loop)
            if export is not None:
                self.db.execute("INSERT OR REPLACE INTO exports VALUES (?, ?)", export)
        return Outcome(tuple(new), tuple(unchanged), tuple(revised), tuple(untimed))

    def _digest(self, row: dict[str, Any]) -> str | None:
        """Return the fingerprint of the night as it is in the file."""
        known = self.db.execute("SELECT digest FROM nights WHERE loop = ? AND start = ? AND end = ?",
                                (row["loop"], row["start"], row["end"])).fetchone()
        return None if known is None else str(known["digest"])

    def _write(self, row: dict[str, object], report: LoopReport) -> None:
        key = (row["loop"], row["start"], row["end"])
        self.db.execute("DELETE FROM half_periods WHERE loop = ? AND night_start = ? AND night_end = ?", key)
        insert(self.db, "nights", (*NIGHT_COLUMNS, "carry"),
               [[*(row[name] for name in NIGHT_COLUMNS), report.carry]])
        insert(self.db, "half_periods", HALF_PERIOD_COLUMNS,
               [half_period_row(row, e, joined=False) for e in report.estimates], "IGNORE")

    def _write_run(self, rows: list[dict[str, object]], result: ScanResult) -> None:
        inputs = sorted({Path(name).name for name in result.inputs})
        failures = [{"code": n.code, "message": n.message} for n in result.failures]
        nights = sorted((str(r["loop"]), float(r["start"]), float(r["end"])) for r in rows)  # type: ignore[arg-type]
        digest = hashlib.sha256(as_json([nights, inputs]).encode("utf-8", "backslashreplace")).hexdigest()[:32]
        self.db.execute("INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?, ?, ?, ?, ?)", (
            digest, min(n[1] for n in nights), max(n[2] for n in nights), len({n[0] for n in nights}), len(nights),
            as_json(inputs), as_json(failures), __version__))

    def export_fingerprint(self, name: str) -> str | None:
        """Return the fingerprint with which an export was scanned last, None when it never was."""
        with in_words(self.path):
            row = self.db.execute("SELECT fingerprint FROM exports WHERE name = ?", (name,)).fetchone()
        return None if row is None else str(row["fingerprint"])

    def loops(self) -> list[str]:
        """Return the names of all loops, in order."""
        with in_words(self.path):
            return [row[0] for row in self.db.execute("SELECT DISTINCT loop FROM nights ORDER BY loop")]

    def nights(self, loop: str) -> list[Night]:
        """Return the nights of a loop in time order; an export inside a longer one is left out."""
        with in_words(self.path):
            rows = self.db.execute(f"SELECT {', '.join(NIGHT_COLUMNS)} FROM nights WHERE loop = ? ORDER BY start, end",
                                   (loop,)).fetchall()
        counting = set(active([(row["start"], row["end"]) for row in rows]))
        return [night_of(row) for row in rows if (row["start"], row["end"]) in counting]

    def recent_half_periods(self, loop: str, days: float = 14.0) -> list[HalfPeriod]:
        """Return the half periods of a loop's last `days`."""
        with in_words(self.path):
            last = self.db.execute("SELECT max(end) FROM nights WHERE loop = ?", (loop,)).fetchone()[0]
        return self.half_periods(loop, (last or 0.0) - days * DAY)

    def half_periods(self, loop: str, since: float = -1e300) -> list[HalfPeriod]:
        """Return the half periods of a loop in time order, each moment once, joined where nights meet.

        since: epoch seconds; only nights that end later.
        """
        with in_words(self.path):
            spans = self.db.execute("SELECT start, end FROM nights WHERE loop = ?", (loop,)).fetchall()
            rows = self.db.execute(
                "SELECT h.*, j.of AS joint, j.until FROM half_periods h LEFT JOIN joins j ON j.loop = h.loop AND "
                "j.start = h.night_start AND j.end = h.night_end WHERE h.loop = ? AND h.night_end > ?",
                (loop, since)).fetchall()
        counting = set(active([(row["start"], row["end"]) for row in spans]))
        return distinct([half_period_of(row) for row in rows if (row["night_start"], row["night_end"]) in counting
                         and not _replaced(row)])

    def repairs(self, loop: str) -> list[Repair]:
        """Return the repairs that people marked for a loop, in time order."""
        with in_words(self.path):
            rows = self.db.execute("SELECT * FROM repairs WHERE loop = ? ORDER BY time", (loop,)).fetchall()
        return [Repair(row["loop"], row["time"], row["note"]) for row in rows]

    def mark_repair(self, loop: str, time: float, note: str) -> bool:
        """Enter a repair of a loop's valve at `time` (epoch seconds); False when it is already there like this."""
        with transaction(self.db, self.path, self.patience, self.say):
            known = self.db.execute("SELECT note FROM repairs WHERE loop = ? AND time = ?", (loop, time)).fetchone()
            self.db.execute("INSERT OR REPLACE INTO repairs VALUES (?, ?, ?)", (loop, time, note))
        return known is None or known["note"] != note

    def remove_repair(self, loop: str, time: float) -> bool:
        """Take back a repair; False when there was none."""
        with transaction(self.db, self.path, self.patience, self.say):
            done = self.db.execute("DELETE FROM repairs WHERE loop = ? AND time = ?", (loop, time)).rowcount
        return bool(done)

    def runs(self) -> list[Run]:
        """Return the runs that added to the history, in the order of their data."""
        with in_words(self.path):
            rows = self.db.execute("SELECT * FROM runs ORDER BY first, last, digest").fetchall()
        return [Run(r["first"], r["last"], r["loops"], r["nights"], tuple(json.loads(r["inputs"])),
                    tuple(Note(n["code"], n["message"]) for n in json.loads(r["failures"])), r["tool"]) for r in rows]


def _replaced(row: sqlite3.Row) -> bool:
    """Whether a night's own half period is replaced by those that go over the cut before it."""
    if row["joined"] or row["joint"] is None:
        return False
    return row["until"] is None or row["start"] < row["until"] - 0.002
