"""Which loops of a plant are computed, by name, by pattern, or a sample that is the same every time, and from when on.

What is left out is counted and said. The choice depends on the names alone, not on the order of files, the engine or
the machine.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from ..errors import InputError, UsageError, nearest
from ..record import IntArray, Note
from .join import LoopSeries
from .options import check_pattern, parse_since, sample_size
from .order import NAT, utc_text
from .signals import Axis, Series

SHOWN = 12  # names written out in a message; all of them stand in its values


@dataclass(frozen=True)
class Choice:
    """names: the loops to compute, in order. notes: what was left out, and why."""

    names: tuple[str, ...]
    notes: tuple[Note, ...] = ()


def choose(names: Iterable[str], only: Sequence[str] = (), matching: Sequence[str] = (), sample: str | None = None,
           seed: int = 0) -> Choice:
    """Return the loops that are wanted of all `names`.

    only: names or wildcards, each of which must exist. matching: patterns (`check_pattern`), of which one must exist.
    sample: "20" or "5%" of what is left, drawn by `seed`. Raises UsageError for a name or patterns that nothing fits.
    """
    everything = sorted(set(names))
    chosen = _named(everything, only)
    notes: list[Note] = []
    if matching:
        tests = [check_pattern(pattern) for pattern in matching]
        fitting = [name for name in chosen if any(test(name) for test in tests)]
        words = " or ".join(repr(pattern) for pattern in matching)
        if not fitting:
            raise UsageError(f"none of {len(chosen)} loops matches {words}", where="--loops-matching",
                             remedy=nearest(matching[0], everything))
        if left := len(chosen) - len(fitting):
            text = f"{left} of {len(chosen)} loops do not match {words} and were not computed"
            notes.append(Note("not_matching", text, {"loops": float(left)}))
        chosen = fitting
    if sample is not None:
        drawn = draw(chosen, sample_size(sample, len(chosen)), seed)
        if left := len(chosen) - len(drawn):
            text = (f"{len(drawn)} of {len(chosen)} loops were drawn (--sample {sample}, seed {seed}): {shown(drawn)}; "
                    f"{left} were not computed")
            notes.append(Note("sampled", text, {"loops": float(left), "seed": float(seed), "drawn": ", ".join(drawn)}))
        chosen = drawn
    return Choice(tuple(chosen), tuple(notes))


def _named(names: list[str], only: Sequence[str]) -> list[str]:
    if not only:
        return names
    chosen: set[str] = set()
    for pattern in only:
        hits = [name for name in names if name == pattern or fnmatchcase(name.lower(), pattern.lower())]
        if not hits:
            raise UsageError(f"no loop {pattern!r} in the data", where="--loop", remedy=nearest(pattern, names))
        chosen.update(hits)
    return sorted(chosen)


def draw(names: Sequence[str], count: int, seed: int = 0) -> list[str]:
    """Return `count` of the names, in order: those whose hash with the seed is smallest.

    So a plant that grows by a few loops keeps nearly the same sample, and every night looks at the same loops.
    """
    def place(name: str) -> bytes:
        return hashlib.sha256(f"{seed}:{name}".encode("utf-8", "backslashreplace")).digest()

    return sorted(sorted(names, key=place)[:count])


def shown(names: Sequence[str]) -> str:
    """The first names, and how many more there are."""
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(name[:40] for name in names[:SHOWN]) + more


def moment_of(since: str, timezone: str | None, last: int | None) -> int:
    """Return the moment [microseconds since 1970 UTC] from which on data count; `last`: last stamp of the data.

    Raises UsageError when an age is given and the data have no stamps.
    """
    moment, age = parse_since(since, timezone)
    if moment is not None:
        return moment
    if last is None:
        raise UsageError("the data have no times", where=f"--since {since}", remedy="leave --since out")
    return last - age


def last_stamp(series: Iterable[Series]) -> int | None:
    """Return the last stamp [microseconds since 1970 UTC] of all series, None if there is none."""
    axes = {id(item.axis): item.axis for item in series}
    return max((last for axis in axes.values() if (last := axis.last()) is not None), default=None)


class Cut:
    """Takes off what lies before a moment; series that share their rows share the shorter ones too."""

    def __init__(self, moment: int, *, age: bool) -> None:
        self.moment, self.age = moment, age
        self._axes: dict[tuple[int, bool], tuple[Axis, slice | IntArray]] = {}

    def loop(self, loop: LoopSeries) -> LoopSeries | None:
        """Return the loop from the moment on, None where no measurement is left.

        Of signals with rows of their own (a setpoint that is recorded when it changes) the last value before the
        moment stays, as it still holds. Raises InputError for a date where the data count from an unknown start.
        """
        measured = loop.roles.get("pv", [])
        if not self.age and any(not item.axis.absolute for item in measured):
            raise InputError("the times count from an unknown start", where=measured[0].where,
                             remedy="give --since as an age, such as 3h")
        own = {id(item.axis) for item in measured}
        roles = self._all(loop.roles, own)
        if measured and "pv" not in roles:
            return None
        return LoopSeries(loop.name, roles, self._all(loop.extra, own), loop.missing_tags)

    def _all(self, signals: Mapping[str, list[Series]], own: set[int]) -> dict[str, list[Series]]:
        found = {name: [part for item in items if (part := self._part(item, keep_one=id(item.axis) not in own)).count]
                 for name, items in signals.items()}
        return {name: parts for name, parts in found.items() if parts}

    def _part(self, item: Series, *, keep_one: bool) -> Series:
        key = id(item.axis), keep_one
        if key not in self._axes:
            rows = self._rows(item.axis.micros, keep_one)
            whole = isinstance(rows, slice) and not rows.start and rows.stop is None
            self._axes[key] = item.axis if whole else item.axis.part(rows), rows
        axis, rows = self._axes[key]
        return item if axis is item.axis else item.part(axis, rows)

    def _rows(self, micros: IntArray, keep_one: bool) -> slice | IntArray:
        before = (micros < self.moment) & (micros != NAT)
        if keep_one and before.any():
            held = np.flatnonzero(before)
            before[held[np.argmax(micros[held])]] = False
        later = np.flatnonzero(~before & (micros != NAT))
        if not len(later):
            return slice(0, 0)
        first = int(later[0])
        return np.flatnonzero(~before) if before[first:].any() else slice(first, None)


def since_notes(since: str, moment: int, without: Sequence[str], loops: int) -> list[Note]:
    """Say from when on data were used, and which loops have none since then."""
    when = f"{utc_text(moment)} UTC"
    notes = [Note("since", f"data before {when} were left out (--since {since})", {"since": when})]
    if without:
        without = sorted(without)
        text = f"{len(without)} of {loops} loops have no data since {when} and were not computed: {shown(without)}"
        notes.append(Note("nothing_since", text, {"loops": float(len(without)), "names": ", ".join(without)}))
    return notes


def nothing_since(since: str, moment: int, last: int | None) -> InputError:
    """The error when no loop has data since then."""
    ends = "" if last is None else f"; the data end at {utc_text(last)} UTC"
    return InputError(f"no loop has data since {utc_text(moment)} UTC{ends}", where=f"--since {since}",
                      remedy="give an earlier time, or an age such as 3d")
