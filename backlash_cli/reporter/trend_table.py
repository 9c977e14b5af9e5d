"""Wear and order of repair as a terminal table and as the JSON document of `backlash trend`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from .._version import __version__
from ..results.history import Place, Repair, Segment, Wear, day_of
from .history_text import columns
from .json_report import iso_time, strict
from .safe import terminal

SCHEMA_VERSION = 1
WORDS = {"pull": "pull", "room": "pull if room", "watch": "watch", "leave": "leave alone", "check": "check"}


def trend_json(wears: Mapping[str, Wear], places: Sequence[Place]) -> str:
    """Return wear and ranking of all loops as strict JSON text, in the order of repair."""
    document = {
        "schema_version": SCHEMA_VERSION, "tool": {"name": "backlash", "version": __version__},
        "loops": [loop_document(wears[place.loop], place) for place in places],
    }
    return json.dumps(strict(document), ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def loop_document(wear: Wear, place: Place) -> dict[str, Any]:
    """Return one loop's wear with the names of the contract; dead bands are shares of the output span."""
    now = wear.current
    known = wear.state != "no_estimate" and now is not None
    return {
        "loop": wear.loop,
        "nights": wear.nights,
        "state": wear.state,
        "message": wear.message,
        "slope_per_day": _slope(now if known else None),
        "level": _level(now if known else None),
        "limit": wear.limit.value,
        "limit_class": wear.limit.name,
        "limit_source": wear.limit.source,
        "limit_date": _limit_date(wear),
        "model": wear.model or None,
        "held_out": _held_out(wear),
        "repairs": [_repair(r) for r in wear.repairs],
        "segments": [_segment(s) for s in wear.segments],
        "gaps": [{"date": date, "code": code} for date, code in wear.gaps],
        "missing_days": list(wear.missing),
        "rank": place.rank,
        "action": place.action,
        "why": list(place.why),
        "ratio_to_limit": place.ratio,
        "confidence": place.confidence,
    }


def _slope(segment: Segment | None) -> dict[str, Any]:
    if segment is None or segment.slope_ci95 is None:
        return {"value": None, "ci95": [None, None]}
    return {"value": segment.slope, "ci95": list(segment.slope_ci95)}


def _level(segment: Segment | None) -> dict[str, Any] | None:
    if segment is None or segment.level_ci95 is None:
        return None
    return {"value": segment.level, "ci95": list(segment.level_ci95)}


def _limit_date(wear: Wear) -> dict[str, Any] | None:
    if wear.limit_date is None:
        return None
    value, early, late = map(day_or_none, wear.limit_date)
    return {"value": value, "ci95": [early, late]}


def _held_out(wear: Wear) -> dict[str, Any] | None:
    h = wear.held_out
    if h is None:
        return None
    return {"nights": h.nights, "since": day_or_none(h.since), "straight_line_error": h.line, "local_error": h.local,
            "straight_line_bias": h.bias, "straight_line_holds": h.line_holds}


def _repair(repair: Repair) -> dict[str, Any]:
    return {"date": repair.date.isoformat(), "time": iso_time(repair.time), "note": repair.note,
            "found": repair.found, "before": repair.before, "after": repair.after}


def _segment(s: Segment) -> dict[str, Any]:
    return {"start": day_or_none(s.first), "end": day_or_none(s.last), "nights": s.nights,
            "below_detection": s.below, "slope_per_day": _slope(s), "level_start": s.level_first,
            "level_end": s.level}


def day_or_none(time: float) -> str | None:
    """Return the calendar day of a time, None outside the calendar (a limit that is thousands of years away)."""
    try:
        return day_of(time).isoformat()
    except (ValueError, OverflowError, OSError):
        return None


def trend_text(wears: Mapping[str, Wear], places: Sequence[Place], *, verbose: bool = False) -> str:
    """Return wear and ranking as a table for the terminal; `verbose` adds why every loop has its place."""
    rows: list[tuple[str, ...]] = [("#", "Loop", "To do", "Now", "Limit", "Per month", "Limit date", "between", "and",
                                    "Nights")]
    rows += [_cells(wears[place.loop], place) for place in places]
    lines = [columns(rows), "Dead bands in % of the output span; per month: growth of the last 30 days, where sure."]
    if not verbose:
        lines.append("Why each loop has its place: --verbose")
    for place in places if verbose else ():
        lines += ["", f"{place.rank}. {terminal(place.loop, 60)}: {place.title}"]
        lines += [f"   {terminal(words)}" for words in (*place.why, *remarks(wears[place.loop]))]
    return "\n".join(lines) + "\n"


def _cells(wear: Wear, place: Place) -> tuple[str, ...]:
    now = wear.current if wear.state != "no_estimate" else None
    date = _limit_date(wear) or {"value": None, "ci95": [None, None]}
    early, late = ((d or "later") if date["value"] else "" for d in date["ci95"])
    return (
        str(place.rank), terminal(place.loop, 24), WORDS[place.action],
        "" if now is None or now.level is None else f"{100 * now.level:.2f}", f"{100 * wear.limit.value:.2g}",
        f"+{3000 * now.slope:.2f}" if now is not None and now.growing and now.slope is not None else "",
        date["value"] or no_date(wear), early, late, str(wear.nights),
    )


def no_date(wear: Wear) -> str:
    """Say why there is no date of the limit, empty where the state says it."""
    return "no trend" if wear.state == "no_trend" else "not in sight" if wear.state == "growing" else ""


def model_words(wear: Wear) -> list[str]:
    """Say which trend was used, how it and a straight line foresaw the last nights, and where the line failed."""
    if not wear.model:
        return []
    used = {"line": "The trend is a straight line.", "local": "The trend is one that may bend."}[wear.model]
    h = wear.held_out
    if h is None:
        return [f"{used} There are too few nights to try both on nights that they have not seen."]
    tried = (f"Of the last {h.nights} nights, hidden from it, a straight line was off by {100 * h.line:.2g} % of span, "
             f"a trend that may bend by {100 * h.local:.2g} % (medians).")
    if wear.model == "line":
        return [f"{used} {tried}"]
    if h.line_holds:
        return [f"{used} {tried} The straight line does not fit the nights before: they bend or go in steps."]
    side = "low" if h.bias > 0 else "high"
    return [f"{used} {tried} The straight line fails from {day_or_none(h.since)} on: it is {100 * abs(h.bias):.2g} % "
            f"of span too {side}."]


def remarks(wear: Wear) -> list[str]:
    """Name repairs, the model of the trend, nights without an answer, and days without an export."""
    out = [f"Repair {r.date.isoformat()}{', ' + r.note if r.note else ''}." for r in wear.repairs]
    out += model_words(wear)
    if wear.gaps:
        codes = sorted({code for _, code in wear.gaps})
        out.append(f"{len(wear.gaps)} of {wear.nights} nights without a size ({', '.join(codes)}).")
    if wear.missing:
        shown = ", ".join(wear.missing[:5]) + (", ..." if len(wear.missing) > 5 else "")
        out.append(f"{len(wear.missing)} days without an export: {shown}.")
    return out
