"""The report of a history, for the person who plans repairs: order of repair and wear of every loop; what it holds."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ..results import Compensator, Estimate, Verdict
from ..results.history import DAY, Night, Place, Repair, Segment, Wear
from . import figures as fig
from .figures import Figure
from .files import form_of
from .json_report import fields_of
from .report import LoopPart, Report
from .safe import entitled, picture
from .templates import lines, screen, sentence
from .words import TITLES, day

WIDTH = 160  # lines of names, dates and numbers are not wrapped
MARKS = {"pull": "bad", "room": "warn", "watch": "watch", "leave": "good", "check": "quiet"}
DRAWN = 60  # loops with figures in a single file
RANKED = 40  # loops in the picture of the plant
LATEST = 30  # nights in a loop's table
RECENT = 14.0  # days whose half periods are drawn
WEEKS = 8  # of the small lines beside the sizes in that picture

HalfPeriods = Callable[[str, float], Sequence[Estimate]]


def loops_text(nights: Mapping[str, Sequence[Night]], repairs: Mapping[str, Sequence[Repair]], runs: int) -> str:
    """Return one line per loop: nights, span, verdicts, last size, repairs."""
    sizes = {name: [n.d for n in found if n.d is not None] for name, found in nights.items()}
    verdicts = {name: Counter(str(n.verdict) for n in found).most_common() for name, found in nights.items()}
    return screen("history.txt", width=WIDTH, nights=nights, repairs=repairs, runs=runs, sizes=sizes, verdicts=verdicts)


def trend(places: Sequence[Place]) -> Report:
    """Return wear and ranking of all loops in the order of repair; verbose: why every loop has its place."""
    return Report("trend", "", {"places": places, "growth": growth}, lambda: {"loops": [*map(_told, places)]},
                  width=WIDTH)


def _told(place: Place) -> dict[str, Any]:
    """Return one loop's wear with the names of the contract; dead bands are shares of the output span."""
    wear, now = place.wear, place.wear.now
    date = wear.limit_date and [*map(day, wear.limit_date)]
    return {
        "message": sentence("outlook", wear), "why": lines("why_place", place), "loop": place.loop,
        "nights": len(wear.nights), "state": wear.state,
        **{name: getattr(place, name) for name in ("rank", "action", "confidence", "ratio_to_limit")},
        "slope_per_day": _slope(now), "level": now and {"value": now.level, "ci95": now.level_ci95},
        "limit": wear.limit.value, "limit_class": wear.limit.name, "limit_source": wear.limit.source,
        "limit_date": date and {"value": date[0], "ci95": date[1:]},
        "limit_earliest": wear.earliest and day(wear.earliest), "model": wear.model or None, "held_out": wear.held_out,
        "repairs": [{"date": day(r.time), **fields_of(r, "loop")} for r in wear.repairs],
        "segments": [{"start": day(s.first), "end": day(s.last), "nights": s.nights,
                      "below_detection": s.below, "slope_per_day": _slope(s), "level_start": s.level_first,
                      "level_end": s.level} for s in wear.segments],
        "gaps": [{"date": day, "code": code} for day, code in wear.gaps], "missing_days": wear.missing_days}


def _slope(segment: Segment | None) -> dict[str, Any]:
    ci95 = segment.slope_ci95 if segment else None
    return {"value": segment.slope if segment and ci95 else None, "ci95": ci95 or [None, None]}


def growth(now: Segment | None) -> float | None:
    """Growth in a month [span] where it is sure."""
    return 30 * now.slope if now is not None and now.growing and now.slope is not None else None


def write_report(output: Path, places: Sequence[Place], half_periods: HalfPeriods, history: str = "") -> None:
    """Write one .html file, figures for the first 60 places and numbers for all, or a folder for any other name; the
    old report stays until the new one is whole. half_periods: of a loop in so many last days. history: its name."""
    single = form_of(output, {"a folder": "folder", ".html": "page", ".htm": "page"}) == "page"
    times = [n.time for p in places for n in p.wear.nights]
    first, last = (day(edge(times)) if times else None for edge in (min, max))  # the clock is not asked
    content = {"places": places, "counts": Counter(TITLES[p.action] for p in places), "ranked": RANKED,
               "cut": DRAWN * (single and len(places) > DRAWN), "weeks": WEEKS, "marks": MARKS, "growth": growth}
    Report("wear", entitled("Valve wear report", [history] * bool(history)), content,
           drawn=lambda: {"picture": plant_picture(places[:RANKED])},
           subtitle=sentence("made", len(places), first, last, len({*map(day, times)})), loops=lambda: [
        LoopPart(p.loop, MARKS[p.action], sentence("brief_wear", p), "wear_loop.html",
                 partial(_loop, p, half_periods, not single or p.rank <= DRAWN))
        for p in places]).write(output, (places, [n.digest for p in places for n in p.wear.nights]))


