"""A plant cut into parts that can be read and analysed apart from each other, and what is to be said of the whole.

Names, the choice of loops and the moment of --since are settled here, once, from the surveys of all files; a part only
reads its own loops from its own files. So the parts together say exactly what one reading of the whole says.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from os import PathLike
from pathlib import Path

from ..errors import BacklashError
from ..record import Note
from ..settings import Metadata
from .choose import last_stamp, moment_of
from .clean import Recipe
from .join import LoopSeries, explicit_tags, renamed_loops
from .opening import kind_of
from .options import ReadOptions, Share, is_age
from .plant import READING_ERRORS, as_input_error, failure, metadata_of, nothing_read, settle
from .remote import Remote
from .signals import Axis, Series
from .sources import Source, find_sources
from .tables import Reading, signals_of_file

PARTS_PER_WORKER = 4  # so that a slow worker holds up the others by a fraction only
SMALLEST = 8 << 20  # bytes of files in a part: below, sending it costs more than it brings
MOST_LOOPS = 50  # of a part: what is lost when a worker dies, and how often the progress moves
Marks = Mapping[str, str | None]


@dataclass(frozen=True)
class Survey:
    """What one file holds. series: its signals without samples. size: bytes. last: its last stamp [microseconds], if
    that was asked for. text: it is no Parquet file, and so can only be read as a whole. mark: what changes when its
    content does. failure: why it cannot be read.
    """

    source: Source
    series: tuple[Series, ...] = ()
    size: int = 0
    last: int | None = None
    text: bool = False
    mark: str | None = None
    failure: BacklashError | None = None


def survey_all(sources: Iterable[Source], options: ReadOptions, *, end: bool = False) -> list[Survey]:
    """Look at several files. end: also find the last stamps, for which all stamps have to be read."""
    return [survey(source, options, end=end) for source in sources]


def survey(source: Source, options: ReadOptions, *, end: bool = False) -> Survey:
    """Look at one file; what is wrong with it stands in `failure`."""
    try:
        size, mark = source.path.stat().st_size, mark_of(source.path)
        found, _ = signals_of_file(source, Reading(options, lambda tag: False, lambda signals: set()))
        last = last_stamp(found) if end else None
        names = tuple(replace(item, axis=Axis(where=item.where), rows=None) for item in found)
        return Survey(source, names, size, last, kind_of(source.path) != "parquet", mark)
    except READING_ERRORS as error:
        return Survey(source, failure=as_input_error(error, str(source.path)))


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
        items = [item for name in names for item in self.series[name].items()]
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


def alone(source: Source) -> Source:
    """Return a source without the names of the files beside it, to be sent elsewhere."""
    return replace(source, beside=None)


def sources_of(inputs: Sequence[str | PathLike[str]], *, absolute: bool = False) -> list[Source]:
    """Return the files of a plant; absolute: with paths that mean the same on every machine of a network drive."""
    found = find_sources(inputs)
    if absolute:
        return [replace(s, path=s.path.absolute()) if isinstance(s.path, Path) else s for s in found]
    return found


def make_plan(inputs: Sequence[str | PathLike[str]], sources: Sequence[Source], surveys: Sequence[Survey], *,
              loops: str | PathLike[str] | Metadata | None, reading: ReadOptions) -> PlantPlan:
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
    files = {name: tuple(sorted({number[item.where] for item in own.items()})) for name, own in settled.loops.items()}
    known = dict.fromkeys(item.loop for item in found if item.loop)
    tags = explicit_tags(metadata)[0]
    taken: dict[str, set[str]] = {}
    for item in found if tags else ():
        for loop, _ in tags.get(item.tag.strip().lower(), ()):
            taken.setdefault(item.loop, set()).add(loop)
    names = Names(renamed_loops(known, metadata), taken)
    return PlantPlan(tuple(map(str, inputs)), tuple(sources), tuple(surveys), files, settled.loops, metadata, reading,
                     names, tuple(notes), settled.notes, settled.unmatched, tuple(failures), moment, last)


def cut_parts(plan: PlantPlan, workers: int, loops: Iterable[str] | None = None, most: int | None = None) -> list[Part]:
    """Return the parts of a plan for so many workers; loops: only these. most: loops of a part.

    Loops of the same files stay together. A Parquet file may be cut into many parts, as each reads its columns only;
    a CSV into no more than there are workers, as each has to go through all of it.
    """
    most = min(most or MOST_LOOPS, MOST_LOOPS)
    wanted = sorted(plan.loops if loops is None else loops)
    cost = _costs(plan)
    total = sum(cost[name] for name in wanted)
    target = max(total / (PARTS_PER_WORKER * max(workers, 1)), SMALLEST)
    groups: dict[tuple[int, ...], list[str]] = {}
    for name in wanted:
        groups.setdefault(plan.loops[name], []).append(name)
    parts: list[list[str]] = []
    small: list[str] = []
    for files, names in sorted(groups.items()):
        work = sum(cost[name] for name in names)
        text = any(plan.surveys[number].text for number in files)
        if len(names) > 1 and (work > target or len(names) > most):
            count = max(round(work / target), -(-len(names) // most))
            parts += _evenly(names, min(count, workers) if text else count)
            continue
        if small and (sum(cost[n] for n in small) + work > target or len(small) + len(names) > most):
            parts.append(small)
            small = []
        small += names
    return [plan.part(names) for names in (*parts, *([small] if small else []))]


def _costs(plan: PlantPlan) -> dict[str, float]:
    """Bytes of files that belong to each loop: a file is shared by the loops in it."""
    loops_in = [0] * len(plan.sources)
    for files in plan.loops.values():
        for number in files:
            loops_in[number] += 1
    return {name: sum(plan.surveys[k].size / loops_in[k] for k in files) for name, files in plan.loops.items()}


def _evenly(names: list[str], count: int) -> list[list[str]]:
    count = max(1, min(count, len(names)))
    edges = [round(k * len(names) / count) for k in range(count + 1)]
    return [names[a:b] for a, b in pairwise(edges)]


def mark_of(path: Path | Remote) -> str | None:
    """Return what changes when the content of a file does, None where that cannot be known. Raises OSError."""
    if isinstance(path, Remote):
        version = path.version()
        return version if " " in version else None  # its size alone says too little
    about = path.stat()
    return f"{about.st_size} {about.st_mtime_ns} {about.st_ctime_ns}"


def marks_of(sources: Iterable[Source]) -> dict[str, str | None]:
    """Return the marks of files by their names; to be taken before they are read."""
    found: dict[str, str | None] = {}
    for source in sources:
        try:
            found[str(source.path)] = mark_of(source.path)
        except OSError:
            found[str(source.path)] = None
    return found


def keyed(recipes: Iterable[Recipe], marks: Marks, moment: int | None, salt: str) -> tuple[Recipe, ...]:
    """Return the recipes with the keys of their loops; none for a loop whose files cannot be known again.

    marks: of the files, by name. moment: of --since [microseconds since 1970 UTC]. salt: what else a report depends on.
    """
    recipes = tuple(recipes)
    how = ""
    if recipes:  # which loops are wanted is not how they are read
        how = repr(replace(recipes[0].options, only_loops=(), loops_matching=(), sample=None, sample_seed=0, since=None,
                           share=None))
    return tuple(replace(recipe, key=_key(recipe, marks, (salt, how, moment))) for recipe in recipes)


def _key(recipe: Recipe, marks: Marks, common: tuple[object, ...]) -> str:
    parts = []
    for role, items in sorted(recipe.series.roles.items()):
        for item in items:
            mark = marks.get(item.where)
            if mark is None:
                return ""
            parts.append((role, item.tag, item.loop, item.signal, item.where, mark))
    values = recipe.values
    settings = None if values is None else (dict(values.values), values.where, sorted(values.from_defaults))
    notes = [(note.code, note.message) for note in recipe.notes]
    whole = repr((common, recipe.loop, settings, notes, sorted(recipe.series.missing_tags.items()), parts))
    return hashlib.sha256(whole.encode("utf-8", "backslashreplace")).hexdigest()[:32]
