"""Columns and stamps of a long record, some rows at a time, from where they are kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .columns import LazyColumn, SlicedColumn
from .csv_signal import ForeignText, Signal
from .parquet_columns import ParquetColumn
from .series import Axis, Cells, CutAxis, EvenAxis, LazyAxis
from .stored_columns import StoredColumn
from .tag_store import TagAxis

PIECE = 1 << 18  # rows looked at at once
MARGIN = 72  # samples around a sample that decide on it: the longest hole that is filled, or a run at the limit


class NotInPieces(Exception):
    """Something of the record has to be seen as a whole."""


@dataclass(frozen=True, eq=False)
class RawColumn:
    """Cells as a column store holds them: numbers, and nan with the code of a word in it. parts: gives the rows anew.

    words: by code; known when all parts have been gone through once. text: the column counts as text.
    """

    parts: Callable[[], Iterator[NDArray[np.float64]]]
    words: Callable[[], list[str]]
    text: bool
    decimal: str = "."


def raw_column(cells: Cells) -> RawColumn:
    """Return the cells of a column that stays where it is. Raises NotInPieces for any other."""
    column = cells.column
    if not isinstance(column, LazyColumn):
        raise NotInPieces
    if isinstance(column, SlicedColumn):
        base = raw_column(Cells(column.base, cells.decimal))
        return RawColumn(partial(_skipped, base.parts, column.start, column.rows), base.words, base.text, cells.decimal)
    if isinstance(column, StoredColumn):
        return RawColumn(column.number_parts, lambda: column.words, bool(column.words), cells.decimal)
    if not isinstance(column, ParquetColumn):
        raise NotInPieces
    kind = column.type
    if pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind):
        return RawColumn(column.number_parts, list, False)
    if pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_dictionary(kind):
        signal = Signal()
        return RawColumn(partial(_coded, column, signal), lambda: list(signal.words), True)
    raise NotInPieces


def _coded(column: ParquetColumn, signal: Signal) -> Iterator[NDArray[np.float64]]:
    for piece in column.file.pieces(column.index, column.first):
        out = np.empty(len(piece))
        try:
            signal.take(piece.cast(pa.string()), out, ".")
        except ForeignText:
            raise NotInPieces from None
        yield out


def stamp_parts(axis: Axis) -> Iterator[NDArray[np.int64]]:
    """Yield the stamps of an axis [microseconds since 1970 UTC], some rows at a time."""
    if isinstance(axis, EvenAxis):
        for first in range(0, axis.rows, PIECE):
            yield axis.start + axis.step * np.arange(first, min(first + PIECE, axis.rows))
    elif isinstance(axis, TagAxis):
        yield from axis.micro_parts()
    elif isinstance(axis, CutAxis):
        yield from _skipped(partial(stamp_parts, axis.base), axis.first, None)
    elif isinstance(axis, LazyAxis) and axis.pieces is not None:
        yield from axis.pieces()
    else:
        micros = axis.micros
        for first in range(0, len(micros), PIECE):
            yield micros[first : first + PIECE]


def _skipped(parts: Callable[[], Iterator[NDArray]], first: int, rows: int | None) -> Iterator[NDArray]:
    """Leave out the first rows, and what comes after so many."""
    left = np.inf if rows is None else rows
    for part in parts():
        if first >= len(part):
            first -= len(part)
            continue
        part = part[first : first + int(min(left, len(part)))]
        first, left = 0, left - len(part)
        if len(part):
            yield part
        if left <= 0:
            return


Piece = dict[str, NDArray]  # arrays of one length by name


def joined(pieces: Sequence[Piece]) -> Piece:
    """Put pieces together."""
    if len(pieces) == 1:
        return pieces[0]
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


def length(piece: Piece) -> int:
    """Number of rows of a piece."""
    return len(next(iter(piece.values())))


def cut(piece: Piece, first: int, last: int | None = None) -> Piece:
    """Return rows first..last-1 of a piece."""
    return {name: values[first:last] for name, values in piece.items()}


def in_blocks(pieces: Iterator[Piece], size: int | None = None) -> Iterator[Piece]:
    """Yield the rows of pieces, `size` of them (PIECE) at a time and the rest at the end."""
    size = size or PIECE
    waiting: list[Piece] = []
    count = 0
    for piece in pieces:
        waiting.append(piece)
        count += length(piece)
        if count < size:
            continue
        whole = joined(waiting)
        last = count // size * size
        for first in range(0, last, size):
            yield cut(whole, first, first + size)
        waiting, count = [cut(whole, last)] if last < count else [], count - last
    if count:
        yield joined(waiting)


def with_margins(pieces: Iterator[Piece], margin: int) -> Iterator[tuple[Piece, int, int]]:
    """Yield (piece, first, last): rows first..last-1 of each are new, up to `margin` rows around them are not."""
    blocks = in_blocks(pieces, max(PIECE, margin))
    before: list[Piece] = []
    following = next(blocks, None)
    while following is not None:
        block, following = following, next(blocks, None)
        first = length(before[0]) if before else 0
        after = [] if following is None else [cut(following, 0, margin)]
        whole = joined([*before, block, *after])
        last = first + length(block)
        yield whole, first, last
        before = [cut(whole, max(last - margin, 0), last)]


def in_step(streams: Sequence[Iterator[NDArray]], size: int | None = None) -> Iterator[tuple[NDArray, ...]]:
    """Yield rows of several streams of arrays together, `size` of them (PIECE) at a time and the rest at the end.

    Raises NotInPieces when they are not of one length.
    """
    size = size or PIECE
    waiting: list[list[NDArray]] = [[] for _ in streams]
    while True:
        counts = []
        for stream, kept in zip(streams, waiting, strict=True):
            count = sum(map(len, kept))
            while count < size and (part := next(stream, None)) is not None:
                kept.append(part)
                count += len(part)
            counts.append(count)
        if len({min(count, size) for count in counts}) > 1:
            raise NotInPieces
        joined = [kept[0] if len(kept) == 1 else np.concatenate(kept) for kept in waiting if kept]
        if not counts[0]:
            return
        yield tuple(whole[:size] for whole in joined)
        waiting = [[whole[size:]] if len(whole) > size else [] for whole in joined]
        if counts[0] < size:
            return
