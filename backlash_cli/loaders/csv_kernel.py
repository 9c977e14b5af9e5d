"""Lines of plain numbers to columns, compiled: the numbers that pyarrow would make of them, several times as fast.

Places in the text are unsigned, as the compiler then need not ask whether they count from the end.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .compiled import bits_of, compiled, inlined, low_zeros, word_at
from .decimal_kernel import any_number, not_digits, number_of, rounded
from .text_blocks import PAD

EVENT = 0x7FF9_0000_0000_0000  # bits of a nan that stands for a word: plus the number of the word
SKIP, STAMP = -1, -2  # instead of a slot: a column that nobody needs, one of time stamps
DONE, WORDS_FULL, STRANGE = 0, 1, 2
NUMBER, EMPTY, WORD, UNSETTLED = 0, 1, 2, 3  # what a cell holds
_NOTHING = 0x7FF8_0000_0000_0000
_SIGN = 0x8000_0000_0000_0000
_ZEROS = 0x3030_3030_3030_3030


@compiled
def look(text: Any) -> Any:
    """(number of line ends, whether all letters are ASCII) of bytes."""
    lines, letters = 0, np.uint8(0)
    for k in range(len(text)):
        lines += text[k] == 10
        letters |= text[k]
    return lines, letters < 128


@inlined
def _ends(letter: Any, delimiter: Any) -> Any:
    return letter == delimiter or letter == 10 or letter == 13


@inlined
def _number(text: Any, at: Any, point: Any, whole_tens: Any) -> Any:
    """A number of up to 19 digits with a point somewhere behind the first: (digits, how many, power of ten, end).

    How many digits is 0 where there is anything else.
    """
    zeros, eight, one, three = np.uint64(_ZEROS), np.uint64(8), np.uint64(1), np.uint64(3)
    nibbles = word_at(text, at) ^ zeros
    before = low_zeros(not_digits(nibbles)) & np.uint64(120)
    digits, after, marks = np.uint64(0), np.uint64(0), before
    if eight <= before < np.uint64(64) and text[at + (before >> three)] == point:
        digits = number_of(nibbles, before)
        at += (before >> three) + one
        for _ in range(3):
            nibbles = word_at(text, at) ^ zeros
            marks = low_zeros(not_digits(nibbles)) & np.uint64(120)
            if marks == 0 or after + marks + before > np.uint64(19 * 8):
                break
            digits = digits * whole_tens[marks >> three] + number_of(nibbles, marks)
            after += marks
            at += marks >> three
            if marks < np.uint64(64):
                marks = np.uint64(0)
                break
    count = np.int64((before + after) >> three) if marks == 0 else np.int64(0)
    return digits, count, -np.int64(after >> three), at


@inlined
def _cell(text: Any, at: Any, delimiter: Any, point: Any, tens: Any, whole_tens: Any, fives: Any) -> Any:
    """(bits of the number in a cell, what the cell holds, its end; where it begins if that is no number)."""
    nothing, begin = np.uint64(_NOTHING), at
    if _ends(text[at], delimiter):
        return nothing, EMPTY, begin
    negative = text[at] == 45
    if negative:
        at += np.uint64(1)
    first = at
    digits, count, power, at = _number(text, first, point, whole_tens)
    if count == 0 or not _ends(text[at], delimiter):
        digits, count, power, at = any_number(text, first, point)
    if count == 0 or not _ends(text[at], delimiter):
        return nothing, WORD, begin
    if count > 19:
        return nothing, UNSETTLED, begin
    bits, settled = rounded(digits, power, tens, fives)
    if not settled:
        return nothing, UNSETTLED, begin
    return bits | np.uint64(_SIGN) if negative else bits, NUMBER, at


@inlined
def _word(text: Any, at: Any, delimiter: Any, last: Any, words: Any) -> Any:
    """End of a word, and whether it is that of the line before."""
    begin = at
    if last >= 0:
        k, n = np.uint64(words[last, 1]), np.uint64(words[last, 2])
        while k < n and text[at] == text[k]:
            at += np.uint64(1)
            k += np.uint64(1)
        if k == n and _ends(text[at], delimiter):
            return at, True
    at = begin
    while not _ends(text[at], delimiter):
        at += np.uint64(1)
    return at, False


@compiled
def parse_lines(
    text: Any, size: int, slots: Any, delimiter: int, point: int, bits: Any, stamps: Any, words: Any, last: Any,
    tens: Any, whole_tens: Any, fives: Any,
) -> Any:
    """Parse whole lines. Returns (rows, words, how it ended: DONE, WORDS_FULL or STRANGE).

    text: bytes, of which `size` are lines; the last one of these ends a line, and PAD more follow. slots: per column
    its row of `bits`, SKIP or STAMP. bits: (slots, rows) uint64, bits of the numbers, of EVENT plus a number for words.
    stamps: (rows, columns of stamps, 2) takes where their cells begin and end. words: (words, 4) of slot, start, end
    and row of each word that is not the one of the line before. last: (slots,) -1, takes the last word of each.
    """
    columns, lines = np.uint64(len(slots)), np.uint64(bits.shape[1])
    if len(text) < size + PAD or size < 1 or text[size - 1] != 10:
        return 0, 0, STRANGE
    one, three, eight, whole, letter_of = np.uint64(1), np.uint64(3), np.uint64(8), np.uint64(56), np.uint64(0xFF)
    zeros, sign, comma = np.uint64(_ZEROS), np.uint64(point), np.uint64(delimiter)
    at, end, row, found = np.uint64(0), np.uint64(size), np.uint64(0), 0
    while at < end and row < lines:
        stamp = 0
        column = np.uint64(0)
        letter = np.uint64(0)
        while column < columns:
            slot = slots[column]
            column += one
            if slot >= 0:
                # most cells: digits and a point, all in eight letters with the delimiter
                word = word_at(text, at)
                nibbles = word ^ zeros
                marks = not_digits(nibbles)
                before = low_zeros(marks) & whole
                marks &= marks - one
                behind = low_zeros(marks) & whole
                letter = (word >> behind) & letter_of
                if before != 0 and behind != 0 and (word >> before) & letter_of == sign and letter == comma:
                    left = (one << before) - one
                    joined = (nibbles & left) | ((nibbles >> eight) & ~left)
                    digits = np.float64(np.int64(number_of(joined, behind - eight)))
                    bits[np.uint64(slot), row] = bits_of(digits / tens[(behind - before - eight) >> three])
                    at += behind >> three
                else:
                    found_bits, kind, at = _cell(text, at, delimiter, point, tens, whole_tens, fives)
                    if kind == WORD:
                        begin = at
                        at, known = _word(text, begin, delimiter, last[slot], words)
                        if not known:
                            for k in range(np.int64(begin), np.int64(at)):
                                if text[k] == 34:
                                    return np.int64(row), found, STRANGE
                            if found == len(words):
                                return np.int64(row), found, WORDS_FULL
                            words[found, 0], words[found, 1], words[found, 2] = slot, np.int64(begin), np.int64(at)
                            words[found, 3] = np.int64(row)
                            last[slot] = found
                            found += 1
                        found_bits = np.uint64(EVENT) + np.uint64(last[slot])
                    elif kind == UNSETTLED:
                        return np.int64(row), found, STRANGE
                    bits[np.uint64(slot), row] = found_bits
                    letter = np.uint64(text[at])
            else:
                begin = at
                letter = np.uint64(text[at])
                quoted = False
                while letter != 10 and (quoted or (letter != comma and letter != 13)):
                    if letter == 34:
                        quoted = not quoted
                    at += one
                    letter = np.uint64(text[at])
                if quoted:
                    return np.int64(row), found, STRANGE
                if slot == STAMP:
                    stamps[row, stamp, 0], stamps[row, stamp, 1] = np.int64(begin), np.int64(at)
                    stamp += 1
            if column < columns:
                if letter != comma:
                    return np.int64(row), found, STRANGE
                at += one
        if letter == 13:
            at += one
            letter = np.uint64(text[at])
        if letter != 10:
            return np.int64(row), found, STRANGE
        at += one
        row += one
    return np.int64(row), found, DONE if at == end else STRANGE


@compiled
def put_words(cells: Any, rows: Any, events: Any, meant: Any) -> None:
    """Put bits where those of events stand: each event from its row on, up to the row of the next."""
    for k in range(len(rows)):
        last = rows[k + 1] if k + 1 < len(rows) else len(cells)
        some, event, bits = cells[rows[k] : last], events[k], meant[k]
        for i in range(len(some)):
            some[i] = bits if some[i] == event else some[i]
