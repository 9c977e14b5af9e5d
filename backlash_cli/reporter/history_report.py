"""The report of a history, for the person who plans repairs: order of repair and wear of every loop, as text, JSON and
pages; and what a history holds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from .._version import __version__
from ..results import Compensator
from ..results.history import DAY, HalfPeriod, Night, Place, Repair, Run, Segment, Wear, day_text
from .figures import Figure
from .files import write_text
from .json_report import fields_of, iso_time
from .page import LoopPart, one_page, write_folder_of
from .plant_figures import WEEKS, PlantRow, half_period_figure, plant_figure, wear_figure
from .report import Report
from .templates import screen, sentence

WIDTH = 160  # lines of names, dates and numbers are not wrapped
TO_DO = {"pull": "pull", "room": "pull if room", "watch": "watch", "leave": "leave alone", "check": "check"}
MARKS = {"pull": "bad", "room": "warn", "watch": "warn", "leave": "good", "check": "quiet"}
DRAWN = 60  # loops with figures in a single file
RANKED = 40  # loops in the picture of the plant
LATEST = 30  # nights in a loop's table
TITLE = "Valve wear report"


def loops_text(nights: Mapping[str, Sequence[Night]], repairs: Mapping[str, Sequence[Repair]], runs: int) -> str:
    """Return one line per loop: nights, span, verdicts, last size, repairs."""
    sizes = {name: [n.d for n in found if n.d is not None] for name, found in nights.items()}
    verdicts = {name: Counter(str(n.verdict) for n in found).most_common() for name, found in nights.items()}
    return screen("history.txt", width=WIDTH, nights=nights, repairs=repairs, runs=runs, sizes=sizes, verdicts=verdicts)


def runs_text(runs: Sequence[Run]) -> str:
    """Return one line per run that added to the history, in the order of their data."""
    return screen("runs.txt", width=WIDTH, runs=runs, day_text=day_text)


def trend(wears: Mapping[str, Wear], places: Sequence[Place]) -> Report:
    """Return wear and ranking of all loops in the order of repair; verbose: why every loop has its place."""
    content = {"wears": wears, "places": places, "day_text": day_text, "growth": growth, "to_do": TO_DO}
    return Report("trend", "", content, lambda: {"loops": [_wear(wears[place.loop], place) for place in places]},
                  width=WIDTH)


def _wear(wear: Wear, place: Place) -> dict[str, Any]:
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


def growth(now: Segment | None) -> float | None:
    """Growth in a month [span] where it is sure."""
    return 30 * now.slope if now is not None and now.growing and now.slope is not None else None


def write_report(output: Path, places: Sequence[Place], wears: Mapping[str, Wear],
                 nights: Mapping[str, Sequence[Night]], half_periods: Callable[[str], Sequence[HalfPeriod]]) -> None:
    """Write one .html file, figures for the first 60 places and numbers for all, or a folder for any other name.

    The old report stays until the new one is whole. half_periods: gives the recent half periods of a loop by its name.
    """
    single = output.suffix.lower() in (".html", ".htm")
    times = [n.time for found in nights.values() for n in found]
    first, last = (day_text(edge(times)) if times else None for edge in (min, max))  # the clock is not asked
    subtitle = sentence("made", len(nights), first, last, __version__, len(times))
    loops = [LoopPart(p.loop, MARKS[p.action], sentence("brief_wear", p, wears[p.loop]), "wear_loop.html",
                      partial(_loop, p, wears[p.loop], nights[p.loop], half_periods, not single or p.rank <= DRAWN))
             for p in places]
    content = {"places": places, "wears": wears, "picture": plant_picture(places[:RANKED], wears, nights),
               "counts": Counter(p.title for p in places), "cut": DRAWN * (single and len(places) > DRAWN),
               "ranked": RANKED, "weeks": WEEKS, "marks": MARKS, "day_text": day_text, "growth": growth}
    if single:
        write_text(output, one_page(TITLE, subtitle, loops, "wear.html", content))
    else:
        told = (places, [[n.digest for n in nights[p.loop]] for p in places], [wears[p.loop] for p in places])
        write_folder_of(output, TITLE, subtitle, loops, "wear.html", content, told)


def plant_picture(places: Sequence[Place], wears: Mapping[str, Wear], nights: Mapping[str, Sequence[Night]]) -> Figure:
    """The loops in the order of repair: the dead band now with its interval against its limit, and its last weeks."""
    since = max((n.time for p in places for n in nights[p.loop]), default=0.0) - 7 * WEEKS * DAY
    rows = []
    for p in places:
        wear, now = wears[p.loop], wears[p.loop].now
        last = sorted((n.time, n.d) for n in nights[p.loop] if n.d is not None and n.time >= since)
        level = None if now is None else now.level
        rows.append(PlantRow(
            p.loop, p.title, MARKS[p.action], level, now.level_ci95 if now else None, None, wear.limit.value,
            "" if level else "no size", sentence("brief_wear", p, wear), tuple(last)))
    return plant_figure(rows, "limit")


def _loop(place: Place, wear: Wear, nights: Sequence[Night], half_periods: Callable[[str], Sequence[HalfPeriod]],
          drawn: bool) -> dict[str, Any]:
    """What is shown of one loop."""
    halves = half_periods(place.loop) if drawn else ()
    advice = [n.details["compensator"] for n in nights if isinstance(n.details.get("compensator"), Mapping)]
    wanted = advice and place.action in ("pull", "room", "watch")
    return {"place": place, "wear": wear, "nights": nights, "drawn": drawn,
            "figure": wear_figure(nights, wear) if drawn and nights else None,
            "half_periods": half_period_figure(halves) if any(h.accepted for h in halves) else None,
            "advice": Compensator(**advice[-1]) if wanted else None,  # type: ignore[arg-type]
            "latest": nights[-LATEST:][::-1]}
