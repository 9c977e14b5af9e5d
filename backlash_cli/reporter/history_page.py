"""The report of a history, for the person who plans repairs: order of repair, and wear of every loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from .._version import __version__
from ..results import Compensator
from ..results.history import DAY, HalfPeriod, Night, Place, Wear, day_text
from .figures import Figure
from .files import write_text
from .folder import LoopPart, one_page, write_folder_of
from .history_text import no_date, remarks
from .page import Cell, Section, Table
from .plant_figure import WEEKS, PlantRow, plant_figure
from .safe import shorten
from .wear_figure import half_period_figure, wear_figure
from .words import MARKS, VERDICTS, compensator_words

ACTION_MARKS = {"pull": "bad", "room": "warn", "watch": "warn", "leave": "good", "check": "quiet"}
DRAWN = 60  # loops with figures in a single file
RANKED = 40  # loops in the picture of the plant
LATEST = 30  # nights in a loop's table
TITLE = "Valve wear report"
COLUMNS = ("#", "Loop", "To do", "Now [%]", "Limit [%]", "Per month [%]", "Limit date", "± days", "Sure [%]", "Nights")


def write_report(output: Path, places: Sequence[Place], wears: Mapping[str, Wear],
                 nights: Mapping[str, Sequence[Night]], half_periods: Callable[[str], Sequence[HalfPeriod]]) -> None:
    """Write one .html file, figures for the first 60 places and numbers for all, or a folder for any other name.

    The old report stays until the new one is whole. half_periods: gives the recent half periods of a loop by its name.
    """
    single = output.suffix.lower() in (".html", ".htm")

    def sections(place: Place) -> list[Section]:
        shown = not single or place.rank <= DRAWN
        return loop_parts(place, wears[place.loop], nights[place.loop], half_periods(place.loop) if shown else (),
                          drawn=shown)

    loops = [LoopPart(p.loop, ACTION_MARKS[p.action], brief(p, wears[p.loop]), partial(sections, p)) for p in places]
    notes = [] if len(places) <= DRAWN or not single else [
        f"Figures and nights are shown for the first {DRAWN} places. For those of all {len(places)} loops write a "
        "folder: --output FOLDER."]

    def above(links: Mapping[str, str]) -> list[Section]:
        return overview(places, wears, nights, links, notes)

    if single:
        write_text(output, one_page(TITLE, subtitle(nights), loops, above))
    else:
        content = (places, [[n.digest for n in nights[p.loop]] for p in places], [wears[p.loop] for p in places])
        write_folder_of(output, TITLE, subtitle(nights), loops, above, content)


def subtitle(nights: Mapping[str, Sequence[Night]]) -> str:
    """Say how much the history holds, from which day to which; the clock is not asked."""
    times = [n.time for found in nights.values() for n in found]
    span = f", {day_text(min(times))} to {day_text(max(times))}" if times else ""
    loops = len(nights)
    return f"{loops} loop{'s' * (loops != 1)}, {len(times)} nights{span}. Made by backlash {__version__}."


def brief(place: Place, wear: Wear) -> str:
    """Return one line on a loop."""
    if wear.state == "no_estimate" and place.why:
        return f"{place.title}: {place.why[0]}"
    return f"{place.title}: {wear.message}."


def plant_picture(places: Sequence[Place], wears: Mapping[str, Wear], nights: Mapping[str, Sequence[Night]]) -> Figure:
    """The loops in the order of repair: the dead band now with its interval against its limit, and its last weeks."""
    since = max((n.time for p in places for n in nights[p.loop]), default=0.0) - 7 * WEEKS * DAY
    rows = []
    for p in places:
        wear, now = wears[p.loop], wears[p.loop].now
        last = sorted((n.time, n.d) for n in nights[p.loop] if n.d is not None and n.time >= since)
        level = None if now is None else now.level
        rows.append(PlantRow(p.loop, p.title, ACTION_MARKS[p.action], level, now.level_ci95 if now else None, None,
                             wear.limit.value, "" if level else "no size", brief(p, wear), tuple(last)))
    return plant_figure(rows, "limit")


def overview(places: Sequence[Place], wears: Mapping[str, Wear], nights: Mapping[str, Sequence[Night]],
             links: Mapping[str, str], notes: Sequence[str] = ()) -> list[Section]:
    """Return the order of repair as a table that can be sorted and filtered, with the rule behind it."""
    counts = {title: sum(p.title == title for p in places) for title in dict.fromkeys(p.title for p in places)}
    said = "; ".join(f"{title}: {n}" for title, n in counts.items())
    rule = ("Pull: the dead band is above its limit beyond doubt and the nights agree. Pull if there is room: above "
            "the limit without being sure, or the limit is reached before the horizon. Watch: growing, near the "
            "limit, or too few nights. Leave alone: below the limit and not growing. Within a group the order follows "
            "the dead band expected at the horizon over the limit, times confidence, times how much the valve moves.")
    words = [f"{said}." if said else "The history holds no night.", "Dead band (play) of the valves in per cent of the "
             "output span. Select a loop for the reasons of its place and its wear over the nights.", *notes]
    rows = [_row(p, wears[p.loop], links[p.loop]) for p in places]
    table = Table(COLUMNS, rows, filterable=True, choices="To do")
    shown = places[:RANKED]
    note = ("First to repair on top. Point and line: the dead band now with its 95 % interval; upright mark: limit. "
            f"Right: the sizes of the last {WEEKS} weeks, the limit dotted.")
    note += f" The first {RANKED} of {len(places)} loops are drawn." * (len(places) > RANKED)
    picture = [Section("The plant", figure=plant_picture(shown, wears, nights), note=note)] if shown else []
    return [*picture, Section("Order of repair", text=words, table=table, note=rule)]


def _row(p: Place, wear: Wear, link: str) -> list[object]:
    now = wear.now
    date = day_text(wear.limit_date[0]) if wear.limit_date else None
    spread = max(1.0, 0.5 * (wear.limit_date[2] - wear.limit_date[1]) / DAY) if wear.limit_date else None
    growth = 30 * now.slope if now is not None and now.growing and now.slope is not None else None
    level = None if now is None else now.level
    return [
        p.rank, Cell(p.loop, text=shorten(p.loop, 80), href=link), Cell(p.title, mark=ACTION_MARKS[p.action]),
        None if level is None else Cell(level, text=f"{100 * level:.2f}"),
        Cell(wear.limit.value, text=f"{100 * wear.limit.value:.2g}"),
        None if growth is None else Cell(growth, text=f"+{100 * growth:.2f}"),
        date or no_date(wear) or None,
        None if spread is None or date is None else Cell(spread, text=f"{spread:.0f}" if spread < 1000 else "> 1000"),
        Cell(p.confidence, text=f"{100 * p.confidence:.0f}"), wear.nights,
    ]


def loop_parts(p: Place, wear: Wear, nights: Sequence[Night], half_periods: Sequence[HalfPeriod], *,
               drawn: bool = True) -> list[Section]:
    """Return everything about one loop: why its place, wear, half periods, advice, nights."""
    parts = [Section("Why this place", text=list(p.why))]
    if drawn and nights:
        parts.append(Section("Wear", text=[f"{wear.message[:1].upper()}{wear.message[1:]}.", *remarks(wear)],
                             figure=wear_figure(nights, wear),
                             note="One point per night with its 95 % interval; a triangle says that the dead band is "
                                  "smaller than this. The line is the level that the nights together say, with its "
                                  "95 % interval; it may bend, and starts anew after a repair. "
                                  f"Limit: {wear.limit.source}."))
    if drawn and any(h.accepted for h in half_periods):
        parts.append(Section("Half periods", figure=half_period_figure(half_periods), folded=True,
                             note="The estimates behind the sizes of the last nights, one per half period of the "
                                  "control error. Scatter is normal; what counts is where they gather."))
    advice = [n for n in nights if isinstance(n.details.get("compensator"), Mapping)]
    if advice and p.action in ("pull", "room", "watch"):
        found = advice[-1].details["compensator"]
        assert isinstance(found, Mapping)
        parts.append(Section("Until then", text=compensator_words(Compensator(**found))))
    if drawn:
        parts.append(Section(f"Last {min(LATEST, len(nights))} nights", table=_nights(nights[-LATEST:]), folded=True))
    return parts


def _nights(nights: Sequence[Night]) -> Table:
    rows: list[list[object]] = []
    for n in reversed(nights):
        low, high = n.ci95 or (None, None)
        rows.append([
            n.date.isoformat(), Cell(VERDICTS[n.verdict], mark=MARKS[n.verdict]),
            None if n.d is None else Cell(n.d, text=f"{100 * n.d:.2f}"),
            None if low is None or high is None else Cell(low, text=f"{100 * low:.2f} to {100 * high:.2f}"),
            Cell(n.confidence, text=f"{100 * n.confidence:.0f}"), n.half_periods, n.detections,
            shorten("; ".join(note.message for note in n.reasons[:2]), 240),
        ])
    return Table(("Night", "Verdict", "Size [%]", "95 % interval", "Confidence [%]", "Half periods", "Found", "Reason"),
                 rows)
