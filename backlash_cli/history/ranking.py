"""Which valves to pull at the next shutdown and which to leave alone; every place says why, in words.

The rule. First the group:
1. pull: even the lower end of the interval of the present dead band is above the limit, and at least three nights
   agree;
2. pull if there is room: above the limit without being sure of it, or the limit is reached before the horizon;
3. watch: growing, or above 70 % of the limit, or too few nights since a repair to say;
4. leave alone: below the limit, not growing, or nights without any dead band;
5. check loop and data: no night gave an answer (it oscillates, or the export does not allow one).
Then, inside a group, by the score: dead band expected at the horizon over the limit, times confidence, times a travel
factor between 0.7 and 1.5 (a valve that moves more wears faster and harms more), the square root of its output travel
over the plant's median.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..results import Verdict
from ..results.history import DAY, Night, Place, Segment, Wear, day_of
from .trend import percent

HORIZON = 90.0  # days ahead that count as "until the next shutdown" unless given
AGREE = 0.5
ENOUGH = 3  # nights with a size that a valve is pulled for
NEAR = 0.7
RECENT = 14  # nights that stand for the present

TITLES = {"pull": "Pull at the next shutdown", "room": "Pull if there is room", "watch": "Watch",
          "leave": "Leave alone", "check": "Check loop and data"}
ORDER = tuple(TITLES)


def rank(wears: Sequence[Wear], nights: Mapping[str, Sequence[Night]], horizon: float = HORIZON) -> list[Place]:
    """Return all loops in the order of repair. horizon: days after the plant's last night that the plan must cover."""
    last = max((n.end for found in nights.values() for n in found), default=0.0)
    recent = {w.loop: [n for n in sorted(nights.get(w.loop, ()), key=lambda n: n.time)
                       if not w.repairs or n.time >= w.repairs[-1].time][-RECENT:] for w in wears}
    moves = {loop: [n.travel for n in found if n.travel is not None] for loop, found in recent.items()}
    travel = {loop: x for loop, found in moves.items() if found and (x := float(np.median(found)))}
    factor = {loop: float(np.clip(np.sqrt(x / np.median([*travel.values()])), 0.7, 1.5)) for loop, x in travel.items()}
    placed = sorted((_placed(w, recent[w.loop], factor.get(w.loop, 1.0), last, horizon) for w in wears),
                    key=lambda row: row[:3])
    return [replace(place, rank=number) for number, (*_, place) in enumerate(placed, 1)]


def _placed(wear: Wear, recent: Sequence[Night], factor: float, last: float, horizon: float
            ) -> tuple[int, float, str, Place]:
    """Return what a loop is sorted by, and its place with the words for what decided.

    recent: the last nights since the repair. factor: of its travel. last: time of the plant's last night.
    """
    now, limit = wear.now, wear.limit
    silent, swinging = (sum(n.verdict is v for n in recent) for v in (Verdict.NO_BACKLASH, Verdict.OSCILLATING))
    answers = [n.confidence for n in recent if n.measured] or [
        n.confidence for n in recent if n.verdict is Verdict.NO_BACKLASH]
    confidence = float(np.sum(answers)) / max(len(recent), 1)
    days_left = (wear.limit_date[0] - last) / DAY if wear.limit_date else np.inf
    expected, ratio = 0.0, None
    if now is None:
        action = "leave" if silent and silent >= 0.5 * len(recent) else "check"
        if action == "leave":
            words = [f"{silent} of the last {len(recent)} nights saw no dead band."]
        elif swinging > 0.5 * len(recent):
            words = [f"The loop oscillated in {swinging} of the last {len(recent)} nights, so its dead band has no "
                     "size.", "Have the tuning and the source of the oscillation looked at: backlash check."]
        else:
            reasons = sorted({code for _, code in wear.gaps[-RECENT:]})
            words = ["No night gave an answer" + (f": {', '.join(reasons)}." if reasons else "."),
                     "See the reasons of the last night and mend the export or the settings."]
    else:
        (low, high), ratio = now.level_ci95, now.level / limit.value
        near = now.growing or now.level > NEAR * limit.value or wear.state == "too_few_nights"
        if silent > 0.5 * len(recent):
            action = "watch" if now.level > limit.value else "leave"
        elif low > limit.value and confidence >= AGREE and now.nights >= ENOUGH:
            action = "pull"
        else:
            action = "room" if now.level > limit.value or days_left <= horizon else "watch" if near else "leave"
        where = "all above" if low > limit.value else "all below" if high < limit.value else "on both sides of"
        words = [f"Dead band {percent(now.level)}, {ratio:.1f} times the limit of {percent(limit.value)} "
                 f"({limit.source}).",
                 f"95 % interval {percent(max(low, 0.0))} to {percent(high)}: {where} the limit.",
                 f"Confidence {confidence:.0%} over the last {len(recent)} nights"
                 + (f"; {silent} of them saw no dead band." if silent else "."),
                 _trend_words(wear, now, days_left, horizon)]
        if factor > 1.1:
            words.append("The valve moves more than most: it wears faster and its dead band does more harm.")
        elif factor < 0.9:
            words.append("The valve moves less than most.")
        # only growth that is sure counts
        expected = max(now.level + (now.slope * horizon if now.growing and now.slope else 0.0), 0.0) / limit.value
    return ORDER.index(action), -expected * confidence * factor, wear.loop, Place(
        wear.loop, 0, action, TITLES[action], tuple(words), ratio, confidence)


def _trend_words(wear: Wear, now: Segment, days_left: float, horizon: float) -> str:
    if wear.state == "too_few_nights":
        nights = now.nights + now.below
        return f"Only {nights} night{'s' * (nights != 1)} since the last repair or start: too few for a trend."
    if wear.state != "growing" or now.slope is None:
        return "No trend: it is not getting worse for sure."
    rate = f"Grows by {percent(30 * now.slope)} of span a month"
    if wear.limit_date is None:
        return f"{rate}, ever slower; if it goes on so it does not reach the limit."
    if days_left > 3650:
        return f"{rate}; the limit is years away."
    day = day_of(wear.limit_date[0]).isoformat()
    if days_left <= 0:
        return f"{rate}; it passed the limit about {day}."
    return (f"{rate}; it reaches the limit about {day}, in {days_left:.0f} days, "
            f"{'within' if days_left <= horizon else 'after'} the horizon of {horizon:.0f} days.")
