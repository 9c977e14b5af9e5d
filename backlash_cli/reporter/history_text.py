"""Wear and order of repair, and what a history holds, as terminal tables and as the JSON of `backlash trend`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from ..results.history import Night, Place, Repair, Run, Segment, Wear, day_of, day_text
from .console import Screen
from .json_report import fields_of, header, iso_time, json_text
from .safe import terminal

WIDTH = 160  # lines of names, dates and numbers are not wrapped
WORDS = {"pull": "pull", "room": "pull if room", "watch": "watch", "leave": "leave alone", "check": "check"}


def loops_text(nights: Mapping[str, Sequence[Night]], repairs: Mapping[str, Sequence[Repair]], runs: int) -> str:
    """Return one line per loop: nights, span, verdicts, last size, repairs."""
    rows = []
    for name, found in nights.items():
        sized = [n.d for n in found if n.d is not None]
        verdicts = Counter(str(n.verdict) for n in found).most_common()
        marked = ", ".join(r.date.isoformat() for r in repairs.get(name, ()))
        rows.append((terminal(name, 30), str(len(found)), found[0].date.isoformat(), found[-1].date.isoformat(),
                     f"{100 * sized[-1]:.2f} %" if sized else "-", marked or "-",
                     ", ".join(f"{n} {word}" for word, n in verdicts)))
    screen = Screen(width=WIDTH)
    screen.table(("Loop", "Nights", "First", "Last", "Last size", "Repairs", "Verdicts"), rows)
    loops = f"{len(nights)} loop{'s' * (len(nights) != 1)}, {runs} run{'s' * (runs != 1)}"
    screen.say(f"\n{loops}. Sizes in % of the output span.")
    return screen.text()


def runs_text(runs: Sequence[Run]) -> str:
    """Return one line per run that added to the history, in the order of their data."""
    screen = Screen(width=WIDTH)
    screen.table(("Data from", "to", "Loops", "Failures", "Inputs"), [
        (day_of(run.first).isoformat(), day_of(run.last).isoformat(), str(run.loops), str(len(run.failures)),
         terminal(", ".join(run.inputs[:3]) + f" and {len(run.inputs) - 3} more" * (len(run.inputs) > 3), 80))
        for run in runs])
    return screen.text()


def trend_text(wears: Mapping[str, Wear], places: Sequence[Place], *, verbose: bool = False) -> str:
    """Return wear and ranking as a table for the terminal; `verbose` adds why every loop has its place."""
    screen = Screen(width=WIDTH)
    screen.table(("#", "Loop", "To do", "Now", "Limit", "Per month", "Limit date", "between", "and", "Nights"),
                 [_cells(wears[place.loop], place) for place in places])
    screen.say("\nDead bands in % of the output span; per month: growth of the last 30 days, where sure.")
    if not verbose:
        screen.say("Why each loop has its place: --verbose")
    for place in places if verbose else ():
        screen.say(f"\n{place.rank}. {terminal(place.loop, 60)}: {place.title}")
        for words in (*place.why, *remarks(wears[place.loop])):
            screen.say(terminal(words), indent=3)
    return screen.text()


def _cells(wear: Wear, place: Place) -> tuple[str, ...]:
    now = wear.now
    date, early, late = map(day_text, wear.limit_date) if wear.limit_date else (None, None, None)
    return (
        str(place.rank), terminal(place.loop, 24), WORDS[place.action],
        "" if now is None or now.level is None else f"{100 * now.level:.2f}", f"{100 * wear.limit.value:.2g}",
        f"+{3000 * now.slope:.2f}" if now is not None and now.growing and now.slope is not None else "",
        date or no_date(wear), *((day or "later") if date else "" for day in (early, late)), str(wear.nights),
    )


def trend_json(wears: Mapping[str, Wear], places: Sequence[Place]) -> str:
    """Return wear and ranking of all loops as strict JSON text, in the order of repair."""
    return json_text({**header(), "loops": [loop_document(wears[place.loop], place) for place in places]})


def loop_document(wear: Wear, place: Place) -> dict[str, Any]:
    """Return one loop's wear with the names of the contract; dead bands are shares of the output span."""
    now, h, date = wear.now, wear.held_out, wear.limit_date
    return {
        **{name: getattr(wear, name) for name in ("loop", "nights", "state", "message")},
        "slope_per_day": _slope(now),
        "level": None if now is None or now.level_ci95 is None else {"value": now.level, "ci95": now.level_ci95},
        "limit": wear.limit.value, "limit_class": wear.limit.name, "limit_source": wear.limit.source,
        "limit_date": None if date is None else {
            "value": day_text(date[0]), "ci95": [day_text(date[1]), day_text(date[2])]},
        "model": wear.model or None,
        "held_out": None if h is None else {
            "nights": h.nights, "since": day_text(h.since), "straight_line_error": h.line, "local_error": h.local,
            "straight_line_bias": h.bias, "straight_line_holds": h.line_holds},
        "repairs": [{"date": r.date.isoformat(), **fields_of(r, "loop"), "time": iso_time(r.time)}
                    for r in wear.repairs],
        "segments": [{"start": day_text(s.first), "end": day_text(s.last), "nights": s.nights,
                      "below_detection": s.below, "slope_per_day": _slope(s), "level_start": s.level_first,
                      "level_end": s.level} for s in wear.segments],
        "gaps": [{"date": day, "code": code} for day, code in wear.gaps],
        "missing_days": wear.missing,
        **{name: getattr(place, name) for name in ("rank", "action", "why")},
        "ratio_to_limit": place.ratio, "confidence": place.confidence,
    }


def _slope(segment: Segment | None) -> dict[str, Any]:
    if segment is None or segment.slope_ci95 is None:
        return {"value": None, "ci95": [None, None]}
    return {"value": segment.slope, "ci95": segment.slope_ci95}


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
    return [f"{used} {tried} The straight line fails from {day_text(h.since)} on: it is {100 * abs(h.bias):.2g} % "
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
