"""Files to signals: Arrow reads tables, whose columns go into memory or the scratch file, named and with their stamps.

Text is read in blocks, Parquet in batches of rows or a column when a loop asks; both show their first rows as a Head.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, islice
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
from numpy.typing import NDArray

from ..errors import BacklashError, InputError
from ..record import IntArray, Note
from .cells import BLANK, Cells, Lexicon, codes_and_words, is_number, is_text, stored
from .grid import CLOCK_CODES, NAT, ordered
from .layouts import Head, Layout, layout_of, of_tag, signals_of
from .names import signal_role
from .opening import Text, kind_of, sheets
from .options import ReadOptions
from .signals import Axis, Piece, Room, Series, Store
from .sniff import HEAD_LINES, find_dialect
from .sources import Remote, Source, open_place, stem_of
from .times import StampReader, micros_of

FEW = 3  # steps back of the stamps of a file that may be a clock that was set back
BATCH_CELLS, BATCH_ROWS = 1 << 22, 1 << 19  # cells and rows of Parquet that are read at once
MAX_GROWTH = 1000  # bytes decoded per byte of a large Parquet file; constant columns reach some hundred
_TWO_LEVELS = re.compile(r"^\('([^']*)', '([^']*)'\)$")  # a name of two levels as pandas writes it
_WORDS = pa.dictionary(pa.int32(), pa.string())
Batch = dict[int, pa.ChunkedArray]


class TextTable:
    """A text file as a table: its first rows, then all of it in batches of columns."""

    def __init__(self, text: Text, stem: str, partition: dict[str, str]) -> None:
        self.text, self.where = text, str(text.path)
        self.dialect = dialect = find_dialect(text.head, text.options, self.where)
        self._bad: list[tuple[int | None, int, int]] = []
        first = self._parsed(text.head[dialect.offset : dialect.end], None, threads=False)
        if first.num_rows == 0:
            raise InputError("no rows of data below the header", where=self.where,
                             remedy="export it again with samples")
        self.head = Head(self.where, stem, dialect.names, tuple(first.columns), dialect.kinds, partition,
                         dialect.decimal, dialect.line)
        self._first_bad = self._bad[0][0] if self._bad else None  # rows are numbered where one thread reads them

    def batches(self, columns: Collection[int], stamps: Collection[int]) -> Iterator[Batch]:
        """Yield the columns that are asked for, some rows at a time; to be called once. stamps: columns of stamps."""
        by_pattern = "%" in (self.text.options.time_format or "")
        types: dict[int, pa.DataType | None] = {}
        for i in {*columns, *stamps}:  # as their first rows are, numbers as float64 and words as a dictionary
            kind = self.head.columns[i].type
            if is_text(kind) or (i in stamps and by_pattern):
                types[i] = _WORDS
            elif i in stamps:
                types[i] = None if pa.types.is_null(kind) else kind
            else:
                types[i] = pa.float64() if is_number(kind) or pa.types.is_null(kind) else pa.string()
        self._bad = []
        for block in chain([self.text.head[self.dialect.offset :]], self.text.rest):
            if block.isspace():
                continue
            before = len(self._bad)
            try:
                table = self._parsed(block, types)
            except pa.ArrowInvalid:
                del self._bad[before:]
                table = self._parsed(block, dict.fromkeys(types))
            yield {i: table.column(f"c{i}") for i in types}

    @property
    def notes(self) -> list[Note]:
        """What was noticed, when all batches were read."""
        if not self._bad:
            return self.text.notes
        line = "" if self._first_bad is None else f", the first is line {self.dialect.line + self._first_bad - 1}"
        _, expected, found = self._bad[0]
        return [*self.text.notes, Note(
            "ragged_rows", f"{len(self._bad)} rows have too few or too many cells and were dropped{line} "
            f"({found} columns instead of {expected})", {"rows": float(len(self._bad)), "file": self.where})]

    def _parsed(self, block: bytes | bytearray, types: dict[int, pa.DataType | None] | None, threads: bool = True
                ) -> pa.Table:
        """Read a block; types: of the columns that are read, None for all, as they look."""
        names = [f"c{i}" for i in range(len(self.dialect.names))]  # two columns of the file may be called the same

        def on_bad_row(row: pa_csv.InvalidRow) -> str:
            self._bad.append((row.number, row.expected_columns, row.actual_columns))
            return "skip"

        chosen = {} if types is None else {"include_columns": [names[i] for i in types], "column_types": {
            names[i]: kind for i, kind in types.items() if kind is not None}}
        reading = pa_csv.ReadOptions(column_names=names, use_threads=threads, block_size=1 << 20)
        parsing = pa_csv.ParseOptions(delimiter=self.dialect.delimiter, newlines_in_values=b'"' in block,
                                      invalid_row_handler=on_bad_row)
        converting = pa_csv.ConvertOptions(
            decimal_point=self.dialect.decimal, null_values=["", " ", *BLANK], quoted_strings_can_be_null=True,
            strings_can_be_null=True, auto_dict_encode=True, auto_dict_max_cardinality=4096, true_values=["\x00"],
            false_values=["\x00"], **chosen)
        return pa_csv.read_csv(pa.BufferReader(block), reading, parsing, converting)


@lru_cache(16)
def open_parquet(path: Any) -> pa_parquet.ParquetFile:
    """Open a file, or return it as it was opened lately. Raises InputError where it is damaged."""
    try:
        return pa_parquet.ParquetFile(open_place(path) if isinstance(path, Remote) else path)
    except FileNotFoundError:
        raise InputError("the machine that reads it does not see this file", where=str(path), code="not_shared",
                         remedy="put the data where every machine finds them under the same name: a network drive, "
                                "or s3://, abfs://, gs://") from None
    except (pa.ArrowException, OSError) as error:
        raise _damaged(str(error), path) from None


def _damaged(problem: str, path: Any) -> InputError:
    return InputError(f"damaged Parquet file: {problem.strip().split(chr(10))[0][:200]}", where=str(path),
                      remedy="export or copy it again")


class ParquetTable:
    """A Parquet file as a table: its first rows, all of it in batches, and rows of a column when they are asked for. It
    can be sent to another process, which opens the file anew."""

    def __init__(self, path: Any, stem: str, options: ReadOptions, partition: dict[str, str]) -> None:
        self.path, self.where, self.options = path.absolute(), str(path), options
        open_parquet.cache_clear()  # the file may have changed
        file = open_parquet(path)
        about, schema, size = file.metadata, file.schema_arrow, path.stat().st_size
        self.count, decoded = about.num_rows, about.num_rows * about.num_columns * 8
        if decoded > options.max_bytes and decoded > MAX_GROWTH * size:
            raise InputError(f"{size} bytes of Parquet expand to {decoded >> 20} MB", where=self.where,
                             remedy="if this is a real export, cut it into parts")
        if not self.count:
            raise InputError("no rows of data", where=self.where, remedy="export it again with samples")
        fields = [field for field in schema if not pa.types.is_nested(field.type)]
        self._names = [field.name for field in fields]
        if len(set(self._names)) < len(fields):
            raise InputError("two columns have the same name", where=self.where, remedy="export it with unique names")
        # cells tell about the layout only where they are no plain measurements
        tell = pa.schema([f for k, f in enumerate(fields) if k == 0 or not pa.types.is_floating(f.type)])
        begun = pa.Table.from_batches(islice(file.iter_batches(HEAD_LINES, columns=tell.names), 1), tell)
        told = dict(zip(tell.names, begun.columns, strict=True))
        first = [told.get(f.name, pa.chunked_array([], f.type)) for f in fields]
        names = tuple(_TWO_LEVELS.sub(r"\1.\2", name) for name in self._names)
        self.head = Head(self.where, stem, names, tuple(first), ("",) * len(names), partition)
        self.notes: list[Note] = []

    def batches(self, columns: Collection[int], stamps: Collection[int]) -> Iterator[Batch]:
        """Yield the columns that are asked for, some rows at a time."""
        wanted = sorted({*columns, *stamps})
        for batch in open_parquet(self.path).iter_batches(min(BATCH_ROWS, 1 + BATCH_CELLS // len(wanted)),
                                                          columns=[self._names[i] for i in wanted], use_threads=False):
            yield {i: pa.chunked_array([batch.column(self._names[i])]) for i in wanted}

    def cells(self, column: str, first: int, last: int, group: int = 0) -> Cells:
        """Return the cells of rows first..last-1 of the column "v3"."""
        words: dict[str, int] = {}
        values, codes = stored(self._column(int(column[1:]), first, last), words)
        return Cells(values, codes, Lexicon(list(words)))

    def stamps(self, column: str, first: int, last: int, group: int = 0) -> IntArray:
        """Return the stamps of rows first..last-1 of the column "v0" [microseconds since 1970 UTC]."""
        return micros_of(self._column(int(column[1:]), first, last))

    def _column(self, at: int, first: int, last: int) -> pa.ChunkedArray:
        file, name = open_parquet(self.path), self._names[at]
        ends = np.cumsum([file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)])
        groups = range(int(np.searchsorted(ends, first, "right")), int(np.searchsorted(ends, last - 1, "right")) + 1)
        begin = int(ends[groups[0] - 1]) if groups and groups[0] else 0
        try:
            column = file.read_row_groups(list(groups), columns=[name], use_threads=False).column(0)
        except (pa.ArrowException, OSError) as error:
            raise _damaged(str(error), self.path) from None
        if len(column := column.slice(first - begin, last - first)) != last - first:
            raise _damaged(f"column {name[:60]} has {len(column)} rows of {last - first}", self.path)
        return column

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "head": None}


Table = TextTable | ParquetTable


@dataclass
class Reading:
    """How files are read. needed: says whether the samples of a signal are. taken: called with the bytes of a file that
    were read."""

    options: ReadOptions
    needed: Callable[[Series], bool]
    taken: Callable[[int], None] | None
    room: Room


def signals_of_file(source: Source, reading: Reading) -> tuple[list[Series], list[Note]]:
    """Return the signals of a file, and what was noticed; a sheet of remarks beside one of data is passed over. Raises
    InputError when it cannot be read."""
    path, options, stem = source.path, reading.options, stem_of(source.path)
    kind = kind_of(path)
    if kind == "parquet" and reading.taken is not None:
        reading.taken(path.stat().st_size)
    parts: list[tuple[str, bytes | None]] = [*sheets(path)] if kind == "workbook" else [(stem, None)]
    found: list[Series] = []
    notes: list[Note] = []
    problems: list[InputError] = []
    for name, data in parts:
        try:
            table = ParquetTable(path, stem, options, source.partition) if kind == "parquet" else TextTable(
                Text(path, options, reading.taken, data), stem if len(parts) == 1 else name, source.partition)
            layout = layout_of(table.head, options)
        except InputError as error:
            problems.append(error)
            continue
        found += _signals(table, layout, reading)
        notes += table.notes
    if len(problems) == len(parts):
        raise problems[0]
    return found, notes


def _signals(table: Table, layout: Layout, reading: Reading) -> list[Series]:
    """Store what is needed of a file: stamps in UTC as "t0", "t1" ..., cells as "v3", "v4" ... Rows of several tags or
    loops are put together by tag. A column of Parquet with stamps in UTC stays in the file until it is needed."""
    head, options = table.head, reading.options
    blank = {i for i in layout.stored if pa.types.is_null(head.columns[i].type)}
    kinds = [head.columns[i].type for pair in layout.stamps for i in pair]
    if not layout.naming and isinstance(table, ParquetTable) and len(kinds) == len(layout.stamps) and all(
            pa.types.is_timestamp(kind) and (kind.tz or not options.timezone) for kind in kinds):
        axes = [Axis(table, f"v{pair[0]}", range(table.count), where=head.where) for pair in layout.stamps]
        return _on_axes(signals_of(head, layout, blank), axes, layout)
    columns = layout.stored
    if not layout.naming:  # what is still blank may be a tag of the loops file
        needed = {i for one in signals_of(head, layout) if reading.needed(one) for i in (one.column, one.marked)}
        columns = [i for i in columns if i in needed or i in blank]
    readers = [StampReader([head.names[i] for i in pair], options, head.where) for pair in layout.stamps]
    raw, store, tags, blank = Store(reading.room), Store(reading.room), dict[str, int](), set(columns)
    words: dict[int, dict[str, int]] = {i: {} for i in columns}
    for batch in table.batches([*columns, *layout.naming], {i for pair in layout.stamps for i in pair}):
        piece: Piece = {f"t{k}": reader.take([batch[i] for i in pair])
                        for k, (reader, pair) in enumerate(zip(readers, layout.stamps, strict=True))}
        for i in columns:
            values, codes = stored(batch[i], words[i], head.decimal, written=isinstance(table, TextTable))
            piece |= {f"v{i}": values} if codes is None else {f"v{i}": values, f"v{i}w": codes}
            if i in blank and (codes is not None or not np.isnan(values).all()):
                blank.remove(i)
        if layout.naming:
            piece["group"] = _numbered(batch, layout.naming, head, tags)
        raw.add(piece)
    clocks = [reader.finish() for reader in readers]
    for piece in raw.emptied():
        store.add({**piece, **{f"t{k}": clock(piece[f"t{k}"][:]) for k, clock in enumerate(clocks)}})
    store.lexicons = {f"v{i}": Lexicon(list(found), head.decimal) for i, found in words.items() if found}
    count = int(store.rows().sum())
    axes = [Axis(store, f"t{k}", range(count), absolute=reader.absolute, notes=reader.all_notes, where=head.where,
                 first_line=head.first_line) for k, reader in enumerate(readers)]
    if layout.naming:
        return _by_tag(axes[0], store, tags, blank, head, layout, reading)
    return _on_axes(signals_of(head, layout, blank), axes, layout)


def _on_axes(signals: list[Series], axes: list[Axis], layout: Layout) -> list[Series]:
    if layout.kind == "pairs":  # shorter ones are padded with rows without a stamp
        axes = [axis.part(slice(0, 1 + int(np.flatnonzero(axis.read() != NAT).max(initial=-1)))) for axis in axes]
    return [replace(one, axis=axes[one.stamps]) for one in signals]


def _numbered(batch: Batch, naming: Sequence[int], head: Head, tags: dict[str, int]) -> NDArray[np.int32]:
    """Return the number of each row's tag, -1 for none, such as a header in between; new tags are added."""
    header = ".".join(head.names[i].strip() for i in naming)
    codes, words = codes_and_words(batch[naming[0]])
    if len(naming) == 2:
        second, fields = codes_and_words(batch[naming[1]])
        both = np.where((codes < 0) | (second < 0), -1, codes * max(len(fields), 1) + second)
        present, codes = np.unique(both, return_inverse=True)
        words = ["" if p < 0 else f"{words[p // len(fields)]}.{fields[p % len(fields)]}" for p in present.tolist()]
    table = np.full(len(words) + 1, -1, np.int32)
    for i in np.flatnonzero(np.bincount(codes + 1)[1:]).tolist():
        if (name := words[i].strip()) and name != header:
            table[i] = tags.setdefault(name, len(tags))
    return table[codes]


