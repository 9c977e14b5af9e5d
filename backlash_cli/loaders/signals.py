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
from .scratch import Arrays, Room, Store

PIECE = 1 << 20  # rows that are looked at together


class Lexicon:
    """Texts that stand in a column, by their numbers; read as numbers once for all that share them."""

    def __init__(self, words: list[str], decimal: str = ".") -> None:
        self.words, self.decimal = words, decimal

    @cached_property
    def parsed(self) -> tuple[FloatArray, NDArray[np.bool_], list[str]]:
        return parse_words(self.words, self.decimal)

    def __getstate__(self) -> dict[str, Any]:
        return {"words": self.words, "decimal": self.decimal}


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

    def numbers(self) -> tuple[FloatArray, NDArray[np.bool_] | None]:
        """Return (values, bad): the cells as numbers, nan where there is none, and True where something stands that is
        no good number (a digital state, inf), None if nowhere; a blank cell is not bad."""
        if not self.is_text:
            return self.values, None
        used, rows, which = self._used
        values, bad, units = self.lexicon.parsed
        wrong = bad[used] | foreign_units([units[i] for i in used], np.bincount(which, minlength=len(used)))
        out = np.where(np.isfinite(self.values), self.values, np.nan)
        out[rows] = np.where(wrong, np.nan, values[used])[which]
        flags = np.isinf(self.values)
        flags[rows] = wrong[which]
        return out, flags if flags.any() else None

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
    """Rows of a file that belong together; `column`: a name by which they know their columns."""

    @property
    def count(self) -> int:
        """Number of rows."""

    def cells(self, column: str, first: int, last: int) -> Cells:
        """Return the cells of rows first..last-1."""

    def stamps(self, column: str, first: int, last: int) -> IntArray:
        """Return the stamps of rows first..last-1 [microseconds since 1970 UTC], NAT where unreadable."""


@dataclass(frozen=True, eq=False)
class StoredRows:
    """Rows of a store, all or those of one group. lexicons: of the columns that hold texts, by their names."""

    store: Store
    count: int
    lexicons: dict[str, Lexicon] = field(default_factory=dict)
    group: int = 0

    def _read(self, names: list[str], first: int, last: int) -> dict[str, NDArray[Any]]:
        return self.store.read(names, first, last, self.group)

    def cells(self, column: str, first: int, last: int) -> Cells:
        lexicon = self.lexicons.get(column)
        if lexicon is None:
            return Cells(self._read([column], first, last)[column])
        found = self._read([column, f"{column}w"], first, last)
        return Cells(found[column], found.get(f"{column}w"), lexicon)

    def stamps(self, column: str, first: int, last: int) -> IntArray:
        return self._read([column], first, last)[column].astype(np.int64, copy=False)


@dataclass(frozen=True, eq=False)
class SomeRows:
    """Some rows of others, by their numbers."""

    base: Rows
    which: range | IntArray

    @property
    def count(self) -> int:
        return len(self.which)

    def cells(self, column: str, first: int, last: int) -> Cells:
        begin, end, taken = self._rows(first, last)
        found = self.base.cells(column, begin, end)
        return Cells(found.values[taken], None if found.codes is None else found.codes[taken], found.lexicon)

    def stamps(self, column: str, first: int, last: int) -> IntArray:
        begin, end, taken = self._rows(first, last)
        return self.base.stamps(column, begin, end)[taken]

    def _rows(self, first: int, last: int) -> tuple[int, int, slice | IntArray]:
        """Rows of the others between which these lie, and which of those they are."""
        which = self.which[first:last]
        if isinstance(which, range):
            return which.start, which.stop, slice(None)
        begin, end = (int(which.min()), int(which.max()) + 1) if len(which) else (0, 0)
        return begin, end, which - begin


def part_of(rows: Rows, chosen: slice | IntArray) -> Rows:
    """Return some rows of others."""
    return SomeRows(rows, range(rows.count)[chosen] if isinstance(chosen, slice) else chosen)


