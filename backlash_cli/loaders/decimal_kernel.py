"""Decimal texts to float64, compiled and rounded as the standard says.

Short ones by one exact division (Clinger 1990), long ones from a 128-bit product (Lemire 2021, "Number parsing at a
gigabyte per second"). What neither settles is left to the caller. Digits are taken eight at a time from a word of
memory, as in Lemire's paper.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .compiled import bits_of, compiled, inlined

LEAST, MOST = -60, 40  # powers of ten in the table
EXACT = 22  # the highest power of ten that is a float64


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
TENS = 10.0 ** np.arange(EXACT + 1)
WHOLE_TENS = 10 ** np.arange(20, dtype=np.uint64)


@inlined
def not_digits(nibbles: Any) -> Any:
    """The highest bit of every byte above 9."""
    high = np.uint64(0x8080808080808080)
    return (((nibbles & ~high) + np.uint64(0x7676767676767676)) | nibbles) & high


@inlined
def number_of(nibbles: Any, bits: Any) -> Any:
    """The number whose digits are the bytes in the lowest `bits`, 8 to 64, the first one lowest."""
    low = np.uint64(0x000000FF000000FF)
    x = nibbles << (np.uint64(64) - bits)
    x = x * np.uint64(10) + (x >> np.uint64(8))
    return ((x & low) * np.uint64(0x000F424000000064)
            + ((x >> np.uint64(16)) & low) * np.uint64(0x0000271000000001)) >> np.uint64(32)


@inlined
def _product(a: Any, b: Any) -> Any:
    """(high, low) 64 bits of the product of two uint64."""
    half, mask = np.uint64(32), np.uint64(0xFFFFFFFF)
    a1, a0, b1, b0 = a >> half, a & mask, b >> half, b & mask
    low, one, two = a0 * b0, a1 * b0, a0 * b1
    middle = (low >> half) + (one & mask) + (two & mask)
    return a1 * b1 + (one >> half) + (two >> half) + (middle >> half), (middle << half) | (low & mask)


@compiled
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


@inlined
def rounded(digits: Any, power: int, tens: Any, fives: Any) -> Any:
    """(bits of digits * 10^power as float64, True), or (0, False) where the rounding is not settled."""
    if digits < np.uint64(1 << 53) and -EXACT <= power <= EXACT:
        number = np.float64(np.int64(digits))
        return bits_of(number / tens[-power] if power < 0 else number * tens[power]), True
    return (np.uint64(0), True) if digits == np.uint64(0) else long_number(digits, power, fives)


@inlined
def any_number(text: Any, at: Any, point: Any) -> Any:
    """A number of any plain form from position `at` on, letter by letter: (digits, how many, power of ten, end).

    How many digits is 0 where there is no number, and more than 19 where they do not fit.
    """
    one, zero, ten = np.uint64(1), np.uint8(48), np.uint64(10)
    begin = first = at
    digits = np.uint64(0)
    while np.uint8(text[at] - zero) < 10:
        digits = digits * ten + np.uint64(np.uint8(text[at] - zero))
        at += one
    count = np.int64(at - first)
    power = np.int64(0)
    if text[at] == point:
        at += one
        first = at
        while np.uint8(text[at] - zero) < 10:
            digits = digits * ten + np.uint64(np.uint8(text[at] - zero))
            at += one
        power = -np.int64(at - first)
        count -= power
    if count and (text[at] == 101 or text[at] == 69):
        at += one
        minus = text[at] == 45
        if minus or text[at] == 43:
            at += one
        exponent = np.int64(0)
        first = at
        while np.uint8(text[at] - zero) < 10 and np.int64(at - first) < 4:
            exponent = exponent * 10 + np.int64(text[at]) - 48
            at += one
        if at == first:
            count = np.int64(0)  # no number
        power += -exponent if minus else exponent
    if count > 19:  # the digits may not fit: zeros in front do not count
        first = begin
        while text[first] == zero or text[first] == point:
            count -= np.int64(text[first] == zero)
            first += one
        count = max(count, np.int64(1))
    return digits, count, power, at