def _by_tag(all_rows: Axis, store: Store, tags: Collection[str], blank: set[int], head: Head, layout: Layout,
            reading: Reading) -> list[Series]:
    """Put the rows of each tag, or of each loop of a tall file, together; of those that are needed."""
    tall = layout.kind == "tall"
    moved, notes = ([], []) if tall else _one_clock(store, f"v{layout.values[0]}", len(tags))
    named = [[Series(f"{name}.{head.names[i]}", name, signal_role(head.names[i]), head.names[i], i)
              for i in layout.values if i not in blank] if tall else [of_tag(head, layout, name, layout.values[0])]
             for name in tags]
    wanted = np.array([any(map(reading.needed, ones)) for ones in named] + [False])
    grouped, first, last = Store(reading.room, grouped=True), 0, NAT
    grouped.lexicons = store.lexicons
    for piece in store.emptied():
        arrays: Piece = {name: column[:] for name, column in piece.items()}
        micros, keep = arrays["t0"][:].astype(np.int64, copy=False), wanted[arrays["group"][:]]
        for row, shift in moved:
            micros = np.where((np.arange(first, first + len(micros)) > row) & (micros != NAT), micros + shift, micros)
        first, last = first + len(micros), max(last, int(micros.max(initial=NAT)))
        arrays["t0"] = micros
        if not tall:  # rows without a stamp, such as headers in between, are no samples
            keep &= micros != NAT
        grouped.add(arrays if keep.all() else {name: column[:][keep] for name, column in arrays.items()})
    found = []
    for number, ones in enumerate(named):
        count = int(grouped.rows(number).sum())
        axis = replace(all_rows, rows=grouped, which=range(count), group=number, first_line=0,
                       notes=(*all_rows.notes, *notes), end=None if wanted[number] else last)
        found += [replace(one, axis=axis) for one in ones if count or not wanted[number]]
    return found


