"""Time stamps that only this program understands, taken apart: a text for each hour, and what each row is later."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from .columns import LazyColumn

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
