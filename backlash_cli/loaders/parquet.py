"""Parquet files: the columns that a loop needs are read when its turn comes, the rows of long files in batches."""

from __future__ import annotations

import re
from collections import OrderedDict
from collections.abc import Collection, Iterator
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pa_parquet

from ..errors import InputError
from ..record import IntArray, Note
from .csv import MAX_COLUMNS, Batch
from .layouts import Head
from .numbers import stored
from .options import ReadOptions
from .remote import Remote, open_place
from .signals import Cells, Lexicon
from .times import StampReader

MAX_GROWTH = 1000  # bytes decoded per byte of a large file; constant columns reach some hundred
HEAD_ROWS = 4000
BATCH_ROWS = 1 << 18
_TWO_LEVELS = re.compile(r"^\('([^']*)', '([^']*)'\)$")  # column names of two levels as pandas writes them
MOST_OPEN = 16  # files that are kept open
_open: OrderedDict[str, pa_parquet.ParquetFile] = OrderedDict()


def open_parquet(path: Any) -> pa_parquet.ParquetFile:
    """Open a file, or return it as it was opened last. Raises InputError where it is damaged."""
    key = str(path)
    if key not in _open:
        try:
            _open[key] = pa_parquet.ParquetFile(open_place(path) if isinstance(path, Remote) else path)
        except FileNotFoundError:
            raise InputError("the machine that reads it does not see this file", where=key, code="not_shared",
                             remedy="put the data where every machine finds them under the same name: a network drive, "
                                    "or s3://, abfs://, gs://") from None
        except (pa.ArrowException, OSError) as error:
            raise _damaged(error, key) from None
        while len(_open) > MOST_OPEN:
            _open.popitem(last=False)[1].close()
    _open.move_to_end(key)
    return _open[key]


def _damaged(error: Exception, where: str) -> InputError:
    return InputError(f"damaged Parquet file: {str(error).strip().split(chr(10))[0][:200]}", where=where,
                      remedy="export or copy it again")


def column_name(name: str) -> str:
    """The name of a Parquet column; two levels as pandas writes them become one.

    >>> column_name("('FIC101', 'PV')")
    'FIC101.PV'
    """
    level = _TWO_LEVELS.match(name)
    return f"{level[1]}.{level[2]}" if level else name


class ParquetTable:
    """A Parquet file as a table: its first rows, and all of it in batches or by columns."""

    def __init__(self, path: Any, stem: str, options: ReadOptions, partition: dict[str, str] | None = None) -> None:
        self.path, self.where, self.options = path, str(path), options
        _open.pop(self.where, None)  # it may have changed
        file = open_parquet(path)
        about, schema = file.metadata, file.schema_arrow
        if about.num_columns > MAX_COLUMNS:
            raise InputError(f"{about.num_columns} columns are too many", where=self.where)
        decoded, size = about.num_rows * about.num_columns * 8, path.stat().st_size
        if decoded > options.max_bytes and decoded > MAX_GROWTH * size:
            raise InputError(f"{size} bytes of Parquet expand to {decoded >> 20} MB", where=self.where,
                             remedy="if this is a real export, cut it into parts")
        self.rows = about.num_rows
        if not self.rows:
            raise InputError("no rows of data", where=self.where, remedy="export it again with samples")
        _check_pieces(file, size, self.where)
        self._at = [i for i, field in enumerate(schema) if not pa.types.is_nested(field.type)]
        self._names = [schema.names[i] for i in self._at]
        names = tuple(column_name(name) for name in self._names)
        first = self._looked_at(file, schema)
        self.head = Head(self.where, stem, names, tuple(first), partition=partition or {})
        self.notes: list[Note] = []

    def _looked_at(self, file: pa_parquet.ParquetFile, schema: pa.Schema) -> list[pa.ChunkedArray]:
        """The first rows of the columns whose cells tell about the layout; of others their type only."""
        kinds = [schema.field(i).type for i in self._at]
        plain = [pa.types.is_floating(kind) for kind in kinds]
        tell = [k for k, number in enumerate(plain) if not number or k == 0] if len(set(self._names)) == len(
            self._names) else []
        batch = next(file.iter_batches(HEAD_ROWS, columns=[self._names[k] for k in tell]), None) if tell else None
        place = {name: i for i, name in enumerate(batch.schema.names)} if batch is not None else {}
        return [pa.chunked_array([batch.column(place[name])]) if batch is not None and name in place
                else pa.chunked_array([pa.nulls(0, kind)]) for name, kind in zip(self._names, kinds, strict=True)]

    def batches(self, columns: Collection[int], stamps: Collection[int]) -> Iterator[Batch]:
        """Yield the columns that are asked for, some rows at a time."""
        wanted = sorted({*columns, *stamps})
        file = open_parquet(self.path)
        for batch in file.iter_batches(BATCH_ROWS, columns=[self._names[i] for i in wanted], use_threads=False):
            place = {name: k for k, name in enumerate(batch.schema.names)}
            yield {i: pa.chunked_array([batch.column(place[self._names[i]])]) for i in wanted}

    def columns(self) -> ParquetRows:
        """Return all rows; each column is read when it is asked for."""
        if len(set(self._names)) < len(self._names):
            raise InputError("two columns have the same name", where=self.where, remedy="export it with unique names")
        return ParquetRows(self.path.absolute(), self.rows, tuple(self._names), self.options)


def _check_pieces(file: pa_parquet.ParquetFile, size: int, where: str) -> None:
    """Raise InputError where the footer tells of data that are not in the file."""
    about = file.metadata
    ends = [column.data_page_offset + 1 for k in range(min(about.num_row_groups, 4)) if about.num_columns
            for column in [about.row_group(k).column(about.num_columns - 1)]]
    if ends and max(ends) > size:
        raise InputError("damaged Parquet file: its columns lie beyond its end", where=where,
                         remedy="export or copy it again")


class ParquetRows:
    """Rows of a Parquet file; the columns read last are kept, and read some at once where they are asked for in turn.

    It can be sent to another process, which opens the file anew.
    """

    def __init__(self, path: Any, count: int, names: tuple[str, ...], options: ReadOptions) -> None:
        self.path, self.count, self.names, self.options = path, count, names, options

    def cells(self, column: str, first: int, last: int) -> Cells:
        words: dict[str, int] = {}
        values, codes = stored(self._column(int(column[1:]), first, last), words)
        return Cells(values, codes, Lexicon(list(words)))

    def stamps(self, column: str, first: int, last: int) -> IntArray:
        at = int(column[1:])
        reader = StampReader([self.names[at]], self.options, str(self.path))
        micros = reader.take([self._column(at, first, last)])
        return reader.finish()(micros)

    def _column(self, at: int, first: int, last: int) -> pa.ChunkedArray:
        file = open_parquet(self.path)
        name = self.names[at]
        try:
            about, begin, skipped = file.metadata, 0, 0
            groups: list[int] = []
            for k in range(about.num_row_groups):
                rows = about.row_group(k).num_rows
                if begin < last and begin + rows > first:
                    skipped = begin if not groups else skipped
                    groups.append(k)
                begin += rows
            table = file.read_row_groups(groups, columns=[name], use_threads=False)
            column = table.column(0).slice(first - skipped, last - first)
            if len(column) != last - first:
                raise OSError(f"column {name[:60]} has {len(column)} rows of {last - first}")
            return column
        except (pa.ArrowException, OSError) as error:
            raise _damaged(error, str(self.path)) from None
