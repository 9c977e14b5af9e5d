"""Blocks of wide CSV that hold plain numbers, stamps and now and then a word, taken by the compiled parser."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
from numpy.typing import NDArray

from .arrays import to_array, to_column
from .dialect import Dialect
from .files import valid_utf8
from .hourly_stamps import HourlyStamps, Hours
from .text_blocks import Lines

LEAST = 1 << 16  # bytes of a block below which compiled code is not worth loading
MOST_WORDS = 20_000  # in a block, counted where a column changes from one word to another
MOST_FAILURES = 3  # blocks after which it is not tried any more
ROWS_AN_HOUR = 4  # fewer: then each stamp is better read by itself


@dataclass
class PlainBlock:
    """piece: (slots, rows) float64. stamps: by column. words: slot -> (bits that stand for it, the row from which
    on they do, the word)."""

    piece: NDArray[np.float64]
    stamps: dict[int, pa.ChunkedArray | HourlyStamps]
    words: dict[int, list[tuple[int, int, str]]]


@dataclass
class PlainLines:
    """The compiled parser for one file. stored, stamps: numbers of its columns, as in fast_csv.Layout.

    by_hours: whether stamps may be taken apart at the minutes.
    """

    dialect: Dialect
    convert: pa_csv.ConvertOptions
    stored: list[int]
    stamps: list[int]
    by_hours: bool = False
    failures: int = field(default=0)

    def parse(self, text: Lines) -> PlainBlock | None:
        """Parse whole lines; None where they hold anything that a full CSV reader has to look at."""
        if len(text) < LEAST or self.failures >= MOST_FAILURES:
            return None
        found = self._parse(text)
        self.failures = 0 if found is not None else self.failures + 1
        return found

    def _parse(self, text: Lines) -> PlainBlock | None:
        from .csv_kernel import DONE, EVENT, SKIP, STAMP, look, parse_lines
        from .decimal_kernel import FIVES, TENS, WHOLE_TENS

        lines, ascii_only = look(text.text)
        if not ascii_only and not valid_utf8(memoryview(text.text)):
            return None
        slots = np.full(len(self.dialect.names), SKIP)
        slots[self.stored] = np.arange(len(self.stored))
        slots[self.stamps] = STAMP
        bits = np.empty((len(self.stored), lines), np.uint64)
        stamps = np.empty((lines, len(self.stamps), 2), np.int64)
        words, last = np.empty((MOST_WORDS, 4), np.int64), np.full(len(self.stored), -1)
        rows, count, ended = parse_lines(
            text.data, len(text), slots, ord(self.dialect.delimiter), ord(self.dialect.decimal), bits, stamps, words,
            last, TENS, WHOLE_TENS, FIVES
        )
        if ended != DONE or rows != lines:
            return None
        found: dict[int, list[tuple[int, int, str]]] = defaultdict(list)
        for event, (slot, start, end, row) in enumerate(words[:count].tolist()):
            word = text.data[start:end].tobytes().decode()
            if _is_float(word):  # inf, nan, or a number in a form that only pyarrow knows
                return None
            found[slot].append((EVENT + event, row, word))
        read = self._stamps(text, stamps) if self.stamps else {}
        return None if read is None else PlainBlock(bits.view(np.float64), read, found)

    def _stamps(
        self, text: Lines, cells: NDArray[np.int64]
    ) -> dict[int, pa.ChunkedArray | HourlyStamps] | None:
        """Return the columns of stamps whose cells stand at these places of the text."""
        from .stamp_kernel import copy_cells

        if len(self.stamps) == 1 and self.by_hours:
            column = self._by_hours(text, cells[:, 0])
            if column is not None:
                return {self.stamps[0]: column}
        out = np.empty(int((cells[:, :, 1] - cells[:, :, 0]).sum()) + cells[:, :, 0].size, np.uint8)
        table = self._read(out[: copy_cells(text.data, cells, ord(self.dialect.delimiter), out)])
        return dict(zip(self.stamps, table.columns, strict=True)) if table.num_rows == len(cells) else None

    def _by_hours(self, text: Lines, cells: NDArray[np.int64]) -> pa.ChunkedArray | HourlyStamps | None:
        """Read one stamp per hour and add what the others are later; None where that cannot be done."""
        from .stamp_kernel import NOT_ONE_FORM, hours_apart

        most = len(cells) // ROWS_AN_HOUR + 1
        which, nanos = np.empty(len(cells), np.int64), np.empty(len(cells), np.int64)
        hours = np.empty(64 * most, np.uint8)
        groups, written = hours_apart(text.data, cells, most, which, nanos, hours)
        if groups == NOT_ONE_FORM:
            return None
        column = self._read(hours[:written]).column(0)
        if len(column) != groups or column.null_count:
            return None
        kind = column.type
        if pa.types.is_timestamp(kind):
            later = nanos // 1_000_000_000 if kind.unit == "s" else nanos
            stamps = to_array(column.cast(pa.int64()))[which] + later
            return pa.chunked_array([to_column(stamps, kind)])
        if pa.types.is_dictionary(kind) or pa.types.is_string(kind):
            return HourlyStamps([Hours(pc.cast(column, pa.string()).combine_chunks(), which, nanos)])
        return None

    def _read(self, text: NDArray[np.uint8]) -> pa.Table:
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
