"""The history of a plant in one SQLite file: what every scanned export said about every loop.

The content is a function of the scanned data: scanning the same export again changes nothing, nights may come in any
order, and a run is in the file as a whole or not at all.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partialmethod
from pathlib import Path
from typing import Any

import msgspec

from .. import __version__
from ..estimator.carry import Carry, unpack
from ..record import LoopSettings, Note
from ..results import Estimate, LoopReport, ScanResult, Verdict
from ..results.history import DAY, HalfPeriod, Night, Outcome, Repair, Run, day_of
from .database import Database, as_json, stored
from .joins import active, distinct, join

EARLIEST, LATEST = 6e10, 2.5e11  # epoch seconds: year 68 to 9892
OF_NIGHT = "(loop, start, end) = (:loop, :start, :end)"
OF_HALVES = "(loop, night_start, night_end) = (:loop, :start, :end)"
_EVIDENCE = {"cluster": ("d", "n", "share", "spread"), "confirmation": ("d", "delta_bic", "error_reduction"),
             "compensator": ("gain", "scheme", "reason")}  # what the report page shows of a night beside its size


class History(Database):
    """An open history with its nights, half periods, repairs and runs; see Database for how it is opened."""

    def add(self, *results: ScanResult, export: tuple[str, str] | None = None) -> Outcome:
        """Store scans at once: all of them are in the file afterwards, or none; nights that are known with the same
        content stay untouched.

        export: name and fingerprint of the export they come from, for the nightly job to know it again.
        """
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
                    key = {name: row[name] for name in ("loop", "start", "end")}
                    known = self.rows(f"SELECT digest FROM nights WHERE {OF_NIGHT}", key)
                    what = "new" if not known else "revised" if known[0]["digest"] != row["digest"] else "unchanged"
                    done[what].append((row["loop"], day_of(0.5 * (row["start"] + row["end"])).isoformat()))
                    if what != "unchanged":
                        self.rows(f"DELETE FROM half_periods WHERE {OF_HALVES}", key)
                        self.insert("nights", [{**row, "carry": report.carry}])
                        self.insert("half_periods", [half_period_row(row, e) for e in report.estimates], "IGNORE")
                if rows:
                    nights = sorted((r["loop"], r["start"], r["end"]) for r in rows)
                    inputs = sorted({Path(name).name for name in result.inputs})
                    self.insert("runs", [{
                        "digest": _digest(as_json([nights, inputs])), "first": min(n[1] for n in nights),
                        "last": max(n[2] for n in nights), "loops": len({n[0] for n in nights}),
                        "nights": len(nights), "inputs": inputs, "failures": _notes(result.failures),
                        "tool": __version__}])
            if export is not None:
                self.insert("exports", [dict(zip(("name", "fingerprint"), export, strict=True))])
        return Outcome(**{name: tuple(nights) for name, nights in done.items()})

    def export_fingerprint(self, name: str) -> str | None:
        """Return the fingerprint with which an export was scanned last, None when it never was."""
        return next((row["fingerprint"] for row in self.rows("SELECT * FROM exports WHERE name = ?", [name])), None)

    def loops(self) -> list[str]:
        """Return the names of all loops, in order."""
        return [row["loop"] for row in self.rows("SELECT DISTINCT loop FROM nights ORDER BY loop")]

    def nights(self, loop: str) -> list[Night]:
        """Return the nights of a loop in time order; an export inside a longer one is left out."""
        rows = self.rows("SELECT * FROM nights WHERE loop = ? ORDER BY start, end", [loop])
        counting = set(active([(row["start"], row["end"]) for row in rows]))
        return [night_of(row) for row in rows if (row["start"], row["end"]) in counting]

    def half_periods(self, loop: str, days: float = math.inf) -> list[HalfPeriod]:
        """Return the half periods of a loop in time order, each moment once, joined where nights meet.

        days: only of nights that end within so many days before the last.
        """
        spans = active([(row["start"], row["end"]) for row in self.rows(
            "SELECT start, end FROM nights WHERE loop = ?", [loop])])
        since = max((end for _, end in spans), default=0.0) - days * DAY
        found: list[HalfPeriod] = []
        before: tuple[Carry, float] | None = None
        for span in spans[max(sum(end <= since for _, end in spans) - 1, 0) :]:
            key = {"loop": loop, "start": span[0], "end": span[1]}
            (row,) = self.rows(f"SELECT * FROM nights WHERE {OF_NIGHT}", key)
            own = self.rows(f"SELECT * FROM half_periods WHERE {OF_HALVES}", key)
            if row["carry"] is None:
                before = None
            else:
                carry, settings = unpack(row["carry"]), msgspec.convert(row["settings"], LoopSettings)
                start = span[0] - float(carry.head[0][0]) * carry.interval
                if before is not None:  # those that go over the cut take the place of the night's own
                    halves, until, tail = join(*before, carry, start, settings)
                    own = [*(r for r in own if r["start"] >= until - 0.002),
                           *({**half_period_row(row, e), "joined": 1} for e in halves)]
                    carry = replace(carry, tail=tail or carry.tail)
                before = carry, start
            if span[1] > since:
                found += msgspec.convert(own, list[HalfPeriod], strict=False)
        return distinct(found)

    recent_half_periods = partialmethod(half_periods, days=14.0)

    def repairs(self, loop: str) -> list[Repair]:
        """Return the repairs that people marked for a loop, in time order."""
        return [Repair(**row) for row in self.rows("SELECT * FROM repairs WHERE loop = ? ORDER BY time", [loop])]

    def mark_repair(self, loop: str, time: float, note: str) -> bool:
        """Enter a repair of a loop's valve at `time` (epoch seconds); False when it is already there like this."""
        with self.transaction():
            known = Repair(loop, time, note) in self.repairs(loop)
            self.insert("repairs", [{"loop": loop, "time": time, "note": note}])
        return not known

    def remove_repair(self, loop: str, time: float) -> bool:
        """Take back a repair; False when there was none."""
        with self.transaction():
            return bool(self.rows("DELETE FROM repairs WHERE loop = ? AND time = ? RETURNING time", [loop, time]))

    def runs(self) -> list[Run]:
        """Return the runs that added to the history, in the order of their data."""
        return msgspec.convert(self.rows("SELECT * FROM runs ORDER BY first, last, digest"), list[Run])


