"""Files to signals: the columns of a file go into memory or the scratch file, named and with their stamps."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import BacklashError, InputError
from ..record import IntArray, Note
from .csv import TextTable
from .layouts import Head, Layout, Named, layout_of, of_tag, signals_of
from .names import signal_role
from .numbers import codes_and_words, stored
from .opening import Text, kind_of, sheets
from .options import ReadOptions
from .order import CLOCK_CODES, NAT, ordered
from .parquet import ParquetTable
from .scratch import Arrays, Room, Store
from .signals import Axis, Lexicon, Rows, Series, StoredRows
from .sources import Source, stem_of
from .times import StampReader

FEW = 3  # steps back of the stamps of a file that may be a clock that was set back
Table = TextTable | ParquetTable


@dataclass
class Reading:
    """How files are read. needed: says of named columns, or of the tags of rows by their numbers, whose samples are.
    taken: called with the bytes of a file that were read."""

    options: ReadOptions
    needed: Callable[[list[Named]], set[int]] = lambda found: {one.column for one in found}
    taken: Callable[[int], None] | None = None
    room: Room = field(default_factory=Room)


def tables_of(source: Source, reading: Reading) -> Iterator[Table]:
    """Open the tables of a file: one, or the sheets of a workbook. Raises InputError."""
    path, options = source.path, reading.options
    kind, stem, where = kind_of(path), stem_of(path), str(path)
    if kind == "parquet":
        if reading.taken is not None:
            reading.taken(path.stat().st_size)
        yield ParquetTable(path, stem, options, source.partition)
    elif kind == "text":
        yield TextTable(influx_plain(Text(path, options, reading.taken)), stem, where, source.partition)
    else:
        yield from _sheets(source, options)


def _sheets(source: Source, options: ReadOptions) -> Iterator[Table]:
    """The sheets of a workbook that are tables of measurements; a sheet of remarks beside one is passed over."""
    found, problem = sheets(source.path), None
    good = 0
    for name, data in found:
        try:
            table = TextTable(Text(source.path, options, data=data), stem_of(source.path) if len(found) == 1 else name,
                              str(source.path), source.partition)
            layout_of(table.head, options)
        except InputError as error:
            problem = problem or error
            continue
        good += 1
        yield table
    if not good and problem is not None:
        raise problem


_ANNOTATION = re.compile(rb"^#(?:datatype|group|default)\b", re.MULTILINE)


def influx_plain(text: Text) -> Text:
    """Take the annotations out of InfluxDB's annotated CSV, where a table of other columns may follow after a blank
    line; the columns of all tables are brought to those of the first."""
    if not _ANNOTATION.search(text.head[: 64 << 10]):
        return text
    columns: list[bytes] = []
    place: list[int] | None = None
    fresh = True

    def changed(block: bytes) -> bytes:
        nonlocal place, fresh
        out = []
        for line in block.splitlines():
            if not line.strip(b" ,\r") or line.startswith((b"#", b'"#')):
                fresh = True
                continue
            cells = line.split(b",")
            if fresh and not any(cell[:1].isdigit() for cell in cells):
                names = [cell.strip(b'"\r ') for cell in cells]
                if not columns:
                    columns.extend(names)
                    out.append(b",".join(columns))
                place = None if names == columns else [names.index(name) if name in names else -1 for name in columns]
            elif place is None:
                out.append(line)
            else:
                out.append(b",".join(cells[k] if 0 <= k < len(cells) else b"" for k in place))
            fresh = False
        return b"\n".join(out) + b"\n" if out else b""

    return text.changed(changed)


def signals_of_file(source: Source, reading: Reading) -> tuple[list[Series], list[Note]]:
    """Return the signals of a file, and what was noticed. Raises InputError when it cannot be read."""
    found: list[Series] = []
    notes: list[Note] = []
    for table in tables_of(source, reading):
        layout = layout_of(table.head, reading.options)
        read = _grouped if layout.naming else _wide
        found += read(table, layout, reading)
        notes += table.notes
    return found, notes


def _wide(table: Table, layout: Layout, reading: Reading) -> list[Series]:
    """A column per signal."""
    head = table.head
    needed = reading.needed(signals_of(head, layout))
    needed |= {layout.quality[i] for i in needed if i in layout.quality}
    empty = {i for i in layout.stored if pa.types.is_null(head.columns[i].type)}
    rows: Rows
    if isinstance(table, ParquetTable):
        rows = table.columns()
        axes = _parquet_axes(table, rows, layout, reading)
    else:
        columns = sorted(set(layout.stored) & (needed | empty))  # what is still empty may be a tag of the loops file
        store, stamps, lexicons, filled = _stored(table, layout, columns, reading)
        rows = StoredRows(store, stamps.rows, lexicons)
        axes = _axes(stamps, table, layout)
        empty = set(columns) - filled
    found = []
    for one in signals_of(head, layout, empty):
        axis = axes[one.stamps]
        series = _series(one, head, layout, axis, rows if one.column in needed | empty else None)
        found.append(_where_stamped(series) if layout.kind == "pairs" else series)
    return found


def _series(one: Named, head: Head, layout: Layout, axis: Axis, rows: Rows | None) -> Series:
    mark = layout.quality.get(one.column)
    quality, name = ("", "") if mark is None else (f"v{mark}", head.names[mark])
    return Series(one.tag, one.loop, one.role, one.signal, axis, rows, f"v{one.column}", quality, head.where, name)


def _where_stamped(series: Series) -> Series:
    """Leave out the rows of a pair of columns that have no stamp: shorter ones are padded with empty cells."""
    known = series.axis.micros != NAT
    count = int(known.sum())
    chosen = slice(0, count) if known[:count].all() else np.flatnonzero(known)
    return series.part(series.axis.part(chosen), chosen)


def _stored(table: Table, layout: Layout, columns: Sequence[int], reading: Reading, tags: _Tags | None = None) -> tuple[
        Store, _Stamps, dict[str, Lexicon], set[int]]:
    """Store the columns of a file; return also its stamps, the texts of its columns, and which hold anything."""
    store, stamps = Store(reading.room), _Stamps(table.head, layout, reading)
    words: dict[int, dict[str, int]] = {i: {} for i in columns}
    filled: set[int] = set()
    for batch in table.batches([*columns, *layout.naming], stamps.columns):
        stamps.take(batch)
        arrays: Arrays = {} if tags is None else {"group": tags.take(batch)}
        for i in columns:
            values, codes = stored(batch[i], words[i], table.head.decimal, written=isinstance(table, TextTable))
            arrays |= {f"v{i}": values} if codes is None else {f"v{i}": values, f"v{i}w": codes}
            if i not in filled and (codes is not None or not np.isnan(values).all()):
                filled.add(i)
        if arrays:
            store.add(arrays)
    lexicons = {f"v{i}": Lexicon(list(found), table.head.decimal) for i, found in words.items() if found}
    return store.close(), stamps.close(), lexicons, filled


class _Stamps:
    """The stamps of a file on their way through its batches."""

    def __init__(self, head: Head, layout: Layout, reading: Reading) -> None:
        self.layout = layout
        self.columns = {i for pair in layout.stamps for i in pair}
        self.readers = [StampReader([head.names[i] for i in pair], reading.options, head.where)
                        for pair in layout.stamps]
        self.store = Store(reading.room)

    def take(self, batch: dict[int, pa.ChunkedArray]) -> None:
        self.store.add({f"t{k}": reader.take([batch[i] for i in pair])
                        for k, (reader, pair) in enumerate(zip(self.readers, self.layout.stamps, strict=True))})

    def close(self) -> _Stamps:
        """Bring all stamps to UTC. Raises InputError when they are not understood."""
        self.store.close()
        clocks = [reader.finish() for reader in self.readers]
        self.store = self.store.mapped(lambda arrays, first: {
            f"t{k}": clock(arrays[f"t{k}"]) for k, clock in enumerate(clocks)})
        return self

    @property
    def rows(self) -> int:
        return self.store.rows


def _axes(stamps: _Stamps, table: Table, layout: Layout) -> list[Axis]:
    rows = StoredRows(stamps.store, stamps.rows)
    return [Axis(rows, f"t{k}", absolute=reader.absolute, notes=reader.all_notes, where=table.head.where,
                 first_line=table.head.first_line) for k, reader in enumerate(stamps.readers)]


def _parquet_axes(table: ParquetTable, rows: Rows, layout: Layout, reading: Reading) -> list[Axis]:
    """Stamps that need no interpretation stay in the file, all others are read."""
    kinds = [table.head.columns[pair[0]].type for pair in layout.stamps]
    if all(len(pair) == 1 and pa.types.is_timestamp(kind) and (kind.tz is not None or not reading.options.timezone)
           for pair, kind in zip(layout.stamps, kinds, strict=True)):
        return [Axis(rows, f"t{pair[0]}", where=table.where) for pair in layout.stamps]
    stamps = _Stamps(table.head, layout, reading)
    for batch in table.batches((), stamps.columns):
        stamps.take(batch)
    return _axes(stamps.close(), table, layout)


class _Tags:
    """Numbers of the tags of a long file, or of the loops of a tall one."""

    def __init__(self, naming: Sequence[int], headers: tuple[str, ...]) -> None:
        self.naming, self.headers = naming, headers
        self.numbers: dict[str, int] = {}
        self.counts: IntArray = np.zeros(0, np.int64)

    def take(self, batch: dict[int, pa.ChunkedArray]) -> NDArray[np.int32]:
        """Return the number of each row's tag, -1 for none."""
        codes, words = codes_and_words(batch[self.naming[0]])
        if len(self.naming) == 2:
            second, fields = codes_and_words(batch[self.naming[1]])
            both = np.where((codes < 0) | (second < 0), -1, codes * max(len(fields), 1) + second)
            present, codes = np.unique(both, return_inverse=True)
            codes = codes - (1 if len(present) and present[0] < 0 else 0)
            present = present[present >= 0]
            words = [f"{words[p // len(fields)]}.{fields[p % len(fields)]}" for p in present.tolist()]
        there = np.zeros(len(words) + 1, bool)
        there[codes] = True
        table = np.full(len(words) + 1, -1, np.int32)
        for i in np.flatnonzero(there[:-1]).tolist():
            if (name := words[i].strip()) and name != self.headers[0]:
                table[i] = self.numbers.setdefault(name, len(self.numbers))
        return table[codes]


