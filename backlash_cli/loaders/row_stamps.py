"""Stamps of a long file that mean what they mean without the others: understood by the reader, or numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import InputError
from .arrays import to_texts
from .csv_signal import ForeignText
from .minutes import is_written, taken_apart
from .number_units import FIRST, unit_of_numbers
from .numbers import to_numbers
from .options import ReadOptions
from .stamp_words import of_day, year_first
from .tag_store import Clock
from .times import DAY, NAT, Times, from_numbers, to_times
from .zones import WallClock


class Stamps:
    """Stamps that mean what they mean without the others. names: of the columns. zoned: they carry an offset."""

    def __init__(self, names: Sequence[str], options: ReadOptions, where: str, zoned: bool) -> None:
        self.name, self.names, self.options, self.where, self.zoned = names[0], names, options, where, zoned
        self.last = NAT
        self.rising = True  # what is kept of a row rises with its stamp
        self._wall = WallClock(options.timezone) if options.timezone else None

    def take(self, columns: Sequence[pa.ChunkedArray]) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
        """Return (raw, known) of a block: what is kept of each row, and which rows have a stamp, None if all have.

        Raises ForeignText when the block is of another kind than those before.
        """
        kind = columns[0].type
        bare = replace(self.options, timezone=None)
        if is_written(kind):
            times = year_first(columns[0], self.name, bare, self.where)
        elif pa.types.is_timestamp(kind) or (len(columns) > 1 and pa.types.is_date(kind)):
            times = to_times(columns[0], self.name, bare, self.where)
        else:
            raise ForeignText
        micros = times.micros
        if len(columns) > 1:
            micros = self._joined(micros, columns[1])
        elif times.zoned != self.zoned and np.any(micros != NAT):
            raise ForeignText
        return self._known(self._in_utc(micros))

    def _joined(self, dates: NDArray[np.int64], column: pa.ChunkedArray) -> NDArray[np.int64]:
        clock = of_day(column, self.names[1], self.options, self.where)
        if np.any(dates[dates != NAT] % DAY):
            raise ForeignText
        return np.where((dates != NAT) & (clock != NAT), dates + clock, NAT)

    def clock(self) -> Clock:
        """Return how the raw stamps are read. Raises ForeignText when that depends on all of them."""
        return Clock(as_they_are, self._about(Times(np.zeros(0, np.int64), zoned=self.zoned)), self.last)

    def _in_utc(self, micros: NDArray[np.int64]) -> NDArray[np.int64]:
        return micros if self.zoned or self._wall is None else self._wall.utc(micros)

    def _about(self, times: Times) -> Times:
        """What is to be said of all stamps, from what is to be said of them before they were brought to UTC."""
        if times.zoned or self._wall is None or not times.absolute:
            return times
        return replace(times, zoned=True, notes=(*times.notes, *self._wall.notes))

    def _known(self, micros: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
        self.last = max(self.last, int(micros.max(initial=NAT)))
        known = micros != NAT
        return micros, None if known.all() else known


def as_they_are(raw: NDArray[np.float64]) -> NDArray[np.int64]:
    return raw.view(np.int64)


class NumberStamps(Stamps):
    """Stamps as numbers, of a unit that all blocks agree upon."""

    _unit: tuple[str, str] | None = None
    _first = np.zeros(0)

    def take(self, columns: Sequence[pa.ChunkedArray]) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
        column = columns[0]
        if is_written(column.type):
            values = _numbers(column)
        elif pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
            values = to_numbers(column).values
        else:
            raise ForeignText
        known = np.isfinite(values)
        if not known.any():
            raise ForeignText
        numbers = values[known]
        if self._unit is None:
            self._first = numbers[:FIRST]
        unit = unit_of_numbers(numbers if len(numbers) >= FIRST else np.concatenate([self._first, numbers]), self.name,
                               self.options)
        if is_written(column.type) and not unit[0].startswith("epoch_"):
            raise ForeignText
        if unit != (self._unit or unit):
            raise ForeignText
        self._unit = unit
        times = self._read(values)
        self.zoned = times.zoned or not times.absolute
        return self._known(self._in_utc(times.micros))

    def _read(self, values: NDArray[np.float64]) -> Times:
        assert self._unit is not None
        try:
            return from_numbers(values, self.name, self.options, self.where, self._unit)
        except InputError:
            raise ForeignText from None

    def clock(self) -> Clock:
        times = self._read(self._first)
        return Clock(as_they_are, self._about(replace(times, micros=times.micros[:0])), self.last)


def _numbers(column: pa.ChunkedArray) -> NDArray[np.float64]:
    """The numbers of texts, nan where there is no digit. Raises ForeignText where there is one and no number."""
    words, which, _ = taken_apart(column, False)
    values = to_numbers(to_texts(words)).values
    used = np.unique(which[which >= 0])
    if not np.isfinite(values[used]).all():
        raise ForeignText
    return np.where(which < 0, np.nan, np.append(values, np.nan)[which])


def counts_from_1970(column: pa.ChunkedArray, name: str, options: ReadOptions) -> bool:
    """Whether texts are numbers that count from 1970."""
    try:
        values = _numbers(column)
    except ForeignText:
        return False
    values = values[np.isfinite(values)]
    return bool(len(values)) and unit_of_numbers(values, name, options)[0].startswith("epoch_")
