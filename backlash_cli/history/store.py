"""The history of a plant in one SQLite file: what every scanned export said about every loop.

The content is a function of the scanned data: scanning the same export again changes nothing, nights may come in any
order, and a run is in the file as a whole or not at all.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from .. import __version__
from ..estimator.carry import Carry, unpack
from ..record import LoopSettings, Note
from ..results import Estimate, LoopReport, ScanResult, Verdict
from ..results.history import DAY, HalfPeriod, Night, Outcome, Repair, Run, day_of
from .database import Database
from .joins import active, distinct, join

EARLIEST, LATEST = 6e10, 2.5e11  # epoch seconds: year 68 to 9892
_EVIDENCE = {"cluster": ("d", "n", "share", "spread"), "confirmation": ("d", "delta_bic", "error_reduction"),
             "compensator": ("gain", "scheme", "reason")}  # what the report page shows of a night beside its size


class History(Database):
    """An open history with its nights, half periods, repairs and runs; see Database for how it is opened."""

    def add(self, *results: ScanResult, export: tuple[str, str] | None = None) -> Outcome:
        """Store scans at once: all of them are in the file afterwards, or none; nights that are known with the same
        content stay untouched.

        export: name and fingerprint of the export they come from, for the nightly job to know it again.
        """
        done: dict[str, list[tuple[str, str]]] = {"new": [], "unchanged": [], "revised": []}
        untimed: list[str] = []
        with self.transaction():
            for result in results:
                rows = []
                for report in result.loops:
                    if not all(t is not None and -EARLIEST < t < LATEST for t in (report.start, report.end)):
                        untimed.append(report.loop)
                        continue
                    row = night_row(report)
                    rows.append(row)
                    known = self.rows("SELECT digest FROM nights WHERE loop = ? AND start = ? AND end = ?",
                                      row["loop"], row["start"], row["end"])
                    what = "new" if not known else "revised" if known[0]["digest"] != row["digest"] else "unchanged"
                    done[what].append((row["loop"], day_of(0.5 * (row["start"] + row["end"])).isoformat()))
                    if what != "unchanged":
                        self.db.execute("DELETE FROM half_periods WHERE (loop, night_start, night_end) = "
                                        "(:loop, :start, :end)", row)
                        self.insert("nights", [{**row, "carry": report.carry}])
                        self.insert("half_periods", [half_period_row(row, e) for e in report.estimates], "IGNORE")
                if rows:
                    nights = sorted((r["loop"], r["start"], r["end"]) for r in rows)
                    inputs = as_json(sorted({Path(name).name for name in result.inputs}))
                    self.insert("runs", [{
                        "digest": _digest(f"[{as_json(nights)},{inputs}]"), "first": min(n[1] for n in nights),
                        "last": max(n[2] for n in nights), "loops": len({n[0] for n in nights}),
                        "nights": len(nights), "inputs": inputs, "failures": _notes(result.failures),
                        "tool": __version__}])
            if export is not None:
                self.insert("exports", [dict(zip(("name", "fingerprint"), export, strict=True))])
        return Outcome(**{name: tuple(nights) for name, nights in done.items()}, untimed=tuple(untimed))

    def export_fingerprint(self, name: str) -> str | None:
        """Return the fingerprint with which an export was scanned last, None when it never was."""
        found = self.rows("SELECT fingerprint FROM exports WHERE name = ?", name)
        return str(found[0]["fingerprint"]) if found else None

    def loops(self) -> list[str]:
        """Return the names of all loops, in order."""
        return [row[0] for row in self.rows("SELECT DISTINCT loop FROM nights ORDER BY loop")]

    def nights(self, loop: str) -> list[Night]:
        """Return the nights of a loop in time order; an export inside a longer one is left out."""
        counting = set(self._spans(loop))
        return [night_of(dict(row)) for row in self.rows("SELECT * FROM nights WHERE loop = ? ORDER BY start", loop)
                if (row["start"], row["end"]) in counting]

    def _spans(self, loop: str) -> list[tuple[float, float]]:
        return active([(r[0], r[1]) for r in self.rows("SELECT start, end FROM nights WHERE loop = ?", loop)])

    def recent_half_periods(self, loop: str) -> list[HalfPeriod]:
        """Return the half periods of a loop's last two weeks."""
        return self.half_periods(loop, max((end for _, end in self._spans(loop)), default=0.0) - 14 * DAY)

    def half_periods(self, loop: str, since: float = -math.inf) -> list[HalfPeriod]:
        """Return the half periods of a loop in time order, each moment once, joined where nights meet.

        since: epoch seconds; only nights that end later.
        """
        spans = self._spans(loop)
        found: list[HalfPeriod] = []
        before: tuple[Carry, float] | None = None
        for span in spans[max(sum(end <= since for _, end in spans) - 1, 0) :]:
            (row,) = self.rows("SELECT * FROM nights WHERE loop = ? AND start = ? AND end = ?", loop, *span)
            own: Iterable[Mapping[str, Any]] = map(dict, self.rows(
                "SELECT * FROM half_periods WHERE loop = ? AND night_start = ? AND night_end = ?", loop, *span))
            if row["carry"] is None:
                before = None
            else:
                carry, settings = unpack(row["carry"]), msgspec.json.decode(row["settings"], type=LoopSettings)
                start = span[0] - float(carry.head[0][0]) * carry.interval
                if before is not None:  # those that go over the cut take the place of the night's own
                    halves, until, tail = join(*before, carry, start, settings)
                    own = [*(r for r in own if r["start"] >= until - 0.002),
                           *({**half_period_row(dict(row), e), "joined": 1} for e in halves)]
                    carry = replace(carry, tail=tail or carry.tail)
                before = carry, start
            if span[1] > since:
                found += [msgspec.convert(r, HalfPeriod, strict=False) for r in own]
        return distinct(found)

    def repairs(self, loop: str) -> list[Repair]:
        """Return the repairs that people marked for a loop, in time order."""
        return [Repair(**row) for row in self.rows("SELECT * FROM repairs WHERE loop = ? ORDER BY time", loop)]

    def mark_repair(self, loop: str, time: float, note: str) -> bool:
        """Enter a repair of a loop's valve at `time` (epoch seconds); False when it is already there like this."""
        with self.transaction():
            known = Repair(loop, time, note) in self.repairs(loop)
            self.insert("repairs", [{"loop": loop, "time": time, "note": note}])
        return not known

    def remove_repair(self, loop: str, time: float) -> bool:
        """Take back a repair; False when there was none."""
        with self.transaction():
            done = self.db.execute("DELETE FROM repairs WHERE loop = ? AND time = ?", (loop, time)).rowcount
        return bool(done)

    def runs(self) -> list[Run]:
        """Return the runs that added to the history, in the order of their data."""
        return [msgspec.convert({**row, "inputs": json.loads(row["inputs"]), "failures": json.loads(row["failures"])},
                                Run) for row in map(dict, self.rows("SELECT * FROM runs ORDER BY first, last, digest"))]


