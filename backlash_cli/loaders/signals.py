"""One recorded signal: its stamps and cells and where they lie; they are read when a loop asks for them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Protocol
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray, Note
from .grid import Grid, make_grid
from .numbers import Numbers, main_unit, number_texts, parse_words
from .order import NAT, Ordered, ordered
from .scratch import Arrays, Room, Store

PIECE = 1 << 20  # rows that are looked at together
MOST_AXES = 6  # whose stamps are kept in memory


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
        """(places in the lexicon of the texts that occur, rows that hold one, its place among those) """
        assert self.codes is not None
        rows = np.flatnonzero(self.codes >= 0)
        used, which = np.unique(self.codes[rows], return_inverse=True)
        return used, rows, which

    @property
    def is_text(self) -> bool:
        return self.codes is not None and len(self._used[0]) > 0

    def numbers(self) -> Numbers:
        """Return the cells as numbers; texts that are none count as bad."""
        if not self.is_text:
            return Numbers(self.values)
        used, rows, which = self._used
        values, bad, units = self.lexicon.parsed
        counts = np.bincount(which, minlength=len(used))
        unit, foreign = main_unit([units[i] for i in used], counts)
        values, bad = values[used], bad[used] | foreign
        out = np.where(np.isfinite(self.values), self.values, np.nan)
        out[rows] = np.where(bad, np.nan, values)[which]
        flags = np.zeros(len(out), bool)
        flags[rows] = bad[which]
        flags |= np.isinf(self.values)
        words = Counter({self.lexicon.words[used[i]].strip()[:40]: int(counts[i]) for i in np.flatnonzero(bad)})
        return Numbers(out, flags if flags.any() else None, words, unit)

    def texts(self) -> tuple[IntArray, list[str]]:
        """Return (codes, words): the text of each cell, numbers as text too; -1 for an empty cell."""
        codes, words = np.full(len(self.values), -1), []
        if self.codes is not None:
            used, rows, which = self._used
            words = [self.lexicon.words[i] for i in used]
            codes[rows] = which
        known = np.flatnonzero(~np.isnan(self.values) & (codes < 0))
        values, which = np.unique(self.values[known], return_inverse=True)
        codes[known] = which + len(words)
        return codes, [*words, *number_texts(values)]


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
    """Some rows of others: from a row on so many, or those that are named by their numbers."""

    base: Rows
    count: int
    begin: int = 0
    which: IntArray | None = None

    def _taken(self, values: Any, first: int, last: int) -> Any:
        return values if self.which is None else values[self.which[first:last] - int(self.which[first:last].min())]

    def _ends(self, first: int, last: int) -> tuple[int, int]:
        if self.which is None:
            return self.begin + first, self.begin + last
        chosen = self.which[first:last]
        return (int(chosen.min()), int(chosen.max()) + 1) if len(chosen) else (0, 0)

    def cells(self, column: str, first: int, last: int) -> Cells:
        found = self.base.cells(column, *self._ends(first, last))
        if self.which is None or first >= last:
            return found
        codes = None if found.codes is None else self._taken(found.codes, first, last)
        return Cells(self._taken(found.values, first, last), codes, found.lexicon)

    def stamps(self, column: str, first: int, last: int) -> IntArray:
        found = self.base.stamps(column, *self._ends(first, last))
        return found if first >= last else self._taken(found, first, last)


def stored_below(rows: Rows | None) -> StoredRows | None:
    """Return the rows of the scratch file that these are some of, None where they lie elsewhere."""
    while isinstance(rows, SomeRows):
        rows = rows.base
    return rows if isinstance(rows, StoredRows) else None


def packed(rows: Rows, columns: Iterable[str]) -> Rows:
    """Return rows with the samples of some columns that lie in the scratch file of this machine in memory."""
    base = stored_below(rows)
    if base is None:
        return rows
    arrays: Arrays = {}
    for column in filter(None, columns):
        cells = rows.cells(column, 0, rows.count)
        arrays |= {column: cells.values} if cells.codes is None else {column: cells.values, f"{column}w": cells.codes}
    store = Store(Room(1 << 62), stays=True)
    store.add(arrays)
    return StoredRows(store, rows.count, base.lexicons)


def part_of(rows: Rows, chosen: slice | IntArray) -> Rows:
    """Return some rows of others."""
    if isinstance(chosen, slice):
        first, last, _ = chosen.indices(rows.count)
        return SomeRows(rows, max(last - first, 0), first)
    return SomeRows(rows, len(chosen), which=chosen)


@dataclass(eq=False)
class Axis:
    """The stamps of a set of rows, shared by all signals recorded in these rows.

    rows, column: where they lie; or given: (rows,) microseconds since 1970 UTC, NAT where unreadable. where: file.
    first_line: line of row 0. absolute: False for stamps that count from an unknown start. parts: first rows of
    further files. end: the last stamp where it is known. What is found out about them is kept for the axes used last.
    """

    rows: Rows | None = None
    column: str = ""
    given: IntArray | None = None
    absolute: bool = True
    notes: tuple[Note, ...] = ()
    where: str = ""
    first_line: int = 0
    parts: tuple[int, ...] = ()
    end: int | None = None
    _micros: IntArray | None = field(default=None, init=False)
    _order: Ordered | None = field(default=None, init=False)
    _grid: Grid | None = field(default=None, init=False)
    _recent: ClassVar[list[ref[Axis]]] = []

    def __len__(self) -> int:
        return len(self.given) if self.given is not None else 0 if self.rows is None else self.rows.count

    @property
    def micros(self) -> IntArray:
        """(rows,) All stamps."""
        if self.given is not None:
            return self.given
        if self._micros is None:
            self._micros = self.read(0, len(self))
            self._used()
        return self._micros

    def read(self, first: int, last: int) -> IntArray:
        """Return the stamps of rows first..last-1."""
        if self.given is not None or self._micros is not None:
            return self.micros[first:last]
        return np.zeros(0, np.int64) if self.rows is None else self.rows.stamps(self.column, first, last)

    def pieces(self) -> Iterator[IntArray]:
        """Yield all stamps, some rows at a time."""
        for first in range(0, len(self), PIECE):
            yield self.read(first, min(first + PIECE, len(self)))

    def last(self) -> int | None:
        """Return the last stamp, None if there is none."""
        last = self.end if self.end is not None else max((int(p.max()) for p in self.pieces()), default=NAT)
        return None if last == NAT else last

    def order(self, probe: FloatArray | None = None) -> Ordered:
        """Return the stamps in time order; `probe` is a measured signal of these rows, used the first time."""
        if self._order is None:
            self._order = ordered(self.micros, probe, self.parts, self.first_line)
            self._used()
        return self._order

    def grid(self, probe: FloatArray | None = None) -> Grid:
        """Return the uniform grid of these stamps. Raises LoopError when there is none."""
        if self._grid is None:
            self._grid = make_grid(self.order(probe))
        return self._grid

    def part(self, chosen: slice | IntArray) -> Axis:
        """Return the stamps of some rows."""
        if self.given is not None or self.rows is None:
            return replace(self, given=self.micros[chosen], first_line=0, parts=(), end=None)
        line = self.first_line + int(chosen.start or 0) if isinstance(chosen, slice) and self.first_line else 0
        return replace(self, rows=part_of(self.rows, chosen), first_line=line, parts=(), end=None)

    def packed(self) -> Axis:
        """Return these stamps in memory where they lie in the scratch file of this machine."""
        return self if stored_below(self.rows) is None else replace(self, rows=None, given=self.micros)

    def _used(self) -> None:
        """Forget what was found out of the axes that were not used for long; it can be found out again."""
        own = ref(self)
        Axis._recent[:] = [*(other for other in Axis._recent if other != own and other() is not None), own]
        while len(Axis._recent) > MOST_AXES:
            oldest = Axis._recent.pop(0)()
            if oldest is not None:
                oldest.forget()

    def forget(self) -> None:
        """Give back the memory of what can be found out again."""
        self._micros = self._order = self._grid = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_micros": None, "_order": None, "_grid": None}


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

    def cells(self, first: int = 0, last: int | None = None) -> Cells:
        """Return its cells, or those of some rows."""
        return self._read(self.column, first, last)

    def marks(self, first: int = 0, last: int | None = None) -> Cells | None:
        """Return the quality of its cells, None where there is none."""
        return self._read(self.quality, first, last) if self.quality else None

    def _read(self, column: str, first: int, last: int | None) -> Cells:
        if self.rows is None:
            return Cells(np.zeros(0))
        return self.rows.cells(column, first, self.rows.count if last is None else last)

    def part(self, axis: Axis, chosen: slice | IntArray) -> Series:
        """Return some rows of it; axis: their stamps."""
        return replace(self, axis=axis, rows=None if self.rows is None else part_of(self.rows, chosen))
