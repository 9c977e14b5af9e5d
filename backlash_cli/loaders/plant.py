"""Read exports: files to tables, tables to signals, signals to loops, loops to records."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from os import PathLike

from ..errors import BacklashError, InputError, LoopError, UsageError, nearest
from ..record import Note, Record
from .file_signals import failure, signals_of
from .join import Joiner, LoopSeries, by_loop
from .lazy_tables import Lazily
from .metadata import Metadata, merge
from .metadata_file import read_metadata
from .options import ReadOptions
from .recipes import Recipe, needed_columns, recipes_of, wanted_tags
from .series import Series
from .settle import settle
from .since import cut_loops, is_age, last_stamp, moment_of, nothing_since, since_notes
from .sources import Source, find_sidecars, find_sources

Inputs = str | PathLike[str] | Sequence[str | PathLike[str]]


@dataclass(frozen=True)
class Plant:
    """All loops of one or several exports.

    records: one per loop, by name. warnings: about the plant as a whole. failures: loops and files that could not
    be read; `values` of each has "loop" or "file". inputs: as given.
    """

    records: tuple[Record, ...]
    warnings: tuple[Note, ...] = ()
    failures: tuple[Note, ...] = ()
    inputs: tuple[str, ...] = ()

    @cached_property
    def _by_name(self) -> dict[str, Record]:
        return {record.loop: record for record in self.records}

    def __getitem__(self, name: str) -> Record:
        """Return one loop. Raises LoopError when it could not be read, UsageError when it does not exist."""
        if name in self._by_name:
            return self._by_name[name]
        for lost in self.failures:
            if lost.values.get("loop") == name:
                raise LoopError(lost.message, code=lost.code)
        return self._by_name[find_loop(name, self._by_name)]

    def __len__(self) -> int:
        return len(self.records)

    def __iter__(self) -> Iterator[Record]:
        return iter(self.records)


def find_loop(name: str, names: Collection[str]) -> str:
    """Return the loop that is meant, in upper or lower case. Raises UsageError, with the nearest, if there is none."""
    same = [name] if name in names else [n for n in names if n.lower() == name.lower()]
    if len(same) == 1:
        return same[0]
    raise UsageError(f"no loop {name!r} in the data", where="--loop", remedy=nearest(name, names))


def read(
    inputs: Inputs, *, loops: str | PathLike[str] | Metadata | None = None, options: ReadOptions | None = None
) -> Plant:
    """Read one plant from exports (files or folders) and its loop settings.

    inputs: CSV or Parquet files, folders of them, or a Parquet dataset. loops: metadata file, or what is in it; None:
    found next to the data. Raises BacklashError when nothing can be read or the metadata are wrong; a single bad file
    or loop becomes a failure of the Plant.
    """
    opened = open_plant(inputs, loops=loops, options=options)
    joiner = Joiner((options or ReadOptions()).good_quality)
    records: list[Record] = []
    failures: list[Note] = []
    for recipe in opened.recipes:
        try:
            records.append(recipe.record(joiner))
        except BacklashError as error:
            failures.append(failure(error, loop=recipe.loop))
    lost = opened.with_lost(failures)
    if opened.whole and not records and lost:
        raise no_loop_read(lost)
    return Plant(tuple(records), opened.warnings, (*opened.failures, *lost), opened.inputs)


def no_loop_read(lost: Sequence[Note]) -> LoopError:
    """The error of a plant none of whose loops could be read."""
    first = lost[0]
    return LoopError(f"no loop could be read; {first.message}" if len(lost) > 1 else first.message, code=first.code)


@dataclass(frozen=True)
class OpenPlant:
    """One or several exports whose loops are known and not yet read: one recipe per loop, by name.

    failures: files that could not be read. lost: loops that cannot be. whole: False for a share of a plant. moment: of
    --since [microseconds since 1970 UTC]. The rest as in Plant.
    """

    recipes: tuple[Recipe, ...]
    warnings: tuple[Note, ...] = ()
    failures: tuple[Note, ...] = ()
    inputs: tuple[str, ...] = ()
    lost: tuple[Note, ...] = ()
    whole: bool = True
    moment: int | None = None

    def with_lost(self, more: Sequence[Note]) -> tuple[Note, ...]:
        """Return the loops that could not be read, with those found out when they were read, by name."""
        return tuple(sorted([*self.lost, *more], key=lambda note: str(note.values["loop"])))


def open_plant(
    inputs: Inputs, *, loops: str | PathLike[str] | Metadata | None = None, options: ReadOptions | None = None,
    lazily: Lazily | None = None,
) -> OpenPlant:
    """Find the loops of exports. lazily: leave the samples where they are until a loop is read; None reads them now.

    Raises BacklashError as `read` does.
    """
    options = options or ReadOptions()
    given = [inputs] if isinstance(inputs, (str, PathLike)) else list(inputs)
    sources = find_sources(given)
    metadata, warnings = metadata_of(given, sources, loops)
    if lazily is not None:
        lazily = replace(lazily, wanted=wanted_tags(metadata, options, lazily.done),
                         needed=partial(needed_columns, metadata=metadata, options=options, done=lazily.done))
    found, more, failures, first_problem = signals_of(sources, options, lazily)
    warnings += more
    if options.share is not None:
        return _share(found, metadata, options, OpenPlant((), tuple(more), tuple(failures), whole=False))
    if not found:
        raise nothing_read(len(sources), first_problem)
    settled = settle(found, metadata, options, str(sources[0].path))
    warnings += settled.notes
    wanted = settled.loops
    lost: list[Note] = []
    moment = None
    if options.since is not None:
        last = last_stamp(found)
        moment = moment_of(options.since, options.timezone, last)
        wanted, without, lost = _cut(wanted, moment, age=is_age(options.since))
        if not wanted and without:
            raise nothing_since(options.since, moment, last)
        warnings += since_notes(options.since, moment, without, len(settled.loops))
    warnings += settled.unmatched
    named = tuple(str(item) for item in given)
    recipes = recipes_of(wanted, metadata, options)
    return OpenPlant(recipes, tuple(warnings), tuple(failures), named, tuple(lost), moment=moment)


def metadata_of(
    given: Sequence[str | PathLike[str]], sources: Sequence[Source], loops: str | PathLike[str] | Metadata | None
) -> tuple[Metadata, list[Note]]:
    """Return the settings of a plant's loops, from the file that is named or those beside the data, and remarks."""
    if isinstance(loops, Metadata):
        return loops, []
    paths = [loops] if loops is not None else find_sidecars(given, sources)
    metadata = merge([read_metadata(path) for path in paths])
    notes = [Note("metadata_conflict", text) for text in metadata.conflicts]
    if not metadata.files:
        notes.append(
            Note("no_metadata", "no loop settings found (loops.toml): settings are missing and have to be identified")
        )
    elif not metadata.loops:
        notes.append(Note("no_metadata", f"the loops file {metadata.files[0]} lists no loops: K and Ti are missing"))
    return metadata, notes


def nothing_read(files: int, first_problem: BacklashError | None) -> BacklashError:
    """The error when no file could be read."""
    if files == 1 and first_problem is not None:
        return first_problem
    return InputError(f"none of {files} files could be read; the first: {first_problem}", remedy="export them again")


def _share(found: list[Series], metadata: Metadata, options: ReadOptions, so_far: OpenPlant) -> OpenPlant:
    """The part of a plant whose names and loops are settled; what concerns the plant as a whole is said elsewhere."""
    share = options.share
    assert share is not None
    series = by_loop(found, metadata, dict(share.renamed))
    wanted = {name: series[name] for name in share.loops if name in series}
    lost: list[Note] = []
    if share.since is not None:
        wanted, without, more = _cut(wanted, share.since, age=share.age)
        lost = [*(Note("nothing_since", "", {"loop": name}) for name in without), *more]
    return replace(so_far, recipes=recipes_of(wanted, metadata, options), lost=tuple(lost))


def _cut(
    wanted: dict[str, LoopSeries], moment: int, *, age: bool
) -> tuple[dict[str, LoopSeries], list[str], list[Note]]:
    kept, without, wrong = cut_loops(wanted, moment, age=age)
    return kept, without, [failure(error, loop=name) for name, error in wrong.items()]
