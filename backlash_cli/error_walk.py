"""One walk over the samples of a loop: both filters, both control errors and their half periods, compiled by numba.

What is carried from block to block is one vector of numbers, so the cut into blocks does not matter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .clean_piece import (
    FILLED,
    bare,
    changes,
    crossings,
    extremes,
    filtered,
    in_order,
    largest,
    summing,
    total,
    usable,
)
from .record import FloatArray, IntArray

MISSING, IMPLAUSIBLE = 2, 6  # the states in which the measurement itself is not known
COLUMNS = 7  # of a half period: begin, end, area, e_max, direction, setpoint_move, complete
ROOM = 512  # samples taken at a time: what is worked out in between stays in the processor's nearest cache
NEVER = -(2.0**62)  # position of a sample before any other

# Places in the vector that is carried: states of the filters, the last sample that went through them, the last one
# that entered an error and its setpoint; then each error's open half period and what has been counted.
KNOWN, USED, SETPOINT = 4, 5, 6
SIGN, BEGIN, CROSSED, AREA, PEAK, MOVE, LAST, STORED, LEFT_OUT = range(9)
PLACES = 9
PLAIN, SMOOTH = 7, 7 + PLACES
LENGTH = SMOOTH + PLACES


def start() -> FloatArray:
    """Return the carried vector as it is before the first sample."""
    carried = np.zeros(LENGTH)
    carried[[KNOWN, USED]] = NEVER
    return carried


def desk() -> tuple[IntArray, FloatArray, FloatArray, FloatArray, NDArray[np.uint8], IntArray]:
    """Return the arrays that a walk works in; nothing in them is carried."""
    return (np.empty(ROOM + 1, np.int64), np.empty(ROOM), np.empty((2, ROOM + 2)), np.empty((2, ROOM + 1)),
            np.zeros(ROOM + 8, np.uint8), np.empty((2, ROOM + 8), np.int64))


@summing
def _filter(index: NDArray[np.int64], setpoint: FloatArray, pv: FloatArray, state: NDArray[np.uint8],
            filters: FloatArray, c: FloatArray, at: NDArray[np.int64], moved: FloatArray, errors: FloatArray) -> int:
    """Run the measurement through both filters; write position, change of setpoint and both errors of each sample
    that may be used, and return how many these are. `at` begins with the one before, errors with an empty place."""
    b10, b11, b12, a11, a12 = filters[0, 0], filters[0, 1], filters[0, 2], filters[0, 3], filters[0, 4]
    b20, b21, b22, a21, a22 = filters[1, 0], filters[1, 1], filters[1, 2], filters[1, 3], filters[1, 4]
    z11, z12, z21, z22 = c[0], c[1], c[2], c[3]
    known, last = np.int64(c[KNOWN]), c[SETPOINT]
    at[0] = np.int64(c[USED])
    n = 0
    for k in range(len(index)):
        what, x = state[k], pv[k]
        if what in (MISSING, IMPLAUSIBLE) or not np.isfinite(x):
            continue
        if index[k] != known + 1:
            z12 = (b12 - a12) * x
            z11 = (b11 - a11) * x + z12
            z22 = (b22 - a22) * x
            z21 = (b21 - a21) * x + z22
        known = index[k]
        # a1 b0 and a2 b0 are nothing: b0 is 0, or the filter is the identity
        y = z11 + b10 * x
        z11, z12 = (b11 * x + z12) - a11 * z11, b12 * x - a12 * z11
        smooth = z21 + b20 * y
        z21, z22 = (b21 * y + z22) - a21 * z21, b22 * y - a22 * z21
        r = setpoint[k]
        if what > FILLED or not np.isfinite(r):
            continue
        errors[0, n + 1] = r - y
        errors[1, n + 1] = r - smooth
        moved[n] = abs(r - last)
        last = r
        n += 1
        at[n] = known
    c[0], c[1], c[2], c[3] = z11, z12, z21, z22
    c[KNOWN], c[USED], c[SETPOINT] = known, at[n], last
    return n


@summing
def cut(errors: FloatArray, at: NDArray[np.int64], moved: FloatArray, n: int, c: FloatArray, out: FloatArray,
        least_area: float, least_length: float) -> None:
    """Cut one error into half periods, from the open one in c on; see `walk`. at[0] is the sample before the first."""
    sign, begin, crossed, area = c[SIGN], c[BEGIN], c[CROSSED], c[AREA]
    peak, move, last = c[PEAK], c[MOVE], c[LAST]
    stored, left_out = np.int64(c[STORED]), c[LEFT_OUT]
    for k in range(n):
        error = errors[k]
        size = abs(error)
        joined = at[k + 1] == at[k] + 1
        # an exact zero belongs to the half period before it
        now = 1.0 if error > 0.0 else -1.0 if error < 0.0 else sign
        if joined and (now == sign or sign == 0.0):
            area += 0.5 * (abs(last) + size)
            peak = max(peak, size)
            move += moved[k]
        else:
            share = last / (last - error) if joined else 0.0
            end = at[k] + share
            area += 0.5 * abs(last) * share
            small = (stored > 0 and area < least_area) or end - begin < least_length
            if joined and crossed > 0.0 and small:
                left_out += 1.0
            elif sign != 0.0:
                row = out[stored]
                row[0], row[1], row[2], row[3] = begin, end, area, peak
                row[4], row[5], row[6] = sign, move, crossed if joined else 0.0
                stored += 1
            if joined:
                begin, crossed, area, move = end, 1.0, 0.5 * size * (1.0 - share), moved[k]
            else:
                begin, crossed, area, move = float(at[k + 1]), 0.0, 0.0, 0.0
                now = 1.0 if error > 0.0 else -1.0 if error < 0.0 else 0.0
            peak = size
        sign, last = now, error
    c[SIGN], c[BEGIN], c[CROSSED], c[AREA] = sign, begin, crossed, area
    c[PEAK], c[MOVE], c[LAST] = peak, move, last
    c[STORED], c[LEFT_OUT] = stored, left_out


@summing
def cut_clean(errors: FloatArray, sums: FloatArray, n: int, crossed_at: IntArray, crossings: int, first: int,
              moved: FloatArray, moves: bool, c: FloatArray, out: FloatArray, least_area: float,
              least_length: float) -> None:
    """Cut one error into half periods where none is zero and no sample is missing; the same as `cut`.

    errors: from place 1 on those of n samples, sums: of all before each. crossed_at: where the sign changes. first:
    position of the first sample. moves: whether the setpoint does; if not, `moved` is not looked at. Between crossings
    the sum of the errors is the area, and their peak is looked for only where the half period is kept.
    """
    begin, crossed, area, peak, move = c[BEGIN], c[CROSSED], c[AREA], c[PEAK], c[MOVE]
    sign, stored, left_out = c[SIGN], np.int64(c[STORED]), c[LEFT_OUT]
    errors[0] = c[LAST]
    bits, spare = errors.view(np.int64), len(errors) - 1
    start = summed = 0  # samples of the open half period in this piece begin here; up to here they are in its area
    for i in range(crossings):
        k = crossed_at[i]
        last, error = errors[k], errors[k + 1]
        share = last / (last - error)
        end = first + k - 1 + share
        area += 0.5 * abs(errors[summed]) + abs(sums[k] - sums[summed]) - 0.5 * abs(last) * (1.0 - share)
        if crossed > 0.0 and ((stored > 0 and area < least_area) or end - begin < least_length):
            left_out += 1.0
        else:
            bits[spare] = largest(bits[start + 1 : k + 1])
            row = out[stored]
            row[0], row[1], row[2], row[3] = begin, end, area, max(peak, errors[spare])
            row[4], row[5], row[6] = sign, move + total(moved[start:k]) if moves else move, crossed
            stored += 1
        begin, crossed, sign, peak, move = end, 1.0, -sign, 0.0, 0.0
        area, start, summed = 0.5 * abs(error) * (1.0 - share), k, k + 1
    bits[spare] = largest(bits[start + 1 : n + 1])
    c[SIGN], c[BEGIN], c[CROSSED] = sign, begin, crossed
    c[AREA] = area + 0.5 * abs(errors[summed]) + abs(sums[n] - sums[summed]) - 0.5 * abs(errors[n])
    c[PEAK], c[MOVE] = max(peak, errors[spare]), move + total(moved[start:n]) if moves else move
    c[LAST], c[STORED], c[LEFT_OUT] = errors[n], stored, left_out


@bare
def _clean(index: IntArray, pv: IntArray, setpoint: IntArray, state: NDArray[np.uint8],
           c: FloatArray) -> tuple[bool, int, int]:
    """Whether a piece goes on where the last one ended and has no doubtful sample; then its lowest and highest
    setpoint, in order. pv, setpoint: bits."""
    if c[KNOWN] != index[0] - 1 or c[USED] != index[0] - 1 or not c[PLAIN + SIGN] or not c[SMOOTH + SIGN]:
        return False, 0, 0
    if not usable(index, state) or not extremes(pv)[2]:
        return False, 0, 0
    low, high, finite = extremes(setpoint)
    return finite, low, high


@bare
def walk(index: NDArray[np.int64], setpoint: FloatArray, pv: FloatArray, state: NDArray[np.uint8], first: int,
         filters: FloatArray, least: FloatArray, carried: FloatArray, plain: FloatArray, smooth: FloatArray,
         at: IntArray, moved: FloatArray, errors: FloatArray, sums: FloatArray, flips: NDArray[np.uint8],
         crossed_at: IntArray) -> int:
    """Take samples from `first` on until all are taken or a table is full; return how many were taken.

    index, setpoint, pv, state: (samples,). filters: (2, 5) numerator and denominator of the two filters, the second
    behind the first. least: area [span samples] of plain and length [samples] of smooth half periods below which
    complete ones are counted and not stored (the first plain one always is). plain, smooth: (rows, COLUMNS) tables.
    The rest is what `desk` gives.
    """
    of_plain, of_smooth, setpoint_before = carried[PLAIN:SMOOTH], carried[SMOOTH:], carried[SETPOINT : SETPOINT + 1]
    while first < len(index):
        if of_plain[STORED] + ROOM > len(plain) or of_smooth[STORED] + ROOM > len(smooth):
            break
        last = min(first + ROOM, len(index))
        n = last - first
        here, r, y = index[first:last], setpoint[first:last], pv[first:last]
        clean, low, high = _clean(here, y.view(np.int64), r.view(np.int64), state[first:last], carried)
        if clean:
            moves = low != high or low != in_order(setpoint_before.view(np.int64)[0])
            if moves:
                changes(r, carried[SETPOINT], moved)
            filtered(r, y, filters, carried, errors, sums)
            of_0 = crossings(errors[0, 1 : n + 1], of_plain[SIGN], flips, crossed_at[0])
            of_1 = crossings(errors[1, 1 : n + 1], of_smooth[SIGN], flips, crossed_at[1])
            carried[KNOWN] = carried[USED] = here[-1]
            carried[SETPOINT] = r[-1]
            clean = of_0 >= 0 and of_1 >= 0
            if clean:
                cut_clean(errors[0], sums[0], n, crossed_at[0], of_0, here[0], moved, moves, of_plain, plain,
                          least[0], 0.0)
                cut_clean(errors[1], sums[1], n, crossed_at[1], of_1, here[0], moved, moves, of_smooth, smooth,
                          0.0, least[1])
            else:
                at[0] = here[0] - 1
                for k in range(n):  # slices are not assigned to in compiled loops: that takes seconds to compile
                    at[k + 1] = here[k]
                    moved[k] = moved[k] if moves else 0.0
        else:
            n = _filter(here, r, y, state[first:last], filters, carried, at, moved, errors)
        if not clean:
            cut(errors[0, 1:], at, moved, n, of_plain, plain, least[0], 0.0)
            cut(errors[1, 1:], at, moved, n, of_smooth, smooth, 0.0, least[1])
        first = last
    return first
