"""Which exports count, and how neighbouring nights are joined at the cut, kept in step with the nights in the file."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from bisect import bisect_left, bisect_right, insort
from collections.abc import Mapping, Sequence
from typing import Any

from ..estimator.carry import Carry, Tail, pack, resume, unpack, unpack_tail
from ..estimator.haegglund import estimate
from ..record import LoopSettings
from ..results import Estimate
from ..results.history import HalfPeriod
from .database import Database

COVERED = 0.9  # shorter exports that together cover this share of a longer one make it superfluous
Span = tuple[float, float]


def active(spans: Sequence[Span]) -> list[Span]:
    """Return the exports of a loop that count, in time order: no data enters twice as a night.

    An export inside a longer one is left out (a night exported too early and then again), unless the shorter ones
    together cover the longer one: then they stand for it (single nights, and later the whole month in one file).
    """
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


def moment(time: float) -> float:
    """Round a time to the millisecond."""
    return round(float(time), 3)


def short(value: float | None) -> float | None:
    """Round to nine digits; None for what is not a number."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.9g}")


def half_period_row(night: Mapping[str, Any], e: Estimate | HalfPeriod, *, joined: bool) -> dict[str, Any]:
    """Return the row of table `half_periods` for one half period of a night."""
    return {"loop": night["loop"], "night_start": night["start"], "night_end": night["end"], "joined": int(joined),
            "start": moment(e.start), "end": moment(e.end), "dt_s": short(e.dt_s), "dy": short(e.dy),
            "e_max": short(e.e_max), "d": short(e.d), "direction": int(e.direction), "accepted": int(e.accepted),
            "why": str(e.why)}


def join(tail: Tail, before: Carry, start_before: float, night: Carry, start: float,
         settings: LoopSettings) -> tuple[list[Estimate], float | None, Tail | None] | None:
    """Go on from the `tail` of one night into the next; None where they do not touch or ran other filters.

    start_before, start: epoch seconds of grid position 0 of both nights. Returns the half periods over the cut, from
    when on the night's own count (epoch seconds, None: none of them), and the state at the night's end where it depends
    on the night before.
    """
    h = night.interval
    shift = round((start_before - start) / h)
    misfit = abs((start_before - start) / h - shift)
    first, last = (float(night.head[0][k]) if len(night.head[0]) else 0.0 for k in (0, -1))
    ends = tail.last_index + shift
    if not before.fits(night) or misfit > 0.25 or ends < first - 1 or ends > last or settings.K is None:
        return None
    done, until, own_tail = resume(tail, night, shift)
    halves = [e for e in estimate(done, h, settings, start) if e.why != "too_short"]
    return halves, None if until is None else start + until * h, own_tail


def distinct(half_periods: list[HalfPeriod]) -> list[HalfPeriod]:
    """Return half periods in time order with no moment counted twice, where exports overlap.

    The accepted ones go first, then the complete ones; one that shares more than half of itself with a kept one is
    left out.
    """
    kept: list[HalfPeriod] = []
    for p in sorted(half_periods, key=lambda p: (not p.accepted, p.why == "incomplete", -p.dt_s, p.start)):
        place = bisect_left(kept, p.start, key=lambda q: q.start)
        near = kept[max(place - 1, 0) : place + 2]
        if all(min(p.end, q.end) - max(p.start, q.start) <= 0.5 * min(p.dt_s, q.dt_s) for q in near):
            insort(kept, p, key=lambda q: q.start)
    return kept


def rejoin(db: Database, loop: str) -> None:
    """Join every night of `loop` with the one before it, where that is not done yet; inside a transaction.

    A join carries the fingerprints of the two nights it is made of, so that only what changed is computed, and the
    result is the same in whatever order the nights came.
    """
    digests = {(r["start"], r["end"]): r["digest"] for r in db.rows(
        "SELECT start, end, digest FROM nights WHERE loop = ?", loop)}
    known = {(r["start"], r["end"]): (r["of"], r["tail"] is not None) for r in db.rows(
        "SELECT start, end, of, tail FROM joins WHERE loop = ?", loop)}
    spans = active(list(digests))
    for span in set(known) - set(spans[1:]):
        _forget(db, loop, span)
    leaves = {span: digests[span] for span in spans}  # fingerprint of the state that a night leaves behind
    for before, span in itertools.pairwise(spans):
        of = hashlib.sha256(f"{leaves[before]}:{digests[span]}".encode()).hexdigest()[:32]
        was, passes_on = known.get(span, ("", False))
        if was != of:
            _forget(db, loop, span)
            passes_on = _join(db, loop, before, span, of)
        if passes_on:
            leaves[span] = of


def _join(db: Database, loop: str, before: Span, span: Span, of: str) -> bool:
    """Compute and store one join; return whether the night passes on the state of the night before."""
    tail, earlier, origin_before, _ = _load(db, loop, before)
    _, night, origin, settings = _load(db, loop, span)
    found = join(tail, earlier, origin_before, night, origin, settings) if tail and earlier and night else None
    # of nights that do not touch, each keeps its own half periods
    halves, until, own_tail = found or ([], span[0], None)
    row = {"loop": loop, "start": span[0], "end": span[1]}
    db.insert("joins", [{**row, "of": of, "until": None if until is None else moment(until),
                         "tail": None if own_tail is None else pack(own_tail)}])
    db.insert("half_periods", [half_period_row(row, h, joined=True) for h in halves], "IGNORE")
    return own_tail is not None


def _forget(db: Database, loop: str, span: Span) -> None:
    db.db.execute("DELETE FROM joins WHERE loop = ? AND start = ? AND end = ?", (loop, *span))
    db.db.execute("DELETE FROM half_periods WHERE loop = ? AND night_start = ? AND night_end = ? AND joined = 1",
                  (loop, *span))


def _load(db: Database, loop: str, span: Span) -> tuple[Tail | None, Carry | None, float, LoopSettings]:
    """Return what a night leaves behind: its tail (as the night before left it, where that matters), its carry, the
    time of its grid position 0, and its settings."""
    (row,) = db.rows(
        "SELECT n.carry, n.settings, j.tail FROM nights n LEFT JOIN joins j ON j.loop = n.loop AND j.start = n.start "
        "AND j.end = n.end WHERE n.loop = ? AND n.start = ? AND n.end = ?", loop, *span)
    if row["carry"] is None:
        return None, None, span[0], LoopSettings()
    carry, plain = unpack(row["carry"]), json.loads(row["settings"])
    tail = carry.tail if row["tail"] is None else unpack_tail(row["tail"])
    return (tail, carry, span[0] - float(carry.head[0][0]) * carry.interval,
            LoopSettings(**{name: plain[name] for name in ("K", "Ti", "Td", "Tf", "Kp")}))
