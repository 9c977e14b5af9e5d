"""The history of a plant in one SQLite file: what every scanned export said about every loop.

Every key is natural (loop and time) and no clock enters, so that the content depends on the scanned data alone: the
same nights give the same tables in whatever order, and however often, they came. The rollback journal (not WAL) keeps
the history one single file that also works on a network drive; a killed run leaves a journal that the next one plays
back, so that either all of a run is in the file or nothing of it."""

import contextlib
import json
import math
import re
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from .. import __version__
from ..errors import BacklashError
from ..estimator.carry import Carry, unpack
from ..record import LoopSettings, Note, fingerprint
from ..results import Estimate, LoopReport, ScanResult
from ..results.history import DAY, Night, Repair, day_of
from ..words import WORDS, explained
from .joins import active, distinct, join

PATIENCE, QUIET = 60.0, 1.0  # seconds to wait for another run before giving up, and before saying so
APPLICATION = 0x6261636B  # "back": marks the file as a backlash history
# statements from each version to the next
STEPS = [[statement for statement in step.split(";") if statement.strip()] for step in re.split(
    "(?m)^-- version.*", resources.files(__package__).joinpath("tables.sql").read_text("utf-8"))[1:]]
AS_JSON = ("settings", "reasons", "warnings", "details", "inputs", "failures")  # columns
BUSY = ("SQLITE_BUSY", "SQLITE_LOCKED")
EARLIEST, LATEST = 6e10, 2.5e11  # epoch seconds: year 68 to 9892
OF_NIGHT = "WHERE (loop, night_start, night_end) = (:loop, :start, :end)"
_EVIDENCE = {"cluster": ("d", "n", "share", "spread"), "confirmation": ("d", "delta_bic", "error_reduction"),
             "compensator": ("gain", "scheme", "reason")}  # what the report page shows of a night beside its size


