"""Time stamps that only this program understands, taken apart: a text for each hour, and what each row is later."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from .arrays import to_texts
from .columns import LazyColumn
from .minutes import taken_apart
from .store import ColumnStore, Room

_CLOCK = re.compile(r"(?<!\d)\d{1,2}:(00)(?::(00)(?:[.,:](0*))?)?(?!\d)")


@dataclass(frozen=True, eq=False)
class Hours:
    """Stamps of some rows. texts: (hours,) with zeros for minutes, seconds and fraction. which: (rows,) hour of each
    row. nanos: (rows,) what it is later [ns]."""

    texts: pa.Array
    which: NDArray[np.int64]
    nanos: NDArray[np.int64]

    def written(self) -> pa.Array:
        """Return the stamps as they stand in the file."""
        texts = self.texts.to_pylist()
        rows = zip(self.which.tolist(), self.nanos.tolist(), strict=True)
        return pa.array([_later(texts[hour], nanos) for hour, nanos in rows], pa.string())


def by_hours(time_format: str | None) -> bool:
    """Say whether stamps of a form may be taken apart at the minutes; the form is as for --time-format."""
    return time_format is None or "%" not in time_format or re.search("%[HI]:%M", time_format) is not None


def as_written(column: pa.ChunkedArray) -> Hours:
    """Return stamps that were not taken apart as if each were an hour of its own."""
    texts = pc.cast(column, pa.string()).combine_chunks()
    return Hours(texts, np.arange(len(column)), np.zeros(len(column), np.int64))


def by_texts(column: pa.ChunkedArray, minutes: bool) -> Hours:
    """Return written stamps by the texts of their minutes, if that may be; cells without a digit are no stamps."""
    words, which, later = taken_apart(column, minutes)
    if (which < 0).all():
        return as_written(column)
    return Hours(pa.concat_arrays([to_texts(words), pa.nulls(1, pa.string())]), np.where(which < 0, len(words), which),
                 later * 1000)


class HourlyStamps(LazyColumn):
    """A column of stamps from several blocks of rows."""

    def __init__(self, parts: Sequence[Hours]) -> None:
        self.parts = tuple(parts)
        super().__init__(pa.string(), sum(len(part.which) for part in self.parts))

    def arrow(self) -> pa.ChunkedArray:
        """Return the stamps as they stand in the file."""
        return pa.chunked_array([part.written() for part in self.parts], pa.string())

    def hours(self) -> Hours:
        """Return all rows as one part."""
        if len(self.parts) == 1:
            return self.parts[0]
        firsts = np.cumsum([0, *(len(part.texts) for part in self.parts)])
        which = [part.which + first for part, first in zip(self.parts, firsts, strict=False)]
        return Hours(pa.concat_arrays([part.texts for part in self.parts]), np.concatenate(which),
                     np.concatenate([part.nanos for part in self.parts]))


class StoredHours(HourlyStamps):
    """The stamps of a file: what each row has of its own is in a column store."""

    def __init__(self, room: Room) -> None:
        super().__init__([])
        self._store = ColumnStore(room)
        self._texts: list[pa.Array] = []
        self._count = 0

    def add(self, part: Hours) -> None:
        """Take the next rows."""
        self._store.add(np.stack([part.which + self._count, part.nanos]).view(np.float64))
        self._texts.append(part.texts)
        self._count += len(part.texts)
        self.rows += len(part.which)

    @property
    def texts(self) -> pa.Array:
        """(hours,) the texts of all rows."""
        return pa.concat_arrays(self._texts)

    def pieces(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Yield (which, nanos) of some rows at a time, as in Hours."""
        for which, nanos in zip(self._store.parts(0), self._store.parts(1), strict=True):
            yield which.view(np.int64), nanos.view(np.int64)

    def arrow(self) -> pa.ChunkedArray:
        texts = self.texts
        return pa.chunked_array([Hours(texts, *piece).written() for piece in self.pieces()], pa.string())

    def hours(self) -> Hours:
        return Hours(self.texts, self._store.column(0).view(np.int64), self._store.column(1).view(np.int64))


def _later(text: str | None, nanos: int) -> str | None:
    clock = _CLOCK.search(text) if text and nanos else None
    if text is None or clock is None:
        return text
    seconds, fraction = divmod(nanos, 1_000_000_000)
    letters = list(text)
    for group, digits in enumerate((f"{seconds // 60:02}", f"{seconds % 60:02}", f"{fraction:09}"), 1):
        begin, end = clock.span(group)
        letters[begin:end] = digits[: end - begin]
    return "".join(letters)
