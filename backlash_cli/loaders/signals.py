"""One recorded signal: its stamps and cells and where they lie; they are read when a loop asks for them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray, Note
from .numbers import foreign_units, parse_words
from .order import NAT
from .scratch import Room, Store

PIECE = 1 << 20  # rows that are looked at together


@dataclass(frozen=True, eq=False)
class Lexicon:
    """Texts that stand in a column, by their numbers; read as numbers once for all that share them."""

    words: list[str]
    decimal: str = "."

    @cached_property
    def parsed(self) -> tuple[FloatArray, NDArray[np.bool_], list[str]]:
        return parse_words(self.words, self.decimal)


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of a column. values: (rows,) the number in each, nan where there is none. codes: (rows,) place in the
    lexicon of the text in each, -1 where there is none; None where the column holds no text at all."""

    values: FloatArray
    codes: NDArray[np.int32] | None = None
    lexicon: Lexicon = field(default_factory=lambda: Lexicon([]))

    @cached_property
    def _used(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """(places in the lexicon of the texts that occur, rows that hold one, its place among those)"""
        rows = np.flatnonzero(np.zeros(0) if self.codes is None else self.codes >= 0)
        used, which = np.unique(rows if self.codes is None else self.codes[rows], return_inverse=True)
        return used, rows, which

    @property
    def is_text(self) -> bool:
        return len(self._used[0]) > 0

    def numbers(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return (values, bad): the cells as numbers, nan where there is none, and True where something stands that is
        no good number (a digital state, inf); a blank cell is not bad."""
        if not self.is_text:
            return self.values, np.zeros(len(self.values), bool)
        used, rows, which = self._used
        values, bad, units = self.lexicon.parsed
        wrong = bad[used] | foreign_units([units[i] for i in used], np.bincount(which, minlength=len(used)))
        out = np.where(np.isfinite(self.values), self.values, np.nan)
        out[rows] = np.where(wrong, np.nan, values[used])[which]
        flags = np.isinf(self.values)
        flags[rows] = wrong[which]
        return out, flags

    def words(self, rows: NDArray[np.bool_], within: slice) -> Counter[str]:
        """Count the texts in rows that are True, of some rows in a row."""
        found: Counter[str] = Counter()
        if self.codes is not None:
            codes, counts = np.unique(self.codes[within][rows[within]], return_counts=True)
            for code, count in zip(codes.tolist(), counts.tolist(), strict=True):
                if code >= 0:
                    found[self.lexicon.words[code].strip()[:40]] += count
        return found

    def texts(self) -> tuple[IntArray, list[str]]:
        """Return (codes, words): the text of each cell, numbers as text too; -1 for an empty cell."""
        used, rows, which = self._used
        words = [self.lexicon.words[i] for i in used]
        codes = np.full(len(self.values), -1)
        codes[rows] = which
        known = np.flatnonzero(~np.isnan(self.values) & (codes < 0))
        values, which = np.unique(self.values[known], return_inverse=True)
        codes[known] = which + len(words)
        # whole ones without a point
        return codes, [*words, *(f"{v:.0f}" if v == np.rint(v) and abs(v) < 1e15 else repr(v) for v in values.tolist())]


class Rows(Protocol):
    """Rows of a file; `column`: a name by which they know their columns."""

    def cells(self, column: str, first: int, last: int) -> Cells:
        """Return the cells of rows first..last-1."""

    def stamps(self, column: str, first: int, last: int) -> IntArray:
        """Return the stamps of rows first..last-1 [microseconds since 1970 UTC], NAT where unreadable."""


@dataclass(frozen=True, eq=False)
class StoredRows:
    """Rows of a store, all or those of one group. lexicons: of the columns that hold texts, by their names."""

    store: Store
    lexicons: dict[str, Lexicon] = field(default_factory=dict)
    group: int = 0

    def cells(self, column: str, first: int, last: int) -> Cells:
        values = self.store.read(column, first, last, self.group)
        if column not in self.lexicons:
            return Cells(values)
        return Cells(values, self.store.read(f"{column}w", first, last, self.group), self.lexicons[column])

    def stamps(self, column: str, first: int, last: int) -> IntArray:
        return self.store.read(column, first, last, self.group).astype(np.int64, copy=False)


@dataclass(frozen=True, eq=False)
class Axis:
    """Rows that belong together, and where their stamps lie, which all signals recorded in these rows share.

    column: of their stamps. which: of the rows these are. absolute: False for stamps that count from an unknown start.
    where: file. first_line: line of row 0. end: the last stamp where it is known.
    """

    rows: Rows
    column: str
    which: range | IntArray
    absolute: bool = True
    notes: tuple[Note, ...] = ()
    where: str = ""
    first_line: int = 0
    end: int | None = None

    def __len__(self) -> int:
        return len(self.which)

    def _base(self, first: int, last: int) -> tuple[int, int, slice | IntArray]:
        """Rows of the file between which these lie, and which of those they are."""
        which = self.which[first:last]
        if isinstance(which, range):
            return which.start, which.stop, slice(None)
        begin, end = (int(which.min()), int(which.max()) + 1) if len(which) else (0, 0)
        return begin, end, which - begin

    def read(self, first: int = 0, last: int | None = None) -> IntArray:
        """Return the stamps of all rows, or of rows first..last-1: microseconds since 1970 UTC, NAT where unreadable.
        """
        begin, end, taken = self._base(first, len(self) if last is None else last)
        return self.rows.stamps(self.column, begin, end)[taken]

    def cells(self, column: str) -> Cells:
        """Return the cells of a column in all rows."""
        begin, end, taken = self._base(0, len(self))
        found = self.rows.cells(column, begin, end)
        return Cells(found.values[taken], None if found.codes is None else found.codes[taken], found.lexicon)

    def pieces(self) -> Iterator[IntArray]:
        """Yield all stamps, some rows at a time."""
        return (self.read(first, min(first + PIECE, len(self))) for first in range(0, len(self), PIECE))

    def first(self) -> int:
        """Return the first stamp that was read, 0 if there is none."""
        return next((int(piece[known][0]) for piece in self.pieces() if (known := piece != NAT).any()), 0)

    def last(self) -> int | None:
        """Return the last stamp, None if there is none."""
        last = self.end if self.end is not None else max((int(p.max()) for p in self.pieces()), default=NAT)
        return None if last == NAT else last

    def part(self, chosen: slice | IntArray) -> Axis:
        """Return some of the rows."""
        if isinstance(chosen, slice):
            line = self.first_line and self.first_line + int(chosen.start or 0)
            return replace(self, which=self.which[chosen], first_line=line, end=None)
        which = self.which.start + chosen if isinstance(self.which, range) else self.which[chosen]
        return replace(self, which=which, first_line=0, end=None)

    def packed(self, columns: Iterable[str]) -> Axis:
        """Return rows that lie in the scratch file of this machine with some columns of cells in memory; all others as
        they are."""
        if not isinstance(self.rows, StoredRows):
            return self
        arrays: dict[str, NDArray[Any]] = {self.column: self.read()}
        for column in columns:
            cells = self.cells(column)
            arrays |= {column: cells.values} | ({} if cells.codes is None else {f"{column}w": cells.codes})
        store = Store(Room(1 << 62), stays=True)
        store.add(arrays)
        return replace(self, rows=StoredRows(store, self.rows.lexicons), which=range(len(self)))


@dataclass(frozen=True, eq=False)
class Series:
    """One signal of one file. tag: its name as written. loop, role, signal: that name taken apart. column: of the
    axis' rows that holds its cells; quality: the column that marks them, "" if there is none, and its name."""

    tag: str
    loop: str
    role: str
    signal: str
    axis: Axis
    column: str
    quality: str = ""
    quality_name: str = ""

    def cells(self) -> Cells:
        """Return its cells."""
        return self.axis.cells(self.column)

    def marks(self) -> Cells | None:
        """Return the quality of its cells, None where there is none."""
        return self.axis.cells(self.quality) if self.quality else None