def _one_clock(store: Store, column: str, tags: int) -> tuple[list[tuple[int, int]], list[Note]]:
    """A clock that was set back in a file written in time order went back for all tags, the rarely recorded too. Return
    after which rows by how much [microseconds] it did, and what is to be said of it."""
    back: list[int] = []
    first, before, counts = 0, -(1 << 62), np.zeros(tags + 1, np.int64)
    for piece in store.pieces:
        micros = piece["t0"][:]
        known = np.flatnonzero(micros != NAT)
        back += (first - 1 + known[np.diff(micros[known], prepend=before) < 0]).tolist() if len(known) else []
        before, first = int(micros[known[-1]]) if len(known) else before, first + len(micros)
        counts += np.bincount(piece["group"][:] + 1, minlength=tags + 1)
    if not 0 < len(back) <= FEW:
        return [], []
    usual = int(np.argmax(counts[1:]))
    times, values = (np.concatenate([piece[name][:][piece["group"][:] == usual] for piece in store.pieces])
                     for name in ("t0", column))
    clock: list[Note] = []
    with contextlib.suppress(BacklashError):
        clock = [note for note in ordered(times, values).notes if note.code in CLOCK_CODES]
    if len(clock) != len(back):
        return [], []
    return [(row, round(float(note.values["seconds"]) * 1e6)) for row, note in zip(back, clock, strict=True)], clock
