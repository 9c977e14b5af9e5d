"""Cells of Arrow columns as NumPy arrays.

Arrow's own `to_numpy` looks for pandas first, and to import that takes longer than a small file takes to be scanned.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray


def to_array(column: pa.ChunkedArray | pa.Array) -> NDArray[Any]:
    """Return the cells (rows,) of a column of numbers or flags as `to_numpy` does: nan where a cell is empty, also of
    whole numbers, which become float64 then. Flags must all be there. The array may be that of the column: read only.
    """
    if isinstance(column, pa.Array):
        return _of_one(column)
    if column.num_chunks == 1:
        return _of_one(column.chunk(0))
    if not column.num_chunks:
        return np.empty(0, _kind(column.type))
    parts = [_of_one(chunk) for chunk in column.chunks]
    return np.concatenate([part.astype(np.float64) for part in parts] if column.null_count else parts)


def where_true(cells: pa.Array) -> NDArray[np.bool_]:
    """Return flags (rows,), False where there is none."""
    return to_array(pc.and_kleene(cells, cells.is_valid()))


def _of_one(cells: pa.Array) -> NDArray[Any]:
    kind = _kind(cells.type)
    if kind.kind == "b":
        return _of_one(cells.cast(pa.uint8())).astype(bool)
    buffer = cells.buffers()[1]
    if buffer is None or not len(cells):
        return np.full(len(cells), np.nan) if len(cells) else np.empty(0, kind)
    values = np.frombuffer(buffer, kind, len(cells), cells.offset * kind.itemsize)
    if not cells.null_count:
        values.flags.writeable = False
        return values
    out = values.astype(kind if kind.kind == "f" else np.float64)
    out[_of_one(cells.is_null())] = np.nan
    return out


@cache
def _kind(kind: pa.DataType) -> np.dtype[Any]:
    letter = "f" if pa.types.is_floating(kind) else "u" if pa.types.is_unsigned_integer(kind) else "i"
    return np.dtype(bool) if pa.types.is_boolean(kind) else np.dtype(f"{letter}{kind.bit_width // 8}")


def to_column(values: NDArray[np.int64], kind: pa.DataType) -> pa.Array:
    """Return whole numbers (rows,) as a column of stamps or of whole numbers, without a copy."""
    values = np.ascontiguousarray(values, np.int64)
    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(values)])


def to_texts(words: Sequence[str]) -> pa.Array:
    """Return texts as a column."""
    coded = [word.encode() for word in words]
    ends = np.cumsum([0, *map(len, coded)], dtype=np.int64)
    if ends[-1] > np.iinfo(np.int32).max:
        return pa.array(words, pa.string())
    return pa.Array.from_buffers(pa.string(), len(coded), [None, pa.py_buffer(ends.astype(np.int32)),
                                                           pa.py_buffer(b"".join(coded))])
