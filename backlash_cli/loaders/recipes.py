"""What makes the record of each loop: its columns, wherever they are, its settings and how to read them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import pyarrow as pa

from ..errors import BacklashError
from ..record import Note, Record
from .clean import build_record
from .columns import LazyColumn, SlicedColumn
from .join import Joiner, LoopSeries, by_loop, explicit_tags
from .layouts import series_of
from .loop_settings import settings_of
from .metadata import LoopValues, Metadata
from .names import split_tag
from .options import ReadOptions
from .parquet_columns import ParquetColumn, ParquetFileColumns
from .selection import check_pattern
from .series import Axis
from .tables import Table

_ASKED = ("pv", "sp", "op", "mode")


@dataclass(frozen=True)
class Recipe:
    """All that makes the record of one loop; samples that were left where they are, are read when it is made.

    It can be sent to another process of this machine. key: by which a finished report of the loop is known again, where
    such are kept (`identity.keyed`).
    """

    loop: str
    series: LoopSeries
    values: LoopValues | None
    options: ReadOptions
    notes: tuple[Note, ...] = ()
    key: str = ""

    def record(self, joiner: Joiner | None = None) -> Record:
        """Read the loop. Raises BacklashError when it cannot be read. joiner: shared by loops of the same files."""
        settings = settings_of(self.values)
        record = build_record(self.series, settings, joiner or Joiner(self.options.good_quality), self.options)
        return replace(record, notes=(*self.notes, *record.notes)) if self.notes else record

    def axes(self) -> list[Axis]:
        """The stamps of all its signals."""
        return [item.axis for items in self.series.roles.values() for item in items]

    @property
    def rows(self) -> int:
        """Rows of the measurement, about the samples of its record."""
        return sum(len(item.cells) for item in self.series.roles.get("pv", ()))


def forget_stamps(done: Recipe, following: Recipe | None) -> None:
    """Give back the memory of the stamps of a loop, but those that the next loop has too."""
    kept = set() if following is None else set(map(id, following.axes()))
    for axis in done.axes():
        if id(axis) not in kept:
            axis.forget()


class RecordsByName(Mapping[str, Record]):
    """The records of recipes by the name of the loop, made anew each time; a loop that cannot be read is not there."""

    def __init__(self, recipes: Iterable[Recipe]) -> None:
        self._recipes = {recipe.loop: recipe for recipe in recipes}

    def __getitem__(self, loop: str) -> Record:
        try:
            return self._recipes[loop].record()
        except BacklashError as error:
            raise KeyError(str(error)) from None

    def __contains__(self, loop: object) -> bool:
        return loop in self._recipes

    def __iter__(self) -> Iterator[str]:
        return iter(self._recipes)

    def __len__(self) -> int:
        return len(self._recipes)


def recipes_of(loops: Mapping[str, LoopSeries], metadata: Metadata, options: ReadOptions) -> tuple[Recipe, ...]:
    """Return the recipes of loops, by name."""
    recipes = tuple(_recipe(name, loops[name], metadata, options) for name in sorted(loops))
    read_in_order(recipes)
    return recipes


def read_in_order(recipes: Iterable[Recipe]) -> None:
    """Prepare files whose columns are read a few at once for recipes that are made in this order."""
    order: dict[int, tuple[ParquetFileColumns, list[tuple[int, int]]]] = {}
    for recipe in recipes:
        for column in _columns(recipe.series):
            column = column.base if isinstance(column, SlicedColumn) else column
            if isinstance(column, ParquetColumn):
                order.setdefault(id(column.file), (column.file, []))[1].append((column.index, column.first))
    for file, columns in order.values():
        file.read_in_order(columns)


def _recipe(name: str, series: LoopSeries, metadata: Metadata, options: ReadOptions) -> Recipe:
    values = metadata.of(name)
    notes: list[Note] = []
    origin = next(iter(series.roles.values()))[0]
    if values is not None and origin.loop and origin.loop != name and metadata.match(origin.loop) is None:
        notes.append(Note("matched_name", f"{origin.loop[:60]} in the data is taken as {name[:60]} of the loops file"))
    if values is None and metadata.files:
        notes.append(Note("not_in_metadata", f"loop {name[:60]} is not in the loops file: its settings are missing"))
    if any(isinstance(column, LazyColumn) for column in _columns(series)):
        series = replace(series, extra={})  # further measured columns are not worth reading twice
    return Recipe(name, series, values if values is not None else metadata.fallback(), options, tuple(notes))


def _columns(loop: LoopSeries) -> Iterator[object]:
    """Columns of a loop's signals, as `build_record` asks for them."""
    for role in sorted(loop.roles, key=_ASKED.index):
        for item in loop.roles[role]:
            yield item.cells.column
            yield None if item.quality is None else item.quality.column


def needed_columns(
    table: Table, metadata: Metadata, options: ReadOptions, done: Collection[str] = ()
) -> set[int]:
    """Return the columns of a table that the wanted loops use, seen from its first rows. done: loops that are not."""
    renamed = dict(options.share.renamed) if options.share is not None else None
    loops = by_loop(series_of(table, options), metadata, renamed)
    place = {id(column): i for i, column in enumerate(table.columns)}
    wanted = [name for name in _perhaps_wanted(loops, options) if name not in done]
    used = {place[id(c)] for name in wanted for c in _columns(loops[name]) if id(c) in place}
    # what is still empty may be a tag of the loops file
    return used | {i for i, column in enumerate(table.columns) if column.null_count == table.rows}


def left_out(recipe: Recipe) -> bool:
    """Whether samples of a loop were not kept when its files were read, as nobody seemed to need them."""
    columns = (column.base if isinstance(column, SlicedColumn) else column for column in _columns(recipe.series))
    return any(type(column) is LazyColumn and not pa.types.is_null(column.type) for column in columns)


def wanted_tags(
    metadata: Metadata, options: ReadOptions, done: Collection[str] = ()
) -> Callable[[str], bool]:
    """Return what says of a tag whether a loop that the options do not rule out may use it. done: loops that do not."""
    done = frozenset(done if options.since is None else ())  # what has no samples would not count as data since then
    if options.share is None and not (options.only_loops or options.loops_matching or done):
        return lambda tag: True
    renamed = dict(options.share.renamed) if options.share is not None else None
    owners = explicit_tags(metadata)[0]

    def wanted(tag: str) -> bool:
        loop = split_tag(tag).loop
        names = {tag, loop, *(name for name, _ in owners.get(tag.strip().lower(), ()))}
        for name in (tag, loop):
            found = (metadata.match(name), metadata.part_of(name)) if renamed is None else (renamed.get(name),)
            names.update(match for match in found if match)
        return done.isdisjoint(names) and bool(_perhaps_wanted(dict.fromkeys(names), options))

    return wanted


def _perhaps_wanted(loops: Mapping[str, object], options: ReadOptions) -> list[str]:
    """Loops that the options do not rule out; which are drawn for a sample is known only when all files are open."""
    if options.share is not None:
        return [name for name in loops if name in set(options.share.loops)]
    names = list(loops)
    if options.only_loops:
        names = [name for name in names
                 if any(name == p or fnmatchcase(name.lower(), p.lower()) for p in options.only_loops)]
    if options.loops_matching:
        tests = [check_pattern(pattern) for pattern in options.loops_matching]
        names = [name for name in names if any(test(name) for test in tests)]
    return names