def _grouped(table: Table, layout: Layout, reading: Reading) -> list[Series]:
    """Rows that belong to different tags or loops: they are put together by tag."""
    head, tall = table.head, layout.kind == "tall"
    header = (".".join(head.names[i].strip() for i in layout.naming),)
    tags = _Tags(layout.naming, header)
    store, stamps, lexicons, filled = _stored(table, layout, layout.stored, reading, tags)
    moved: list[tuple[int, int]] = []
    notes = stamps.readers[0].all_notes
    if not tall:
        moved, more = _one_clock(store, stamps.store, f"v{layout.values[0]}")
        notes = (*notes, *more)
    names = list(tags.numbers)
    named = [[Named(k, f"{name}.{head.names[i]}", name, signal_role(head.names[i]), head.names[i])
              for i in layout.values] if tall else [of_tag(name, k)] for k, name in enumerate(names)]
    needed = reading.needed([one for ones in named for one in ones])
    wanted = np.array([k in needed for k in range(len(names))] + [False])
    last = NAT

    def by_tag(arrays: Arrays, first: int) -> Arrays:
        nonlocal last
        micros = stamps.store.read(["t0"], first, first + len(arrays["group"]))["t0"].astype(np.int64, copy=False)
        for row, shift in moved:
            micros = np.where((np.arange(first, first + len(micros)) > row) & (micros != NAT), micros + shift, micros)
        last = max(last, int(micros.max(initial=NAT)))
        keep = wanted[arrays["group"]]
        if not tall:  # rows without a stamp, such as headers in between, are no samples
            keep &= micros != NAT
        if keep.all():
            return {**arrays, "t0": micros}
        return {name: column[keep] for name, column in {**arrays, "t0": micros}.items()}

    grouped = store.mapped(by_tag, groups=True)
    found = []
    for number in range(len(names)):
        count = int(grouped.group_rows(number).sum())
        rows = StoredRows(grouped, count, lexicons, number) if wanted[number] else None
        about: dict[str, Any] = {"absolute": stamps.readers[0].absolute, "notes": notes, "where": head.where}
        axis = Axis(rows, "t0", **about) if rows is not None else Axis(end=last, **about)
        if not tall and rows is not None and not count:
            continue
        for i, one in zip(layout.values, named[number], strict=True):
            if not tall or i in filled:
                found.append(_series(replace(one, column=i), head, layout, axis, rows))
    return found