def packed(rows: Rows | None, columns: Iterable[str], stamps: str = "") -> Rows | None:
    """Return rows that lie in the scratch file of this machine with some columns of cells, or with their stamps, in
    memory; all others as they are."""
    base = rows
    while isinstance(base, SomeRows):
        base = base.base
    if rows is None or not isinstance(base, StoredRows):
        return rows
    arrays: Arrays = {stamps: rows.stamps(stamps, 0, rows.count)} if stamps else {}
    for column in filter(None, columns):
        cells = rows.cells(column, 0, rows.count)
        arrays |= {column: cells.values} if cells.codes is None else {column: cells.values, f"{column}w": cells.codes}
    store = Store(Room(1 << 62), stays=True)
    store.add(arrays)
    return StoredRows(store, rows.count, base.lexicons)


@dataclass(frozen=True, eq=False)
class Axis:
    """Where the stamps of a set of rows lie, which all signals recorded in these rows share.

    rows, column: where they are read. absolute: False for stamps that count from an unknown start. where: file.
    first_line: line of row 0. end: the last stamp where it is known.
    """

    rows: Rows | None = None
    column: str = ""
    absolute: bool = True
    notes: tuple[Note, ...] = ()
    where: str = ""
    first_line: int = 0
    end: int | None = None

    def __len__(self) -> int:
        return 0 if self.rows is None else self.rows.count

    def read(self, first: int = 0, last: int | None = None) -> IntArray:
        """Return the stamps of all rows, or of rows first..last-1: microseconds since 1970 UTC, NAT where unreadable.
        """
        if self.rows is None:
            return np.zeros(0, np.int64)
        return self.rows.stamps(self.column, first, self.rows.count if last is None else last)

    @property
    def micros(self) -> IntArray:
        """(rows,) All stamps."""
        return self.read()

    def pieces(self) -> Iterator[IntArray]:
        """Yield all stamps, some rows at a time."""
        for first in range(0, len(self), PIECE):
            yield self.read(first, min(first + PIECE, len(self)))

    def first(self) -> int:
        """Return the first stamp that was read, 0 if there is none."""
        return next((int(piece[known][0]) for piece in self.pieces() if (known := piece != NAT).any()), 0)

    def last(self) -> int | None:
        """Return the last stamp, None if there is none."""
        last = self.end if self.end is not None else max((int(p.max()) for p in self.pieces()), default=NAT)
        return None if last == NAT else last

    def part(self, chosen: slice | IntArray) -> Axis:
        """Return the stamps of some rows."""
        line = self.first_line + int(chosen.start or 0) if isinstance(chosen, slice) and self.first_line else 0
        return replace(self, rows=None if self.rows is None else part_of(self.rows, chosen), first_line=line, end=None)


@dataclass(frozen=True, eq=False)
class Series:
    """One signal of one file. tag: its name as written. loop, role, signal: that name taken apart. column: of the
    axis' rows that holds its cells; quality: the column that marks them, and its name."""

    tag: str
    loop: str
    role: str
    signal: str
    axis: Axis
    rows: Rows | None
    column: str = ""
    quality: str = ""
    where: str = ""
    quality_name: str = ""

    @property
    def count(self) -> int:
        return 0 if self.rows is None else self.rows.count

    def cells(self) -> Cells:
        """Return its cells."""
        return Cells(np.zeros(0)) if self.rows is None else self.rows.cells(self.column, 0, self.count)

    def marks(self) -> Cells | None:
        """Return the quality of its cells, None where there is none."""
        return self.rows.cells(self.quality, 0, self.count) if self.rows is not None and self.quality else None

    def part(self, axis: Axis, chosen: slice | IntArray) -> Series:
        """Return some rows of it; axis: their stamps."""
        return replace(self, axis=axis, rows=None if self.rows is None else part_of(self.rows, chosen))
