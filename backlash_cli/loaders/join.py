"""Series of all files to the signals of each loop: by name, by explicit tags, and joined in time order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from ..errors import BacklashError, LoopError
from ..record import FloatArray, Note
from ..settings import ROLE_KEYS, Metadata
from .grid import Times
from .names import SIGNALS, plain
from .signals import Axis, Series
from .states import good_samples, inside, runs

Faults = dict[tuple[str, str], Counter[str]]  # (what is wrong, tag) -> what stood there, counted
MOST_TIMES = 8  # kept: more than one loop has, and few enough for plants of many files


def failure(error: BacklashError, *, loop: str = "", file: str = "") -> Note:
    """Return an error as a failure of the plant, about a loop or a file."""
    values: dict[str, float | str] = {key: value for key, value in (("loop", loop), ("file", file)) if value}
    return Note(error.code, f"{loop}: {error}" if loop else str(error), values)


@dataclass
class LoopSeries:
    """All recorded signals of one loop: role ("sp", "pv", "op", "mode") or column name -> series in file order."""

    name: str
    roles: dict[str, list[Series]] = field(default_factory=dict)
    extra: dict[str, list[Series]] = field(default_factory=dict)
    missing_tags: dict[str, str] = field(default_factory=dict)

    def changed(self, change: Callable[[Axis], Axis]) -> LoopSeries:
        """Return it with other rows in the place of its own, also shared ones; without signals that have none left."""
        once = cache(change)
        roles, extra = ({name: there for name, items in signals.items() if (
            there := [replace(item, axis=axis) for item in items if len(axis := once(item.axis))])}
            for signals in (self.roles, self.extra))
        return replace(self, roles=roles, extra=extra)


@dataclass(frozen=True, eq=False)
class Signal:
    """One signal over all files. values: (rows,) nan where blank or bad; bad: (rows,) True where something stood
    that is no good measurement. faults: what stood there, counted, by what is wrong and by tag."""

    times: Times
    values: FloatArray
    bad: NDArray[np.bool_]
    notes: tuple[Note, ...] = ()
    faults: Faults = field(default_factory=dict)


def by_loop(series: Sequence[Series], metadata: Metadata) -> dict[str, LoopSeries]:
    """Assign every series to a loop; tags named in the metadata go where it says."""
    explicit, asked = explicit_tags(metadata)
    loops: dict[str, LoopSeries] = {}

    def own(name: str) -> LoopSeries:
        return loops.setdefault(name, LoopSeries(name))

    # loops that the metadata know by another spelling or by a whole part of the name, one by one
    present = {item.loop for item in series if item.loop} if metadata.loops else set()
    found = {name: metadata.match(name) or metadata.part_of(name) for name in present - metadata.loops.keys()}
    counts = Counter(found.values())
    renamed = {name: match for name, match in found.items() if match and counts[match] == 1 and match not in present}
    for item in series:
        owners = explicit.get(item.tag.strip().lower(), ())
        for loop, role in owners:
            own(loop).roles.setdefault(role, []).append(item)
        name = renamed.get(item.loop, item.loop)
        # unless the metadata name another tag for this signal
        if item.loop and not owners and not (item.role and item.role in asked.get(name, {})):
            (own(name).roles if item.role else own(name).extra).setdefault(item.role or item.signal, []).append(item)
    for loop, tags in asked.items():
        own(loop).missing_tags |= {role: tag for role, tag in tags.items() if role not in own(loop).roles}
    return {name: loop for name, loop in loops.items() if loop.roles}


def explicit_tags(metadata: Metadata) -> tuple[dict[str, list[tuple[str, str]]], dict[str, dict[str, str]]]:
    """Return the tags that the metadata name: tag in lower case -> (loop, role) of each, and loop -> role -> tag."""
    explicit: dict[str, list[tuple[str, str]]] = {}
    asked = {loop: {role: tag for role in ROLE_KEYS if isinstance(tag := values.values.get(role), str) and tag.strip()}
             for loop, values in metadata.loops.items()}
    for loop, tags in asked.items():
        for role, tag in tags.items():
            explicit.setdefault(tag.strip().lower(), []).append((loop, role))
    return explicit, asked


class Joiner:
    """Joins the parts of signals; signals whose parts lie in the same rows share their times."""

    def __init__(self, good_quality: tuple[str, ...] = ()) -> None:
        self.good_quality = good_quality
        self.only: tuple[int, int] | None = None  # stamps between which faults are counted, in the chunks of a loop
        self._marks: dict[tuple[str, str], dict[str, float]] = {}  # what earlier chunks tell of a quality's numbers
        self.times = lru_cache(MOST_TIMES)(_times)  # of all rows of some axes, the same ones for the same axes

    def next_chunk(self, begin: int, end: int) -> None:
        """Go on with the chunk of a loop between two stamps."""
        self.only = begin, end
        self.times.cache_clear()

    def signal(self, series: list[Series], role: str, loop: str) -> Signal:
        """Return one signal from its series. Raises LoopError when two different columns carry one name."""
        chosen, notes = _one_per_file(series, role, loop)
        chosen = sorted(chosen, key=lambda item: item.axis.first()) if len(chosen) > 1 else chosen
        parts = [self._part(item) for item in chosen]
        faults: Faults = parts[0].faults
        for part in parts[1:]:
            add_faults(faults, part.faults)
        said = {(note.code, note.message): note for part in parts for note in part.notes}
        one = parts[0] if len(parts) == 1 else Signal(
            self.times(*(item.axis for item in chosen)), np.concatenate([part.values for part in parts]),
            np.concatenate([part.bad for part in parts]))
        return replace(one, notes=(*said.values(), *notes), faults=faults)

    def _part(self, item: Series) -> Signal:
        cells, marks, good = item.cells(), item.marks(), None
        values, bad = cells.numbers()
        notes: list[Note] = []
        times = self.times(item.axis)
        own = slice(None) if self.only is None else slice(*np.searchsorted(times.micros, self.only).tolist())
        faults: Faults = {("not_numbers", item.tag): cells.words(bad, own)}
        if marks is not None:
            known = {} if self.only is None else self._marks.setdefault((item.axis.where, item.tag), {})
            good, notes = good_samples(marks, self.good_quality, item.quality, known)
        for code in ("bad_quality", "lone_zeros"):
            wrong = lone_zeros(values) if code == "lone_zeros" else None if good is None else ~good
            faults[code, item.tag] = Counter({code: 0 if wrong is None else int(np.count_nonzero(wrong[own]))})
            if wrong is not None and wrong.any():
                bad, values = bad | wrong, np.where(wrong, np.nan, values)
        return Signal(times, values, bad, tuple(notes), faults)


def _times(*axes: Axis) -> Times:
    micros, first = [axis.read() for axis in axes], axes[0]
    if len(axes) == 1:
        return Times(micros[0], first.notes, line=first.first_line)
    return Times(np.concatenate(micros), tuple(note for axis in axes for note in axis.notes),
                 tuple(np.cumsum([len(axis) for axis in axes])[:-1].tolist()))


def add_faults(total: Faults, found: Faults) -> list[Note]:
    """Add what was counted to a total; return what is to be said of these kinds of faults."""
    notes = []
    for (code, tag), words in found.items():
        all_words = total.setdefault((code, tag), Counter())
        all_words.update(words)
        if count := all_words.total():
            top = ", ".join(f"{word or '(blank)'} ({number})" for word, number in all_words.most_common(4))
            text = _FAULTS[code].format(tag=tag[:60], top=top)
            notes.append(Note(code, f"{count} {text}", {"samples": float(count)}))
    return notes


_FAULTS = {"not_numbers": "cells of {tag} are no good numbers: {top}",
           "bad_quality": "samples of {tag} have bad quality and are not used",
           "lone_zeros": "samples of {tag} jump to exactly 0 and back, far outside the rest: a fault of the recording; "
                         "they are not used"}
LONE = 3  # samples in a row that may be lone zeros
FAR = 8.0  # usual moves from one sample to the next that a zero must lie outside of all others


def lone_zeros(values: FloatArray) -> NDArray[np.bool_] | None:
    """(rows,) True where up to LONE samples are exactly 0 and lie far outside all others; None where there are none.
    Far: FAR times the largest usual move between samples (99.9 %), and a fifth of the distance that all others span."""
    zero = values == 0.0
    if not zero.any() or zero.all():
        return None
    rest = values[~zero & np.isfinite(values)]
    if len(rest) < 20:
        return None
    low, high = float(rest.min()), float(rest.max())
    nearest = low if low > 0.0 else -high if high < 0.0 else 0.0
    if nearest <= max(FAR * float(np.quantile(np.abs(np.diff(rest)), 0.999)), 0.2 * (high - low)):
        return None
    starts, ends = runs(zero)
    few = (ends - starts <= LONE) & (starts > 0) & (ends < len(values))
    return inside(starts[few], ends[few], len(values)) if few.any() else None


def _one_per_file(series: list[Series], role: str, loop: str) -> tuple[list[Series], list[Note]]:
    notes: list[Note] = []
    groups: dict[str, list[Series]] = {}
    for item in series:
        groups.setdefault(item.axis.where, []).append(item)
    chosen: list[Series] = []
    priority = {word: i for i, word in enumerate(SIGNALS.get(role, "").split())}
    for where, items in groups.items():
        ranks = [priority.get(plain(item.signal), 99) for item in items]
        first = [item for item, rank in zip(items, ranks, strict=True) if rank == min(ranks)]
        if len(first) < len(items):
            names = ", ".join(item.tag for item in items)
            notes.append(Note("several_columns", f"{names} could all be {role.upper()}; {first[0].tag} is used"))
        if len(first) > 1 and first[0].axis is first[1].axis:
            values, *others = (item.cells().numbers()[0] for item in first)
            if not all(np.array_equal(values, other, equal_nan=True) for other in others):
                raise LoopError(f"{len(first)} columns are called {first[0].tag!r} and differ: duplicate column names",
                                where=where, remedy="rename one of them, or name the right one in loops.toml",
                                code="duplicate_columns")
            notes.append(Note("duplicate_columns",
                              f"column {first[0].tag} stands {len(first)} times with the same content"))
            first = first[:1]
        chosen += first
    return chosen, notes
