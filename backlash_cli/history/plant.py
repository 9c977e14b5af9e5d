"""The whole history at once: nights, wear and the order of repair; repairs as people type them; plain tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

from ..errors import UsageError, nearest
from ..results.history import Night, Place, Wear
from .limits import Limits
from .ranking import HORIZON, rank
from .store import History
from .trend import wear


@dataclass(frozen=True)
class PlantHistory:
    """Nights and wear by loop, in the order of repair given by `places`."""

    nights: dict[str, list[Night]]
    wears: dict[str, Wear]
    places: list[Place]


def plant_history(history: History, limits: Limits, *, loops: Sequence[str] = (),
                  horizon: float = HORIZON) -> PlantHistory:
    """Read a history and work out wear and ranking of all loops, or of the named ones."""
    nights = {name: history.nights(name) for name in chosen(history, loops)}
    wears = {name: wear(name, found, history.repairs(name), limits.of(name)) for name, found in nights.items()}
    return PlantHistory(nights, wears, rank(list(wears.values()), nights, horizon))


def chosen(history: History, names: Sequence[str]) -> list[str]:
    """Return all loops, or the named ones after a look whether they exist."""
    known = history.loops()
    for name in names:
        if name not in known:
            raise UsageError(f"the history has no loop {name!r}", where=str(history.path), remedy=nearest(name, known))
    return [name for name in known if not names or name in names]


def mark(history: History, loop: str, date: str, note: str) -> str:
    """Enter a repair and say so."""
    chosen(history, [loop])
    new = history.mark_repair(loop, moment_of(date), note)
    return f"repair of {loop} on {date} {'entered' if new else 'was already entered'}: {note}"


def unmark(history: History, loop: str, date: str) -> str:
    """Take a repair back and say so."""
    if not history.remove_repair(loop, moment_of(date)):
        days = ", ".join(r.date.isoformat() for r in history.repairs(loop)) or "none"
        raise UsageError(f"no repair of {loop} is entered on {date}", where=str(history.path),
                         remedy=f"entered are: {days}")
    return f"repair of {loop} on {date} taken back"


def moment_of(date: str) -> float:
    """Return a day or time (UTC unless it has an offset) as epoch seconds; a day means its first moment."""
    try:
        found = datetime.fromisoformat(date.strip())
    except ValueError:
        raise UsageError(f"{date!r} is not a day", where="--repair",
                         remedy="write it as 2026-03-02 or 2026-03-02T14:30") from None
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


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
        return [{"loop": loop, **asdict(p)} for loop in loops for p in history.half_periods(loop)]
    return [night for loop in loops for night in map(_night_values, history.nights(loop))]


def _night_values(night: Night) -> dict[str, Any]:
    low, high = night.ci95 or (None, None)
    return {
        "loop": night.loop, "date": night.date.isoformat(), "start": night.start, "end": night.end,
        "verdict": str(night.verdict), "confidence": night.confidence, "d": night.d, "d_low": low, "d_high": high,
        **{name: getattr(night, name) for name in ("source", "limit_of_detection", "samples", "interval_s",
                                                   "half_periods", "detections")},
        "output_travel_per_hour": night.travel, **{name: night.settings.get(name) for name in ("K", "Ti", "Kp")},
        "reasons": "; ".join(n.message for n in night.reasons), "warnings": "; ".join(n.code for n in night.warnings),
    }
