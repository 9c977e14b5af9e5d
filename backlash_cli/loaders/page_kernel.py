"""The pages of a Parquet column of numbers, compiled: their headers, and indices into a dictionary.

Format: parquet-format, PageHeader in Thrift's compact protocol, and the hybrid of run lengths and packed bits. What is
not as expected gives -1, never a wrong number; nothing is read beyond the arrays that are given.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .compiled import compiled, word_at

# Where `page_header` writes the fields that matter: those of the page itself, then of the header of its kind.
KIND, UNPACKED, PACKED = 1, 2, 3
OF_DATA, OF_DICTIONARY, OF_DATA_2 = 10, 20, 30
VALUES = 1
PLACES = 40
DEPTH = 6


@compiled
def _varint(data: Any, at: int) -> Any:
    """A whole number of seven bits a byte, and the place behind it; -1 where it does not end."""
    found, shift = np.uint64(0), np.uint64(0)
    for k in range(at, min(at + 9, len(data))):
        found |= np.uint64(data[k] & 127) << shift
        if data[k] < 128:
            return np.int64(found), k + 1
        shift += np.uint64(7)
    return np.int64(0), np.int64(-1)


@compiled
def page_header(data: Any, at: int, out: Any, stack: Any) -> Any:
    """Read the header at a place, and return the place behind it. out: (PLACES,) numbers. stack: (DEPTH,) to work in.
    """
    for k in range(len(out)):
        out[k] = -1
    depth = stack[0] = 0
    while 0 <= at < len(data):
        head = np.int64(data[at])
        at += 1
        if head == 0:
            depth -= 1
            if depth < 0:
                return at
            continue
        kind, field = head & 15, stack[depth] + (head >> 4)
        value = np.int64(kind == 1)
        if head >> 4 == 0:
            number, at = _varint(data, at)
            field = (number >> 1) ^ -(number & 1)
            if at < 0:
                return -1
        stack[depth] = field
        if kind == 3:
            at += 1
        elif 4 <= kind <= 6:
            number, at = _varint(data, at)
            value = (number >> 1) ^ -(number & 1)
        elif kind == 7:
            at += 8
        elif kind == 8:
            number, at = _varint(data, at)
            at = at + number if at >= 0 and 0 <= number <= len(data) else -1
        elif kind == 12:
            depth += 1
            if depth >= len(stack):
                return -1
            stack[depth] = 0
            continue
        elif kind > 2:
            return -1
        if kind <= 6 and 0 < field < 10:
            if depth == 0:
                out[field] = value
            elif depth == 1:
                of = 10 if stack[0] == 5 else 20 if stack[0] == 7 else 30 if stack[0] == 8 else -1
                if of > 0:
                    out[of + field] = value
    return -1


@compiled
def levels_end(data: Any, values: int) -> Any:
    """Return the place behind the definition levels of a page whose cells are all there; -1 where one may be empty."""
    if len(data) < 6:
        return -1
    size = np.int64(data[0]) | np.int64(data[1]) << 8 | np.int64(data[2]) << 16 | np.int64(data[3]) << 24
    header, at = _varint(data, 4)
    if at < 0 or header & 1 or header >> 1 < values or at >= len(data) or data[at] != 1 or 4 + size > len(data):
        return -1
    return 4 + size


@compiled
def look_up(data: Any, at: int, width: int, table: Any, out: Any) -> Any:
    """Write the numbers of a dictionary whose indices begin at a place; return how many, -1 where something is wrong.

    width: bits of an index.
    """
    done, top, size, in_bytes = 0, np.uint64(len(table) - 1), len(data), (width + 7) // 8
    mask = (np.uint64(1) << np.uint64(width)) - np.uint64(1)
    while done < len(out):
        header, at = _varint(data, at)
        count = header >> 1
        if at < 0 or count < 1:
            return -1
        if header & 1:
            groups = min(count, len(out))  # of eight indices
            count = min(groups * 8, len(out) - done)
            if (count * width + 7) // 8 > size - at:
                return -1
            if not _packed(data, at, width, mask, table, top, out[done : done + count]):
                return -1
            at += groups * width
        else:
            count = min(count, len(out) - done)
            if in_bytes > size - at:
                return -1
            index = np.int64(0)
            for k in range(in_bytes):
                index |= np.int64(data[at + k]) << (8 * k)
            if index >= len(table):
                return -1
            for k in range(done, done + count):
                out[k] = table[index]
            at += in_bytes
        done += count
    return done


@compiled
def _packed(data: Any, at: int, width: int, mask: Any, table: Any, top: Any, out: Any) -> Any:
    """Write the numbers of indices of `width` bits each, one behind the other; False where one is too large."""
    count, worst, first = len(out), np.uint64(0), at * 8
    room = len(data) - 8 - at  # bytes up to the last place from which eight can be fetched
    near = 0 if room < 0 else count if width == 0 else min(count, room * 8 // width + 1)
    for k in range(near):
        bit = np.uint64(first + k * width)
        index = (word_at(data, bit >> np.uint64(3)) >> (bit & np.uint64(7))) & mask
        worst = max(worst, index)
        out[k] = table[min(index, top)]
    for k in range(near, count):
        index = np.uint64(0)
        for b in range(width):
            place = first + k * width + b
            index |= np.uint64((data[place >> 3] >> (place & 7)) & 1) << np.uint64(b)
        worst = max(worst, index)
        out[k] = table[min(index, top)]
    return worst <= top
