"""Loops over the rows of one signal that tell what the recorder did to it, compiled by numba.

Rows come with the grid number of each sample; only neighbours on the grid are compared. index: (rows,) strictly
increasing, values: (rows,).
"""

from __future__ import annotations

import numba
import numpy as np

from ..record import FloatArray, IntArray

PIECE = 128
RECUR = 0.7  # share of different values up to which levels recur
NEVER = 0x7FFFFFFFFFFFFFFF
LARGEST = 0.2  # of a step that a difference may be off, however many steps it has


@numba.njit(cache=True, nogil=True, error_model="numpy")
def lattice(ordered: FloatArray, least: float, limit: float) -> float:
    """Step of the lattice that values in order lie on, 0 when they lie on none.

    least: differences up to it are none. limit: how far from a whole number of steps a difference may lie, growing with
    the square root of the number, up to a fifth. A lattice is a finding only where levels recur, or where the typical
    difference is a step or two: a few scattered values always fit some lattice.
    """
    gaps = ordered[1:] - ordered[:-1]
    bits = gaps.view(np.int64)  # of numbers that are not negative, in the same order as these
    levels, smallest = 1, NEVER
    for k in range(len(gaps)):
        levels += gaps[k] > 0.0
        smallest = min(smallest, int(bits[k]) if gaps[k] > least else NEVER)
    step = np.inf
    for k in range(len(gaps)):
        if bits[k] == smallest:
            step = gaps[k]
            break
    for parts in (1.0, 2.0, 3.0, 5.0):
        if _fits(gaps, least, parts / step, limit * limit):
            step /= parts
            return step if levels <= RECUR * len(ordered) or _median_below(gaps, least, 2.0 * step) else 0.0
    return 0.0


@numba.njit(cache=True, nogil=True)
def _median_below(gaps: FloatArray, least: float, limit: float) -> bool:
    """Whether the median of the differences above `least` is at most `limit`; without putting them in order."""
    n = below = 0
    for k in range(len(gaps)):  # no branches: which way the next one goes cannot be guessed
        n += gaps[k] > least
        below += (gaps[k] > least) & (gaps[k] <= limit)
    if 2 * below != n:
        return 2 * below > n
    last, first = 0.0, np.inf  # the nearest to the limit on either side
    for k in range(len(gaps)):
        gap = gaps[k]
        if gap > least:
            last = max(last, gap) if gap <= limit else last
            first = first if gap <= limit else min(first, gap)
    return 0.5 * (last + first) <= limit


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _fits(gaps: FloatArray, least: float, scale: float, limit: float) -> bool:
    """Whether all differences above `least` are whole numbers of steps, 1/scale each; a few at a time, most fail soon.

    limit: square of the share of a step that a difference may be off.
    """
    for first in range(0, len(gaps), PIECE):
        piece, misses = gaps[first : first + PIECE], 0
        for k in range(len(piece)):
            steps = piece[k] * scale
            off = steps - np.rint(steps)
            misses += (piece[k] > least) & (off * off > min(limit * max(steps, 1.0), LARGEST * LARGEST))
        if misses:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def bends(index: IntArray, values: FloatArray) -> FloatArray:
    """Sizes of the second differences of three neighbours in a row."""
    out = np.empty(max(len(index) - 2, 0))
    n = 0
    for k in range(len(index) - 2):
        if index[k + 2] - index[k] == 2:
            out[n] = abs(values[k + 2] - 2.0 * values[k + 1] + values[k])
            n += 1
    return out[:n]


@numba.njit(cache=True, nogil=True)
def differences(index: IntArray, values: FloatArray, least: float) -> tuple[FloatArray, int, int]:
    """What `bends` gives, the number of neighbours, and of these that differ by more than `least`."""
    pairs = moves = 0
    for k in range(len(index) - 1):
        joined = index[k + 1] - index[k] == 1
        pairs += joined
        moves += joined & (abs(values[k + 1] - values[k]) > least)
    return bends(index, values), pairs, moves


@numba.njit(cache=True, nogil=True)
def changes(index: IntArray, values: FloatArray, least: float) -> FloatArray:
    """Sizes of the differences between neighbours that are above `least`."""
    out = np.empty(max(len(index) - 1, 0))
    n = 0
    for k in range(len(index) - 1):
        change = abs(values[k + 1] - values[k])
        if index[k + 1] - index[k] == 1 and change > least:
            out[n] = change
            n += 1
    return out[:n]


@numba.njit(cache=True, nogil=True)
def straight_runs(index: IntArray, values: FloatArray, tolerance: float, shortest: int,
                  least_rise: float) -> tuple[int, int, int, FloatArray, IntArray]:
    """Lines that rise or fall and are straight to `tolerance`.

    Returns the number of samples inside such lines, of kinks five times the tolerance, and of bends between the two;
    then the rise and the number of inner samples of every line of at least `shortest` of these that rises by more than
    `least_rise`.
    """
    rises, lengths = np.empty(len(index)), np.empty(len(index), np.int64)
    straight = kinks = between = runs = first = length = 0
    for k in range(len(index) - 1):
        inside = False
        if k + 2 < len(index) and index[k + 2] - index[k] == 2:
            bend = abs(values[k + 2] - 2.0 * values[k + 1] + values[k])
            inside = bend <= tolerance and abs(values[k + 2] - values[k]) > 0.0
            kinks += bend > 5.0 * tolerance
            between += bend > tolerance and bend <= 5.0 * tolerance
        if inside:
            straight += 1
            first = k if length == 0 else first
            length += 1
        elif length:
            rise = abs(values[min(k + 1, len(values) - 1)] - values[first])
            if length >= shortest and rise > least_rise:
                rises[runs], lengths[runs] = rise, length
                runs += 1
            length = 0
    return straight, kinks, between, rises[:runs], lengths[:runs]


@numba.njit(cache=True, nogil=True)
def reversals(values: FloatArray, threshold: float) -> int:
    """Return how often the signal turned round by more than `threshold` (zigzag count)."""
    count, direction = 0, 0
    high = low = values[0] if len(values) else 0.0
    for value in values:
        if direction >= 0 and value > high:
            high = value
        if direction <= 0 and value < low:
            low = value
        if direction >= 0 and high - value > threshold:
            count += direction > 0
            direction, low = -1, value
        elif direction <= 0 and value - low > threshold:
            count += direction < 0
            direction, high = 1, value
    return count
