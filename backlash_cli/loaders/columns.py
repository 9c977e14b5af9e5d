"""Columns that stay where they are until a loop asks for them: what all kinds of them have."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .numbers import Numbers, codes_and_words, to_numbers, words_that_occur


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
