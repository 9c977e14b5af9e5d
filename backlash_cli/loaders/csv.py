"""Text tables in blocks: pyarrow reads the bulk, this module only tells it where the data begin and what to keep."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import pyarrow as pa
import pyarrow.csv as pa_csv

from ..errors import InputError
from ..record import Note
from .layouts import Head
from .numbers import BLANK, is_number, is_text
from .opening import Text
from .sniff import Dialect, find_dialect

BLOCK = 8 << 20  # bytes of text that are read at once
MAX_COLUMNS = 100_000
Batch = dict[int, pa.ChunkedArray]


class TextTable:
    """A text file as a table: its first rows, then all of it in batches of columns."""

    def __init__(self, text: Text, stem: str, where: str, partition: dict[str, str] | None = None) -> None:
        self.text, self.where = text, where
        self.dialect: Dialect = find_dialect(text.head, text.complete, text.options, where)
        if len(self.dialect.names) > MAX_COLUMNS:
            raise InputError(f"{len(self.dialect.names)} columns are too many", where=where)
        begun = text.head[self.dialect.offset :]
        if not text.complete:
            begun = begun[: begun.rfind(b"\n") + 1] or begun
        self._bad: list[tuple[int | None, int, int]] = []
        first = self._parsed(begun, None, threads=False)
        if first.num_rows == 0:
            raise InputError("no rows of data below the header", where=where, remedy="export it again with samples")
        self.head = Head(where, stem, self.dialect.names, tuple(first.columns), self.dialect.decimal,
                         self.dialect.line, partition=partition or {}, kinds=self.dialect.kinds)
        self._first = first if text.complete else None
        self._first_bad = self._bad[0][0] if self._bad else None  # rows are numbered where one thread reads them

    def batches(self, columns: Collection[int], stamps: Collection[int]) -> Iterator[Batch]:
        """Yield the columns that are asked for, some rows at a time; to be called once. stamps: columns of stamps."""
        if self._first is not None:
            yield {i: self._first.column(i) for i in {*columns, *stamps}}
            return
        self._bad = []
        types = {i: self._type(i, i in stamps) for i in {*columns, *stamps}}
        for block in self.text.blocks(self.dialect.offset, BLOCK):
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
        first = self._first_bad
        line = "" if first is None else f", the first is line {self.dialect.line + first - 1}"
        _, expected, found = self._bad[0]
        return [*self.text.notes, Note(
            "ragged_rows", f"{len(self._bad)} rows have too few or too many cells and were dropped{line} "
            f"({found} columns instead of {expected})", {"rows": float(len(self._bad)), "file": self.where})]

    def _type(self, column: int, stamps: bool) -> pa.DataType | None:
        """The type in which a column is read: as its first rows are, numbers as float64 and words as a dictionary."""
        kind = self.head.columns[column].type
        if stamps:
            text = is_text(kind) or "%" in (self.text.options.time_format or "")
            return pa.dictionary(pa.int32(), pa.string()) if text else None if pa.types.is_null(kind) else kind
        if is_text(kind):
            return pa.dictionary(pa.int32(), pa.string())
        return pa.float64() if is_number(kind) or pa.types.is_null(kind) else pa.string()

    def _parsed(self, block: bytes, types: dict[int, pa.DataType | None] | None, threads: bool = True) -> pa.Table:
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
