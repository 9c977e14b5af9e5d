"""Rows of many tags as a long file has them, kept in bounded memory and given back tag by tag."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..record import Note
from .series import Axis
from .store import ColumnStore, Room
from .times import NAT, Times

GATHERED = 1 << 20  # rows that are sorted by tag at once
STAMP, VALUE = 0, 1  # fields of a row; further ones after them
Decode = Callable[[NDArray[np.float64]], NDArray[np.int64]]


class TagStore:
    """Takes rows as they come: a tag by its code, a stamp, values; gives them back by tag, in the order they came.

    Some rows are gathered, sorted by tag and put into a column store, so that the rows of a tag lie together.
    """

    def __init__(self, room: Room | None = None) -> None:
        self._store = ColumnStore(room)
        self._waiting: list[tuple[NDArray[np.int32], list[NDArray[np.float64]]]] = []
        self._rows = 0
        self.fields = 0
        self._starts: list[NDArray[np.int32]] = []  # of each piece: the first row of each code, and the end

    def add(self, codes: NDArray[np.int32], fields: Sequence[NDArray[np.float64]]) -> None:
        """Take the next rows; codes: (rows,), those below 0 are dropped. fields: (rows,) each, stamps first."""
        keep = codes >= 0
        if not keep.all():
            codes, fields = codes[keep], [field[keep] for field in fields]
        if not len(codes):
            return
        self._waiting.append((codes, list(fields)))
        self._rows += len(codes)
        if self._rows >= GATHERED:
            self.cut()

    def cut(self) -> int:
        """End the piece here, and return the number of the next one."""
        if self._rows:
            codes = np.concatenate([codes for codes, _ in self._waiting])
            counts = np.bincount(codes)
            order = np.argsort(codes.astype(np.int16) if len(counts) < 1 << 15 else codes, kind="stable")
            self.fields = len(self._waiting[0][1])
            piece = np.empty((self.fields, len(codes)))
            for slot, out in enumerate(piece):
                np.take(np.concatenate([fields[slot] for _, fields in self._waiting]), order, out=out)
            self._waiting, self._rows = [], 0
            self._store.add(piece)
            self._starts.append(np.concatenate([[0], np.cumsum(counts)]).astype(np.int32))
        return self._store.pieces

    def tag(self, code: int) -> TagRows:
        """Return the rows of one tag, once all are taken."""
        found = [(number, int(starts[code]), int(starts[code + 1] - starts[code]))
                 for number, starts in enumerate(self._starts) if code + 1 < len(starts)]
        parts = [part for part in found if part[2]]
        return TagRows(self._store, np.array(parts, np.int64).reshape(-1, 3))


class TagRows:
    """The rows of one tag in a store, as a ColumnStore of their own. parts: (parts, 3) piece, first row, rows."""

    def __init__(self, store: ColumnStore, parts: NDArray[np.int64]) -> None:
        self._store, self._parts = store, parts
        self.rows = int(parts[:, 2].sum())

    def column(self, slot: int) -> NDArray[np.float64]:
        """Return all rows of one field, a new array."""
        return np.concatenate([np.empty(0), *self.parts(slot)])

    def parts(self, slot: int) -> Iterator[NDArray[np.float64]]:
        """Yield the rows of one field piece by piece."""
        return (part for _, part in self.numbered(slot))

    def numbered(self, slot: int) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """Yield the rows of one field with the number of each piece."""
        return ((number, self._store.part(number, slot, first, rows)) for number, first, rows in self._parts.tolist())


@dataclass(frozen=True)
class Clock:
    """How the stamps of a long file are read. last: the last stamp of all rows [microseconds since 1970 UTC].

    moved: (number of a piece, microseconds): from there on the stamps are later by them.
    """

    decode: Decode
    times: Times
    last: int
    moved: tuple[tuple[int, int], ...] = ()
    notes: tuple[Note, ...] = ()


class TagAxis(Axis):
    """The stamps of one tag, read anew each time."""

    def __init__(self, rows: TagRows, clock: Clock, where: str) -> None:
        self.rows, self.clock, self.where = rows, clock, where
        self.absolute, self.zoned = clock.times.absolute, clock.times.zoned
        self.notes = (*clock.times.notes, *clock.notes)
        self.first_line, self.parts = 0, ()
        self._order, self._grid = None, None

    @property
    def micros(self) -> NDArray[np.int64]:  # type: ignore[override]
        """(rows,) microseconds since 1970 UTC, made anew each time."""
        return np.concatenate([np.empty(0, np.int64), *self.micro_parts()])

    def micro_parts(self) -> Iterator[NDArray[np.int64]]:
        """Yield the stamps piece by piece."""
        for number, part in self.rows.numbered(STAMP):
            micros = self.clock.decode(part)
            later = sum(by for first, by in self.clock.moved if number >= first)
            yield micros + later if later else micros

    def forget(self) -> None:
        """Give back the memory of what can be found out again, of the one tag that has these stamps."""
        self._order = self._grid = None

    def last(self) -> int | None:
        """Return the last stamp of all tags of the file."""
        return None if self.clock.last == NAT else self.clock.last
