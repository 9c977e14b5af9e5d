"""Read exports: files to signals, signals to loops, loops to records; which loops, and from when on."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from pyarrow.lib import ArrowException

from ..errors import BacklashError, InputError, LoopError, UsageError, nearest, some
from ..record import Frozen, Note, Record, failure
from ..scratch import Room
from ..selection import choose, fits, since
from ..settings import Metadata, merge
from .clean import Recipe
from .names import explained, noted
from .options import ReadOptions
from .signals import Joiner, LoopSeries, Owners, Series, by_loop, explicit_tags, owners_of
from .sources import Source, find_sidecars, find_sources, read_metadata
from .tables import signals_of_file

if TYPE_CHECKING:
    import pandas as pd

Inputs = str | PathLike[str] | Sequence[str | PathLike[str]]
FEW = 3  # loops of the loops file without data that are named one by one


class Plant(Frozen):
    """All loops of exports, by name. failures: loops and files that could not be read, `values` "loop" or "file"."""

    records: tuple[Record, ...]
    warnings: tuple[Note, ...] = ()
    failures: tuple[Note, ...] = ()
    inputs: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Record:
        """Return one loop. Raises LoopError when it could not be read, UsageError when it does not exist."""
        if lost := next((note for note in self.failures if note.values.get("loop") == name), None):
            raise LoopError(lost.message, code=lost.code)
        same = [r for r in self if r.loop == name] or [r for r in self if r.loop.lower() == name.lower()]
        if len(same) == 1:
            return same[0]
        raise UsageError(f"no loop {name!r} in the data", where="--loop", remedy=nearest(name, [r.loop for r in self]))

    def __len__(self) -> int:
        return len(self.records)

    def __contains__(self, loop: object) -> bool:
        return loop in {r.loop for r in self}

    def __iter__(self) -> Iterator[Record]:
        return iter(self.records)


def read(inputs: Inputs | pd.DataFrame, *, loops: str | PathLike[str] | Metadata | None = None,
         options: ReadOptions | None = None) -> Plant:
    """Read one plant from exports (files or folders) and its loop settings. inputs: CSV, Parquet or Excel files,
    folders, Parquet datasets; or a table in memory, its columns named as those of a file, with the times in a column or
    the index. loops: metadata file, or what is in it; None: found next to the data. Raises BacklashError."""
    if not isinstance(inputs, (str, PathLike, Sequence)):
        with TemporaryDirectory() as folder:
            file = Path(folder, "DataFrame.parquet")
            try:
                inputs.apply(lambda column: column if column.dtype != object else  # words among numbers
                             column.astype(str).where(column.notna())).to_parquet(file)
                return replace(read(file, loops=loops, options=options), inputs=("DataFrame",))
            except BacklashError as error:
                error.where = error.where.replace(str(file), "DataFrame")
                raise
            except (ArrowException, AttributeError, ValueError, TypeError) as error:
                raise InputError(**explained("table", problem=str(error).split("\n")[0][:300])) from None
    opened = open_plant(inputs, loops=loops, options=options)
    joiner, records, failures = Joiner((options or ReadOptions()).good_quality), list[Record](), list[Note]()
    for recipe in opened.recipes:
        try:
            records.append(recipe.record(joiner))
        except BacklashError as error:
            failures.append(failure(error, loop=recipe.loop))
    lost = opened.all_lost(failures, read=len(records))
    return Plant(tuple(records), opened.warnings, (*opened.failures, *lost), opened.inputs)


class OpenPlant(Frozen, Mapping[str, Record], eq=False):
    """Exports whose loops are known, not read: as a mapping it makes a record each time. failures: files; as Plant."""

    recipes: tuple[Recipe, ...]
    warnings: tuple[Note, ...] = ()
    failures: tuple[Note, ...] = ()
    inputs: tuple[str, ...] = ()

    @cached_property
    def _by_name(self) -> dict[str, Recipe]:
        return {recipe.loop: recipe for recipe in self.recipes}

    def __getitem__(self, loop: str) -> Record:
        try:
            return self._by_name[loop].record()
        except BacklashError:
            raise KeyError(loop) from None

    def __contains__(self, loop: object) -> bool:
        return loop in self._by_name

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_name)

    def __len__(self) -> int:
        return len(self._by_name)

    def all_lost(self, more: Sequence[Note], *, read: int) -> tuple[Note, ...]:
        """Return all loops that could not be read, by name. read: how many could. Raises LoopError when none could."""
        lost = tuple(sorted(more, key=lambda note: str(note.values["loop"])))
        if lost and not read:
            said = some([note.message for note in lost], 3, 400)
            raise LoopError("no loop could be read; " * (len(lost) > 1) + said, code=lost[0].code)
        return lost


def open_plant(inputs: Inputs, *, loops: str | PathLike[str] | Metadata | None = None,
               options: ReadOptions | None = None, taken: Callable[[int], None] | None = None,
               room: Room | None = None, salt: str | None = None, sources: Sequence[Source] | None = None) -> OpenPlant:
    """Find the loops of exports. taken: called with the bytes that were read. room: memory for samples, the rest is in
    scratch. salt: what a kept report depends on beside the data. sources: files, None: all. Raises BacklashError."""
    options, ways = options or ReadOptions(), [inputs] if isinstance(inputs, (str, PathLike)) else list(inputs)
    sources = find_sources(ways) if sources is None else sources
    marks = {} if salt is None else {str(source.path): source.mark() for source in sources}  # before they are read
    (metadata, warnings), series, problems = _metadata(ways, sources, loops), list[Series](), dict[str, BacklashError]()
    owners, room, taken = explicit_tags(metadata)[0], room or Room(), taken or (lambda count: None)
    needed, with_tags = _needed(metadata, owners, options), replace(options, tags=frozenset(owners))
    for source in sources:
        try:
            found, notes, lost = signals_of_file(source, with_tags, needed, room, taken)
            series += found
            warnings += notes
            problems |= lost
        except (BacklashError, ArrowException, OverflowError, MemoryError, OSError, ValueError) as error:
            text = str(error).strip().split("\n")[0][:300] or type(error).__name__
            problems[str(source.path)] = error if isinstance(error, BacklashError) else InputError(
                **explained("not_understood", text=text), where=str(source.path))
    if not series:
        first = next(iter(problems.values()), InputError(**explained("no_rows", below=""), where=str(sources[0].path)))
        first.what = f"none of {len(sources)} files could be read; the first: " * (len(sources) > 1) + first.what
        raise first
    if not (all_loops := by_loop(series, metadata)):
        tags = sorted({item.tag for item in series if item.tag}) or ["columns without a name"]
        raise InputError(**explained("no_loop", tags=some(tags, 12)), where=str(sources[0].path))
    # an indicator, or a column with a chance name
    single = sorted(name for name, own in all_loops.items() if len(own.roles) == 1 and metadata.match(name) is None)
    complete = all_loops.keys() - single or {*single}
    used = {one.tag for name in complete for kind in (all_loops[name].roles, all_loops[name].extra)
            for found in kind.values() for one in found}
    if spare := sorted({one.tag for one in series} - used):
        warnings.append(noted("single_signals", count=len(spare), names=some(spare, 5)))
    names, notes = choose(complete, options.only_loops, options.loops_matching, options.sample, options.sample_seed)
    wanted, moment = {name: all_loops[name] for name in names}, None
    warnings += notes
    if options.since is not None:
        wanted, notes, moment = since(wanted, series, options.since, options.timezone)
        warnings += notes
    warnings += _shared(all_loops) + _unmatched(all_loops, metadata, complete=not problems)
    slaves = {(one.axis.where, one.tag): loop for loop, own in all_loops.items() for one in own.roles.get("sp", ())}
    recipes = (_recipe(name, wanted[name], metadata, options, slaves) for name in sorted(wanted))
    return OpenPlant(tuple(recipe.keyed(marks, (salt, moment)) for recipe in recipes), tuple(warnings),
                     tuple(failure(error, file=path) for path, error in problems.items()), tuple(map(str, ways)))


def _metadata(given: Sequence[str | PathLike[str]], sources: Sequence[Source],
              loops: str | PathLike[str] | Metadata | None) -> tuple[Metadata, list[Note]]:
    if isinstance(loops, Metadata):
        return loops, []
    metadata = merge([*map(read_metadata, find_sidecars(given, sources) if loops is None else [loops])])
    notes = [Note("metadata_conflict", text) for text in metadata.conflicts]
    if not metadata.loops:
        code = "no_metadata:empty" if metadata.files else "no_metadata"
        notes.append(noted("no_metadata:defaults" if metadata.defaults else code, file="".join(metadata.files[:1])))
    return metadata, notes


def _shared(series: Mapping[str, LoopSeries]) -> list[Note]:
    owners = defaultdict[tuple[str, Series], list[str]](list)  # not of SP: it may be one of several loops
    for loop, own in series.items():
        for role in ("pv", "op") if len(own.roles) > 1 else ():
            for one in own.roles.get(role, ()):
                owners[role, one].append(loop)
    shared = {(one.tag, role, some(sorted(loops), FEW)) for (role, one), loops in owners.items() if len(loops) > 1}
    return [noted("shared_tag", tag=tag[:60], role=role.upper(), names=loops) for tag, role, loops in sorted(shared)]


def _unmatched(series: Mapping[str, LoopSeries], metadata: Metadata, *, complete: bool) -> list[Note]:
    there = {*(matched := {name: metadata.match(name) for name in series}).values()}
    names = [name for name in metadata.loops if name not in there]
    if len(names) > FEW:  # the loops file of a whole plant beside the export of a few loops: usual
        return [noted("loop_not_found:many", {"loop": ", ".join(names), "loops": len(names)}, names=some(names, FEW))]
    notes, free = [], sorted(name for name, match in matched.items() if match is None)
    for name in names:
        tags = ", ".join(metadata.loops[name].tags.values())
        hint = f"its tags {tags} are not there" if tags else "not all files could be read" if not complete else (
            nearest(name, free).replace("known:", "the data have") if free else f"there are {some(sorted(series))}")
        notes.append(noted("loop_not_found", {"loop": name}, hint=hint))
    return notes


def _recipe(name: str, series: LoopSeries, metadata: Metadata, options: ReadOptions,
            slaves: Mapping[tuple[str, str], str]) -> Recipe:
    values, notes = metadata.loops.get(name), tuple[Note, ...]()
    origin = next(iter(series.roles.values()))[0].loop
    if values is None and metadata.files:
        notes = (noted("not_in_metadata:defaults" if metadata.defaults else "not_in_metadata", loop=name[:60]),)
    elif values is not None and origin not in ("", name):
        notes = (noted("matched_name", origin=origin[:60], loop=name[:60]),)
    if {True, False} <= {zone for items in series.roles.values() for item in items for zone in item.axis.zones}:
        notes += (noted("mixed_zones", others="count as UTC (--timezone names their zone)"),)
    if (pv := series.roles.get("pv", [])) and (pv[0].role != "pv" or pv[0].loop.lower() != origin.lower()) and not (
            values and "pv" in values.tags):
        notes += (noted("bare_pv", tag=pv[0].tag[:60], loop=name[:60]),)
    for slave in {slaves.get((one.axis.where, one.tag), "") for one in series.roles.get("op", ())} - {"", name}:
        notes += (noted("cascade", {"effect": "limits"}, loop=name[:60], slave=slave[:60]),)
    return Recipe(name, series, metadata.fallback() if values is None else values, options, notes)


def _needed(metadata: Metadata, owners: Owners, options: ReadOptions) -> Callable[[Series], bool]:
    """Return what says whether a loop that the options do not rule out may use a signal."""
    @cache
    def wanted(loop: str) -> bool:
        names = [loop] if loop in metadata.loops else [loop, metadata.match(loop), metadata.part_of(loop)]
        return any(fits(name, options.only_loops) and fits(name, options.loops_matching) for name in names if name)

    return lambda one: not (options.only_loops or options.loops_matching) or any(
        map(wanted, [one.loop or one.tag, *(loop for loop, _ in owners_of(one.tag, owners))]))