def night_row(report: LoopReport) -> dict[str, Any]:
    """Return the row of table `nights` for a report that has a time.

    digest: fingerprint of the row, the half periods and the carry.
    """
    d, ci95, source = size_of(report)
    s = report.settings
    found = {name: vars(evidence) for name in _EVIDENCE if (evidence := getattr(report, name)) is not None}
    row = _rounded({
        # what is no valid text (broken encodings) is spelled out
        "loop": report.loop.encode("utf-8", "backslashreplace").decode("utf-8"),
        "start": report.start, "end": report.end, "verdict": str(report.verdict), "confidence": report.confidence,
        "d": d, "d_low": ci95[0] if ci95 else None, "d_high": ci95[1] if ci95 else None, "source": source,
        **{name: getattr(report, name) for name in ("limit_of_detection", "samples", "interval_s", "half_periods",
                                                    "detections")},
        "settings": _rounded({name: getattr(s, name) for name in ("K", "Ti", "Td", "Tf", "Kp", "theta")}) | {
            "pv_range": s.pv_range, "op_range": s.op_range, "source": dict(s.source)},
        "reasons": _notes(report.reasons), "warnings": _notes(report.warnings),
        "travel": unpack(report.carry).travel if report.carry else None,
        "details": {name: _rounded({key: values[key] for key in _EVIDENCE[name]}) for name, values in found.items()},
    })
    halves = [list(half_period_row(row, e).values()) for e in report.estimates]
    return {**row, "digest": _digest(as_json([stored(row), halves]), report.carry or b"")}


def half_period_row(night: Mapping[str, Any], e: Estimate) -> dict[str, Any]:
    """Return the row of table `half_periods` for one half period of a night."""
    return {"loop": night["loop"], "night_start": night["start"], "night_end": night["end"], "joined": 0,
            **_rounded(vars(e)), "accepted": int(e.accepted)}


def night_of(row: Mapping[str, Any]) -> Night:
    """Return a row of table `nights` as a Night."""
    return msgspec.convert({**row, "ci95": None if row["d_low"] is None else (row["d_low"], row["d_high"])}, Night)


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


def _notes(notes: Sequence[Note]) -> list[dict[str, str]]:
    return [{"code": n.code, "message": n.message} for n in notes]


def _rounded(values: Mapping[str, Any]) -> dict[str, Any]:
    """Round times to the millisecond and numbers to nine digits: rounding errors are no news; None for no number."""
    return {name: value if not isinstance(value, float) else None if not math.isfinite(value) else
            round(value, 3) if name in ("start", "end") else float(f"{value:.9g}") for name, value in values.items()}


def _digest(text: str, more: bytes = b"") -> str:
    return hashlib.sha256(text.encode("utf-8", "backslashreplace") + more).hexdigest()[:32]