class History(contextlib.AbstractContextManager["History"]):
    """An open history with its nights, half periods, repairs and runs; use it in a `with` block.

    path: the SQLite file. create: make it where it does not exist; an older one is brought up to date. patience:
    seconds to wait for another run. say: is told, once, when this run waits for another one. Raises BacklashError with
    the remedy for all that can go wrong."""

    def __init__(self, path: str | Path, *, create: bool = False, patience: float = PATIENCE,
                 say: Callable[[str], object] = lambda text: None) -> None:
        self.path, self.patience, self.say = Path(path), patience, say
        if create:
            check_folder(self.path)
        elif not self.path.is_file() or not self.path.stat().st_size:
            raise BacklashError(**explained("no_history"), where=str(path))
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

    def __exit__(self, *error: object) -> None:
        self.db.close()

    def add(self, *results: ScanResult, export: tuple[str, str] | None = None) -> dict[str, list[Any]]:
        """Store scans at once: all of them are in the file afterwards, or none; nights that are known with the same
        content stay untouched. Returns the nights, as (loop, day), that are `new`, `unchanged` or `revised`, and the
        loops without a time (`untimed`), which are not stored.

        export: name and fingerprint of the export they come from, for the nightly job to know it again."""
        done: dict[str, list[Any]] = {"new": [], "unchanged": [], "revised": [], "untimed": []}
        with self.transaction():
            for result in results:
                rows = []
                for report in result.loops:
                    if not all(t is not None and -EARLIEST < t < LATEST for t in (report.start, report.end)):
                        done["untimed"].append(report.loop)
                        continue
                    row = night_row(report)
                    rows.append(row)
                    known = self.rows("SELECT digest FROM nights WHERE (loop, start, end) = (:loop, :start, :end)", row)
                    what = "new" if not known else "revised" if known[0]["digest"] != row["digest"] else "unchanged"
                    done[what].append((row["loop"], day_of(0.5 * (row["start"] + row["end"]))))
                    if what != "unchanged":
                        self.rows(f"DELETE FROM half_periods {OF_NIGHT}", row)
                        self.insert("nights", [{**row, "carry": report.carry}])
                        self.insert("half_periods", [half_period_row(row, e) for e in report.estimates], "IGNORE")
                if rows:
                    nights = sorted((r["loop"], r["start"], r["end"]) for r in rows)
                    inputs = sorted({Path(name).name for name in result.inputs})
                    self.insert("runs", [{"digest": fingerprint(as_json([nights, inputs])), "tool": __version__,
                        "first": min(n[1] for n in nights), "last": max(n[2] for n in nights), "nights": len(nights),
                        "loops": len({n[0] for n in nights}), "inputs": inputs, "failures": _notes(result.failures)}])
            if export is not None:
                self.insert("exports", [dict(zip(("name", "fingerprint"), export, strict=True))])
        return done

    def exports(self) -> dict[str, str]:
        """Return the names of the exports that were scanned, each with its fingerprint then."""
        return {row["name"]: row["fingerprint"] for row in self.rows("SELECT * FROM exports")}

    def loops(self) -> list[str]:
        """Return the names of all loops, in order."""
        return [row["loop"] for row in self.rows("SELECT DISTINCT loop FROM nights ORDER BY loop")]

    def nights(self, loop: str) -> list[Night]:
        """Return the nights of a loop in time order; an export inside a longer one is left out."""
        with self._in_words():
            return [night_of(row) for row in self._nights(loop)]

    def _nights(self, loop: str) -> list[dict[str, Any]]:
        rows = {(row["start"], row["end"]): row for row in self.rows("SELECT * FROM nights WHERE loop = ?", [loop])}
        return [rows[span] for span in active([*rows])]

    def half_periods(self, loop: str, days: float = math.inf) -> list[Estimate]:
        """Return the half periods of a loop in time order, each moment once, joined where nights meet.

        days: only of nights that end within so many days before the last."""
        with self._in_words():
            rows = self._nights(loop)
            since = max((row["end"] for row in rows), default=0.0) - days * DAY
            found: list[Estimate] = []
            before: tuple[Carry, float] | None = None
            for row in rows[max(sum(row["end"] <= since for row in rows) - 1, 0) :]:
                own = self.rows(f"SELECT * FROM half_periods {OF_NIGHT}", row)
                if row["carry"] is None:
                    before = None
                else:
                    carry, settings = unpack(row["carry"]), msgspec.convert(row["settings"], LoopSettings)
                    start = row["start"] - float(carry.head[0][0]) * carry.interval
                    if before is not None:  # those that go over the cut take the place of the night's own
                        halves, until, tail = join(*before, carry, start, settings)
                        own = [*(r for r in own if r["start"] >= until - 0.002),
                               *(half_period_row(row, replace(e, joined=True)) for e in halves)]
                        carry = replace(carry, tail=tail or carry.tail)
                    before = carry, start
                if row["end"] > since:
                    found += msgspec.convert(own, list[Estimate], strict=False)
            return distinct(found)

    def repairs(self, loop: str) -> list[Repair]:
        """Return the repairs that people marked for a loop, in time order."""
        with self._in_words():
            return msgspec.convert(self.rows("SELECT * FROM repairs WHERE loop=? ORDER BY time", [loop]), list[Repair])

    def mark_repair(self, loop: str, time: float, note: str) -> bool:
        """Enter a repair of a loop's valve at `time` (epoch seconds); False when it is already there like this."""
        with self.transaction():
            known = Repair(loop, time, note) in self.repairs(loop)
            self.insert("repairs", [{"loop": loop, "time": time, "note": note}])
        return not known

    def remove_repair(self, loop: str, time: float) -> bool:
        """Take back a repair; False when there was none."""
        with self.transaction():
            done = self.db.execute("DELETE FROM repairs WHERE loop = ? AND time = ?", [loop, time]).rowcount
        return bool(done)

    def runs(self) -> list[dict[str, Any]]:
        """Return the runs that added to the history, in the order of their data, each by the columns of its table."""
        return self.rows("SELECT * FROM runs ORDER BY first, last, digest")

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
            raise BacklashError(**explained("not_a_history"), where=str(self.path))
        if version > len(STEPS):
            raise BacklashError(**explained("newer_history", version=version, known=len(STEPS)), where=str(self.path))
        return version

    def _patiently(self, action: Callable[[], Any]) -> Any:
        """Run `action`; when another run holds the file, say so and wait for it."""
        try:
            return action()
        except sqlite3.OperationalError as error:
            if not getattr(error, "sqlite_errorname", "").startswith(BUSY):
                raise
        self.say(f"another run is writing to {self.path}; waiting up to {self.patience:g} s")
        self.db.execute(f"PRAGMA busy_timeout = {int(1000 * self.patience)}")
        return action()

    @contextlib.contextmanager
    def _in_words(self) -> Iterator[None]:
        """Turn the database's errors into messages that say what to do."""
        try:
            yield
        except (sqlite3.Error, msgspec.ValidationError, json.JSONDecodeError) as error:  # the others: of a row
            name = getattr(error, "sqlite_errorname", "" if isinstance(error, sqlite3.Error) else "SQLITE_CORRUPT")
            known = next((words for kind, words in WORDS["history"].items() if name.startswith(kind)),
                         f"the history cannot be used: {error} -> restore it from a backup, or move it away")
            what, _, remedy = known.rpartition(" -> ")
            raise BacklashError(what, where=str(self.path), remedy=remedy,
                                code="history_busy" if name.startswith(BUSY) else "history_unusable") from error


