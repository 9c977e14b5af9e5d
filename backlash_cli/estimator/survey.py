"""One look at every sample of a loop: counts, ranges, and an even sample of stretches at several time scales.

What is kept is bounded and does not depend on where the record is cut into blocks: a stretch is ROWS rows of the grid,
rows are single samples or, for slower pictures, means over 4, 16, 64 and 256 of them; every second stretch is dropped,
and only every second one taken from then on, whenever more than SLOTS are held.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray, Record, SampleState

ROWS = 1024
SLOTS = 16
LEVELS = 5
SLOWER = 4  # rows of one picture in a row of the next
SETPOINT, MEASUREMENT, OUTPUT = range(3)
GOOD, FILLED = 0, 1
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


@numba.njit(cache=True, nogil=True)
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
            rows[j] = np.nan
            return j
    return -1


@numba.njit(cache=True, nogil=True)
def _means(at: IntArray, rows: FloatArray, n: int, open_: IntArray, sums: FloatArray) -> int:
    """Means over complete groups of SLOWER rows, in place of these; returns how many. The open group is carried."""
    group, taken = open_[0], open_[1]
    a, b, c = sums[0], sums[1], sums[2]
    done = 0
    for k in range(n):
        if at[k] // SLOWER != group:
            group, taken = at[k] // SLOWER, 0
            a = b = c = 0.0
        a, b, c, taken = a + rows[k, 0], b + rows[k, 1], c + rows[k, 2], taken + 1
        if taken == SLOWER:
            at[done] = group
            rows[done, 0], rows[done, 1], rows[done, 2] = a / SLOWER, b / SLOWER, c / SLOWER
            done += 1
    open_[0], open_[1] = group, taken
    sums[0], sums[1], sums[2] = a, b, c
    return done


@numba.njit(cache=True, nogil=True)
def _keep(at: IntArray, rows: FloatArray, n: int, held: IntArray, kept: FloatArray) -> None:
    """Put rows into their slots."""
    current, slot = held[CURRENT], held[SLOT]
    for k in range(n):
        if at[k] // ROWS != current:
            current = at[k] // ROWS
            slot = _slot(current, held, kept)
        if slot >= 0:
            i = at[k] % ROWS
            kept[slot, i, 0], kept[slot, i, 1], kept[slot, i, 2] = rows[k, 0], rows[k, 1], rows[k, 2]


@numba.njit(cache=True, nogil=True)
def look(index: IntArray, setpoint: FloatArray, pv: FloatArray, op: FloatArray, state: NDArray[np.uint8],
         numbers: IntArray, signals: FloatArray, held: IntArray, raw: FloatArray, kinds: NDArray[np.uint8],
         slower: FloatArray) -> None:
    """Take a block of samples; op is empty where there is no output. held: first of `raw`, then of each of `slower`.

    raw: (slots, ROWS, 3) samples with their `kinds`, nan where none; slower: (levels, slots, ROWS, 3) means.
    """
    at, rows = np.empty(ROOM, np.int64), np.empty((ROOM, 3))
    for first in range(0, len(index), ROOM):
        last = min(first + ROOM, len(index))
        n = _count(index[first:last], setpoint[first:last], pv[first:last], op[first:last], state[first:last],
                   numbers, signals, held[0], raw, kinds, at, rows, len(slower) > 0)
        for level in range(len(slower)):
            n = _means(at, rows, n, numbers[OPEN + 2 * level :], signals[SUMS + 3 * level :])
            _keep(at, rows, n, held[1 + level], slower[level])


@numba.njit(cache=True, nogil=True)
def _count(index: IntArray, setpoint: FloatArray, pv: FloatArray, op: FloatArray, state: NDArray[np.uint8],
           numbers: IntArray, signals: FloatArray, held: IntArray, raw: FloatArray, kinds: NDArray[np.uint8],
           at: IntArray, rows: FloatArray, wanted: bool) -> int:
    """Count, and keep the samples wanted; write those with all three signals to at, rows and return their number."""
    has_output = len(op) > 0
    if numbers[FIRST] == NOWHERE:
        numbers[FIRST], numbers[LAST] = index[0], index[0] - 1
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
            raw[slot, i, 0], raw[slot, i, 1], raw[slot, i, 2] = r, y, u
            kinds[slot, i] = what
        if not has_u:
            continue
        if wanted:
            at[used] = here
            rows[used, 0], rows[used, 1], rows[used, 2] = r, y, u
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


class Survey:
    """Takes the blocks of one loop's record; signals are setpoint, measurement and output, in this order.

    slower: keep the slower pictures as well, from which the settings of the controller can be read.
    """

    def __init__(self, interval: float, *, slower: bool = True) -> None:
        self.interval = interval
        self.numbers = np.zeros(NUMBERS, dtype=np.int64)
        self.numbers[[FIRST, *range(OPEN, NUMBERS, 2)]] = NOWHERE
        self._signals = np.zeros(SUMS + 3 * LEVELS)
        self._signals[[0, 2, 4]], self._signals[[1, 3, 5]] = np.inf, -np.inf
        self._signals[LAST_SETPOINT] = np.nan
        levels = LEVELS if slower else 1
        self._held = np.full((levels, IN_SLOTS + SLOTS), NOWHERE, dtype=np.int64)
        self._held[:, [STRIDE, SLOT, HELD]] = 1, -1, 0
        self._raw = np.empty((SLOTS, ROWS, 3))
        self._kinds = np.empty((SLOTS, ROWS), dtype=np.uint8)
        self._slower = np.empty((levels - 1, SLOTS, ROWS, 3))

    def update(self, block: Record) -> None:
        """Take in the next block of the loop."""
        output = np.empty(0) if block.output is None else block.output
        r, y, u = (np.ascontiguousarray(x, dtype=np.float64) for x in (block.setpoint, block.measurement, output))
        look(np.ascontiguousarray(block.index, dtype=np.int64), r, y, u,
             np.ascontiguousarray(block.state, dtype=np.uint8), self.numbers, self._signals, self._held, self._raw,
             self._kinds, self._slower)

    @property
    def states(self) -> IntArray:
        """(states,) number of samples of each SampleState."""
        return self.numbers[:STATES]

    def spread(self, column: int) -> float:
        """Largest less smallest usable value of one signal, 0 where there was none."""
        low, high = self._signals[2 * column : 2 * column + 2].tolist()
        return max(high - low, 0.0)

    def samples(self) -> tuple[IntArray, FloatArray, IntArray, FloatArray]:
        """Samples that were measured, not filled in, from half of what is kept: grid numbers (rows,) and values (rows,)
        of the measurement, then of the output.

        More would not show better what a recorder did to them.
        """
        index, rows, kinds = self._rows(0, most=SLOTS // 2)
        if kinds.any():
            index, rows = index[kinds == GOOD], rows[kinds == GOOD]
        measured, outputs = np.ascontiguousarray(rows[:, 1:].T)
        there = np.isfinite(outputs)
        return (index, measured, index, outputs) if there.all() else (index, measured, index[there], outputs[there])

    def rows(self, level: int) -> tuple[IntArray, FloatArray]:
        """Grid numbers (rows,) in units of SLOWER**level samples, and means (rows, 3) of all three signals."""
        index, rows, _ = self._rows(level)
        mine = np.isfinite(rows[:, 2])
        return (index, rows) if mine.all() else (index[mine], rows[mine])

    def _rows(self, level: int, most: int = SLOTS) -> tuple[IntArray, FloatArray, NDArray[np.uint8]]:
        """What is kept of one picture, in time order; every second stretch where it is more than `most`."""
        slots = self._held[level, IN_SLOTS:]
        order = np.argsort(slots)[np.count_nonzero(slots == NOWHERE) :]
        order = order[::2] if len(order) > most else order
        held = self._slower[level - 1] if level else self._raw
        rows = held[order].reshape(-1, 3)
        index = (slots[order, None] * ROWS + np.arange(ROWS)).ravel()
        there = np.isfinite(rows[:, 0])
        kinds = self._kinds[order].ravel() if level == 0 else np.zeros(len(rows), dtype=np.uint8)
        return (index, rows, kinds) if there.all() else (index[there], rows[there], kinds[there])
