"""Lines of plain numbers to columns, compiled: the numbers that pyarrow would make of them, several times as fast.

Decimal texts are rounded as the standard says: short ones by one exact division (Clinger 1990), long ones from a
128-bit product (Lemire 2021, "Number parsing at a gigabyte per second"). What neither settles is left to the caller.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

EVENT = 0x7FF9_0000_0000_0000  # bits of a nan that stands for a word: plus the number of the word
SKIP, STAMP = -1, -2  # instead of a slot: a column that nobody needs, one of time stamps
DONE, WORDS_FULL, STRANGE = 0, 1, 2
LEAST, MOST = -60, 40  # powers of ten in the table


def _powers_of_five() -> NDArray[np.uint64]:
    """The first 128 bits of 5^q for q = LEAST..MOST, (powers, 2) high and low; those of 1 / 5^-q rounded up."""
    rows = []
    for q in range(LEAST, MOST + 1):
        five = 5 ** abs(q)
        if q >= 0:
            value = five << 127 >> (five.bit_length() - 1)
        else:
            z = (five - 1).bit_length()
            value = (1 << (z + 127 if q >= -27 else 2 * z + 128)) // five + 1
            while value >= 1 << 128:
                value >>= 1
        rows.append((value >> 64, value & 0xFFFF_FFFF_FFFF_FFFF))
    return np.array(rows, np.uint64)


FIVES = _powers_of_five()
TENS = 10.0 ** np.arange(23)


@numba.njit(cache=True, nogil=True, inline="always")
def _product(a: Any, b: Any) -> Any:
    """(high, low) 64 bits of the product of two uint64."""
    half, mask = np.uint64(32), np.uint64(0xFFFFFFFF)
    a1, a0, b1, b0 = a >> half, a & mask, b >> half, b & mask
    low, one, two = a0 * b0, a1 * b0, a0 * b1
    middle = (low >> half) + (one & mask) + (two & mask)
    return a1 * b1 + (one >> half) + (two >> half) + (middle >> half), (middle << half) | (low & mask)


@numba.njit(cache=True, nogil=True)
def long_number(digits: Any, power: int, fives: Any) -> Any:
    """(bits of digits * 10^power as float64, True), or (0, False) where these bits do not settle the rounding."""
    none = np.uint64(0)
    if power < LEAST or power > MOST or digits == none:
        return none, False
    zeros = 0
    while digits < np.uint64(0x8000000000000000):
        digits <<= np.uint64(1)
        zeros += 1
    high, low = _product(digits, fives[power - LEAST, 0])
    if (high & np.uint64(0x1FF)) == np.uint64(0x1FF):
        more, _ = _product(digits, fives[power - LEAST, 1])
        low += more
        if more > low:
            high += np.uint64(1)
    if low == np.uint64(0xFFFFFFFFFFFFFFFF) and (power < -27 or power > 55):
        return none, False
    top = high >> np.uint64(63)
    shift = top + np.uint64(9)
    mantissa = high >> shift
    exponent = ((217706 * power) >> 16) + 63 + np.int64(top) - zeros + 1023
    if exponent <= 0 or exponent >= 0x7FF - 1:
        return none, False
    if low <= np.uint64(1) and -4 <= power <= 23 and (mantissa & np.uint64(3)) == np.uint64(1) and (
            mantissa << shift) == high:
        mantissa &= ~np.uint64(1)
    mantissa += mantissa & np.uint64(1)
    mantissa >>= np.uint64(1)
    if mantissa >= np.uint64(1 << 53):
        mantissa = np.uint64(1 << 52)
        exponent += 1
    mantissa &= ~np.uint64(1 << 52)
    return mantissa | (np.uint64(exponent) << np.uint64(52)), True


@numba.njit(cache=True, nogil=True)
def count_lines(text: Any) -> int:
    """Number of line ends in bytes."""
    count = 0
    for k in range(len(text)):
        count += text[k] == 10
    return count


@numba.njit(cache=True, nogil=True)
def parse_lines(
    text: Any, slots: Any, delimiter: int, point: int, bits: Any, stamps: Any, words: Any, tens: Any, fives: Any,
) -> Any:
    """Parse whole lines. Returns (rows, bytes of stamps, words, how it ended: DONE, WORDS_FULL or STRANGE).

    text: bytes, the last one a line end. slots: per column its row of `bits`, SKIP or STAMP. bits: (slots, rows)
    int64, bits of the numbers, of EVENT plus a number for words. stamps: takes the cells of stamps as lines of text.
    words: (words, 3) of slot, start and end of each word that is not the one of the line before.
    """
    size, columns = len(text), len(slots)
    last = np.full(len(bits), -1)  # word of each slot
    number = np.empty(1, np.float64)
    number_bits = number.view(np.int64)
    empty = np.int64(0x7FF8_0000_0000_0000)
    at, row, written, found = 0, 0, 0, 0
    while at < size:
        stamped = False
        for column in range(columns):
            slot = slots[column]
            start = at
            letter = text[at]
            if slot >= 0:
                negative = letter == 45
                if negative:
                    at += 1
                    letter = text[at]
                digits, first = np.uint64(0), at
                digit = np.uint8(letter - np.uint8(48))
                while digit < 10:
                    digits = digits * np.uint64(10) + np.uint64(digit)
                    at += 1
                    letter = text[at]
                    digit = np.uint8(letter - np.uint8(48))
                count, power = at - first, 0
                if letter == point:
                    at += 1
                    first = at
                    letter = text[at]
                    digit = np.uint8(letter - np.uint8(48))
                    while digit < 10:
                        digits = digits * np.uint64(10) + np.uint64(digit)
                        at += 1
                        letter = text[at]
                        digit = np.uint8(letter - np.uint8(48))
                    power = first - at
                    count -= power
                if count and (letter == 101 or letter == 69):
                    at += 1
                    minus = text[at] == 45
                    if minus or text[at] == 43:
                        at += 1
                    exponent: Any = 0
                    first = at
                    while np.uint8(text[at] - np.uint8(48)) < 10 and at - first < 4:
                        exponent = exponent * 10 + np.int64(text[at]) - 48
                        at += 1
                    if at == first:
                        count = 0  # no number
                    power += -exponent if minus else exponent
                    letter = text[at]
                plain = count > 0 and (letter == delimiter or letter == 10 or letter == 13)
                if plain:
                    if count > 19:  # the digits may not fit: zeros in front do not count
                        first = start
                        while text[first] == 45 or text[first] == 48 or text[first] == point:
                            count -= text[first] == 48
                            first += 1
                        if count > 19:
                            return row, written, found, STRANGE
                    if digits == np.uint64(0):
                        number[0] = 0.0
                    elif digits < np.uint64(1 << 53) and -22 <= power <= 22:
                        number[0] = np.float64(np.int64(digits))
                        if power < 0:
                            number[0] /= tens[-power]
                        elif power > 0:
                            number[0] *= tens[power]
                    else:
                        pattern, settled = long_number(digits, power, fives)
                        if not settled:
                            return row, written, found, STRANGE
                        number_bits[0] = np.int64(pattern)
                    bits[slot, row] = number_bits[0] | (np.int64(-0x8000000000000000) if negative else np.int64(0))
                elif at == start and (letter == delimiter or letter == 10 or letter == 13):
                    bits[slot, row] = empty
                else:
                    while letter != delimiter and letter != 10 and letter != 13:
                        if letter == 34:
                            return row, written, found, STRANGE
                        at += 1
                        letter = text[at]
                    word = last[slot]
                    same = word >= 0 and words[word, 2] - words[word, 1] == at - start
                    if same:
                        for k in range(at - start):
                            if text[start + k] != text[words[word, 1] + k]:
                                same = False
                                break
                    if not same:
                        if found == len(words):
                            return row, written, found, WORDS_FULL
                        word = found
                        words[word, 0], words[word, 1], words[word, 2] = slot, start, at
                        last[slot] = word
                        found += 1
                    bits[slot, row] = EVENT + word
            else:
                if slot == STAMP:
                    if stamped:
                        stamps[written] = delimiter
                        written += 1
                    stamped = True
                quoted = False
                while letter != 10 and (quoted or (letter != delimiter and letter != 13)):
                    if letter == 34:
                        quoted = not quoted
                    if slot == STAMP:
                        stamps[written] = letter
                        written += 1
                    at += 1
                    letter = text[at]
                if quoted:
                    return row, written, found, STRANGE
            if column < columns - 1:
                if letter != delimiter:
                    return row, written, found, STRANGE
                at += 1
        if letter == 13:
            at += 1
            letter = text[at]
        if letter != 10:
            return row, written, found, STRANGE
        at += 1
        if stamped:
            stamps[written] = 10
            written += 1
        row += 1
    return row, written, found, DONE
