"""Columns that stay where they are until a loop asks for them: of a Parquet file, or of a CSV in the column store."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator
from functools import cached_property
from itertools import accumulate, takewhile
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pa_parquet
from numpy.typing import NDArray

from .numbers import Numbers, as_texts, codes_and_words, main_unit, parse_words, to_numbers, words_that_occur
from .places import Remote

TAG = 0x7FF8_0000_0000_0000  # bits of nan, an empty cell; a word has its code plus one added


class LazyColumn:
    """A column of a table that is read when it is used, each time anew; itself one that no loop needs.

    type: its Arrow type. rows: how many cells it has.
    """

    def __init__(self, kind: pa.DataType, rows: int) -> None:
        self.type, self.rows = kind, rows

    def __len__(self) -> int:
        return self.rows

    @property
    def null_count(self) -> int:
        """Number of empty cells, as far as it matters: all or not all."""
        return self.rows if pa.types.is_null(self.type) else 0

    def arrow(self) -> pa.ChunkedArray:
        """Return the column as Arrow holds it."""
        return pa.chunked_array([pa.nulls(self.rows, self.type)])

    def slice(self, start: int, length: int) -> LazyColumn:
        """Return some rows, which are read when they are used."""
        return SlicedColumn(self, start, length)

    def numbers(self, decimal: str) -> Numbers:
        """Return the cells as numbers, as `to_numbers` does."""
        return to_numbers(self.arrow(), decimal)

    def texts(self) -> tuple[NDArray[np.int64], list[str]]:
        """Return (codes, words) of a text column, as `codes_and_words` does."""
        return codes_and_words(self.arrow())


class SlicedColumn(LazyColumn):
    """Some rows of a column."""

    def __init__(self, base: LazyColumn, start: int, length: int) -> None:
        super().__init__(base.type, min(length, len(base) - start))
        self.base, self.start = base, start

    def arrow(self) -> pa.ChunkedArray:
        return self.base.arrow().slice(self.start, self.rows)

    def texts(self) -> tuple[NDArray[np.int64], list[str]]:
        codes, words = self.base.texts()
        return words_that_occur(codes[self.start : self.start + self.rows], words)

    def numbers(self, decimal: str) -> Numbers:
        if not pa.types.is_floating(self.type):
            return super().numbers(decimal)
        return Numbers(self.base.numbers(decimal).values[self.start : self.start + self.rows])


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


def word_codes(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the code of the word of each stored cell, -1 for numbers and empty cells."""
    return np.where(np.isnan(values), values.view(np.int64) - (TAG + 1), -1)


def word_counts(values: NDArray[np.float64], words: int) -> NDArray[np.int64]:
    """Count the words of stored cells by their codes."""
    codes = word_codes(values)
    return np.bincount(codes[codes >= 0], minlength=words)


class WordReading:
    """What the words of a column mean as numbers; counts: how often each stands there.

    tally: words that are no good numbers, counted. unit: the unit behind most of the others.
    """

    def __init__(self, words: list[str], counts: NDArray[np.int64], decimal: str) -> None:
        self._found, self._bad, units = parse_words(words, decimal)
        self.unit, foreign = main_unit([u if c else "" for u, c in zip(units, counts, strict=True)], counts)
        self._bad |= foreign
        self._found[self._bad] = np.nan
        there = [i for i in np.flatnonzero(self._bad) if counts[i]]
        self.tally = Counter({words[i].strip()[:40]: int(counts[i]) for i in there})

    def apply(self, values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return (numbers, bad) of stored cells."""
        codes = word_codes(values)
        said = codes >= 0
        out = values.copy()
        out[said] = self._found[codes[said]]
        return out, np.append(self._bad, False)[codes]


class Stored(Protocol):
    """Columns of float64 that a StoredColumn reads: a ColumnStore, or the rows of a tag in one."""

    rows: int

    def column(self, slot: int) -> NDArray[np.float64]:
        """Return all rows of one column, a new array."""

    def parts(self, slot: int) -> Iterator[NDArray[np.float64]]:
        """Yield the rows of one column piece by piece."""


class StoredColumn(LazyColumn):
    """One column of a CSV in the store. words: what stood where no plain number stood, in the order of its codes.

    A column with words is text, as Arrow would see it: all its cells count as texts then, also the plain numbers.
    """

    def __init__(self, store: Stored, slot: int, words: list[str], empty: bool) -> None:
        self.store, self.slot = store, slot
        self.words = words
        kind = pa.dictionary(pa.int32(), pa.string()) if words else pa.null() if empty else pa.float64()
        super().__init__(kind, store.rows)

    def numbers(self, decimal: str) -> Numbers:
        values = self.store.column(self.slot)
        if not self.words:
            return Numbers(values)
        reading = WordReading(self.words, word_counts(values, len(self.words)), decimal)
        values, flags = reading.apply(values)
        return Numbers(values, flags if flags.any() else None, reading.tally, reading.unit)

    def number_parts(self) -> Iterator[NDArray[np.float64]]:
        """Yield the cells as numbers, some rows at a time; only of a column without words."""
        return self.store.parts(self.slot)

    def texts(self) -> tuple[NDArray[np.int64], list[str]]:
        values, lengths = _runs(self.store.column(self.slot))
        codes = word_codes(values)
        number = ~np.isnan(values)
        codes, words = words_that_occur(codes, self.words)
        if number.any():
            distinct, place = np.unique(values[number], return_inverse=True)
            codes[number] = place + len(words)
            words += as_texts(distinct)
        return codes if lengths is None else np.repeat(codes, lengths), words

    def arrow(self) -> pa.ChunkedArray:
        if pa.types.is_null(self.type):
            return pa.chunked_array([pa.nulls(len(self))])
        if not self.words:
            values = self.store.column(self.slot)
            empty = values.view(np.int64) == TAG
            return pa.chunked_array([pa.array(values, mask=empty if empty.any() else None)])
        codes, words = self.texts()
        coded = pa.DictionaryArray.from_arrays(pa.array(codes.astype(np.int32), mask=codes < 0), pa.array(words))
        return pa.chunked_array([coded])


def _runs(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64] | None]:
    """Return one value of each run of the same bits, and how long it is; all values and None where runs are short."""
    bits = values.view(np.int64)
    starts = np.flatnonzero(bits[1:] != bits[:-1]) + 1
    if len(starts) > len(values) // 8:
        return values, None
    starts = np.concatenate([[0], starts]) if len(values) else starts
    return values[starts], np.diff(np.append(starts, len(values)))