def plant_picture(places: Sequence[Place]) -> Figure:
    """The loops in the order of repair: the dead band now with its interval against its limit, and its last weeks."""
    since = max((n.time for p in places for n in p.wear.nights), default=0.0) - 7 * WEEKS * DAY
    rows = []
    for p in places:
        wear, now = p.wear, p.wear.now
        last = [(n.time, n.d) for n in wear.nights if n.d is not None and n.time >= since]
        level, ci95 = (now.level, now.level_ci95) if now else (None, None)
        rows.append(fig.PlantRow(p.loop, TITLES[p.action], MARKS[p.action], level, ci95, None, wear.limit.value,
                                 "" if level else "no size", sentence("brief_wear", p), tuple(last)))
    return fig.plant(rows, "limit")


def _loop(place: Place, half_periods: HalfPeriods, drawn: bool) -> dict[str, Any]:
    halves, nights = half_periods(place.loop, RECENT) if drawn else (), place.wear.nights
    advice = [n.details["compensator"] for n in nights if isinstance(n.details.get("compensator"), Mapping)]
    wanted = advice and place.action in ("pull", "room", "watch")
    return {"place": place, "drawn": drawn, "figure": _wear_figure(place.wear) if drawn and nights else None,
            "half_periods": _half_period_figure(halves) if any(h.accepted for h in halves) else None,
            "advice": Compensator(**advice[-1]) if wanted else None,  # type: ignore[arg-type]
            "latest": nights[-LATEST:][::-1]}


def _wear_figure(wear: Wear) -> Figure:
    nights = wear.nights
    times = [*(n.time for n in nights), *(p[0] for p in wear.forecast)]
    limit, lines = 100 * wear.limit.value, []
    for suspected, name, symbol in ((False, "night", "circle"), (True, "suspected", "circle-open")):
        own = [n for n in nights if n.d is not None and (n.verdict is Verdict.SUSPECTED) is suspected]
        line = fig.dots([(n.time, n.d or 0.0) for n in own], name, fig.EVIDENCE, symbol=symbol, size=7,
                        hover="%{x|%Y-%m-%d}: %{y:.2f} %")
        lines.append(line | {"error_y": fig.bars(line["y"], [n.ci95 for n in own], fig.QUIET, thickness=1, width=2)})
    below = [(n.time, n.limit_of_detection or 0.0) for n in nights if n.below_detection]
    lines.append(fig.dots(below, "below detection", fig.SETPOINT, symbol="triangle-down-open",
                          hover="%{x|%Y-%m-%d}: below %{y:.2f} %"))
    for number, path in enumerate(s.path for s in wear.segments if s.path):
        lines += _band(path, "wear", shown=number == 0, width=3)  # the level between repairs
    if wear.forecast:  # what comes if it goes on, to the limit or as far as the figure goes
        lines += _band(wear.forecast, "if it goes on", dash="dot", width=2)
    lines.append(fig.trace([fig.ms(min(times) - DAY), fig.ms(max(times) + DAY)], [limit, limit],
                           f"limit {limit:.2g} %", fig.OUTPUT, dash="dash", width=2, hoverinfo="name", hover=""))
    words = [fig.written(picture("repair found" if r.found else f"repair: {r.note}" if r.note else "repair", 30),
        fig.ms(r.time), 1.0, yref="paper", xanchor="left", yanchor="top", xshift=4) for r in wear.repairs]
    shapes = [fig.across("x", note["x"], fig.QUIET, width=2, dash="dashdot") for note in words]
    return fig.figure([line for line in lines if line["x"]], fig.DATES, fig.axis("dead band [% of output span]",
        rangemode="tozero"), height=420, shapes=shapes, annotations=words, margin={"t": 60})


def _half_period_figure(half_periods: Sequence[Estimate]) -> Figure:
    groups = []
    for joined, name, symbol in ((False, "half period", "circle"), (True, "across the cut of two nights", "diamond")):
        if part := [p for p in half_periods if p.accepted and p.joined is joined]:
            groups.append(fig.dots([(p.start, p.d) for p in part], name, fig.EVIDENCE, symbol=symbol, size=6,
                                   hover="%{y:.2f} % (%{text})", text=[f"{p.dt_s:.4g} s long" for p in part]))
    return fig.figure(groups, fig.DATES, fig.axis("estimate [% of output span]", rangemode="tozero"), height=320)


def _band(path: Sequence[tuple[float, ...]], name: str, *, shown: bool = True, **line: Any) -> list[Figure]:
    """A level over time with its 95 % band; path: (epoch seconds, level, low, high) in spans."""
    x = [fig.ms(p[0]) for p in path]
    y, low, high = ([round(100 * max(p[i], 0.0), 4) for p in path] for i in (1, 2, 3))
    common: Figure = {"legendgroup": name, "hoverinfo": "skip", "hover": ""}
    return [fig.trace([*x, *x[::-1]], [*high, *low[::-1]], f"{name}, 95 %", fig.QUIET, width=0, showlegend=False,
                      fill="toself", fillcolor="rgba(128, 128, 128, 0.18)", **common),
            fig.trace(x, y, name, fig.MEASUREMENT, showlegend=shown, **line, **common)]
