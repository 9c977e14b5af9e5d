"""One recorded signal as it stands in a file: stamps, cells, quality; converted only when a loop asks for it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..record import Note
from .columns import LazyColumn
from .grid import Grid, make_grid
from .numbers import Numbers, codes_and_words, main_unit, parse_words, to_numbers, words_that_occur
from .order import Ordered, ordered
from .times import NAT, Times


class Axis:
    """The time stamps of a set of rows, shared by all signals recorded in these rows.

    micros: (rows,) microseconds since 1970 UTC, NAT where unreadable. where: file. first_line: line of row 0.
    """

    def __init__(self, times: Times, where: str, first_line: int = 0) -> None:
        self.micros = times.micros
        self.absolute = times.absolute
        self.zoned = times.zoned
        self.notes: tuple[Note, ...] = times.notes
        self.where = where
        self.first_line = first_line
        self.parts: tuple[int, ...] = ()  # first rows of further files
        self._order: Ordered | None = None
        self._grid: Grid | None = None

    def moved(self, micros: NDArray[np.int64], notes: list[Note]) -> Axis:
        """Return the same rows with other stamps, and why."""
        times = Times(micros, self.absolute, self.zoned, (*self.notes, *notes))
        return Axis(times, self.where, self.first_line)

    def order(self, probe: NDArray[np.float64] | None = None) -> Ordered:
        """Return the stamps in time order; `probe` is a measured signal of these rows, used the first time."""
        if self._order is None:
            self._order = ordered(self.micros, probe, self.parts, self.first_line)
        return self._order

    def grid(self, probe: NDArray[np.float64] | None = None) -> Grid:
        """Return the uniform grid of these stamps. Raises LoopError when there is none."""
        if self._grid is None:
            self._grid = make_grid(self.order(probe))
        return self._grid

    def last(self) -> int | None:
        """Return the last stamp [microseconds since 1970 UTC], None if there is none."""
        last = int(self.micros.max(initial=NAT))
        return None if last == NAT else last

    def forget(self) -> None:
        """Give back the memory of what can be found out again."""
        if self._order is not None and self._order.rows is None and not self._order.notes:
            self._order = self._grid = None  # else a look at another signal might tell otherwise

    def take(self, rows: NDArray[np.int64]) -> Axis:
        """Return the stamps of some rows."""
        part = Axis(Times(self.micros[rows], self.absolute, self.zoned, self.notes), self.where)
        return part


class LazyAxis(Axis):
    """Stamps that are read when the first loop needs them. pieces: gives them some rows at a time, if that can be."""

    def __init__(
        self, read: Callable[[], Times], zoned: bool, where: str,
        pieces: Callable[[], Iterator[NDArray[np.int64]]] | None = None, first_line: int = 0, absolute: bool = True,
        notes: tuple[Note, ...] = (),
    ) -> None:
        self._read, self.pieces = read, pieces
        self.absolute, self.zoned, self.where = absolute, zoned, where
        self.notes, self.first_line, self.parts = notes, first_line, ()
        self._order, self._grid = None, None

    @cached_property
    def micros(self) -> NDArray[np.int64]:  # type: ignore[override]
        """(rows,) microseconds since 1970 UTC."""
        return self._read().micros

    def last(self) -> int | None:
        if self.pieces is None:
            return super().last()
        last = max((int(part.max(initial=NAT)) for part in self.pieces()), default=NAT)
        return None if last == NAT else last

    def forget(self) -> None:
        super().forget()
        if self._order is None:
            self.__dict__.pop("micros", None)


class EvenAxis(Axis):
    """Stamps at even intervals, which need no memory. start, step: microseconds."""

    def __init__(
        self, start: int, step: int, rows: int, zoned: bool, where: str, first_line: int = 0, absolute: bool = True,
        notes: tuple[Note, ...] = (),
    ) -> None:
        self.start, self.step, self.rows = start, step, rows
        self.absolute, self.zoned, self.where, self.first_line = absolute, zoned, where, first_line
        self.notes, self.parts = notes, ()
        self._order, self._grid = None, None

    @property
    def micros(self) -> NDArray[np.int64]:  # type: ignore[override]
        """(rows,) microseconds since 1970 UTC, made anew each time."""
        return self.start + self.step * np.arange(self.rows)


class CutAxis(Axis):
    """The stamps of another axis from row `first` on, read anew each time. first_line: line of that row."""

    def __init__(self, base: Axis, first: int, first_line: int) -> None:
        self.base, self.first = base, first
        self.absolute, self.zoned, self.where, self.first_line = base.absolute, base.zoned, base.where, first_line
        self.notes, self.parts = base.notes, ()
        self._order, self._grid = None, None

    @property
    def micros(self) -> NDArray[np.int64]:  # type: ignore[override]
        """(rows,) microseconds since 1970 UTC, made anew each time."""
        return self.base.micros[self.first :]

    def forget(self) -> None:
        super().forget()
        self.base.forget()


class Lexicon:
    """The distinct texts of a column, read as numbers once for all tags that share the column."""

    def __init__(self, words: list[str], decimal: str) -> None:
        self.words = words
        self.decimal = decimal

    @cached_property
    def parsed(self) -> tuple[NDArray[np.float64], NDArray[np.bool_], list[str]]:
        return parse_words(self.words, self.decimal)


@dataclass(frozen=True, eq=False)
class Cells:
    """One column or a part of it: either an Arrow column, or codes into a lexicon, or numbers."""

    column: pa.ChunkedArray | LazyColumn | None = None
    decimal: str = "."
    codes: NDArray[np.int64] | None = None
    lexicon: Lexicon | None = None
    values: NDArray[np.float64] | None = None

    @property
    def is_text(self) -> bool:
        if self.codes is not None:
            return True
        if self.column is None:
            return False
        kind = self.column.type
        return pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_dictionary(kind)

    def split(self) -> Cells:
        """Return the same cells in a form from which rows can be taken cheaply many times."""
        if self.column is None:
            return self
        if self.is_text:
            codes, words = self.texts()
            return Cells(codes=codes, lexicon=Lexicon(words, self.decimal), decimal=self.decimal)
        return Cells(values=self.numbers().values, decimal=self.decimal)

    def take(self, rows: NDArray[np.int64]) -> Cells:
        """Return some rows; call split() first."""
        if self.codes is not None:
            return Cells(codes=self.codes[rows], lexicon=self.lexicon, decimal=self.decimal)
        assert self.values is not None
        return Cells(values=self.values[rows], decimal=self.decimal)

    def part(self, rows: slice | NDArray[np.int64]) -> Cells:
        """Return some rows; a slice of a column is no copy."""
        if isinstance(rows, slice):
            if self.column is not None:
                start, stop, _ = rows.indices(len(self.column))
                return replace(self, column=self.column.slice(start, stop - start))
            if self.codes is not None:
                return replace(self, codes=self.codes[rows])
            assert self.values is not None
            return replace(self, values=self.values[rows])
        return self.split().take(rows)

    def numbers(self) -> Numbers:
        """Return the cells as numbers."""
        if self.values is not None:
            return Numbers(self.values)
        if isinstance(self.column, LazyColumn):
            return self.column.numbers(self.decimal)
        if self.column is not None:
            return to_numbers(self.column, self.decimal)
        assert self.codes is not None and self.lexicon is not None
        values, bad, units = self.lexicon.parsed
        codes, used, counts = self._used()
        if not len(used):
            return Numbers(np.full(len(self.codes), np.nan))
        unit, foreign = main_unit([units[i] for i in used], counts)
        bad = bad[used] | foreign
        flags = np.append(bad, False)[codes]
        out = np.append(np.where(bad, np.nan, values[used]), np.nan)[codes]
        words = self.lexicon.words
        tally = Counter({words[used[i]].strip()[:40]: int(counts[i]) for i in np.flatnonzero(bad)})
        return Numbers(out, flags if flags.any() else None, tally, unit)

    def texts(self) -> tuple[NDArray[np.int64], list[str]]:
        """Return (codes, words); code -1 is an empty cell. Only words that occur are listed."""
        if self.codes is not None and self.lexicon is not None:
            codes, used, _ = self._used()
            return codes, [self.lexicon.words[i] for i in used]
        if isinstance(self.column, LazyColumn):
            return self.column.texts()
        if self.column is not None:
            return words_that_occur(*codes_and_words(self.column))
        assert self.values is not None
        return codes_and_words(pa.array(self.values).cast(pa.string()))

    def _used(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Return (codes into the words that occur, their places in the lexicon, how often each occurs)."""
        assert self.codes is not None
        used, codes, counts = np.unique(self.codes, return_inverse=True, return_counts=True)
        if len(used) and used[0] < 0:
            return codes - 1, used[1:], counts[1:]
        return codes, used, counts

    def __len__(self) -> int:
        for part in (self.codes, self.values, self.column):
            if part is not None:
                return len(part)
        return 0


@dataclass(frozen=True, eq=False)
class Series:
    """One signal of one file. tag: its name as written. loop, role, signal: that name taken apart."""

    tag: str
    loop: str
    role: str
    signal: str
    axis: Axis
    cells: Cells
    quality: Cells | None = None
    where: str = ""
    notes: tuple[Note, ...] = field(default=())
