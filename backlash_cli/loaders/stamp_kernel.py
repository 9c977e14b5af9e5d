"""Cells of time stamps taken apart at the minutes, compiled: what stands around them is understood once an hour."""

from __future__ import annotations

from typing import Any

import numpy as np

from .compiled import compiled, inlined, word_at

COLON, POINT, COMMA, ZERO = 58, 46, 44, 48
NOT_ONE_FORM = -1


@inlined
def _digit(text: Any, at: int, end: int) -> Any:
    return at < end and np.uint8(text[at] - np.uint8(ZERO)) < 10


@inlined
def _pair(text: Any, at: int) -> Any:
    """The number of two digits, 99 and more where they are none."""
    tens, ones = np.int64(text[at]) - ZERO, np.int64(text[at + 1]) - ZERO
    return tens * 10 + ones if 0 <= tens <= 9 and 0 <= ones <= 9 else 100


@compiled
def _clock(text: Any, begin: int, end: int) -> Any:
    """Where the minutes of a stamp stand behind its hour, whether seconds follow, and how many digits of a fraction;
    the place is NOT_ONE_FORM where there is no such thing."""
    for at in range(begin + 1, end - 2):
        if text[at] != COLON or not _digit(text, at - 1, end) or not _digit(text, at + 1, end):
            continue
        hour = at - 1
        while hour > begin and _digit(text, hour - 1, end):
            hour -= 1
        if at - hour > 2:  # a year, with the clock behind it
            continue
        if not _digit(text, at + 2, end) or _digit(text, at + 3, end):
            return NOT_ONE_FORM, False, 0
        seconds = at + 5 < end and text[at + 3] == COLON and _digit(text, at + 4, end) and _digit(text, at + 5, end)
        if not seconds:
            return at + 1, False, 0
        if _digit(text, at + 6, end):
            return NOT_ONE_FORM, False, 0
        count = 0
        if at + 6 < end and (text[at + 6] == POINT or text[at + 6] == COMMA or text[at + 6] == COLON):
            while _digit(text, at + 7 + count, end):
                count += 1
        return (at + 1, True, count) if count <= 9 else (NOT_ONE_FORM, False, 0)
    return NOT_ONE_FORM, False, 0


@inlined
def _same(text: Any, a: int, b: int, count: int) -> Any:
    """Are `count` bytes at two places the same?"""
    done = 0
    while count - done >= 8:
        if word_at(text, a + done) != word_at(text, b + done):
            return False
        done += 8
    if done == count:
        return True
    left = np.uint64(8 * (8 - (count - done)))
    return (word_at(text, a + done) ^ word_at(text, b + done)) << left == np.uint64(0)


@compiled
def hours_apart(text: Any, cells: Any, most: int, which: Any, nanos: Any, hours: Any) -> Any:
    """Group stamps that differ in minutes, seconds and fraction only. Returns (groups, bytes written to `hours`).

    text: bytes, PAD more than the cells reach. cells: (rows, 2) begin and end of each. which, nanos: (rows,) take the
    group of each row and what it is later than its hour [ns]. hours: takes a stamp of each group with zeros there, as
    lines. NOT_ONE_FORM groups where a cell holds no clock, or there are more than `most`.
    """
    groups = written = 0
    width, first, at, has_seconds, count, tail = -1, 0, 0, False, 0, 0
    for row in range(len(cells)):
        begin, end = cells[row, 0], cells[row, 1]
        minutes = begin + at
        known = end - begin == width and _same(text, begin, first, at)
        known = known and _same(text, minutes + tail, first + at + tail, width - at - tail)
        if known and has_seconds:
            known = text[minutes + 2] == COLON and (count == 0 or text[minutes + 5] == text[first + at + 5])
        if not known:
            minutes, has_seconds, count = _clock(text, begin, end)
            if minutes == NOT_ONE_FORM or groups == most or written + end - begin + 1 > len(hours):
                return NOT_ONE_FORM, 0
            width, first, at = end - begin, begin, minutes - begin
            tail = 2 + 3 * has_seconds + (count > 0) + count
            groups += 1
            for k in range(begin, end):
                inside = k - minutes
                digit = 0 <= inside < tail and _digit(text, k, end)
                hours[written] = ZERO if digit else text[k]
                written += 1
            hours[written] = 10
            written += 1
        minute = _pair(text, minutes)
        second = _pair(text, minutes + 3) if has_seconds else 0
        fraction = np.int64(0)
        for k in range(minutes + 6, minutes + 6 + count):
            if not _digit(text, k, end):
                return NOT_ONE_FORM, 0
            fraction = fraction * 10 + np.int64(text[k]) - ZERO
        if minute > 59 or second > 59:
            return NOT_ONE_FORM, 0
        for _ in range(count, 9):
            fraction *= 10
        which[row] = groups - 1
        nanos[row] = (minute * 60 + second) * 1_000_000_000 + fraction
    return groups, written


@compiled
def copy_cells(text: Any, cells: Any, delimiter: int, out: Any) -> int:
    """Copy the cells (rows, columns, 2) to lines of text; returns their length."""
    written = 0
    for row in range(len(cells)):
        for column in range(cells.shape[1]):
            if column:
                out[written] = delimiter
                written += 1
            for k in range(cells[row, column, 0], cells[row, column, 1]):
                out[written] = text[k]
                written += 1
        out[written] = 10
        written += 1
    return written
