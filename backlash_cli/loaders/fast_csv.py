"""Wide CSV of any size: blocks of lines parsed one after the other or several at once, into the store.

Blocks of plain numbers go through the compiled parser, all others through pyarrow. The result is the table that
pyarrow would make of the whole file, with columns that are read when a loop needs them. Signals are asked for as
numbers; a block in which one holds text is parsed once more, and from there on that column counts as text. Where the
table of the whole file would differ (text that is not UTF-8, stamps of changing kinds), `read_blocks` returns None, and
the caller reads the file whole.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
from numpy.typing import NDArray

from .columns import LazyColumn
from .csv_signal import ForeignText, Signal
from .dialect import Dialect
from .even import EvenStamps, dated
from .files import valid_utf8
from .hourly_stamps import HourlyStamps, Hours, StoredHours, as_written, by_texts
from .minutes import is_written
from .plain_csv import PlainBlock, PlainLines
from .store import ColumnStore, Room
from .stored_columns import StoredColumn
from .text_blocks import EndlessLine, Lines

BLOCK = 8 << 20  # bytes of text per block


@dataclass
class Block:
    """One block of lines. columns: by number, those of signals not where `plain` has them. bad: (row from 1, cells
    expected, cells found) of rows of wrong width."""

    columns: dict[int, pa.ChunkedArray | HourlyStamps]
    bad: list[tuple[int, int, int]]
    rows: int
    size: int
    plain: PlainBlock | None = None


@dataclass
class Layout:
    """What is read of a CSV. stored: columns of signals, in the order of the store. stamps: columns of time stamps.

    texts: stored columns in which text has been seen so far. by_hours: whether stamps may be taken apart. as_dates:
    whether texts that begin with a year may be read as stamps.
    """

    dialect: Dialect
    convert: pa_csv.ConvertOptions
    stored: list[int]
    stamps: list[int]
    texts: set[int] = field(default_factory=set)
    by_hours: bool = False
    as_dates: bool = False

    @cached_property
    def lines(self) -> PlainLines:
        return PlainLines(self.dialect, self.convert, self.stored, self.stamps, self.by_hours)

    def parse(self, text: Lines) -> Block:
        """Parse whole lines. Raises ForeignText."""
        plain = self.lines.parse(text)
        if plain is not None:
            return Block(plain.stamps, [], plain.piece.shape[1], len(text), plain)
        if not valid_utf8(memoryview(text.text)):
            raise ForeignText
        try:
            return self._parse(text, self.texts)
        except pa.ArrowInvalid:
            try:
                block = self._parse(text, set(self.stored))
            except pa.ArrowInvalid:
                raise ForeignText from None
            for column in set(self.stored) - self.texts:  # one of them holds the text
                with contextlib.suppress(pa.ArrowInvalid):
                    block.columns[column] = pc.cast(pc.utf8_trim_whitespace(block.columns[column]), pa.float64())
            return block

    def _parse(self, text: Lines, texts: set[int]) -> Block:
        bad: list[tuple[int, int, int]] = []

        def on_bad_row(row: pa_csv.InvalidRow) -> str:
            bad.append((row.number, row.expected_columns, row.actual_columns))
            return "skip"

        names = [f"c{i}" for i in range(len(self.dialect.names))]
        given = self.convert
        table = pa_csv.read_csv(
            text.buffer(),
            read_options=pa_csv.ReadOptions(column_names=names, use_threads=False, block_size=len(text) + 1),
            parse_options=pa_csv.ParseOptions(delimiter=self.dialect.delimiter, invalid_row_handler=on_bad_row),
            convert_options=pa_csv.ConvertOptions(
                decimal_point=given.decimal_point, null_values=given.null_values, quoted_strings_can_be_null=True,
                auto_dict_encode=True, auto_dict_max_cardinality=given.auto_dict_max_cardinality,
                true_values=given.true_values, false_values=given.false_values,
                column_types={names[i]: pa.string() if i in texts else pa.float64() for i in self.stored},
                include_columns=[names[i] for i in (*self.stored, *self.stamps)],
                strings_can_be_null=True,
            ),
        )
        columns = dict(zip((*self.stored, *self.stamps), table.columns, strict=True))
        return Block(columns, bad, table.num_rows, len(text))


def read_blocks(
    blocks: Iterator[Lines], layout: Layout, kinds: list[pa.DataType], *, room: Room | None = None, threads: int = 1,
    progress: Callable[[int], None] | None = None,
) -> tuple[list[LazyColumn | pa.ChunkedArray], list[tuple[int, int, int]]] | None:
    """Read the text below the header. Returns all columns and the rows of wrong width; None: read the file whole.

    kinds: types of all columns in the first lines, for those that are not stored. progress: called with the bytes of
    each block.
    """
    room = room or Room()
    signals = [Signal() for _ in layout.stored]
    store = ColumnStore(room)
    stamps = [_Stamps(room, layout.as_dates) for _ in layout.stamps]
    bad: list[tuple[int, int, int]] = []
    rows = 0
    try:
        for block in parsed_blocks(blocks, layout, threads):
            piece = piece_of(block, signals, layout)
            for parts, column in zip(stamps, layout.stamps, strict=True):
                parts.add(block.columns[column])
            store.add(piece)
            bad += [(rows + number, expected, found) for number, expected, found in block.bad]
            rows += block.rows + len(block.bad)
            if progress is not None:
                progress(block.size)
        times = {column: parts.column() for column, parts in zip(layout.stamps, stamps, strict=True)}
    except (ForeignText, EndlessLine):
        return None
    place = {column: slot for slot, column in enumerate(layout.stored)}
    columns: list[LazyColumn | pa.ChunkedArray] = []
    for column, kind in enumerate(kinds):
        if column in times:
            columns.append(times[column])
        elif column in place:
            signal = signals[place[column]]
            columns.append(StoredColumn(store, place[column], list(signal.words), empty=not signal.filled))
        else:
            columns.append(LazyColumn(kind, store.rows))
    return columns, bad


def piece_of(block: Block, signals: list[Signal], layout: Layout) -> NDArray[np.float64]:
    """Return the cells of a block as the store takes them, (signals, rows). Raises ForeignText."""
    decimal = layout.dialect.decimal
    if block.plain is None:
        piece = np.empty((len(signals), block.rows))
        for signal, column, out in zip(signals, layout.stored, piece, strict=True):
            signal.take(block.columns[column], out, decimal)
            if signal.words:
                layout.texts.add(column)
        return piece
    piece = block.plain.piece
    for signal, out in zip(signals, piece, strict=True):
        if not signal.filled:
            signal.filled = bool(np.count_nonzero(out == out))
    for slot, words in block.plain.words.items():
        signals[slot].take_words(words, piece[slot], decimal)
        if signals[slot].words:
            layout.texts.add(layout.stored[slot])
    return piece


def parsed_blocks(blocks: Iterator[Lines], layout: Layout, threads: int) -> Iterator[Block]:
    """Parse blocks in order; with several threads the next ones are parsed while this one is taken."""
    if threads <= 1:
        yield from map(layout.parse, blocks)
        return
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[Block]] = deque()
        try:
            for text in blocks:
                waiting.append(pool.submit(layout.parse, text))
                if len(waiting) > threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


class _Stamps:
    """A column of time stamps on its way through the blocks. as_dates: as in Layout."""

    def __init__(self, room: Room, as_dates: bool) -> None:
        self._even = EvenStamps(room)
        self._written: StoredHours | None = None
        self._room, self._as_dates = room, as_dates

    def add(self, part: pa.ChunkedArray | HourlyStamps) -> None:
        """Take the stamps of the next block. Raises ForeignText."""
        if not len(part):
            return
        if not isinstance(part, HourlyStamps) and is_written(part.type):
            part = dated(part) if self._as_dates else part
            if is_written(part.type):
                part = HourlyStamps([by_texts(part, self._as_dates)])
        if isinstance(part, HourlyStamps):
            if self._even.column is not None:
                raise ForeignText
            self._written = self._written or StoredHours(self._room)
            for hours in (*map(_text, self._even.parts), *part.parts):
                self._written.add(hours)
            self._even = EvenStamps()
        elif self._written is not None:
            self._written.add(_text(part))
        else:
            self._even.add(part)

    def column(self) -> pa.ChunkedArray | LazyColumn:
        """Return all stamps. Raises ForeignText."""
        if self._written is not None:
            return self._written
        return self._even.column or _unified(self._even.parts)


def _text(part: pa.ChunkedArray) -> Hours:
    if not pa.types.is_null(part.type):
        raise ForeignText
    return as_written(part)


def _unified(parts: list[pa.ChunkedArray]) -> pa.ChunkedArray:
    """One column from the parts of its blocks. Raises ForeignText when they are of different kinds."""
    parts = [part for part in parts if len(part)]
    kinds = {part.type for part in parts if not pa.types.is_null(part.type)}
    if not kinds:
        return pa.chunked_array([chunk for part in parts for chunk in part.chunks], pa.null())
    kind = next(iter(kinds))
    if len(kinds) > 1:
        if all(pa.types.is_timestamp(k) and k.tz is None for k in kinds):
            kind = pa.timestamp("ns")
        elif all(pa.types.is_integer(k) or pa.types.is_floating(k) for k in kinds):
            kind = pa.float64()
        else:
            raise ForeignText
    try:
        return pa.chunked_array([chunk for part in parts for chunk in pc.cast(part, kind).chunks], kind)
    except pa.ArrowException:
        raise ForeignText from None
