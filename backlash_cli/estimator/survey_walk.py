"""The loops over samples behind a survey, compiled by numba; what is carried from block to block is a few vectors.

A stretch is ROWS rows of the grid, rows are single samples or, for slower pictures, means over 4, 16, 64 and 256 of
them; every second stretch is dropped, and only every second one taken from then on, whenever more than SLOTS are held.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..clean_piece import FILLED, bare, extremes, in_order, usable
from ..record import FloatArray, IntArray, SampleState

ROWS = 1024
SLOTS = 16
LEVELS = 5
SLOWER = 4  # rows of one picture in a row of the next
SETPOINT, MEASUREMENT, OUTPUT = range(3)
GOOD = 0
STATES = len(SampleState)
NOWHERE = -(2**62)
ROOM = 512  # samples taken at a time: what is worked out in between stays in the processor's nearest cache

# Places in the vector of whole numbers, after the count of each state.
FIRST, LAST, GAPS, LONGEST, MOVES, USED, USED_FILLED, WITH_SETPOINT, WITH_OUTPUT = range(STATES, STATES + 9)
OPEN = STATES + 9  # for each level above the first: group and number of rows in it
NUMBERS = OPEN + 2 * LEVELS
# Of one level's stretches: stride, the current one, its slot, how many are held; then which one is in each slot.
STRIDE, CURRENT, SLOT, HELD, IN_SLOTS = range(5)
# In the vector of signals: lowest and highest of setpoint, measurement and output, the last setpoint; then sums.
LAST_SETPOINT, SUMS = 6, 7


@bare
def _slot(stretch: int, held: IntArray, rows: FloatArray) -> int:
    """Slot of a stretch that begins, -1 where it is not wanted; empties what is no longer held."""
    held[CURRENT] = stretch
    held[SLOT] = -1
    if stretch % held[STRIDE]:
        return -1
    slots = held[IN_SLOTS:]
    while held[HELD] == len(slots):
        held[STRIDE] *= 2
        for j in range(len(slots)):
            if slots[j] % held[STRIDE]:
                slots[j] = NOWHERE
                held[HELD] -= 1
    if stretch % held[STRIDE]:
        return -1
    for j in range(len(slots)):
        if slots[j] == NOWHERE:
            slots[j] = stretch
            held[HELD] += 1
            held[SLOT] = j
            for i in range(ROWS):  # the setpoint tells where there is a row
                rows[SETPOINT, j, i] = np.nan
            return j
    return -1


@bare
def _means(at: IntArray, rows: FloatArray, n: int, open_: IntArray, sums: FloatArray) -> int:
    """Means over complete groups of SLOWER rows, in place of these; returns how many. The open group is carried."""
    group, taken = open_[0], open_[1]
    a, b, c = sums[0], sums[1], sums[2]
    done = k = 0
    while k < n:
        if at[k] // SLOWER != group:
            group, taken = at[k] // SLOWER, 0
            a = b = c = 0.0
        if at[k] == group * SLOWER and k + SLOWER <= n and at[k + SLOWER - 1] == at[k] + SLOWER - 1:
            for j in range(SLOWER):
                a, b, c = a + rows[0, k + j], b + rows[1, k + j], c + rows[2, k + j]
            taken, k = SLOWER, k + SLOWER
        else:
            a, b, c, taken, k = a + rows[0, k], b + rows[1, k], c + rows[2, k], taken + 1, k + 1
        if taken == SLOWER:
            at[done] = group
            rows[0, done], rows[1, done], rows[2, done] = a / SLOWER, b / SLOWER, c / SLOWER
            done += 1
    open_[0], open_[1] = group, taken
    sums[0], sums[1], sums[2] = a, b, c
    return done


@bare
def _keep(at: IntArray, rows: FloatArray, n: int, held: IntArray, kept: FloatArray) -> None:
    """Put rows into their slots."""
    current, slot = held[CURRENT], held[SLOT]
    for k in range(n):
        if at[k] // ROWS != current:
            current = at[k] // ROWS
            slot = _slot(current, held, kept)
        if slot >= 0:
            i = at[k] % ROWS
            kept[0, slot, i], kept[1, slot, i], kept[2, slot, i] = rows[0, k], rows[1, k], rows[2, k]


@bare
def look(index: IntArray, setpoint: FloatArray, pv: FloatArray, op: FloatArray, state: NDArray[np.uint8],
         numbers: IntArray, signals: FloatArray, held: IntArray, raw: FloatArray, kinds: NDArray[np.uint8],
         slower: FloatArray, at: IntArray, rows: FloatArray, found: IntArray) -> None:
    """Take a block of samples; op is empty where there is no output. held: first of `raw`, then of each of `slower`.

    raw: (3, slots, ROWS) samples with their `kinds`, nan where none; slower: (levels, 3, slots, ROWS) means. at, rows,
    found: (ROOM,), (3, ROOM) and (3, 2), to work in.
    """
    wanted = len(slower) > 0
    if len(index) and numbers[FIRST] == NOWHERE:
        numbers[FIRST], numbers[LAST] = index[0], index[0] - 1
    for first in range(0, len(index), ROOM):
        last = min(first + ROOM, len(index))
        here, what, r, y = index[first:last], state[first:last], setpoint[first:last], pv[first:last]
        u = op[first:last]
        if _clean(here, r, y, u, what, found):
            n = _count_clean(here, r, y, u, what, found, numbers, signals, held[0], raw, kinds, at, rows, wanted)
        else:
            n = _count(here, r, y, u, what, numbers, signals, held[0], raw, kinds, at, rows, wanted)
        for level in range(len(slower)):
            n = _means(at, rows, n, numbers[OPEN + 2 * level :], signals[SUMS + 3 * level :])
            _keep(at, rows, n, held[1 + level], slower[level])


@bare
def _clean(index: IntArray, setpoint: FloatArray, pv: FloatArray, op: FloatArray, state: NDArray[np.uint8],
           found: IntArray) -> bool:
    """Whether a piece has no hole and no doubtful sample; writes lowest and highest of each signal to `found`."""
    if not usable(index, state):
        return False
    found[SETPOINT, 0], found[SETPOINT, 1], finite = extremes(setpoint.view(np.int64))
    found[MEASUREMENT, 0], found[MEASUREMENT, 1], known = extremes(pv.view(np.int64))
    finite = finite and known
    if len(op):
        found[OUTPUT, 0], found[OUTPUT, 1], known = extremes(op.view(np.int64))
        finite = finite and known
    return finite


@bare
def _put(values: FloatArray, row: FloatArray) -> None:
    """Copy values to the beginning of a row; by themselves, so that the compiler copies many at once."""
    for k in range(len(values)):
        row[k] = values[k]


@bare
def _count_clean(index: IntArray, setpoint: FloatArray, pv: FloatArray, op: FloatArray, state: NDArray[np.uint8],
                 found: IntArray, numbers: IntArray, signals: FloatArray, held: IntArray, raw: FloatArray,
                 kinds: NDArray[np.uint8], at: IntArray, rows: FloatArray, wanted: bool) -> int:
    """The same as `_count` for a piece that is `_clean`."""
    n, has_output, last = len(index), len(op) > 0, signals[LAST_SETPOINT]
    bits = signals.view(np.int64)
    for signal in range(3 if has_output else 2):
        if found[signal, 0] < in_order(bits[2 * signal]):
            bits[2 * signal] = in_order(found[signal, 0])
        if found[signal, 1] > in_order(bits[2 * signal + 1]):
            bits[2 * signal + 1] = in_order(found[signal, 1])
    step = index[0] - numbers[LAST]
    if step > 1:
        numbers[LONGEST] = max(numbers[LONGEST], step)
        numbers[GAPS] += step > 2
    numbers[LAST] = index[-1]
    moves = np.int64(setpoint[0] != last and not np.isnan(last))
    if found[SETPOINT, 0] != found[SETPOINT, 1]:
        for k in range(1, n):
            moves += setpoint[k] != setpoint[k - 1]
    signals[LAST_SETPOINT] = setpoint[-1]
    filled = 0
    for k in range(n):
        filled += state[k]
    numbers[GOOD] += n - filled
    numbers[FILLED] += filled
    numbers[MOVES] += moves
    numbers[WITH_SETPOINT] += n
    if has_output:
        numbers[USED] += n
        numbers[USED_FILLED] += filled
        numbers[WITH_OUTPUT] += n
    done = 0
    while done < n:
        stretch = (index[0] + done) // ROWS
        if stretch != held[CURRENT]:
            _slot(stretch, held, raw)
        end = min(n, (stretch + 1) * ROWS - index[0])
        slot, to = held[SLOT], (index[0] + done) % ROWS
        if slot >= 0:
            _put(setpoint[done:end], raw[SETPOINT, slot, to:])
            _put(pv[done:end], raw[MEASUREMENT, slot, to:])
            if has_output:
                _put(op[done:end], raw[OUTPUT, slot, to:])
            else:
                for k in range(end - done):
                    raw[OUTPUT, slot, to + k] = np.nan
            kind, what = kinds[slot, to:], state[done:end]
            for k in range(len(what)):
                kind[k] = what[k]
        done = end
    if not (has_output and wanted):
        return n if has_output else 0
    for k in range(n):
        at[k], rows[0, k], rows[1, k], rows[2, k] = index[k], setpoint[k], pv[k], op[k]
    return n


@bare
def _count(index: IntArray, setpoint: FloatArray, pv: FloatArray, op: FloatArray, state: NDArray[np.uint8],
           numbers: IntArray, signals: FloatArray, held: IntArray, raw: FloatArray, kinds: NDArray[np.uint8],
           at: IntArray, rows: FloatArray, wanted: bool) -> int:
    """Count, and keep the samples wanted; write those with all three signals to at, rows and return their number."""
    has_output = len(op) > 0
    before = numbers[LAST]
    good = gaps = longest = moves = used = filled = with_setpoint = with_output = 0
    low0, high0, low1, high1, low2, high2 = signals[0], signals[1], signals[2], signals[3], signals[4], signals[5]
    last = signals[LAST_SETPOINT]
    current, slot = held[CURRENT], held[SLOT]
    for k in range(len(index)):
        here, what, r, y = index[k], state[k], setpoint[k], pv[k]
        u = op[k] if has_output else np.nan
        if here - before > 1:
            longest = max(longest, here - before)
            gaps += here - before > 2
        before = here
        has_r, has_u = np.isfinite(r), np.isfinite(u)
        with_setpoint += has_r
        with_output += has_u
        if what == GOOD:
            good += 1
        else:
            numbers[min(what, STATES - 1)] += 1
            if what > FILLED:
                continue
        if has_r:
            low0, high0 = min(low0, r), max(high0, r)
            moves += r != last and not np.isnan(last)
            last = r
        if has_u:
            low2, high2 = min(low2, u), max(high2, u)
        if not np.isfinite(y):
            continue
        low1, high1 = min(low1, y), max(high1, y)
        if not has_r:
            continue
        if here // ROWS != current:
            current = here // ROWS
            slot = _slot(current, held, raw)
        if slot >= 0:
            i = here % ROWS
            raw[0, slot, i], raw[1, slot, i], raw[2, slot, i] = r, y, u
            kinds[slot, i] = what
        if not has_u:
            continue
        if wanted:
            at[used] = here
            rows[0, used], rows[1, used], rows[2, used] = r, y, u
        used += 1
        filled += what == FILLED
    numbers[GOOD] += good
    numbers[LAST] = before
    numbers[GAPS] += gaps
    numbers[LONGEST] = max(numbers[LONGEST], longest)
    numbers[MOVES] += moves
    numbers[USED] += used
    numbers[USED_FILLED] += filled
    numbers[WITH_SETPOINT] += with_setpoint
    numbers[WITH_OUTPUT] += with_output
    signals[0], signals[1], signals[2], signals[3], signals[4], signals[5] = low0, high0, low1, high1, low2, high2
    signals[LAST_SETPOINT] = last
    return used
