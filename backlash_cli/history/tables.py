"""The history as plain tables for a spreadsheet or another program."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ..errors import UsageError, nearest
from ..results.history import Night, day_of
from .store import History

TABLES = ("nights", "half_periods", "repairs", "runs")


def rows_of(history: History, table: str, loops: list[str]) -> list[dict[str, Any]]:
    """Return one table of the history as flat rows; dead bands in output spans, times in epoch seconds.

    Raises UsageError for a table that does not exist.
    """
    if table not in TABLES:
        raise UsageError(f"no table {table!r}", where="--table", remedy=nearest(table, TABLES))
    if table == "runs":
        return [{"start": r.first, "end": r.last, "loops": r.loops, "nights": r.nights, "inputs": ", ".join(r.inputs),
                 "failures": "; ".join(n.message for n in r.failures), "tool": r.tool} for r in history.runs()]
    if table == "repairs":
        return [{"loop": loop, "time": r.time, "date": r.date.isoformat(), "note": r.note}
                for loop in loops for r in history.repairs(loop)]
    if table == "half_periods":
        return [asdict(p) for loop in loops for p in history.half_periods(loop)]
    return [night for loop in loops for night in map(night_values, history.nights(loop))]


def night_values(night: Night) -> dict[str, Any]:
    """Return a night as a flat row."""
    low, high = night.ci95 or (None, None)
    return {
        "loop": night.loop, "date": day_of(night.time).isoformat(), "start": night.start, "end": night.end,
        "verdict": str(night.verdict), "confidence": night.confidence, "d": night.d, "d_low": low, "d_high": high,
        "source": night.source, "limit_of_detection": night.limit_of_detection, "samples": night.samples,
        "interval_s": night.interval_s, "half_periods": night.half_periods, "detections": night.detections,
        "output_travel_per_hour": night.travel, "K": night.settings.get("K"), "Ti": night.settings.get("Ti"),
        "Kp": night.settings.get("Kp"), "reasons": "; ".join(n.message for n in night.reasons),
        "warnings": "; ".join(n.code for n in night.warnings),
    }
