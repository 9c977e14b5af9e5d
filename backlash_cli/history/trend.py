"""From nights to wear: how fast a dead band grows since the last repair, and when it reaches the limit.

The time of a night is the middle of its data; the clock is never asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..results.history import DAY, Limit, Night, Repair, Segment, Wear, day_of
from .change_points import WINDOW, drops
from .points import Points, main_source, points_of, pooled, precision
from .robust_line import ENOUGH, Line, robust_line

SAME_REPAIR = 5  # a drop found this close (in nights) to a marked repair is that repair


def wear(loop: str, nights: Sequence[Night], marked: Sequence[Repair], limit: Limit) -> Wear:
    """Return the wear of one loop from its nights, in any order, and the repairs that people marked."""
    nights = sorted(nights, key=lambda n: n.time)
    source = main_source(nights)
    points, gaps = points_of(nights, source)
    repairs = [*marked, *_found(loop, points, marked)]
    repairs.sort(key=lambda r: r.time)
    edges = [-np.inf, *(r.time for r in repairs), np.inf]
    parts = [points.select((points.time >= first) & (points.time < last))
             for first, last in pairwise(edges)]
    fits = [(_line(part), part) for part in parts if len(part)]
    segments = tuple(_segment(line, part) for line, part in fits)
    # after the last repair nothing may have been measured yet: then no older slope speaks for the valve
    line, current = (fits[-1][0], segments[-1]) if fits and len(parts[-1]) else (None, None)
    state, message, limit_date = _outlook(line, current, limit, bool(repairs))
    return Wear(loop, len(nights), limit, state, message, segments, tuple(repairs), limit_date, tuple(gaps),
                tuple(missing_days(nights)))


def missing_days(nights: Sequence[Night]) -> list[str]:
    """Return the UTC days between the first and the last night that no export covers."""
    if len(nights) < 2:
        return []
    first, last = int(nights[0].start // DAY), int(nights[-1].end // DAY)
    covered = np.zeros(last - first + 1)
    for night in nights:
        for day in range(int(night.start // DAY), int(night.end // DAY) + 1):
            covered[day - first] += max(min(night.end, (day + 1) * DAY) - max(night.start, day * DAY), 1.0)
    covered[0] = covered[-1] = DAY
    return [day_of((first + int(k)) * DAY).isoformat() for k in np.flatnonzero(covered == 0.0)]


def _found(loop: str, points: Points, marked: Sequence[Repair]) -> list[Repair]:
    """Return repairs seen in the data that nobody marked; searched between the marked ones."""
    out = []
    edges = [-np.inf, *sorted(r.time for r in marked), np.inf]
    for first, last in pairwise(edges):
        part = points.select((points.time >= first) & (points.time < last))
        for k in drops(part.high, part.low != part.high):
            near_start = np.isfinite(first) and k <= SAME_REPAIR
            near_end = np.isfinite(last) and len(part) - k <= SAME_REPAIR
            if near_start or near_end:
                continue
            midnight = part.time[k] // DAY * DAY
            time = midnight if midnight > part.time[k - 1] else 0.5 * (part.time[k - 1] + part.time[k])
            before = float(np.median(part.high[max(0, k - WINDOW) : k]))
            after = float(np.median(part.high[k : k + WINDOW]))
            note = f"found: dead band fell from {percent(before)} to {percent(after)}"
            out.append(Repair(loop, float(time), note, True, before, after))
    return out


def _line(part: Points) -> Line:
    start = part.time[0]
    part = pooled(part)
    days = (part.time - start) / DAY
    return robust_line(days, part.low, part.high, part.weight * precision(part, days))


def _segment(line: Line, part: Points) -> Segment:
    measured = part.low == part.high
    last = float((part.time[-1] - part.time[0]) / DAY)
    low, high = line.interval_at(last)
    own = _own_width(part)
    level = line.at(last)
    return Segment(float(part.time[0]), float(part.time[-1]), int(measured.sum()), int((~measured).sum()),
                   line.slope if line.slope_ci is not None else None, line.slope_ci, line.at(0.0), level,
                   (level - float(np.hypot(level - low, own)), level + float(np.hypot(high - level, own))))


def _own_width(part: Points) -> float:
    """Return what the nights' own intervals add to that of the line: few nights scatter too little to be believed."""
    width = part.width[np.isfinite(part.width)]
    return float(np.median(width) / np.sqrt(max(len(part) / ENOUGH, 1.0))) if len(width) else 0.0


def _outlook(line: Line | None, current: Segment | None, limit: Limit,
             repaired: bool) -> tuple[str, str, tuple[float, float, float] | None]:
    """Return state, sentence and the date of the limit (value, early, late) in epoch seconds."""
    if line is None or current is None:
        since = " since the last repair" if repaired else ""
        return "no_estimate", f"no night{since} gives a size of the dead band", None
    assert current.level is not None
    now, over = f"now {percent(current.level)}", current.level > limit.value
    state_now = f"above the limit of {percent(limit.value)}" if over else f"below the limit of {percent(limit.value)}"
    if current.slope_ci95 is None:
        nights = current.nights + current.below
        return "too_few_nights", (f"{nights} night{'s' * (nights != 1)} since the last repair or start; a trend needs "
                                  f"{ENOUGH}; {now}, {state_now}"), None
    low, high = current.slope_ci95
    rate = f"{100 * line.slope:.2g} % of span per day (95 %: {100 * low:.2g} to {100 * high:.2g})"
    reached = line.reaches(limit.value)
    if reached is None:
        word = "falls" if high < 0 else "shows no trend"
        return "no_trend", f"the dead band {word}, {rate}; {now}, {state_now}", None
    value, early, late = (current.first + DAY * days for days in reached)
    verb = "was reached" if over else "is reached"
    return "growing", (f"the dead band grows by {rate}; {now}; the limit of {percent(limit.value)} {verb} about "
                       f"{_day(value)} (between {_day(early)} and {_day(late)})"), (value, early, late)


def percent(value: float) -> str:
    """Return a dead band in words.

    >>> percent(0.0314)
    '3.1 %'
    """
    return f"{100 * value:.2g} %"


def _day(time: float) -> str:
    """Calendar day of a time, `never` outside the calendar."""
    try:
        return day_of(time).isoformat()
    except (ValueError, OverflowError, OSError):
        return "never"
