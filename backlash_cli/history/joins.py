"""Which exports count, and how neighbouring nights are joined at the cut."""

import math
from bisect import bisect_left, bisect_right, insort
from collections.abc import Sequence

from ..estimator.carry import Carry, Tail, resume
from ..estimator.haegglund import estimate
from ..record import LoopSettings
from ..results import Estimate

COVERED = 0.9  # shorter exports that together cover this share of a longer one make it superfluous
Span = tuple[float, float]


def active(spans: Sequence[Span]) -> list[Span]:
    """Return the exports of a loop that count, in time order: no data enters twice as a night.

    An export inside a longer one is left out (a night exported too early and then again), unless the shorter ones
    together cover the longer one: then they stand for it (single nights, and later the whole month in one file)."""
    everything = sorted(set(spans))
    out: set[Span] = set()
    for span in sorted(everything, key=lambda s: (s[0] - s[1], s)):  # longest first
        near = everything[bisect_left(everything, (span[0], -math.inf)) : bisect_right(everything, (span[1], math.inf))]
        inside = [] if span in out else [s for s in near if s != span and s[1] <= span[1] and s not in out]
        covered, reached = 0.0, -math.inf
        for first, last in inside:
            covered += max(last - max(first, reached), 0.0)
            reached = max(reached, last)
        out.update([span] if inside and covered >= COVERED * (span[1] - span[0]) else inside)
    return [span for span in everything if span not in out]


def join(before: Carry, start_before: float, night: Carry, start: float, settings: LoopSettings
         ) -> tuple[list[Estimate], float, Tail | None]:
    """Go on from the tail of one night into the next.

    start_before, start: epoch seconds of grid position 0 of both nights. Returns the half periods over the cut, from
    when on the night's own count (epoch seconds), and the state at the night's end where it depends on the night
    before. Nights that do not touch or ran other filters keep all their own."""
    h, tail = night.interval, before.tail
    shift = round((start_before - start) / h)
    misfit = abs((start_before - start) / h - shift)
    first, last = (float(night.head[0][k]) if len(night.head[0]) else 0.0 for k in (0, -1))
    if (tail is None or not before.fits(night) or misfit > 0.25 or settings.K is None
            or not first - 1 <= tail.last_index + shift <= last):
        return [], -math.inf, None
    done, until, own_tail = resume(tail, night, shift)
    halves = [e for e in estimate(done, h, settings, start) if e.why != "too_short"]
    return halves, math.inf if until is None else start + until * h, own_tail


def distinct(half_periods: list[Estimate]) -> list[Estimate]:
    """Return half periods in time order with no moment counted twice, where exports overlap.

    The accepted ones go first, then the complete ones, but those that share more than half with a kept one."""
    kept: list[Estimate] = []
    for p in sorted(half_periods, key=lambda p: (not p.accepted, p.why == "incomplete", -p.dt_s, p.start)):
        place = bisect_left(kept, p.start, key=lambda q: q.start)
        near = kept[max(place - 1, 0) : place + 2]
        if all(min(p.end, q.end) - max(p.start, q.start) <= 0.5 * min(p.dt_s, q.dt_s) for q in near):
            insort(kept, p, key=lambda q: q.start)
    return kept
