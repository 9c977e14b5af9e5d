"""Written stamps of one form, taken apart at the seconds: then only one text per minute has to be understood."""

from __future__ import annotations

import re

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .arrays import to_column, to_texts
from .numbers import codes_and_words

LEAST = 1000  # rows below which it is not worth the trouble
_SECONDS = re.compile(rb"(?<!\d)\d{1,2}:\d\d:(\d\d)(?:[.,:](\d{1,9}))?(?!\d)")
_POINT, _ZERO = ord("."), ord("0")


def whole_minutes(column: pa.ChunkedArray | pa.Array) -> tuple[pa.Array, NDArray[np.int64], NDArray[np.int64]] | None:
    """Return (texts with zeros as seconds, which of them each row has, its seconds in microseconds).

    None where the rows are not all of one length with their seconds at one place, or change too quickly.
    """
    letters = _letters(column)
    if letters is None or len(letters) < LEAST:
        return None
    match = _SECONDS.search(letters[0].tobytes())
    if match is None:
        return None
    at = match.start(1)
    fraction = range(*match.span(2)) if match[2] else range(0)
    digits = [at, at + 1, *fraction]
    values = letters[:, digits].astype(np.int64) - _ZERO
    fixed = [at - 1, at - 4, *([fraction[0] - 1] if fraction else [])]
    beyond = values.min() < 0 or values.max() > 9 or np.any(values[:, 0] * 10 + values[:, 1] > 60)
    if beyond or np.any(letters[:, fixed] != letters[0, fixed]):
        return None
    letters[:, digits] = _ZERO
    starts = np.flatnonzero(np.concatenate([[True], np.any(letters[1:] != letters[:-1], axis=1)]))
    if len(starts) > len(letters) // 4:
        return None
    counts = np.diff(np.append(starts, len(letters)))
    weights = [10_000_000, 1_000_000, *(10 ** (5 - k) if k < 6 else 0 for k in range(len(fraction)))]
    try:
        texts = to_texts([row.tobytes().decode() for row in letters[starts]])
    except UnicodeDecodeError:
        return None
    return texts, np.repeat(np.arange(len(starts)), counts), values @ np.array(weights)


def _letters(column: pa.ChunkedArray | pa.Array) -> NDArray[np.uint8] | None:
    """(rows, letters) bytes of texts of one length, a copy; None where they are not."""
    if column.null_count or not len(column):
        return None
    column = column.cast(pa.large_string())
    array = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    if isinstance(array, pa.ChunkedArray):
        return None
    _, offsets, data = array.buffers()
    ends = np.frombuffer(offsets, np.int64)[array.offset : array.offset + len(array) + 1]
    width = int(ends[1] - ends[0])
    if not 0 < width <= 64 or np.any(np.diff(ends) != width):
        return None
    return np.frombuffer(data, np.uint8)[ends[0] : ends[-1]].reshape(len(array), width).copy()


def is_written(kind: pa.DataType) -> bool:
    """Whether a column holds texts."""
    return pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_dictionary(kind)


def taken_apart(
    column: pa.ChunkedArray, minutes: bool
) -> tuple[list[str], NDArray[np.int64], NDArray[np.int64]]:
    """Return (texts, which of them each row has, what it is later [microseconds]); -1 where there is no stamp.

    A cell without a digit, as in a header between the rows, is no stamp. minutes: texts of minutes may do.
    """
    split = whole_minutes(column) if minutes else None
    if split is not None:
        return split[0].to_pylist(), split[1], split[2]
    codes, words = codes_and_words(column)
    digits = np.array([any(map(str.isdigit, word)) for word in words] + [False])
    there = digits[codes]
    if there.all():
        return words, codes, np.zeros(len(codes), np.int64)
    which, later = np.full(len(codes), -1), np.zeros(len(codes), np.int64)
    rows = np.flatnonzero(there)
    if len(rows):
        words, which[rows], later[rows] = taken_apart(column.take(to_column(rows, pa.int64())), minutes)
    return words, which, later
