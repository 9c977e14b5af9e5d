"""What the walks over a loop's samples do with a piece that has no hole and no doubtful sample, compiled by numba.

Most of a record is such pieces. Their samples need not be looked at one by one: sums, extremes and changes of sign are
found for eight at a time, and only the recursion of the filters goes from sample to sample. Extremes are compared as
whole numbers (see `in_order`), because compilers do that for eight at a time as well.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from .record import FloatArray, IntArray

FILLED = 1  # highest SampleState that may enter an estimate
REST = 0x7FFFFFFFFFFFFFFF  # all bits of a number but its sign
INFINITE = 0x7FF0000000000000  # bits of infinity; what is larger in size is no number


# Arrays are not counted on their way into a function: for pieces of a few hundred samples that took as long as the
# work itself. So a function compiled like this may not make an array.
_bare: Any = partial(numba.njit, cache=True, nogil=True, _nrt=False)
bare: Any = _bare()
summing: Any = _bare(fastmath={"contract"})  # a product may go into a sum unrounded


@numba.njit(cache=True, nogil=True, inline="always")
def in_order(bits: Any) -> Any:
    """Turn the bits of a float into a whole number such that the order of floats is that of the whole numbers; the
    same once more turns it back."""
    return bits ^ ((bits >> 63) & REST)


@bare
def extremes(bits: IntArray) -> tuple[Any, Any, Any]:
    """Lowest and highest number of a piece, both `in_order`, and whether all are finite. bits: (samples,) of floats."""
    low, high = np.int64(REST), np.int64(-REST)
    for k in range(len(bits)):
        x = in_order(bits[k])
        low, high = min(low, x), max(high, x)
    return low, high, low > in_order(INFINITE | ~np.int64(REST)) and high < INFINITE


@bare
def usable(index: IntArray, state: NDArray[np.uint8]) -> bool:
    """Whether the samples follow each other on the grid and may all enter an estimate."""
    if index[-1] - index[0] != len(index) - 1:
        return False
    worst = state[0]
    for k in range(len(state)):
        worst = max(worst, state[k])
    return worst <= FILLED


@summing
def filtered(setpoint: FloatArray, pv: FloatArray, filters: FloatArray, z: FloatArray, errors: FloatArray,
             sums: FloatArray) -> None:
    """Run a piece of the measurement through both filters of a walk, the second behind the first.

    z: the states of both, in direct form II transposed, changed in place. Inside, each filter keeps its last two
    outputs instead: the way from one sample to the next is then one multiplication long, and while it lasts the errors
    are summed. errors, sums: (2, samples + 1) the control error behind each filter from place 1 on, and the sum of
    those before each.
    """
    b10, b11, b12, a11, a12 = filters[0, 0], filters[0, 1], filters[0, 2], filters[0, 3], filters[0, 4]
    b20, b21, b22, a21, a22 = filters[1, 0], filters[1, 1], filters[1, 2], filters[1, 3], filters[1, 4]
    plain, smooth, sum1, sum2 = errors[0], errors[1], sums[0], sums[1]
    x = pv[0]
    before1, before2 = z[0], z[2]
    y = before1 + b10 * x
    now1 = (b11 * x + z[1]) - a11 * before1
    now2 = (b21 * y + z[3]) - a21 * before2
    total1, total2 = setpoint[0] - y, setpoint[0] - (before2 + b20 * y)
    plain[1], smooth[1] = total1, total2
    sum1[0], sum2[0], sum1[1], sum2[1] = 0.0, 0.0, total1, total2
    for k in range(1, len(pv)):
        x_before, y_before = x, y
        x = pv[k]
        y = now1 + b10 * x
        error1, error2 = setpoint[k] - y, setpoint[k] - (now2 + b20 * y)
        next1 = ((b11 * x + b12 * x_before) - a12 * before1) - a11 * now1
        next2 = ((b21 * y + b22 * y_before) - a22 * before2) - a21 * now2
        total1, total2 = total1 + error1, total2 + error2
        plain[k + 1], smooth[k + 1], sum1[k + 1], sum2[k + 1] = error1, error2, total1, total2
        before1, now1, before2, now2 = now1, next1, now2, next2
    z[0], z[1] = now1, b12 * x - a12 * before1
    z[2], z[3] = now2, b22 * y - a22 * before2


@bare
def crossings(errors: FloatArray, sign: float, flips: NDArray[np.uint8], at: IntArray) -> int:
    """Write to `at` where the sign of the errors changes; return how often, -1 where an error is exactly zero, which
    has no sign. sign: that of the error before the first. flips: room for a mark per error and for seven more."""
    zeros, n = 0, len(errors)
    flips[0] = (errors[0] > 0.0) != (sign > 0.0)
    for k in range(1, n):
        flips[k] = (errors[k] > 0.0) != (errors[k - 1] > 0.0)
    for k in range(n):
        zeros += errors[k] == 0.0
    if zeros:
        return -1
    for k in range(n, n + 7):
        flips[k] = 0
    eights, found = flips.view(np.uint64), 0
    for eight in range((n + 7) // 8):
        if eights[eight]:
            for k in range(8 * eight, 8 * eight + 8):
                at[found] = k
                found += flips[k]
    return found


@bare
def changes(setpoint: FloatArray, before: float, moved: FloatArray) -> None:
    """Write the size of each change of the setpoint."""
    moved[0] = abs(setpoint[0] - before)
    for k in range(1, len(setpoint)):
        moved[k] = abs(setpoint[k] - setpoint[k - 1])


@partial(_bare, fastmath={"contract", "reassoc", "nsz"})
def total(values: FloatArray) -> float:
    """Sum of the sizes."""
    found = 0.0
    for k in range(len(values)):
        found += abs(values[k])
    return found


@bare
def largest(bits: IntArray) -> Any:
    """Bits of the largest size. bits: (samples,) of floats."""
    found = np.int64(0)
    for k in range(len(bits)):
        found = max(found, bits[k] & REST)
    return found
