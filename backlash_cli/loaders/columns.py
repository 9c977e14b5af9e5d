"""Tables whose columns Arrow reads: text in blocks, Parquet in batches of rows or a column when a loop needs it.

Both show their first rows as a Head. This module only tells Arrow where the data begin and what to keep.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from functools import lru_cache
from itertools import chain, islice
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from ..errors import InputError
from ..record import IntArray, Note
from .layouts import Head
from .numbers import BLANK, is_number, is_text, stored
from .opening import Text
from .options import ReadOptions
from .signals import Cells, Lexicon
from .sniff import HEAD_LINES, find_dialect
from .sources import Remote, open_place
from .times import micros_of

BATCH_CELLS, BATCH_ROWS = 1 << 22, 1 << 19  # cells and rows of Parquet that are read at once
MAX_COLUMNS = 100_000
MAX_GROWTH = 1000  # bytes decoded per byte of a large Parquet file; constant columns reach some hundred
_TWO_LEVELS = re.compile(r"^\('([^']*)', '([^']*)'\)$")  # a name of two levels as pandas writes it
_WORDS = pa.dictionary(pa.int32(), pa.string())
Batch = dict[int, pa.ChunkedArray]


class TextTable:
    """A text file as a table: its first rows, then all of it in batches of columns."""

    def __init__(self, text: Text, stem: str, partition: dict[str, str]) -> None:
        self.text, self.where = text, str(text.path)
        self.dialect = dialect = find_dialect(text.head, text.options, self.where)
        if len(dialect.names) > MAX_COLUMNS:
            raise InputError(f"{len(dialect.names)} columns are too many", where=self.where)
        self._bad: list[tuple[int | None, int, int]] = []
        first = self._parsed(text.head[dialect.offset : dialect.end], None, threads=False)
        if first.num_rows == 0:
            raise InputError("no rows of data below the header", where=self.where,
                             remedy="export it again with samples")
        self.head = Head(self.where, stem, dialect.names, tuple(first.columns), dialect.kinds, partition,
                         dialect.decimal, dialect.line)
        self._first = first
        self._first_bad = self._bad[0][0] if self._bad else None  # rows are numbered where one thread reads them

    def batches(self, columns: Collection[int], stamps: Collection[int]) -> Iterator[Batch]:
        """Yield the columns that are asked for, some rows at a time; to be called once. stamps: columns of stamps."""
        by_pattern = "%" in (self.text.options.time_format or "")
        types: dict[int, pa.DataType | None] = {}
        for i in {*columns, *stamps}:  # as their first rows are, numbers as float64 and words as a dictionary
            kind = self.head.columns[i].type
            number = is_number(kind) or pa.types.is_null(kind)
            types[i] = pa.float64() if number else pa.string()
            if is_text(kind) or (i in stamps and by_pattern):
                types[i] = _WORDS
            elif i in stamps:
                types[i] = None if pa.types.is_null(kind) else kind
        begin = self.dialect.end
        if by_pattern:  # stamps are read as text from the beginning
            begin, self._bad = self.dialect.offset, []
        else:
            yield {i: self._first.column(i) for i in types}
        for block in chain([self.text.head[begin:]], self.text.rest):
            if not block or block.isspace():
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
        return pa_csv.read_csv(
            pa.BufferReader(block),
            read_options=pa_csv.ReadOptions(column_names=names, use_threads=threads, block_size=1 << 20),
            parse_options=pa_csv.ParseOptions(delimiter=self.dialect.delimiter, newlines_in_values=b'"' in block,
                                              invalid_row_handler=on_bad_row),
            convert_options=pa_csv.ConvertOptions(
                decimal_point=self.dialect.decimal, null_values=["", " ", *BLANK], quoted_strings_can_be_null=True,
                strings_can_be_null=True, auto_dict_encode=True, auto_dict_max_cardinality=4096,
                true_values=["\x00"], false_values=["\x00"], **chosen),
        )


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
    """A Parquet file as a table: its first rows, all of it in batches, and rows of a column when they are asked for.

    It can be sent to another process, which opens the file anew.
    """

    def __init__(self, path: Any, stem: str, options: ReadOptions, partition: dict[str, str]) -> None:
        self.path, self.where, self.options = path.absolute(), str(path), options
        open_parquet.cache_clear()  # the file may have changed
        file = open_parquet(path)
        about, schema, size = file.metadata, file.schema_arrow, path.stat().st_size
        self.count, decoded = about.num_rows, about.num_rows * about.num_columns * 8
        if about.num_columns > MAX_COLUMNS:
            raise InputError(f"{about.num_columns} columns are too many", where=self.where)
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

    def cells(self, column: str, first: int, last: int) -> Cells:
        """Return the cells of rows first..last-1 of the column "v3"."""
        words: dict[str, int] = {}
        values, codes = stored(self._column(int(column[1:]), first, last), words)
        return Cells(values, codes, Lexicon(list(words)))

    def stamps(self, column: str, first: int, last: int) -> IntArray:
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
