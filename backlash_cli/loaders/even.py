"""Time stamps at even intervals: two numbers instead of one per row, so that long files need no memory for them."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from .columns import LazyColumn, ParquetColumn

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
        return pa.chunked_array([pa.array(self.start + self.step * np.arange(self.rows)).cast(self.type)])


class EvenStamps:
    """Joins pieces of a column of stamps, and keeps two numbers instead as long as they are even."""

    def __init__(self) -> None:
        self.parts: list[pa.ChunkedArray] = []
        self._even: EvenColumn | None = None

    def add(self, part: pa.ChunkedArray) -> None:
        """Take the next rows."""
        if not len(part):
            return
        known = self._even
        if known is None and self.parts:
            self.parts.append(part)
            return
        kind = part.type if known is None else known.type
        if pa.types.is_timestamp(kind) and part.type == kind and not part.null_count and len(part) > 1:
            stamps = part.cast(pa.int64()).to_numpy()
            start, step = int(stamps[0]), int(stamps[1] - stamps[0])
            goes_on = known is None or (start == known.start + known.step * known.rows and step == known.step)
            if step > 0 and goes_on and not np.any(np.diff(stamps) != step):
                first, rows = (start, 0) if known is None else (known.start, known.rows)
                self._even = EvenColumn(first, step, rows + len(part), kind)
                return
        self.parts = [part] if known is None else [known.arrow(), part]
        self._even = None

    @property
    def column(self) -> EvenColumn | None:
        """The column, None where its stamps are not even: then it is in `parts`."""
        return self._even


def even_stamps(cells: LazyColumn) -> EvenColumn | None:
    """Return a column of stamps as one of even stamps if it is; None where it is not, or where nobody knows yet."""
    if isinstance(cells, EvenColumn):
        return cells
    if not isinstance(cells, ParquetColumn) or len(cells) <= LONG:
        return None
    stamps = EvenStamps()
    for piece in cells.file.pieces(cells.index):
        stamps.add(piece)
        if stamps.column is None:
            return None
    return stamps.column
