"""The columns of a Parquet file, which are decoded when a loop asks for them."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator
from functools import cached_property
from itertools import accumulate, takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pa_parquet
from numpy.typing import NDArray

from .columns import LazyColumn, SlicedColumn
from .numbers import to_numbers
from .places import Remote

Part = tuple[int, int]  # a column of a Parquet file, from a row group on


class ParquetFileColumns:
    """The columns of one flat Parquet file, read a few at a time in the order in which they will be wanted.

    texts: names of columns of text that repeats itself. about: what the file says of itself, where that is known.
    """

    BATCH = 1 << 20  # bytes of decoded columns read ahead at once: what a core keeps near itself
    FAR = 8  # times as much at once where each reading is a request

    def __init__(
        self, path: Path | Remote, texts: tuple[str, ...] = (), about: pa_parquet.FileMetaData | None = None
    ) -> None:
        self.path, self.texts, self._about = path, texts, about
        self._batch = self.BATCH * (self.FAR if isinstance(path, Remote) else 1)
        self.read_in_order([])

    def read_in_order(self, columns: list[Part]) -> None:
        """Say in which order columns will be wanted, each as often as it will be, and from which row group on."""
        self._uses = Counter(columns)
        self._order = list(self._uses)
        self._place = {index: place for place, index in enumerate(self._order)}
        self._next = 0
        self._read_ahead: dict[Part, pa.ChunkedArray] = {}

    @cached_property
    def file(self) -> pa_parquet.ParquetFile:
        far = isinstance(self.path, Remote)
        place = self.path.open_bytes() if isinstance(self.path, Remote) else self.path
        return pa_parquet.ParquetFile(place, metadata=self._about, read_dictionary=list(self.texts), pre_buffer=far)

    def column(self, index: int, first: int = 0) -> pa.ChunkedArray:
        """Return one column from row group `first` on; the next ones of the order are read with it, and kept while they
        will be wanted."""
        key = index, first
        if key not in self._read_ahead:
            wanted = [key]
            place = self._place.get(key, -1)
            rows = self.file.metadata.num_rows - self.begins[first]
            if place >= self._next:
                ahead = self._order[place:][: max(1, self._batch // max(8 * rows, 1))]
                wanted = list(takewhile(lambda other: other[1] == first, ahead))
                self._next = place + len(wanted)
                # what was left lying belongs to loops that could not be used, unless loops share it
                self._read_ahead = {k: c for k, c in self._read_ahead.items() if self._uses[k] > 1}
            wanted.sort()
            groups = list(range(first, self.file.metadata.num_row_groups))
            table = self.file.reader.read_row_groups(groups, column_indices=[i for i, _ in wanted], use_threads=False)
            self._read_ahead.update(zip(wanted, table.columns, strict=True))
        self._uses[key] -= 1
        return self._read_ahead[key] if self._uses[key] > 0 else self._read_ahead.pop(key)

    @cached_property
    def begins(self) -> list[int]:
        """The first row of each row group."""
        about = self.file.metadata
        return [0, *accumulate(about.row_group(group).num_rows for group in range(about.num_row_groups))][:-1]

    def pieces(self, index: int, first: int = 0) -> Iterator[pa.ChunkedArray]:
        """Yield one column row group by row group, from row group `first` on."""
        for group in range(first, self.file.metadata.num_row_groups):
            yield self.file.reader.read_row_groups([group], column_indices=[index], use_threads=False).column(0)

    def nulls(self, index: int) -> int:
        """Return how many cells of a column are empty, from the statistics in the file where it has them."""
        about = self.file.metadata
        count = 0
        for group in range(about.num_row_groups):
            said = about.row_group(group).column(index).statistics
            if said is None or not said.has_null_count:
                return int(self.column(index).null_count)
            count += said.null_count
        return count

    def __getstate__(self) -> dict[str, Any]:
        return {"path": self.path, "texts": self.texts}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]


class ParquetColumn(LazyColumn):
    """One column of a Parquet file, from row group `first` on."""

    def __init__(self, file: ParquetFileColumns, index: int, kind: pa.DataType, rows: int, first: int = 0) -> None:
        super().__init__(kind, rows)
        self.file, self.index, self.first = file, index, first

    @property
    def null_count(self) -> int:
        return self.file.nulls(self.index)

    def arrow(self) -> pa.ChunkedArray:
        return self.file.column(self.index, self.first)

    def slice(self, start: int, length: int) -> LazyColumn:
        """Return some rows; where they go to the end, older row groups are not read."""
        begins = self.file.begins
        if self.first or start + length < self.rows or not begins:
            return SlicedColumn(self, start, length)
        first = max(bisect_right(begins, start) - 1, 0)
        rest = ParquetColumn(self.file, self.index, self.type, self.rows - begins[first], first)
        return SlicedColumn(rest, start - begins[first], length)

    def number_parts(self) -> Iterator[NDArray[np.float64]]:
        """Yield the cells as numbers, some rows at a time."""
        return (to_numbers(piece).values for piece in self.file.pieces(self.index, self.first))
