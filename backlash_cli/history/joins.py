"""Which exports count, and how neighbouring nights are joined at the cut, kept in step with the nights in the file."""

from __future__ import annotations

import hashlib
import itertools
import json
import sqlite3
from bisect import bisect_left, insort
from collections.abc import Sequence
from dataclasses import dataclass

from ..estimator.carry import Carry, Tail, pack, resume, unpack, unpack_tail
from ..estimator.haegglund import estimate
from ..record import LoopSettings
from ..results.history import HalfPeriod
from .rows import HALF_PERIOD_COLUMNS, half_period_row, insert, moment

COVERED = 0.9  # shorter exports that together cover this share of a longer one make it superfluous
Span = tuple[float, float]


def active(spans: Sequence[Span]) -> list[Span]:
    """Return the exports of a loop that count, in time order: no data enters twice as a night.

    An export inside a longer one is left out (a night exported too early and then again), unless the shorter ones
    together cover the longer one: then they stand for it (single nights, and later the whole month in one file).
    """
    everything = sorted(set(spans))
    nested = _nested(everything)
    kept = list(nested)
    for span in sorted(nested, key=lambda s: (s[0] - s[1], s)):  # longest first
        if span not in kept:
            continue
        inside = [s for s in kept if s != span and span[0] <= s[0] and s[1] <= span[1]]
        if inside and _length(inside) >= COVERED * (span[1] - span[0]):
            kept.remove(span)
        else:
            kept = [s for s in kept if s not in inside]
    left_out = set(nested) - set(kept)
    return [span for span in everything if span not in left_out]


def _nested(spans: list[Span]) -> list[Span]:
    """Return the spans that lie inside another one or hold one, from spans in order; usually there are none."""
    found: set[Span] = set()
    longest_first = sorted(spans, key=lambda s: (s[0], -s[1]))
    reach = float("-inf")
    for i, span in enumerate(longest_first):
        if span[1] <= reach:
            found.add(span)
            found.update(s for s in longest_first[:i] if s[1] >= span[1])
        reach = max(reach, span[1])
    return sorted(found)


def _length(spans: list[Span]) -> float:
    """Length of the union of spans."""
    total, reached = 0.0, float("-inf")
    for first, last in sorted(spans):
        total += max(last - max(first, reached), 0.0)
        reached = max(reached, last)
    return total


@dataclass(frozen=True, eq=False)
class Join:
    """What the night before adds to a night: half periods over the cut, and from where on the night's own count.

    until: epoch seconds (None: none of its own). tail: state at the night's end where it depends on the night before.
    """

    half_periods: tuple[HalfPeriod, ...]
    until: float | None
    tail: Tail | None


def join(loop: str, tail: Tail, before: Carry, start_before: float, night: Carry, start: float,
         settings: LoopSettings) -> Join | None:
    """Go on from the `tail` of one night into the next; None where they do not touch or ran other filters.

    start_before, start: epoch seconds of grid position 0 of both nights.
    """
    h = night.interval
    shift = round((start_before - start) / h)
    misfit = abs((start_before - start) / h - shift)
    first = night.head[0][0] if len(night.head[0]) else 0.0
    last = night.head[0][-1] if len(night.head[0]) else 0.0
    ends = tail.last_index + shift
    if not before.fits(night) or misfit > 0.25 or ends < first - 1 or ends > last or settings.K is None:
        return None
    done, until, own_tail = resume(tail, night, shift)
    found = estimate(done, h, settings)
    rows = tuple(
        HalfPeriod(loop, start + b, start + b + dt, dt, dy, e_max, d, int(direction), why == "ok", str(why), True)
        for b, dt, dy, e_max, d, direction, why in zip(
            found.begin.tolist(), found.duration.tolist(), found.dy.tolist(), found.e_max.tolist(), found.d.tolist(),
            found.direction, found.why, strict=True)
        if why != "too_short"
    )
    return Join(rows, None if until is None else start + until * h, own_tail)


