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
from dataclasses import dataclass, replace

import numpy as np

from ..results import Verdict
from ..results.history import DAY, Night, Place, Wear, day_of
from .trend import percent

HORIZON = 90.0  # days ahead that count as "until the next shutdown" unless given
AGREE = 0.5
ENOUGH = 3  # nights with a size that a valve is pulled for
NEAR = 0.7
RECENT = 14  # nights that stand for the present

TITLES = {"pull": "Pull at the next shutdown", "room": "Pull if there is room", "watch": "Watch",
          "leave": "Leave alone", "check": "Check loop and data"}
ORDER = tuple(TITLES)


@dataclass(frozen=True)
class _Facts:
    """What the rule looks at, for one loop: the last nights since the repair, and how many of them say what."""

    wear: Wear
    confidence: float
    travel: float | None
    silent: int  # recent nights without any dead band
    swinging: int  # recent nights in which the loop oscillated
    recent: int
    days_left: float | None


def rank(wears: Sequence[Wear], nights: Mapping[str, Sequence[Night]], horizon: float = HORIZON) -> list[Place]:
    """Return all loops in the order of repair. horizon: days after the plant's last night that the plan must cover."""
    last = max((n.end for found in nights.values() for n in found), default=0.0)
    facts = [_facts(wear, nights.get(wear.loop, ()), last) for wear in wears]
    travels = [f.travel for f in facts if f.travel]
    rows = []
    for f in facts:
        now, limit, expected = f.wear.now, f.wear.limit.value, 0.0
        factor = float(np.clip(np.sqrt(f.travel / np.median(travels)), 0.7, 1.5)) if f.travel else 1.0
        if now is not None:  # only growth that is sure counts
            expected = max(now.level + (now.slope * horizon if now.growing and now.slope else 0.0), 0.0) / limit
        action = _action(f, horizon)
        rows.append((ORDER.index(action), -expected * f.confidence * factor, f.wear.loop, Place(
            f.wear.loop, 0, action, TITLES[action], _why(f, action, factor, horizon),
            None if now is None else now.level / limit, f.confidence)))
    rows.sort(key=lambda row: row[:3])
    return [replace(place, rank=number) for number, (*_, place) in enumerate(rows, 1)]


def _facts(wear: Wear, nights: Sequence[Night], last: float) -> _Facts:
    since = wear.repairs[-1].time if wear.repairs else -np.inf
    recent = [n for n in sorted(nights, key=lambda n: n.time) if n.time >= since][-RECENT:]
    silent, swinging = (sum(n.verdict is v for n in recent) for v in (Verdict.NO_BACKLASH, Verdict.OSCILLATING))
    answers = [n.confidence for n in recent if n.measured] or [
        n.confidence for n in recent if n.verdict is Verdict.NO_BACKLASH]
    travels = [n.travel for n in recent if n.travel is not None]
    return _Facts(wear, float(np.sum(answers)) / max(len(recent), 1), float(np.median(travels)) if travels else None,
                  silent, swinging, len(recent), (wear.limit_date[0] - last) / DAY if wear.limit_date else None)


def _action(f: _Facts, horizon: float) -> str:
    now, limit = f.wear.now, f.wear.limit.value
    if now is None:
        return "leave" if f.silent and f.silent >= 0.5 * f.recent else "check"
    if f.silent > 0.5 * f.recent:
        return "watch" if now.level > limit else "leave"
    if now.level_ci95[0] > limit and f.confidence >= AGREE and now.nights >= ENOUGH:
        return "pull"
    if now.level > limit or (f.days_left is not None and f.days_left <= horizon):
        return "room"
    return "watch" if now.growing or now.level > NEAR * limit or f.wear.state == "too_few_nights" else "leave"


def _why(f: _Facts, action: str, factor: float, horizon: float) -> tuple[str, ...]:
    """Say in words what decided: size over limit, confidence, trend, travel."""
    wear, now, limit = f.wear, f.wear.now, f.wear.limit
    if now is None:
        if action == "leave":
            return (f"{f.silent} of the last {f.recent} nights saw no dead band.",)
        if f.swinging > 0.5 * f.recent:
            return (f"The loop oscillated in {f.swinging} of the last {f.recent} nights, so its dead band has no size.",
                    "Have the tuning and the source of the oscillation looked at: backlash check.")
        reasons = sorted({code for _, code in wear.gaps[-RECENT:]})
        return ("No night gave an answer" + (f": {', '.join(reasons)}." if reasons else "."),
                "See the reasons of the last night and mend the export or the settings.")
    low, high = now.level_ci95
    where = "all above" if low > limit.value else "all below" if high < limit.value else "on both sides of"
    words = [f"Dead band {percent(now.level)}, {now.level / limit.value:.1f} times the limit of {percent(limit.value)} "
             f"({limit.source}).",
             f"95 % interval {percent(max(low, 0.0))} to {percent(high)}: {where} the limit.",
             f"Confidence {f.confidence:.0%} over the last {f.recent} nights"
             + (f"; {f.silent} of them saw no dead band." if f.silent else "."),
             _trend_words(f, horizon)]
    if factor > 1.1:
        words.append("The valve moves more than most: it wears faster and its dead band does more harm.")
    elif factor < 0.9:
        words.append("The valve moves less than most.")
    return tuple(words)


def _trend_words(f: _Facts, horizon: float) -> str:
    wear, now = f.wear, f.wear.current
    if wear.state == "too_few_nights":
        nights = now.nights + now.below if now is not None else 0
        return f"Only {nights} night{'s' * (nights != 1)} since the last repair or start: too few for a trend."
    if wear.state != "growing" or now is None or now.slope is None:
        return "No trend: it is not getting worse for sure."
    rate = f"Grows by {percent(30 * now.slope)} of span a month"
    if wear.limit_date is None:
        return f"{rate}, ever slower; if it goes on so it does not reach the limit."
    if f.days_left is not None and f.days_left <= 0:
        return f"{rate}; it passed the limit about {day_of(wear.limit_date[0]).isoformat()}."
    if f.days_left is not None and f.days_left <= 3650:
        side = "within" if f.days_left <= horizon else "after"
        return (f"{rate}; it reaches the limit about {day_of(wear.limit_date[0]).isoformat()}, "
                f"in {f.days_left:.0f} days, {side} the horizon of {horizon:.0f} days.")
    return f"{rate}; the limit is years away."
