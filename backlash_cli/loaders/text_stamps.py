"""Stamps of a long file that are texts: kept by the numbers of the texts, understood when all texts are known."""

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
from .options import ReadOptions
from .row_stamps import Stamps, as_they_are
from .stamp_words import TextsSoFar, of_day
from .tag_store import Clock
from .times import DAY, NAT, from_text, in_zone

MOST_TEXTS = 1 << 21  # different written stamps, without their seconds
_LATER = 37  # bits of what a row is later than its text, less than a day in microseconds
_MASK = (1 << _LATER) - 1


class WrittenStamps(Stamps):
    """Stamps as texts: the text of the minute (or the date) by its number, and what the row is later.

    Where a time zone is named, they are understood at once if that is possible, and at the end seen to be right.
    """

    def __init__(self, names: Sequence[str], options: ReadOptions, where: str, zoned: bool) -> None:
        super().__init__(names, options, where, zoned)
        self._texts: dict[str, int] = {}
        self._latest = np.zeros(0, np.int64)  # of each text: what the last row is later, -1 for none
        self._so_far = TextsSoFar(self.name, options, where) if self._wall is not None else None
        self._understood: NDArray[np.int64] | None = None

    def take(self, columns: Sequence[pa.ChunkedArray]) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
        if not is_written(columns[0].type):
            raise ForeignText
        words, which, later = taken_apart(columns[0], self.options.time_format is None and len(columns) == 1)
        if len(columns) > 1:
            later = of_day(columns[1], self.names[1], self.options, self.where)
            which = np.where(later == NAT, -1, which)
        new = [word for word in dict.fromkeys(words) if word not in self._texts]
        numbers = np.append(np.array([self._texts.setdefault(w, len(self._texts)) for w in words], np.int64), -1)[which]
        if len(self._texts) > MOST_TEXTS:
            raise ForeignText
        rows = np.flatnonzero(numbers >= 0)
        self._latest = np.append(self._latest, np.full(len(new), -1))
        np.maximum.at(self._latest, numbers[rows], later[rows])
        if self._so_far is not None:
            return self._at_once(self._so_far, new, numbers, later)
        return _packed(numbers, later)

    def _at_once(
        self, so_far: TextsSoFar, new: list[str], numbers: NDArray[np.int64], later: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
        try:
            self._understood = so_far.add(new)
        except InputError:
            if self._understood is not None:
                raise ForeignText from None
            self._so_far = None  # what comes first does not tell
            return _packed(numbers, later)
        begins = np.append(self._understood, NAT)[numbers]
        micros = np.where(begins == NAT, NAT, begins + later)
        if len(self.names) == 1:
            self.zoned = so_far.zoned
        return self._known(self._in_utc(micros))

    def clock(self) -> Clock:
        parts = len(self.names) > 1
        bare = replace(self.options, timezone=None)
        try:
            times = from_text(to_texts(list(self._texts)), self.name, bare, self.where)
            used = np.flatnonzero(self._latest >= 0)
            if np.any(times.micros[used] == NAT) or any(note.code == "relative_time" for note in times.notes):
                raise ForeignText
            if parts:
                times = replace(times, zoned=False)
                if np.any(times.micros[used] % DAY):
                    raise ForeignText
            if self._understood is not None:
                if not np.array_equal(times.micros, self._understood) or (not parts and times.zoned != self.zoned):
                    raise ForeignText
                return Clock(as_they_are, self._about(replace(times, micros=times.micros[:0])), self.last)
            times = in_zone(times, self.options)
        except InputError:
            raise ForeignText from None
        if self._wall is not None and (parts or any(note.code == "dst_repeated_hour" for note in times.notes)):
            raise ForeignText
        self.rising = not np.any(np.diff(times.micros[used]) < 0)
        last = int((times.micros[used] + self._latest[used]).max(initial=NAT))
        return Clock(Texts(times.micros), replace(times, micros=times.micros[:0]), last)


def _packed(
    numbers: NDArray[np.int64], later: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
    """Return (raw, known), see `Stamps.take`, of the numbers of texts, -1 for none, and of what the rows are later."""
    known = numbers >= 0
    return (numbers << _LATER) | later, None if known.all() else known


class Texts:
    """Reads stamps of a text by its number and of what they are later. micros: of texts [microseconds since 1970 UTC].
    """

    def __init__(self, micros: NDArray[np.int64]) -> None:
        self.micros = micros

    def __call__(self, raw: NDArray[np.float64]) -> NDArray[np.int64]:
        bits = raw.view(np.int64)
        return self.micros[bits >> _LATER] + (bits & _MASK)