def distinct(half_periods: list[HalfPeriod]) -> list[HalfPeriod]:
    """Return half periods in time order with no moment counted twice, where exports overlap.

    The accepted ones go first, then the complete ones; one that shares more than half of itself with a kept one is
    left out.
    """
    kept: list[HalfPeriod] = []
    order = sorted(half_periods, key=lambda p: (not p.accepted, p.why == "incomplete", -p.dt_s, p.start))
    starts: list[float] = []
    for p in order:
        place = bisect_left(starts, p.start)
        near = kept[max(place - 1, 0) : place + 2]
        if any(min(p.end, q.end) - max(p.start, q.start) > 0.5 * min(p.dt_s, q.dt_s) for q in near):
            continue
        insort(starts, p.start)
        insort(kept, p, key=lambda q: q.start)
    return kept


def rejoin(db: sqlite3.Connection, loop: str) -> None:
    """Join every night of `loop` with the one before it, where that is not done yet; inside a transaction.

    A join carries the fingerprints of the two nights it is made of, so that only what changed is computed, and the
    result is the same in whatever order the nights came.
    """
    digests = {(r["start"], r["end"]): r["digest"] for r in db.execute(
        "SELECT start, end, digest FROM nights WHERE loop = ?", (loop,))}
    known = {(r["start"], r["end"]): (r["of"], r["tail"] is not None) for r in db.execute(
        "SELECT start, end, of, tail FROM joins WHERE loop = ?", (loop,))}
    spans = active(list(digests))
    for span in set(known) - set(spans[1:]):
        _forget(db, loop, span)
    leaves = {span: digests[span] for span in spans}  # fingerprint of the state that a night leaves behind
    for before, span in itertools.pairwise(spans):
        of = hashlib.sha256(f"{leaves[before]}:{digests[span]}".encode()).hexdigest()[:32]
        if known.get(span, ("", False))[0] != of:
            _forget(db, loop, span)
            passes_on = _join(db, loop, before, span, of)
        else:
            passes_on = known[span][1]
        if passes_on:
            leaves[span] = of


def _join(db: sqlite3.Connection, loop: str, before: Span, span: Span, of: str) -> bool:
    """Compute and store one join; return whether the night passes on the state of the night before."""
    tail, earlier, origin_before, _ = _load(db, loop, before)
    _, night, origin, settings = _load(db, loop, span)
    found = None
    if tail is not None and earlier is not None and night is not None:
        found = join(loop, tail, earlier, origin_before, night, origin, settings)
    if found is None:
        db.execute("INSERT INTO joins VALUES (?, ?, ?, ?, ?, NULL)", (loop, *span, of, span[0]))
        return False
    db.execute("INSERT INTO joins VALUES (?, ?, ?, ?, ?, ?)", (
        loop, *span, of, None if found.until is None else moment(found.until),
        None if found.tail is None else pack(found.tail)))
    row = {"loop": loop, "start": span[0], "end": span[1]}
    insert(db, "half_periods", HALF_PERIOD_COLUMNS,
           [half_period_row(row, h, joined=True) for h in found.half_periods], "IGNORE")
    return found.tail is not None


def _forget(db: sqlite3.Connection, loop: str, span: Span) -> None:
    db.execute("DELETE FROM joins WHERE loop = ? AND start = ? AND end = ?", (loop, *span))
    db.execute("DELETE FROM half_periods WHERE loop = ? AND night_start = ? AND night_end = ? AND joined = 1",
               (loop, *span))


def _load(db: sqlite3.Connection, loop: str,
          span: Span) -> tuple[Tail | None, Carry | None, float, LoopSettings]:
    """Return what a night leaves behind: its tail (as the night before left it, where that matters), its carry, the
    time of its grid position 0, and its settings."""
    row = db.execute(
        "SELECT n.carry, n.settings, j.tail FROM nights n LEFT JOIN joins j ON j.loop = n.loop AND j.start = n.start "
        "AND j.end = n.end WHERE n.loop = ? AND n.start = ? AND n.end = ?", (loop, *span)).fetchone()
    if row["carry"] is None:
        return None, None, span[0], LoopSettings()
    carry = unpack(row["carry"])
    tail = carry.tail if row["tail"] is None else unpack_tail(row["tail"])
    plain = json.loads(row["settings"])
    settings = LoopSettings(**{name: plain[name] for name in ("K", "Ti", "Td", "Tf", "Kp")})
    return tail, carry, span[0] - float(carry.head[0][0]) * carry.interval, settings