def night_row(report: LoopReport) -> dict[str, Any]:
    """Return the row of table `nights` for a report that has a time.

    digest: fingerprint of the row, the half periods and the carry."""
    claimed, s = report.claimed, report.settings  # a number that the verdict refused is not a point of the wear
    d, low, high = (claimed.d, *claimed.ci95) if claimed else (None, None, None)
    found = {name: vars(evidence) for name in _EVIDENCE if (evidence := getattr(report, name)) is not None}
    row = _rounded({
        # what is no valid text (broken encodings) is spelled out
        "loop": report.loop.encode("utf-8", "backslashreplace").decode("utf-8"),
        "start": report.start, "end": report.end, "verdict": str(report.verdict), "confidence": report.confidence,
        "d": d, "d_low": low, "d_high": high, "source": type(claimed).__name__.lower() if claimed else "",
        **{name: getattr(report, name) for name in ("limit_of_detection", "samples", "interval_s", "half_periods",
                                                    "detections")},
        "settings": _rounded({name: getattr(s, name) for name in ("K", "Ti", "Td", "Tf", "Kp", "theta")}) | {
            "pv_range": s.pv_range, "op_range": s.op_range, "source": dict(s.source)},
        "reasons": _notes(report.reasons), "warnings": _notes(report.warnings),
        "travel": unpack(report.carry).travel if report.carry else None,
        "details": {name: _rounded({key: values[key] for key in _EVIDENCE[name]}) for name, values in found.items()}})
    halves = [list(half_period_row(row, e).values()) for e in report.estimates]
    return {**row, "digest": fingerprint(as_json([stored(row), halves]), more=report.carry or b"")}


def half_period_row(night: Mapping[str, Any], e: Estimate) -> dict[str, Any]:
    """Return the row of table `half_periods` for one half period of a night."""
    return {"loop": night["loop"], "night_start": night["start"], "night_end": night["end"], **_rounded(vars(e)),
            "accepted": int(e.accepted), "joined": int(e.joined)}


def night_of(row: Mapping[str, Any]) -> Night:
    """Return a row of table `nights` as a Night."""
    return msgspec.convert({**row, "ci95": None if row["d_low"] is None else (row["d_low"], row["d_high"])}, Night)


def _notes(notes: Sequence[Note]) -> list[dict[str, str]]:
    return [{"code": n.code, "message": n.message} for n in notes]


def _rounded(values: Mapping[str, Any]) -> dict[str, Any]:
    """Round times to the millisecond and numbers to nine digits: rounding errors are no news; None for no number."""
    return {name: value if not isinstance(value, float) else None if not math.isfinite(value) else
            round(value, 3) if name in ("start", "end") else float(f"{value:.9g}") for name, value in values.items()}


def as_json(value: object) -> str:
    """Return JSON that is the same for the same value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)


def stored(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row as its table holds it."""
    return {name: as_json(value) if name in AS_JSON else value for name, value in row.items()}


def check_folder(path: Path) -> None:
    """Raises BacklashError where a folder or pipe has the name of a history, or there is no folder it could lie in."""
    if path.exists() and not path.is_file():
        raise BacklashError(**explained("history_folder"), where=str(path))
    if not path.parent.is_dir():
        raise BacklashError(**explained("history_nowhere"), where=str(path.parent))
