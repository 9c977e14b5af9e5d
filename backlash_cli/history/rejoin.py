"""Keeps the half periods over the cuts in step with the nights in the file."""

from __future__ import annotations

import hashlib
import itertools
import json
import sqlite3
from typing import Any

from ..estimator.carry import Carry, Tail
from ..estimator.carry_bytes import pack, unpack, unpack_tail
from ..record import LoopSettings
from .joins import active, join
from .rows import HALF_PERIOD_COLUMNS, half_period_row, moment


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


def _join(db: sqlite3.Connection, loop: str, before: tuple[float, float], span: tuple[float, float], of: str) -> bool:
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
    db.executemany(f"INSERT OR IGNORE INTO half_periods ({', '.join(HALF_PERIOD_COLUMNS)}) VALUES "
                   f"({', '.join('?' for _ in HALF_PERIOD_COLUMNS)})",
                   [half_period_row(row, h, joined=True) for h in found.half_periods])
    return found.tail is not None


def _forget(db: sqlite3.Connection, loop: str, span: tuple[float, float]) -> None:
    db.execute("DELETE FROM joins WHERE loop = ? AND start = ? AND end = ?", (loop, *span))
    db.execute("DELETE FROM half_periods WHERE loop = ? AND night_start = ? AND night_end = ? AND joined = 1",
               (loop, *span))


def _load(db: sqlite3.Connection, loop: str,
          span: tuple[float, float]) -> tuple[Tail | None, Carry | None, float, LoopSettings]:
    """Return what a night leaves behind: its tail (as the night before left it, where that matters), its carry, the
    time of its grid position 0, and its settings."""
    row = db.execute(
        "SELECT n.carry, n.settings, j.tail FROM nights n LEFT JOIN joins j ON j.loop = n.loop AND j.start = n.start "
        "AND j.end = n.end WHERE n.loop = ? AND n.start = ? AND n.end = ?", (loop, *span)).fetchone()
    if row["carry"] is None:
        return None, None, span[0], LoopSettings()
    carry = unpack(row["carry"])
    tail = carry.tail if row["tail"] is None else unpack_tail(row["tail"])
    return tail, carry, span[0] - float(carry.head[0][0]) * carry.interval, _settings(json.loads(row["settings"]))


def _settings(plain: dict[str, Any]) -> LoopSettings:
    names = ("K", "Ti", "Td", "Tf", "Kp")
    return LoopSettings(**{name: plain[name] for name in names})
