"""Written stamps of a block of rows that can be understood before those that follow are seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import InputError
from .arrays import to_texts
from .csv_signal import ForeignText
from .minutes import taken_apart
from .options import ReadOptions
from .times import DAY, NAT, Times, from_text, to_times

CONTEXT = 2000  # texts beside which others are read


def year_first(column: pa.ChunkedArray, name: str, options: ReadOptions, where: str) -> Times:
    """Read stamps that begin with the year, which mean the same whatever stands beside them.

    Raises ForeignText where there are others.
    """
    words, which, later = taken_apart(column, True)
    used = np.unique(which[which >= 0])
    if options.time_format is not None or not all(_is_year(words[i].strip()[:5]) for i in used.tolist()):
        raise ForeignText
    try:
        times = from_text(to_texts(words), name, options, where)
    except InputError:
        raise ForeignText from None
    if times.notes or not times.absolute or np.any(times.micros[used] == NAT):
        raise ForeignText
    micros = np.append(times.micros, NAT)[which]
    return replace(times, micros=np.where(which < 0, NAT, micros + later))


def _is_year(begin: str) -> bool:
    return begin[:2] in ("19", "20") and begin[2:4].isdigit() and begin[4:] in ("-", "/", ".")


def of_day(column: pa.ChunkedArray, name: str, options: ReadOptions, where: str) -> NDArray[np.int64]:
    """Return times of day [microseconds], NAT where there is none. Raises ForeignText for any other stamps."""
    try:
        times = to_times(column, name, replace(options, timezone=None, time_format=None), where)
    except InputError:
        raise ForeignText from None
    if not any(note.code == "relative_time" for note in times.notes):
        raise ForeignText
    return np.where(times.micros == NAT, NAT, times.micros % DAY)


class TextsSoFar:
    """Reads texts as they come, each as beside those that came first; at the end it is seen whether that was right."""

    def __init__(self, name: str, options: ReadOptions, where: str) -> None:
        self.name, self.where = name, where
        self.options = replace(options, timezone=None)
        self.zoned = False
        self._first: list[str] = []
        self._micros = np.zeros(0, np.int64)

    def add(self, words: list[str]) -> NDArray[np.int64]:
        """Take texts that were not there before, and return what all so far mean. Raises InputError."""
        if words:
            beside = self._first or words[:CONTEXT]
            times = self.all([*beside, *words])
            if self._first and times.zoned != self.zoned:
                raise InputError("some time stamps carry an offset and some do not", where=self.where)
            self.zoned, self._first = times.zoned, beside
            self._micros = np.concatenate([self._micros, times.micros[len(beside) :]])
        return self._micros

    def all(self, words: list[str]) -> Times:
        """Return what texts mean together. Raises InputError."""
        return from_text(to_texts(words), self.name, self.options, self.where)
