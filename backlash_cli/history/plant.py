"""The whole history at once: nights, wear and the order of repair.

The rule of the order, which valves to pull at the next shutdown and which to leave alone. First the group:
1. pull: even the lower end of the interval of the present dead band is above the limit, and three nights or more agree;
2. pull if there is room: above the limit without being sure of it, or the limit is reached before the horizon;
3. watch: growing, or above 70 % of the limit, or too few nights since a repair to say;
4. leave alone: below the limit, not growing, or nights without any dead band;
5. check loop and data: no night gave an answer (it oscillates, or the export does not allow one).
Then, inside a group, by the score: dead band expected at the horizon over the limit, times confidence, times a travel
factor between 0.7 and 1.5 (a valve that moves more wears faster and harms more), the square root of its output travel
over the plant's median."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import UsageError, nearest
from ..results import Verdict
from ..results.history import DAY, Night, Place, Wear
from ..selection import fits
from .limits import Limits
from .store import History
from .trend import wear

HORIZON = 90.0  # days ahead that count as "until the next shutdown" unless given
AGREE = 0.5
ENOUGH = 3  # nights with a size that a valve is pulled for
NEAR = 0.7
RECENT = 14  # nights that stand for the present
ORDER = ("pull", "room", "watch", "leave", "check")


def plant_history(history: History, limits: Limits, *, loops: Sequence[str] = (), horizon: float = HORIZON
                  ) -> list[Place]:
    """Read a history and return wear and place in the order of repair of all loops, or of the named ones."""
    return rank([wear(name, history.nights(name), history.repairs(name), limits.of(name))
                 for name in chosen(history, loops)], horizon)


def rank(wears: Sequence[Wear], horizon: float = HORIZON) -> list[Place]:
    """Return all loops in the order of repair. horizon: days after the plant's last night that the plan must cover."""
    last = max((n.end for w in wears for n in w.nights), default=0.0)
    recent = {w.loop: [n for n in w.nights if not w.repairs or n.time >= w.repairs[-1].time][-RECENT:] for w in wears}
    moves = {loop: [n.travel for n in found if n.travel is not None] for loop, found in recent.items()}
    travel = {loop: x for loop, found in moves.items() if found and (x := float(np.median(found)))}
    factor = {loop: float(np.clip(np.sqrt(x / np.median([*travel.values()])), 0.7, 1.5)) for loop, x in travel.items()}
    placed = sorted((_placed(w, recent[w.loop], factor.get(w.loop, 1.0), last, horizon) for w in wears),
                    key=lambda row: (ORDER.index(row[1].action), -row[0], row[1].loop))
    return [replace(place, rank=number) for number, (_, place) in enumerate(placed, 1)]


def _placed(wear: Wear, recent: Sequence[Night], factor: float, last: float, horizon: float) -> tuple[float, Place]:
    """Return the score of a loop and its place. recent: the last nights since the repair; last: time of the plant's."""
    now, limit = wear.now, wear.limit.value
    silent, swinging = (sum(n.verdict is v for n in recent) for v in (Verdict.NO_BACKLASH, Verdict.OSCILLATING))
    answers = [n.confidence for n in recent if n.d is not None] or [
        n.confidence for n in recent if n.verdict is Verdict.NO_BACKLASH]
    confidence = float(np.sum(answers)) / max(len(recent), 1)
    days_left = (wear.limit_date[0] - last) / DAY if wear.limit_date else np.inf
    if now is None:
        action = "leave" if silent and silent >= 0.5 * len(recent) else "check"
    elif silent > 0.5 * len(recent):
        action = "watch" if now.level > limit else "leave"
    elif now.level_ci95[0] > limit and confidence >= AGREE and now.nights >= ENOUGH:
        action = "pull"
    elif now.level > limit or days_left <= horizon:
        action = "room"
    else:
        near = now.growing or now.level > NEAR * limit or wear.state == "too_few_nights"
        action = "watch" if near else "leave"
    growth = now.slope * horizon if now and now.growing and now.slope else 0.0  # only what is sure counts
    expected = max(now.level + growth, 0.0) / limit if now else 0.0
    return expected * confidence * factor, Place(
        wear, wear.loop, 0, action, confidence, now.level / limit if now else None, len(recent), silent, swinging,
        tuple(sorted({code for _, code in wear.gaps[-RECENT:]})), factor, days_left, horizon)


def chosen(history: History, names: Sequence[str]) -> list[str]:
    """Return all loops, or those that names or patterns fit. Raises UsageError for one that fits none."""
    known = history.loops()
    if lost := next((name for name in names if not any(fits(loop, [name]) for loop in known)), None):
        raise UsageError(f"the history has no loop {lost!r}", where=str(history.path), remedy=nearest(lost, known))
    return [loop for loop in known if fits(loop, names)]