def _one_clock(store: Store, stamps: Store, column: str) -> tuple[list[tuple[int, int]], list[Note]]:
    """A clock that was set back in a file written in time order went back for all tags, the rarely recorded too.

    Return after which rows by how much [microseconds] it did, and what is to be said of it.
    """
    back, before, counts = [], None, np.zeros(0, np.int64)
    for first, arrays in stamps.pieces(["t0"]):
        micros = arrays["t0"]
        steps = np.diff(micros, prepend=micros[:1] if before is None else before)
        earlier = np.concatenate([[NAT if before is None else before], micros[:-1]])
        fell = (steps < 0) & (micros != NAT) & (earlier != NAT)
        back += (first - 1 + np.flatnonzero(fell)).tolist()
        before = int(micros[-1])
        if len(back) > FEW:
            return [], []
    if not back:
        return [], []
    for _, arrays in store.pieces(["group"]):
        found = np.bincount(arrays["group"][arrays["group"] >= 0])
        counts = found + np.pad(counts, (0, len(found) - len(counts))) if len(found) > len(counts) else counts + np.pad(
            found, (0, len(counts) - len(found)))
    times, values = [], []
    for first, arrays in store.pieces(["group", column, f"{column}w"]):
        rows = np.flatnonzero(arrays["group"] == int(np.argmax(counts)))
        times.append(stamps.read(["t0"], first, first + len(arrays["group"]))["t0"][rows])
        values.append(arrays[column][rows])
    try:
        notes = ordered(np.concatenate(times), np.concatenate(values)).notes
    except BacklashError:
        return [], []
    clock = [note for note in notes if note.code in CLOCK_CODES]
    if len(clock) != len(back):
        return [], []
    return [(row, round(float(note.values["seconds"]) * 1e6)) for row, note in zip(back, clock, strict=True)], clock
