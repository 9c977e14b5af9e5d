"""Time stamps at even intervals: two numbers instead of one per row, so that long files need no memory for them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .arrays import to_array, to_column
from .columns import LazyColumn
from .csv_signal import ForeignText
from .numbers import to_numbers
from .options import ReadOptions
from .parquet_columns import ParquetColumn
from .stamp_words import year_first
from .store import ColumnStore, Room
from .times import NAT, Times, to_times

LONG = 1 << 20  # rows from which on a record is worth reading in pieces


class EvenColumn(LazyColumn):
    """Time stamps at even intervals. start, step: in the unit of their type."""

    def __init__(self, start: int, step: int, rows: int, kind: pa.TimestampType) -> None:
        super().__init__(kind, rows)
        self.start, self.step = start, step

    @property
    def micros(self) -> tuple[int, int]:
        """(start, step) in microseconds; the step is 0 where it has no whole number of them."""
        many, few = {"s": (1_000_000, 1), "ms": (1000, 1), "us": (1, 1), "ns": (1, 1000)}[self.type.unit]
        whole = self.start % few == 0 and self.step % few == 0
        return (self.start * many // few, self.step * many // few if whole else 0)

    def arrow(self) -> pa.ChunkedArray:
        return pa.chunked_array([to_column(self.start + self.step * np.arange(self.rows), self.type)])


class StampColumn(LazyColumn):
    """Time stamps at any intervals, in a column store."""

    def __init__(self, kind: pa.TimestampType, room: Room) -> None:
        super().__init__(pa.timestamp("us", kind.tz), 0)
        self._store = ColumnStore(room)

    def add(self, part: pa.ChunkedArray) -> None:
        """Take the next rows. Raises ForeignText when they are of another kind."""
        if not pa.types.is_timestamp(part.type) or part.type.tz != self.type.tz:
            raise ForeignText
        micros = to_times(part, "", ReadOptions(), "").micros
        self._store.add(micros.view(np.float64).reshape(1, -1))
        self.rows += len(part)

    def pieces(self) -> Iterator[NDArray[np.int64]]:
        """Yield the stamps [microseconds since 1970 UTC], some rows at a time."""
        return (part.view(np.int64) for part in self._store.parts(0))

    def times(self) -> Times:
        """Return all stamps."""
        return Times(self._store.column(0).view(np.int64), zoned=self.type.tz is not None)

    def arrow(self) -> pa.ChunkedArray:
        micros = self.times().micros
        return pa.chunked_array([_stamps(micros, self.type)])


class NumberColumn(LazyColumn):
    """Stamps that are numbers, in a column store."""

    def __init__(self, room: Room) -> None:
        super().__init__(pa.float64(), 0)
        self._store = ColumnStore(room)

    def add(self, part: pa.ChunkedArray) -> None:
        """Take the next rows. Raises ForeignText when they are no numbers."""
        if not (is_number(part.type) or pa.types.is_null(part.type)):
            raise ForeignText
        self._store.add(to_numbers(part).values.reshape(1, -1))
        self.rows += len(part)

    def pieces(self) -> Iterator[NDArray[np.float64]]:
        """Yield the numbers, nan where there is none, some rows at a time."""
        return self._store.parts(0)

    def arrow(self) -> pa.ChunkedArray:
        values = self._store.column(0)
        return pa.chunked_array([pa.array(values, mask=np.isnan(values))])


def is_number(kind: pa.DataType) -> bool:
    """Whether cells of a type are integers or floating numbers."""
    return pa.types.is_integer(kind) or pa.types.is_floating(kind)


class EvenStamps:
    """Joins pieces of a column of stamps, and keeps two numbers instead as long as they are even.

    room: for stamps that are not, which go to a column store; None keeps them in `parts`.
    """

    def __init__(self, room: Room | None = None) -> None:
        self.parts: list[pa.ChunkedArray] = []
        self._even: EvenColumn | None = None
        self._room = room
        self._stored: StampColumn | NumberColumn | None = None

    def add(self, part: pa.ChunkedArray) -> None:
        """Take the next rows."""
        if not len(part):
            return
        known = self._even
        if self._stored is not None:
            self._stored.add(part)
            return
        if known is None and self.parts:
            self.parts.append(part)
            return
        kind = part.type if known is None else known.type
        enough = len(part) > 1 or known is not None  # a last line without an end comes by itself
        if pa.types.is_timestamp(kind) and part.type == kind and not part.null_count and enough:
            stamps = to_array(part.cast(pa.int64()))
            start = int(stamps[0])
            step = int(stamps[1]) - start if len(stamps) > 1 or known is None else known.step
            goes_on = known is None or (start == known.start + known.step * known.rows and step == known.step)
            if step > 0 and goes_on and not np.any(np.diff(stamps) != step):
                first, rows = (start, 0) if known is None else (known.start, known.rows)
                self._even = EvenColumn(first, step, rows + len(part), kind)
                return
        before = [] if known is None else [known.arrow()]
        self._even = None
        if self._room is not None and (pa.types.is_timestamp(kind) or is_number(kind)):
            self._stored = StampColumn(kind, self._room) if pa.types.is_timestamp(kind) else NumberColumn(self._room)
            for rows_before in (*before, part):
                self._stored.add(rows_before)
            return
        self.parts = [*before, part]

    @property
    def even(self) -> EvenColumn | None:
        """The column if its stamps are even."""
        return self._even

    @property
    def column(self) -> EvenColumn | StampColumn | NumberColumn | None:
        """The column, None where it is in `parts`."""
        return self._even or self._stored


def dated(part: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return texts that begin with a year as stamps, also with a header between them; any others as they are."""
    try:
        times = year_first(part, "", ReadOptions(), "")
    except ForeignText:
        return part
    return pa.chunked_array([_stamps(times.micros, pa.timestamp("us", "UTC" if times.zoned else None))])


def _stamps(micros: NDArray[np.int64], kind: pa.DataType) -> pa.Array:
    missing = micros == NAT
    return pa.array(micros, pa.int64(), mask=missing).cast(kind) if missing.any() else to_column(micros, kind)


def even_stamps(cells: LazyColumn) -> EvenColumn | None:
    """Return a column of stamps as one of even stamps if it is; None where it is not, or where nobody knows yet."""
    if isinstance(cells, EvenColumn):
        return cells
    if not isinstance(cells, ParquetColumn) or len(cells) <= LONG:
        return None
    stamps = EvenStamps()
    for piece in cells.file.pieces(cells.index):
        stamps.add(piece)
        if stamps.even is None:
            return None
    return stamps.even
