"""Between reports and table rows: what of a night is kept, rounded so that rounding errors do not count as news."""

from __future__ import annotations

import hashlib
import json
import math
import sqlite3
from collections.abc import Mapping, Sequence
from typing import Any

from ..estimator.carry import unpack
from ..record import LoopSettings, Note
from ..results import LoopReport, Verdict
from ..results.history import HalfPeriod, Night

EARLIEST, LATEST = 6e10, 2.5e11  # epoch seconds: year 68 to 9892
SIZED = (Verdict.BACKLASH, Verdict.SUSPECTED)

NIGHT_COLUMNS = (
    "loop", "start", "end", "digest", "verdict", "confidence", "d", "d_low", "d_high", "source", "limit_of_detection",
    "samples", "interval_s", "half_periods", "detections", "settings", "reasons", "warnings", "travel", "details",
)
HALF_PERIOD_COLUMNS = (
    "loop", "night_start", "night_end", "joined", "start", "end", "dt_s", "dy", "e_max", "d", "direction", "accepted",
    "why",
)


def night_row(report: LoopReport) -> dict[str, Any]:
    """Return the row of table `nights` for a report that has a time; `digest` covers half periods and carry too."""
    assert report.start is not None and report.end is not None
    d, ci95, source = size_of(report)
    row: dict[str, Any] = {
        "loop": storable(report.loop), "start": moment(report.start), "end": moment(report.end),
        "verdict": str(report.verdict), "confidence": short(report.confidence) or 0.0,
        "d": short(d), "d_low": short(ci95[0]) if ci95 else None, "d_high": short(ci95[1]) if ci95 else None,
        "source": source, "limit_of_detection": short(report.limit_of_detection), "samples": report.samples,
        "interval_s": short(report.interval_s), "half_periods": report.half_periods, "detections": report.detections,
        "settings": as_json(settings_dict(report.settings)), "reasons": as_json(list(map(_note, report.reasons))),
        "warnings": as_json(list(map(_note, report.warnings))),
        "travel": short(unpack(report.carry).travel) if report.carry else None, "details": as_json(_evidence(report)),
    }
    halves = [half_period_row(row, e, joined=False) for e in report.estimates]
    content = as_json([row, halves]).encode("utf-8", "backslashreplace") + (report.carry or b"")
    row["digest"] = hashlib.sha256(content).hexdigest()[:32]
    return row


def half_period_row(night: Mapping[str, Any], estimate: Any, *, joined: bool) -> tuple[Any, ...]:
    """Return the row of table `half_periods` for one half period of a night."""
    e = estimate
    return (night["loop"], night["start"], night["end"], int(joined), moment(e.start), moment(e.end), short(e.dt_s),
            short(e.dy), short(e.e_max), short(e.d), int(e.direction), int(e.accepted), str(e.why))


def insert(db: sqlite3.Connection, table: str, columns: Sequence[str], rows: Sequence[Sequence[Any]],
           known: str = "REPLACE") -> None:
    """Write rows into a table; a row that is known is replaced, or with `known="IGNORE"` left as it is."""
    places = ", ".join("?" for _ in columns)
    db.executemany(f"INSERT OR {known} INTO {table} ({', '.join(columns)}) VALUES ({places})", rows)


def storable(name: str) -> str:
    """Return a name as the file can hold it: what is no valid text (broken encodings) is spelled out."""
    return name.encode("utf-8", "backslashreplace").decode("utf-8")


def timed(report: LoopReport) -> bool:
    """Whether a report has times that a calendar knows."""
    return all(t is not None and math.isfinite(t) and -EARLIEST < t < LATEST for t in (report.start, report.end))


def size_of(report: LoopReport) -> tuple[float | None, tuple[float, float] | None, str]:
    """Return the dead band that a report stands for, its interval, and where it comes from.

    The measurement against the output goes before the half periods, which read low in noise. No size without the
    verdict backlash or suspected: a number that the verdict refused is not a point of the wear.
    """
    if report.verdict not in SIZED:
        return None, None, ""
    for source in ("confirmation", "cluster"):
        found = getattr(report, source)
        if found is not None and math.isfinite(found.d) and found.d > 0:
            return found.d, found.ci95, source
    return None, None, ""


def settings_dict(settings: LoopSettings) -> dict[str, object]:
    """Return the settings as plain values."""
    plain = {name: short(getattr(settings, name)) for name in ("K", "Ti", "Td", "Tf", "Kp", "theta")}
    return {**plain, "pv_range": list(settings.pv_range), "op_range": list(settings.op_range),
            "source": dict(settings.source)}


def night_of(row: Mapping[str, Any]) -> Night:
    """Return a row of table `nights` as a Night."""
    ci95 = None if row["d_low"] is None else (row["d_low"], row["d_high"])
    return Night(
        row["loop"], row["start"], row["end"], Verdict(row["verdict"]), row["confidence"], row["d"], ci95,
        row["source"], row["limit_of_detection"], row["samples"], row["interval_s"], row["half_periods"],
        row["detections"], row["travel"], json.loads(row["settings"]), _notes(row["reasons"]),
        _notes(row["warnings"]), json.loads(row["details"]), row["digest"],
    )


def half_period_of(row: Mapping[str, Any]) -> HalfPeriod:
    """Return a row of table `half_periods` as a HalfPeriod."""
    return HalfPeriod(row["loop"], row["start"], row["end"], row["dt_s"], row["dy"], row["e_max"], row["d"],
                      row["direction"], bool(row["accepted"]), row["why"], bool(row["joined"]))


def as_json(value: object) -> str:
    """Return JSON that is the same for the same value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)


def moment(time: float) -> float:
    """Round a time to the millisecond."""
    return round(float(time), 3)


def short(value: float | None) -> float | None:
    """Round to nine digits; None for what is not a number."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{value:.9g}")


def _evidence(report: LoopReport) -> dict[str, object]:
    """Return what the report page shows of a night beside its size."""
    out: dict[str, object] = {}
    if report.cluster is not None:
        c = report.cluster
        out["cluster"] = {"d": short(c.d), "n": c.n, "share": short(c.share), "spread": short(c.spread)}
    if report.confirmation is not None:
        c2 = report.confirmation
        out["confirmation"] = {"d": short(c2.d), "delta_bic": short(c2.delta_bic),
                               "error_reduction": short(c2.error_reduction)}
    if report.compensator is not None:
        out["compensator"] = {"gain": short(report.compensator.gain), "scheme": report.compensator.scheme,
                              "reason": report.compensator.reason}
    return out


def _note(note: Note) -> dict[str, object]:
    return {"code": note.code, "message": note.message}


def _notes(text: str) -> tuple[Note, ...]:
    return tuple(Note(n["code"], n["message"]) for n in json.loads(text))
