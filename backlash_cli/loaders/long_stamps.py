"""The stamps of a long file, block by block: kept as they come, understood when the last one is known.

Whatever the kind of stamps, a row keeps 64 bits of it. What these mean is settled at the end, from all that was seen,
exactly as `to_times` does with the column of the whole file; where that cannot be done, ForeignText is raised and the
file has to be read whole.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import InputError
from .csv_signal import ForeignText
from .minutes import whole_minutes
from .numbers import codes_and_words, to_numbers
from .options import ReadOptions
from .tag_store import Clock
from .times import NAT, Times, from_numbers, from_text, in_zone, to_times, unit_of_numbers

MOST_TEXTS = 1 << 21  # different written stamps, without their seconds
_SECONDS = 27  # bits of the seconds of a minute in microseconds
_MASK = (1 << _SECONDS) - 1
_WRITTEN = (pa.types.is_string, pa.types.is_large_string, pa.types.is_dictionary)


def stamps_for(kind: pa.DataType, name: str, options: ReadOptions, where: str) -> Stamps:
    """Return what takes the stamps of a column. Raises ForeignText for stamps that must be seen as a whole."""
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    made: type[Stamps] | None = None
    if pa.types.is_timestamp(kind):
        made = Stamps
    elif pa.types.is_string(kind) or pa.types.is_large_string(kind):
        made = WrittenStamps
    elif pa.types.is_integer(kind) or pa.types.is_floating(kind):
        made = NumberStamps
    zoned = pa.types.is_timestamp(kind) and kind.tz is not None
    if made is None:
        raise ForeignText
    return made(name, options, where, zoned)


class Stamps:
    """Stamps that a reader of files has understood already."""

    def __init__(self, name: str, options: ReadOptions, where: str, zoned: bool) -> None:
        self.name, self.options, self.where, self.zoned = name, options, where, zoned
        self.last = NAT
        self.rising = True  # what is kept of a row rises with its stamp

    def take(self, column: pa.ChunkedArray) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
        """Return (raw, known) of a block: what is kept of each row, and which rows have a stamp, None if all have.

        Raises ForeignText when the block is of another kind than those before.
        """
        kind = column.type
        if not pa.types.is_timestamp(kind) or (kind.tz is not None) != self.zoned:
            raise ForeignText
        return self._known(_row_by_row(to_times(column, self.name, self.options, self.where)).micros)

    def clock(self) -> Clock:
        """Return how the raw stamps are read. Raises ForeignText when that depends on all of them."""
        zoned = self.zoned or bool(self.options.timezone)
        return Clock(_as_they_are, Times(np.zeros(0, np.int64), zoned=zoned), self.last)

    def _known(self, micros: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
        self.last = max(self.last, int(micros.max(initial=NAT)))
        known = micros != NAT
        return micros, None if known.all() else known


class WrittenStamps(Stamps):
    """Stamps as texts: the text of the minute by its number, and the seconds of the minute."""

    def __init__(self, name: str, options: ReadOptions, where: str, zoned: bool) -> None:
        super().__init__(name, options, where, zoned)
        self._texts: dict[str, int] = {}
        self._latest: dict[int, int] = {}  # seconds of the last stamp of each minute [microseconds]

    def take(self, column: pa.ChunkedArray) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
        if not any(is_one(column.type) for is_one in _WRITTEN):
            raise ForeignText
        split = whole_minutes(column) if self.options.time_format is None else None
        if split is None:
            codes, words = codes_and_words(column)
            raw = np.append(self._numbers(words), np.int64(0))[codes] << _SECONDS
            for number in np.unique(raw[codes >= 0] >> _SECONDS).tolist():
                self._latest.setdefault(number, 0)
            return raw, codes >= 0 if codes.min(initial=0) < 0 else None
        texts, which, seconds = split
        starts = np.flatnonzero(np.diff(which, prepend=-1))
        numbers = self._numbers(texts.to_pylist())
        for number, last in zip(numbers.tolist(), np.maximum.reduceat(seconds, starts).tolist(), strict=True):
            self._latest[number] = max(self._latest.get(number, 0), last)
        return (numbers[which] << _SECONDS) | seconds, None

    def _numbers(self, words: list[str]) -> NDArray[np.int64]:
        found = [self._texts.setdefault(word, len(self._texts)) for word in words]
        if len(self._texts) > MOST_TEXTS:
            raise ForeignText
        return np.array(found, np.int64)

    def clock(self) -> Clock:
        try:
            texts = pa.array(list(self._texts), pa.string())
            times = _row_by_row(in_zone(from_text(texts, self.name, self.options, self.where), self.options))
        except InputError:
            raise ForeignText from None
        used = np.array(list(self._latest), np.int64)
        if any(note.code == "relative_time" for note in times.notes) or np.any(times.micros[used] == NAT):
            raise ForeignText
        self.rising = not np.any(np.diff(times.micros[np.sort(used)]) < 0)
        last = int((times.micros[used] + np.array(list(self._latest.values()))).max(initial=NAT))
        return Clock(Minutes(times.micros), replace(times, micros=times.micros[:0]), last)


class NumberStamps(Stamps):
    """Stamps as numbers, of a unit that all blocks agree upon."""

    _unit: tuple[str, str] | None = None
    _first = np.zeros(0)

    def take(self, column: pa.ChunkedArray) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
        if not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
            raise ForeignText
        values = to_numbers(column).values
        known = np.isfinite(values)
        if not known.any():
            raise ForeignText
        unit = unit_of_numbers(values[known], self.name, self.options)
        if self._unit is None:
            self._unit, self._first = unit, values[known][:1000]
        if unit != self._unit:
            raise ForeignText
        return self._known(self._read(values).micros)

    def _read(self, values: NDArray[np.float64]) -> Times:
        assert self._unit is not None
        try:
            times = from_numbers(values, self.name, self.options, self.where, self._unit)
            return _row_by_row(in_zone(times, self.options))
        except InputError:
            raise ForeignText from None

    def clock(self) -> Clock:
        times = self._read(self._first)
        return Clock(_as_they_are, replace(times, micros=times.micros[:0]), self.last)


def _row_by_row(times: Times) -> Times:
    """Return the stamps if each means the same without the others. Raises ForeignText for an hour that occurs twice."""
    if any(note.code == "dst_repeated_hour" for note in times.notes):
        raise ForeignText
    return times


class Minutes:
    """Reads stamps of a minute by its number and of the seconds in it. minutes: [microseconds since 1970 UTC]."""

    def __init__(self, minutes: NDArray[np.int64]) -> None:
        self.minutes = minutes

    def __call__(self, raw: NDArray[np.float64]) -> NDArray[np.int64]:
        bits = raw.view(np.int64)
        return self.minutes[bits >> _SECONDS] + (bits & _MASK)


def _as_they_are(raw: NDArray[np.float64]) -> NDArray[np.int64]:
    return raw.view(np.int64)
