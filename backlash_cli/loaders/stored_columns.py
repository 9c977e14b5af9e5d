"""The columns of a CSV in the column store: numbers, and words among them as codes in the bits of nan."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Protocol

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .columns import LazyColumn
from .numbers import Numbers, as_texts, main_unit, parse_words, words_that_occur

TAG = 0x7FF8_0000_0000_0000  # bits of nan, an empty cell; a word has its code plus one added


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
