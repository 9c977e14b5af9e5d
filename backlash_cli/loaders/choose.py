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
from .join import LoopSeries, failure
from .options import check_pattern, parse_since, sample_size
from .order import NAT, utc_text
from .signals import Axis, Series

SHOWN = 12  # names written out in a message; all of them stand in its values


def choose(names: Iterable[str], only: Sequence[str] = (), matching: Sequence[str] = (), sample: str | None = None,
           seed: int = 0) -> tuple[list[str], list[Note]]:
    """Return the loops that are wanted of all `names`, in order, and what was left out and why.

    only: names or wildcards, each of which must exist. matching: patterns (`check_pattern`), of which one must exist.
    sample: "20" or "5%" of what is left, drawn by `seed`. Raises UsageError for a name or patterns that nothing fits.
    """
    everything = sorted(set(names))
    for pattern in only:
        if not any(is_named(name, [pattern]) for name in everything):
            raise UsageError(f"no loop {pattern!r} in the data", where="--loop", remedy=nearest(pattern, everything))
    chosen = [name for name in everything if is_named(name, only)]
    notes: list[Note] = []
    if matching:
        fitting = [name for name in chosen if is_matching(name, matching)]
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
    return chosen, notes


def is_named(name: str, only: Sequence[str]) -> bool:
    """Say whether a loop is one of those named, also by wildcards; all are where none is named."""
    return not only or any(name == pattern or fnmatchcase(name.lower(), pattern.lower()) for pattern in only)


def is_matching(name: str, matching: Sequence[str]) -> bool:
    """Say whether a loop's name fits a pattern; every name does where there is none."""
    return not matching or any(check_pattern(pattern)(name) for pattern in matching)


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


@dataclass(frozen=True)
class Since:
    """What --since leaves. loops: from the moment on [microseconds since 1970 UTC]. lost: those that cannot be cut."""

    moment: int
    loops: dict[str, LoopSeries]
    notes: list[Note]
    lost: list[Note]


def since(loops: Mapping[str, LoopSeries], found: Iterable[Series], when: str, timezone: str | None) -> Since:
    """Take off what lies before a moment, or before an age of the last stamp of all series found.

    Of signals with rows of their own (a setpoint that is recorded when it changes) the last value before the moment
    stays, as it still holds. Raises UsageError when the data have no times, InputError when no loop has later ones.
    """
    moment, age = parse_since(when, timezone)
    last = max((last for axis in {id(item.axis): item.axis for item in found}.values()
                if (last := axis.last()) is not None), default=None)
    if moment is None:
        if last is None:
            raise UsageError("the data have no times", where=f"--since {when}", remedy="leave --since out")
        moment = last - age
    cut = _Cut(moment)
    kept, without, lost = {}, [], []
    for name, own in loops.items():
        measured = own.roles.get("pv", [])
        if not age and any(not item.axis.absolute for item in measured):
            error = InputError("the times count from an unknown start", where=measured[0].where,
                               remedy="give --since as an age, such as 3h")
            lost.append(failure(error, loop=name))
            continue
        own = cut.loop(own)
        if measured and "pv" not in own.roles:
            without.append(name)
        else:
            kept[name] = own
    text = f"{utc_text(moment)} UTC"
    if without and not kept:
        ends = "" if last is None else f"; the data end at {utc_text(last)} UTC"
        raise InputError(f"no loop has data since {text}{ends}", where=f"--since {when}",
                         remedy="give an earlier time, or an age such as 3d")
    notes = [Note("since", f"data before {text} were left out (--since {when})", {"since": text})]
    if without:
        said = f"{len(without)} of {len(loops)} loops have no data since {text} and were not computed: {shown(without)}"
        notes.append(Note("nothing_since", said, {"loops": float(len(without)), "names": ", ".join(without)}))
    return Since(moment, kept, notes, lost)


class _Cut:
    """Takes off what lies before a moment; series that share their rows share the shorter ones too."""

    def __init__(self, moment: int) -> None:
        self.moment = moment
        self._axes: dict[tuple[int, bool], tuple[Axis, slice | IntArray]] = {}

    def loop(self, loop: LoopSeries) -> LoopSeries:
        own = {id(item.axis) for item in loop.roles.get("pv", ())}
        roles, extra = ({name: parts for name, items in signals.items() if (parts := [
            part for item in items if (part := self._part(item, keep_one=id(item.axis) not in own)).count])}
            for signals in (loop.roles, loop.extra))
        return LoopSeries(loop.name, roles, extra, loop.missing_tags)

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
