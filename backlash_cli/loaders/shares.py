"""A plant cut into parts that can be read and analysed apart from each other, and what is to be said of the whole.

Names, the choice of loops and the moment of --since are settled here, once, from the surveys of all files; a part only
reads its own loops from its own files. So the parts together say exactly what one reading of the whole says.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

from ..record import Note
from .file_signals import failure
from .join import LoopSeries, explicit_tags, renamed_loops
from .metadata import Metadata
from .options import ReadOptions
from .plant import metadata_of, nothing_read
from .selection import Share
from .series import Series
from .settle import settle
from .since import is_age, moment_of
from .sources import Source, find_sources
from .survey import Survey


@dataclass(frozen=True)
class Part:
    """What one worker does: `loops` of these files, read with `reading` (which holds the Share) and `metadata`."""

    loops: tuple[str, ...]
    sources: tuple[Source, ...]
    reading: ReadOptions
    metadata: Metadata

    def only(self, loops: Collection[str]) -> Part:
        """Return the same part for some of its loops."""
        names = tuple(name for name in self.loops if name in loops)
        assert self.reading.share is not None
        return replace(self, loops=names, reading=replace(self.reading, share=replace(self.reading.share, loops=names)))


@dataclass(frozen=True)
class Names:
    """Which names of the data mean which loops. renamed: names in the data -> loops. taken: names in the data -> other
    loops to which the loops file gives tags of theirs."""

    renamed: Mapping[str, str]
    taken: Mapping[str, Collection[str]]


@dataclass(frozen=True)
class PlantPlan:
    """loops: those to compute, with the numbers of the files that hold them. The notes stand in the report of the
    whole: `notes` before those of the files, `chosen` after them, `unmatched` last. moment: of --since [microseconds].
    """

    given: tuple[str, ...]
    sources: tuple[Source, ...]
    surveys: tuple[Survey, ...]
    loops: Mapping[str, tuple[int, ...]]
    series: Mapping[str, LoopSeries]
    metadata: Metadata
    reading: ReadOptions
    names: Names
    notes: tuple[Note, ...] = ()
    chosen: tuple[Note, ...] = ()
    unmatched: tuple[Note, ...] = ()
    failures: tuple[Note, ...] = ()
    moment: int | None = None
    last: int | None = None

    def part(self, loops: Iterable[str]) -> Part:
        """Return the part with these loops: their files, and what of the settings they can need."""
        names = tuple(sorted(loops))
        files = sorted({number for name in names for number in self.loops[name]})
        items = [item for name in names for item in items_of(self.series[name])]
        raw = {item.loop for item in items if item.loop}
        wanted = {match for name in (*names, *raw) if (match := self.metadata.match(name)) is not None}
        wanted |= {loop for name in (*names, *raw) for loop in self.names.taken.get(name, ())}
        settings = {name: self.metadata.loops[name] for name in sorted(wanted)}
        renamed = tuple(sorted((old, new) for old in raw if (new := self.names.renamed.get(old)) is not None))
        age = self.reading.since is not None and is_age(self.reading.since)
        reading = replace(self.reading, share=Share(names, renamed, self.moment, age), only_loops=(),
                          loops_matching=(), sample=None, since=None)
        return Part(names, tuple(alone(self.sources[number]) for number in files), reading,
                    replace(self.metadata, loops=settings, conflicts=()))


def items_of(loop: LoopSeries) -> list[Series]:
    """Return all signals of a loop."""
    return [item for parts in (loop.roles, loop.extra) for items in parts.values() for item in items]


def alone(source: Source) -> Source:
    """Return a source without the names of the files beside it, to be sent elsewhere."""
    return replace(source, beside=None)


def sources_of(inputs: Sequence[str | PathLike[str]], *, absolute: bool = False) -> list[Source]:
    """Return the files of a plant; absolute: with paths that mean the same on every machine of a network drive."""
    found = find_sources(inputs)
    if absolute:
        return [replace(s, path=s.path.absolute()) if isinstance(s.path, Path) else s for s in found]
    return found


def make_plan(
    inputs: Sequence[str | PathLike[str]], sources: Sequence[Source], surveys: Sequence[Survey], *,
    loops: str | PathLike[str] | Metadata | None, reading: ReadOptions,
) -> PlantPlan:
    """Settle what is to be computed. surveys: of all sources, in order, with their ends where --since is an age.

    Raises BacklashError as `read` does.
    """
    metadata, notes = metadata_of(inputs, sources, loops)
    failures = [failure(s.failure, file=str(s.source.path)) for s in surveys if s.failure is not None]
    found = [item for s in surveys for item in s.series]
    if not found:
        raise nothing_read(len(sources), next((s.failure for s in surveys if s.failure is not None), None))
    settled = settle(found, metadata, reading, str(sources[0].path))
    moment = last = None
    if reading.since is not None:
        last = max((s.last for s in surveys if s.last is not None), default=None)
        moment = moment_of(reading.since, reading.timezone, last)
    number = {str(source.path): k for k, source in enumerate(sources)}
    files = {name: tuple(sorted({number[item.where] for item in items_of(own)}))
             for name, own in settled.loops.items()}
    known = dict.fromkeys(item.loop for item in found if item.loop)
    tags = explicit_tags(metadata)[0]
    taken: dict[str, set[str]] = {}
    for item in found if tags else ():
        for loop, _ in tags.get(item.tag.strip().lower(), ()):
            taken.setdefault(item.loop, set()).add(loop)
    names = Names(renamed_loops(known, metadata), taken)
    return PlantPlan(
        tuple(map(str, inputs)), tuple(sources), tuple(surveys), files, settled.loops, metadata, reading, names,
        tuple(notes), settled.notes, settled.unmatched, tuple(failures), moment, last,
    )
