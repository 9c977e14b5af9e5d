"""Blocks of wide CSV that hold plain numbers, stamps and now and then a word, taken by the compiled parser."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from numpy.typing import NDArray

from .dialect import Dialect

LEAST = 1 << 16  # bytes of a block below which compiled code is not worth loading
MOST_WORDS = 20_000  # in a block, counted where a column changes from one word to another
MOST_FAILURES = 3  # blocks after which it is not tried any more


@dataclass
class PlainBlock:
    """piece: (slots, rows) float64. stamps: by column. words: slot -> (bits that stand for it, the word)."""

    piece: NDArray[np.float64]
    stamps: dict[int, pa.ChunkedArray]
    words: dict[int, list[tuple[int, str]]]


@dataclass
class PlainLines:
    """The compiled parser for one file. stored, stamps: numbers of its columns, as in fast_csv.Layout."""

    dialect: Dialect
    convert: pa_csv.ConvertOptions
    stored: list[int]
    stamps: list[int]
    failures: int = field(default=0)

    def parse(self, text: bytes) -> PlainBlock | None:
        """Parse whole lines; None where they hold anything that a full CSV reader has to look at."""
        if len(text) < LEAST or self.failures >= MOST_FAILURES:
            return None
        found = self._parse(text)
        self.failures = 0 if found is not None else self.failures + 1
        return found

    def _parse(self, text: bytes) -> PlainBlock | None:
        from .csv_kernel import DONE, EVENT, FIVES, SKIP, STAMP, TENS, count_lines, parse_lines

        text = text if text.endswith(b"\n") else text + b"\n"
        slots = np.full(len(self.dialect.names), SKIP)
        slots[self.stored] = np.arange(len(self.stored))
        slots[self.stamps] = STAMP
        data = np.frombuffer(text, np.uint8)
        lines = count_lines(data)
        bits = np.empty((len(self.stored), lines), np.int64)
        stamps = np.empty(len(text) + lines if self.stamps else 0, np.uint8)
        words = np.empty((MOST_WORDS, 3), np.int64)
        rows, written, count, ended = parse_lines(
            data, slots, ord(self.dialect.delimiter), ord(self.dialect.decimal), bits, stamps, words, TENS, FIVES
        )
        if ended != DONE or rows != lines:
            return None
        found: dict[int, list[tuple[int, str]]] = defaultdict(list)
        for event, (slot, start, end) in enumerate(words[:count].tolist()):
            word = text[start:end].decode()
            if _is_float(word):  # inf, nan, or a number in a form that only pyarrow knows
                return None
            found[slot].append((EVENT + event, word))
        if not self.stamps:
            return PlainBlock(bits.view(np.float64), {}, found)
        table = self._stamps(stamps[:written])
        if table.num_rows != rows:
            return None
        return PlainBlock(bits.view(np.float64), dict(zip(self.stamps, table.columns, strict=True)), found)

    def _stamps(self, text: NDArray[np.uint8]) -> pa.Table:
        given = self.convert
        return pa_csv.read_csv(
            pa.BufferReader(pa.py_buffer(text)),
            read_options=pa_csv.ReadOptions(column_names=[f"c{i}" for i in self.stamps], use_threads=False,
                                            block_size=len(text) + 1),
            parse_options=pa_csv.ParseOptions(delimiter=self.dialect.delimiter),
            convert_options=pa_csv.ConvertOptions(
                decimal_point=given.decimal_point, null_values=given.null_values, quoted_strings_can_be_null=True,
                auto_dict_encode=True, auto_dict_max_cardinality=given.auto_dict_max_cardinality,
                true_values=given.true_values, false_values=given.false_values, strings_can_be_null=True,
            ),
        )


def _is_float(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
