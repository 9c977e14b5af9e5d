"""One look at every sample of a loop: counts, ranges, and an even sample of stretches at several time scales.

What is kept is bounded and does not depend on where the record is cut into blocks. A stretch is ROWS rows of the grid;
rows are single samples or, for slower pictures, means over 4, 16, 64 and 256 of them. Every second stretch is dropped,
and only every second one taken from then on, whenever more than SLOTS are held.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray, Record, SampleState

ROWS = 1024
SLOTS = 16
LEVELS = 5
SLOWER = 4  # rows of one picture in a row of the next
SETPOINT, MEASUREMENT, OUTPUT = range(3)
STATES, FILLED = len(SampleState), SampleState.FILLED.value
Signals = list[FloatArray]


class Picture:
    """Stretches of one picture of the record: grid numbers (rows,), signals (3, rows) and states (rows,) of each."""

    def __init__(self) -> None:
        self._held: dict[int, list[tuple[IntArray, FloatArray, NDArray[np.uint8]]]] = {}
        self._stride = 1
        self._left = np.empty(0, np.int64), [np.empty(0)] * 3  # of an open group

    def keep(self, index: IntArray, signals: Signals, states: NDArray[np.uint8]) -> None:
        """Take the next rows."""
        taken, last = [], 0
        while last < len(index):
            first, number = last, int(index[last]) // ROWS
            if number % self._stride:  # on to the next that is wanted
                last = int(index.searchsorted((number // self._stride + 1) * self._stride * ROWS))
                continue
            last = int(index.searchsorted((number + 1) * ROWS))
            while number not in self._held and len(self._held) == SLOTS:
                self._stride *= 2
                self._held = {n: parts for n, parts in self._held.items() if n % self._stride == 0}
            if number % self._stride == 0:
                self._held.setdefault(number, [])
                taken.append((number, slice(first, last)))
        for number, here in taken:
            if number in self._held:
                part = index[here].copy(), np.array([x[here] for x in signals]), states[here].copy()
                self._held[number].append(part)

    def groups(self, index: IntArray, signals: Signals) -> tuple[IntArray, Signals]:
        """Means over complete groups of SLOWER rows, and their numbers; the open group is kept for the next block."""
        index = np.concatenate([self._left[0], index])
        signals = [np.concatenate(pair) for pair in zip(self._left[1], signals, strict=True)]
        last = np.searchsorted(index, (index[-1] + 1) // SLOWER * SLOWER) if len(index) else 0
        self._left = index[last:].copy(), [x[last:].copy() for x in signals]
        if len(index) and index[-1] - index[0] == len(index) - 1:
            first = int(-index[0] % SLOWER)
            end = first + (len(index) - first) // SLOWER * SLOWER
            places: list[slice | IntArray] = [slice(first + i, end, SLOWER) for i in range(SLOWER)]
        else:
            ahead = index[SLOWER - 1 :] - index[: 1 - SLOWER]
            whole = np.flatnonzero((index[: 1 - SLOWER] % SLOWER == 0) & (ahead == SLOWER - 1))
            places = [whole + i for i in range(SLOWER)]
        a, b, c, d = places
        return index[a] // SLOWER, [(x[a] + x[b] + x[c] + x[d]) / SLOWER for x in signals]

    def rows(self, most: int = SLOTS, only: int = STATES) -> tuple[IntArray, FloatArray]:
        """What is kept, in time order; every second stretch where there are more than `most`.

        Grid numbers (rows,) and signals (3, rows). only: highest state of the samples wanted.
        """
        chosen = sorted(self._held)[:: 2 if len(self._held) > most else 1]
        parts = [part for number in chosen for part in self._held[number]]
        if not parts:
            return np.empty(0, np.int64), np.empty((3, 0))
        index, rows, states = (np.concatenate(x, axis=-1) for x in zip(*parts, strict=True))
        wanted = states <= only
        return (index, rows) if wanted.all() else (index[wanted], rows[:, wanted])


class Survey:
    """Takes the blocks of one loop's record; signals are setpoint, measurement and output, in this order.

    slower: keep the slower pictures as well, from which the settings of the controller can be read.
    states: (states,) number of samples of each SampleState. first, last: grid numbers. gaps: holes of more than one
    sample; longest: of them, in steps of the grid, 0 without any. moves: changes of the setpoint between usable
    samples. used, used_filled: usable samples with all three signals, and those of them that were filled in.
    with_setpoint, with_output: samples with one.
    """

    def __init__(self, interval: float, *, slower: bool = True) -> None:
        self.interval = interval
        self.states: IntArray = np.zeros(STATES, dtype=np.int64)
        self.first = self.last = self.gaps = self.longest = self.moves = 0
        self.used = self.used_filled = self.with_setpoint = self.with_output = 0
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._setpoint = np.nan  # the last usable one
        self._pictures = [Picture() for _ in range(LEVELS if slower else 1)]

    @property
    def samples(self) -> int:
        """Number of samples taken."""
        return int(self.states.sum())

    def update(self, block: Record) -> None:
        """Take in the next block of the loop."""
        if not len(block):
            return
        index, state = block.index, block.state
        output = np.full(len(block), np.nan) if block.output is None else block.output
        signals: Signals = [np.asarray(x, np.float64) for x in (block.setpoint, block.measurement, output)]
        if not self.samples:
            self.first, self.last = int(index[0]), int(index[0]) - 1
        if index[-1] - self.last != len(index):
            steps = np.diff(index, prepend=self.last)
            self.longest = max(self.longest, int(steps.max()))
            self.gaps += int(np.count_nonzero(steps > 2))
        self.last = int(index[-1])
        self.states = self.states + np.bincount(state, minlength=STATES)
        there = [np.isfinite(x) for x in signals]
        self.with_setpoint += int(np.count_nonzero(there[SETPOINT]))
        self.with_output += int(np.count_nonzero(there[OUTPUT]))
        usable = state <= FILLED
        there = [known & usable for known in there]
        known_values = [x if known.all() else x[known] for x, known in zip(signals, there, strict=True)]
        for signal, values in enumerate(known_values):
            if len(values):
                self._low[signal] = min(self._low[signal], values.min())
                self._high[signal] = max(self._high[signal], values.max())
        setpoint = known_values[SETPOINT]
        if len(setpoint):
            before = setpoint[0] if np.isnan(self._setpoint) else self._setpoint
            self.moves += int(setpoint[0] != before) + int(np.count_nonzero(setpoint[1:] != setpoint[:-1]))
            self._setpoint = float(setpoint[-1])
        whole, mine = there[SETPOINT] & there[MEASUREMENT], there[OUTPUT]
        if not whole.all():
            index, state, mine, signals = index[whole], state[whole], mine[whole], [x[whole] for x in signals]
        self._pictures[0].keep(index, signals, state)
        self.used += int(np.count_nonzero(mine))
        self.used_filled += int(np.count_nonzero(mine & (state == FILLED)))
        if not mine.all():
            index, signals = index[mine], [x[mine] for x in signals]
        for picture in self._pictures[1:]:
            index, signals = picture.groups(index, signals)
            picture.keep(index, signals, np.zeros(len(index), np.uint8))

    def spread(self, signal: int) -> float:
        """Largest less smallest usable value of one signal, 0 where there was none."""
        return max(float(self._high[signal] - self._low[signal]), 0.0)

    def measured(self) -> tuple[IntArray, FloatArray, IntArray, FloatArray]:
        """Samples that were measured, not filled in, from half of what is kept: grid numbers (rows,) and values (rows,)
        of the measurement, then of the output.

        More would not show better what a recorder did to them.
        """
        index, (_, measured, outputs) = self._pictures[0].rows(SLOTS // 2, SampleState.GOOD)
        there = np.isfinite(outputs)
        return index, measured, index[there], outputs[there]

    def rows(self, level: int) -> tuple[IntArray, FloatArray]:
        """Grid numbers (rows,) in units of SLOWER**level samples, and means (3, rows) of all three signals."""
        index, rows = self._pictures[level].rows()
        mine = np.isfinite(rows[OUTPUT])
        return index[mine], rows[:, mine]