def moment(time: float) -> float:
    """Round a time to the millisecond."""
    return round(float(time), 3)


def short(value: float | None) -> float | None:
    """Round to nine digits; None for what is not a number."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.9g}")


def night_row(report: LoopReport) -> dict[str, Any]:
    """Return the row of table `nights` for a report that has a time, rounded so that rounding errors are no news.

    digest: fingerprint of the row, the half periods and the carry.
    """
    assert report.start is not None and report.end is not None
    d, ci95, source = size_of(report)
    s = report.settings
    found = ((name, getattr(report, name)) for name in _EVIDENCE)
    row: dict[str, Any] = {
        # what is no valid text (broken encodings) is spelled out
        "loop": report.loop.encode("utf-8", "backslashreplace").decode("utf-8"),
        "start": moment(report.start), "end": moment(report.end),
        "verdict": str(report.verdict), "confidence": short(report.confidence) or 0.0,
        "d": short(d), "d_low": short(ci95[0]) if ci95 else None, "d_high": short(ci95[1]) if ci95 else None,
        "source": source, "limit_of_detection": short(report.limit_of_detection), "samples": report.samples,
        "interval_s": short(report.interval_s), "half_periods": report.half_periods, "detections": report.detections,
        "settings": as_json({**{name: short(getattr(s, name)) for name in ("K", "Ti", "Td", "Tf", "Kp", "theta")},
                             "pv_range": s.pv_range, "op_range": s.op_range, "source": dict(s.source)}),
        "reasons": _notes(report.reasons), "warnings": _notes(report.warnings),
        "travel": short(unpack(report.carry).travel) if report.carry else None,
        "details": as_json({name: {key: short(v) if isinstance(v := getattr(value, key), float) else v
                                   for key in _EVIDENCE[name]} for name, value in found if value is not None}),
    }
    halves = [list(half_period_row(row, e).values()) for e in report.estimates]
    row["digest"] = _digest(as_json([row, halves]), report.carry or b"")
    return row


def half_period_row(night: Mapping[str, Any], e: Estimate) -> dict[str, Any]:
    """Return the row of table `half_periods` for one half period of a night."""
    return {"loop": night["loop"], "night_start": night["start"], "night_end": night["end"], "joined": 0,
            "start": moment(e.start), "end": moment(e.end), "dt_s": short(e.dt_s), "dy": short(e.dy),
            "e_max": short(e.e_max), "d": short(e.d), "direction": int(e.direction), "accepted": int(e.accepted),
            "why": str(e.why)}


def night_of(row: Mapping[str, Any]) -> Night:
    """Return a row of table `nights` as a Night."""
    plain = {**row, **{name: json.loads(row[name]) for name in ("settings", "reasons", "warnings", "details")}}
    return msgspec.convert({**plain, "ci95": None if row["d_low"] is None else (row["d_low"], row["d_high"])}, Night)


def size_of(report: LoopReport) -> tuple[float | None, tuple[float, float] | None, str]:
    """Return the dead band that a report stands for, its interval, and where it comes from.

    The measurement against the output goes before the half periods, which read low in noise. No size without the
    verdict backlash or suspected: a number that the verdict refused is not a point of the wear.
    """
    if report.verdict in (Verdict.BACKLASH, Verdict.SUSPECTED):
        for source in ("confirmation", "cluster"):
            found = getattr(report, source)
            if found is not None and math.isfinite(found.d) and found.d > 0:
                return found.d, found.ci95, source
    return None, None, ""


def as_json(value: object) -> str:
    """Return JSON that is the same for the same value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)


def _notes(notes: Sequence[Note]) -> str:
    return as_json([{"code": n.code, "message": n.message} for n in notes])


def _digest(text: str, more: bytes = b"") -> str:
    return hashlib.sha256(text.encode("utf-8", "backslashreplace") + more).hexdigest()[:32]
