"""The stamps of a wide file of many rows, understood some rows at a time and kept in a temporary file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import InputError
from .columns import LazyColumn
from .even import EvenColumn, NumberColumn, StampColumn, is_number
from .hourly_stamps import StoredHours
from .number_units import FIRST, unit_of_numbers
from .numbers import to_numbers
from .options import ReadOptions
from .parquet_columns import ParquetColumn
from .series import Axis, EvenAxis, LazyAxis
from .store import ColumnStore, on_disk
from .times import DAY, NAT, Times, from_numbers, from_text, to_times
from .zones import WallClock

PIECE = 1 << 18  # rows looked at at once
Micros = Iterable[NDArray[np.int64]]


def kept_axis(cells: LazyColumn, name: str, options: ReadOptions, where: str, line: int) -> Axis | None:
    """Return the axis of a column of stamps; line: that of its first row. None where it must be seen as a whole."""
    found = _pieces(cells, name, options, where)
    return None if found is None else keep(*found, options, where, line)


def keep(pieces: Micros, about: Times, options: ReadOptions, where: str, line: int) -> Axis:
    """Return the axis of stamps as they are written; about: what is to be said of all of them."""
    wall = WallClock(options.timezone) if options.timezone and about.absolute and not about.zoned else None
    kept = _Kept()
    for micros in pieces:
        kept.add(micros if wall is None else wall.utc(micros))
    zoned = about.zoned or wall is not None
    kept.about = Times(np.zeros(0, np.int64), about.absolute, zoned)
    notes = (*about.notes, *(() if wall is None else wall.notes))
    if kept.even is not None and kept.rows > 1:
        return EvenAxis(*kept.even, kept.rows, zoned, where, line, about.absolute, notes)
    return LazyAxis(kept.times, zoned, where, kept.pieces, line, about.absolute, notes)


class _Kept:
    """Stamps in a temporary file. even: (start, step) where they are [microseconds since 1970 UTC]."""

    def __init__(self) -> None:
        self.rows, self.about = 0, Times(np.zeros(0, np.int64))
        self.even: tuple[int, int] | None = None
        self._store = ColumnStore(on_disk())

    def add(self, micros: NDArray[np.int64]) -> None:
        """Take the next rows."""
        if not len(micros):
            return
        if not self.rows and len(micros) > 1 and micros[0] != NAT and micros[1] > micros[0]:
            self.even = int(micros[0]), int(micros[1] - micros[0])
        if self.even is not None:
            start, step = self.even
            if micros[0] != start + step * self.rows or np.any(np.diff(micros) != step):
                self.even = None
        self._store.add(micros.view(np.float64).reshape(1, -1))
        self.rows += len(micros)

    def pieces(self) -> Iterator[NDArray[np.int64]]:
        """Yield the stamps, some rows at a time."""
        return (part.view(np.int64) for part in self._store.parts(0))

    def times(self) -> Times:
        """Return all stamps."""
        return Times(self._store.column(0).view(np.int64), self.about.absolute, self.about.zoned)


def _pieces(cells: LazyColumn, name: str, options: ReadOptions, where: str) -> tuple[Micros, Times] | None:
    """Return stamps as they are written, some rows at a time, and what is to be said of all."""
    kind = cells.type
    about = Times(np.zeros(0, np.int64))
    if isinstance(cells, StoredHours):
        try:
            hours = from_text(cells.texts, name, options, where)
        except InputError:
            return None  # said of the stamps as they are written
        about = Times(about.micros, hours.absolute, hours.zoned, hours.notes)
        return (_of_hours(hours.micros, *piece) for piece in cells.pieces()), about
    if pa.types.is_timestamp(kind) and kind.tz is None:
        if isinstance(cells, StampColumn):
            return cells.pieces(), about
        if isinstance(cells, EvenColumn) and cells.micros[1]:
            start, step = cells.micros
            firsts = range(0, len(cells), PIECE)
            return (start + step * np.arange(i, min(i + PIECE, len(cells))) for i in firsts), about
        if isinstance(cells, ParquetColumn):
            bare = ReadOptions()
            return (to_times(part, name, bare, where).micros for part in cells.file.pieces(cells.index)), about
    if isinstance(cells, NumberColumn) or (isinstance(cells, ParquetColumn) and is_number(kind)):
        return _of_numbers(cells, name, options, where)
    return None


def _of_hours(begins: NDArray[np.int64], which: NDArray[np.int64], nanos: NDArray[np.int64]) -> NDArray[np.int64]:
    begin = begins[which]
    return np.where(begin == NAT, NAT, begin + nanos // 1000)


def _of_numbers(
    cells: NumberColumn | ParquetColumn, name: str, options: ReadOptions, where: str
) -> tuple[Micros, Times] | None:
    """Numbers of a unit that all pieces agree upon."""
    unit: tuple[str, str] | None = None
    first = np.zeros(0)
    for values in _numbers(cells):
        known = values[np.isfinite(values)]
        if not len(known):
            continue
        first = known[:FIRST] if unit is None else first
        own = unit_of_numbers(known if len(known) >= FIRST else np.concatenate([first, known]), name, options)
        if own != (unit or own):
            return None
        unit = own
    if unit is None:
        return None
    about = from_numbers(first, name, options, where, unit)
    read = (from_numbers(values, name, options, where, unit).micros if np.isfinite(values).any()
            else np.full(len(values), NAT) for values in _numbers(cells))
    return read, Times(np.zeros(0, np.int64), about.absolute, about.zoned, about.notes)


def _numbers(cells: NumberColumn | ParquetColumn) -> Iterator[NDArray[np.float64]]:
    if isinstance(cells, NumberColumn):
        return cells.pieces()
    return (to_numbers(part).values for part in cells.file.pieces(cells.index, cells.first))


def kept_parts(
    dates: pa.ChunkedArray, clocks: pa.ChunkedArray, options: ReadOptions, where: str, line: int
) -> Axis | None:
    """Return the axis of dates and times of day that Arrow has understood; None where dates carry times themselves."""
    def joined(first: int) -> NDArray[np.int64]:
        date = to_times(dates.slice(first, PIECE), "", ReadOptions(), where).micros
        clock = to_times(clocks.slice(first, PIECE), "", ReadOptions(), where).micros
        return np.where((date != NAT) & (clock != NAT), date + clock % DAY, NAT)

    for first in range(0, len(dates), PIECE):
        date = to_times(dates.slice(first, PIECE), "", ReadOptions(), where).micros
        if np.any(date[date != NAT] % DAY):
            return None
    pieces = (joined(first) for first in range(0, len(dates), PIECE))
    return keep(pieces, Times(np.zeros(0, np.int64)), options, where, line)
