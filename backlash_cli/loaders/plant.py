"""Read exports: files to tables, tables to signals, signals to loops, loops to records."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from os import PathLike, fspath

from pyarrow.lib import ArrowException

from ..errors import BacklashError, InputError, LoopError, UsageError, nearest
from ..record import Note, Record
from .clean import build_record
from .join import Joiner, LoopSeries, by_loop
from .layouts import series_of
from .loop_settings import settings_of
from .metadata import ROLE_KEYS, Metadata, merge, read_metadata
from .options import ReadOptions
from .series import Series
from .sources import find_sidecars, find_sources
from .tables import read_table

Inputs = str | PathLike[str] | Sequence[str | PathLike[str]]

FEW_LOOPS = 3  # loops of the loops file without data that are named one by one


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
        for failure in self.failures:
            if failure.values.get("loop") == name:
                raise LoopError(failure.message, code=failure.code)
        same = [n for n in self._by_name if n.lower() == name.lower()]
        if len(same) == 1:
            return self._by_name[same[0]]
        raise UsageError(f"no loop {name!r} in the data", where="--loop", remedy=nearest(name, self._by_name))

    def __len__(self) -> int:
        return len(self.records)

    def __iter__(self) -> Iterator[Record]:
        return iter(self.records)


def read(inputs: Inputs, *, loops: str | PathLike[str] | None = None, options: ReadOptions | None = None) -> Plant:
    """Read one plant from exports (files or folders) and its loop settings.

    inputs: CSV or Parquet files, folders of them, or a Parquet dataset. loops: metadata file; None: found next to
    the data. Raises BacklashError when nothing can be read or the metadata are wrong; a single bad file or loop
    becomes a failure of the Plant.
    """
    options = options or ReadOptions()
    given = [inputs] if isinstance(inputs, (str, PathLike)) else list(inputs)
    sources = find_sources(given)
    paths = [loops] if loops is not None else find_sidecars(given, sources)
    metadata = merge([read_metadata(fspath(path)) for path in paths])
    warnings = [Note("metadata_conflict", text) for text in metadata.conflicts]
    if not metadata.files:
        warnings.append(
            Note("no_metadata", "no loop settings found (loops.toml): settings are missing and have to be identified")
        )
    elif not metadata.loops:
        warnings.append(Note("no_metadata", f"the loops file {metadata.files[0]} lists no loops: K and Ti are missing"))
    failures: list[Note] = []
    found: list[Series] = []
    first_problem: BacklashError | None = None
    for source in sources:
        try:
            table = read_table(source.path, options, source.partition)
            found += series_of(table, options)
            warnings += table.notes
        except (BacklashError, ArrowException, UnicodeError, OverflowError, MemoryError) as caught:
            error = caught if isinstance(caught, BacklashError) else _unreadable(caught, str(source.path))
            first_problem = first_problem or error
            failures.append(_failure(error, file=str(source.path)))
    if not found:
        if len(sources) == 1 and first_problem is not None:
            raise first_problem
        raise InputError(
            f"none of {len(sources)} files could be read; the first: {first_problem}", remedy="export them again"
        )
    series = by_loop(found, metadata)
    if not series:
        tags = sorted({item.tag for item in found})
        found_names = ", ".join(filter(None, tags[:12])) or "columns without a name"
        raise InputError(
            "no loop found: no column is called SP, PV or OP of a loop",
            where=str(sources[0].path),
            remedy=f"name the tags in loops.toml; found: {found_names}",
        )
    series, more = _loops_only(series, metadata)
    warnings += more
    records, more = _records(series, metadata, options)
    failures += more
    warnings += _unmatched(series, metadata)
    if not records and more:
        raise LoopError(
            f"no loop could be read; {more[0].message}" if len(more) > 1 else more[0].message, code=more[0].code
        )
    return Plant(tuple(records), tuple(warnings), tuple(failures), tuple(str(item) for item in given))


def _records(
    series: dict[str, LoopSeries], metadata: Metadata, options: ReadOptions
) -> tuple[list[Record], list[Note]]:
    joiner = Joiner(options.good_quality)
    records, failures = [], []
    for name in sorted(_wanted(series, options)):
        values = metadata.of(name)
        notes: list[Note] = []
        origin = next(iter(series[name].roles.values()))[0]
        if values is not None and origin.loop and origin.loop != name and metadata.match(origin.loop) is None:
            notes.append(
                Note("matched_name", f"{origin.loop[:60]} in the data is taken as {name[:60]} of the loops file")
            )
        if values is None and metadata.files:
            notes.append(
                Note("not_in_metadata", f"loop {name[:60]} is not in the loops file: its settings are missing")
            )
        try:
            settings = settings_of(values if values is not None else metadata.fallback())
            record = build_record(series[name], settings, joiner, options)
        except BacklashError as error:
            failures.append(_failure(error, loop=name))
            continue
        if notes:
            from dataclasses import replace

            record = replace(record, notes=(*notes, *record.notes))
        records.append(record)
    return records, failures


def _loops_only(series: dict[str, LoopSeries], metadata: Metadata) -> tuple[dict[str, LoopSeries], list[Note]]:
    """Set aside what has one signal only and is not in the metadata: an indicator, or a column with a chance name."""
    single = [name for name, own in series.items() if len(own.roles) == 1 and metadata.of(name) is None]
    if not single or len(single) == len(series):
        return series, []
    shown = ", ".join(name[:40] for name in sorted(single)[:5]) + (", ..." if len(single) > 5 else "")
    text = f"{len(single)} tags have one signal only and are no loops; they are left out: {shown}"
    return {name: own for name, own in series.items() if name not in set(single)}, [Note("single_signals", text)]


def _wanted(series: dict[str, LoopSeries], options: ReadOptions) -> list[str]:
    if not options.only_loops:
        return list(series)
    chosen: dict[str, None] = {}
    for pattern in options.only_loops:
        hits = [name for name in series if name == pattern or fnmatchcase(name.lower(), pattern.lower())]
        if not hits:
            raise UsageError(
                f"no loop {pattern!r} in the data", where="--loop", remedy=nearest(pattern, sorted(series))
            )
        chosen.update(dict.fromkeys(hits))
    return list(chosen)


def _unmatched(series: dict[str, LoopSeries], metadata: Metadata) -> list[Note]:
    used = {metadata.match(name) for name in series}
    missing = {name: own for name, own in metadata.loops.items() if name not in used}
    if len(missing) > FEW_LOOPS:
        # The loops file of a whole plant beside the export of a few loops: usual, and one line says it.
        shown = ", ".join(list(missing)[:FEW_LOOPS])
        text = f"{len(missing)} loops of the loops file are not found in the data: {shown} ..."
        return [Note("loop_not_found", text, {"loop": ", ".join(missing), "loops": len(missing)})]
    notes = []
    for name, own in missing.items():
        tags = ", ".join(tag for role in ROLE_KEYS if isinstance(tag := own.values.get(role), str))
        hint = f"its tags {tags} are not there" if tags else nearest(name, sorted(series))
        text = f"loop {name} of the loops file is not found in the data ({hint})"
        notes.append(Note("loop_not_found", text, {"loop": name}))
    return notes


def _unreadable(error: BaseException, where: str) -> InputError:
    text = str(error).strip().split("\n")[0][:200] or type(error).__name__
    return InputError(f"damaged or not understood: {text}", where=where, remedy="export the file again")


def _failure(error: BacklashError, *, loop: str = "", file: str = "") -> Note:
    values: dict[str, float | str] = {}
    if loop:
        values["loop"] = loop
    if file:
        values["file"] = file
    text = str(error)
    return Note(error.code, f"{loop}: {text}" if loop else text, values)
