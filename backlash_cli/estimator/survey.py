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
STATES = len(SampleState)


class Picture:
    """Stretches of one picture of the record: grid numbers (rows,), signals (3, rows) and states (rows,) of each."""

    def __init__(self) -> None:
        self._held: dict[int, list[tuple[IntArray, FloatArray, NDArray[np.uint8]]]] = {}
        self._stride = 1
        self._left: tuple[IntArray, FloatArray] = (np.empty(0, np.int64), np.empty((3, 0)))  # of an open group

    def keep(self, index: IntArray, rows: FloatArray, states: NDArray[np.uint8]) -> None:
        """Take the next rows."""
        last = 0
        while last < len(index):
            first, number = last, int(index[last]) // ROWS
            last = int(np.searchsorted(index, (number + 1) * ROWS))
            if number % self._stride:
                continue
            while number not in self._held and len(self._held) == SLOTS:
                self._stride *= 2
                self._held = {n: parts for n, parts in self._held.items() if n % self._stride == 0}
            if number % self._stride == 0:
                part = index[first:last].copy(), rows[:, first:last].copy(), states[first:last].copy()
                self._held.setdefault(number, []).append(part)

    def groups(self, index: IntArray, rows: FloatArray) -> tuple[IntArray, FloatArray]:
        """Means over complete groups of SLOWER rows, and their numbers; the open group is kept for the next block."""
        index, rows = np.concatenate([self._left[0], index]), np.concatenate([self._left[1], rows], axis=1)
        last = np.searchsorted(index, (index[-1] + 1) // SLOWER * SLOWER) if len(index) else 0
        self._left = index[last:].copy(), rows[:, last:].copy()
        if len(index) and index[-1] - index[0] == len(index) - 1:
            first = int(-index[0] % SLOWER)
            end = first + (len(index) - first) // SLOWER * SLOWER
            places: list[slice | IntArray] = [slice(first + i, end, SLOWER) for i in range(SLOWER)]
        else:
            ahead = index[SLOWER - 1 :] - index[: 1 - SLOWER]
            whole = np.flatnonzero((index[: 1 - SLOWER] % SLOWER == 0) & (ahead == SLOWER - 1))
            places = [whole + i for i in range(SLOWER)]
        a, b, c, d = (rows[:, place] for place in places)
        return index[places[0]] // SLOWER, (a + b + c + d) / SLOWER

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
        signals = np.array([block.setpoint, block.measurement, output], dtype=np.float64)
        if not self.samples:
            self.first, self.last = int(index[0]), int(index[0]) - 1
        if index[-1] - self.last != len(index):
            steps = np.diff(index, prepend=self.last)
            self.longest = max(self.longest, int(steps.max()))
            self.gaps += int(np.count_nonzero(steps > 2))
        self.last = int(index[-1])
        self.states = self.states + np.bincount(state, minlength=STATES)
        there = np.isfinite(signals)
        self.with_setpoint += int(np.count_nonzero(there[SETPOINT]))
        self.with_output += int(np.count_nonzero(there[OUTPUT]))
        usable = state <= SampleState.FILLED
        if not usable.all():
            there &= usable
        for signal, (values, known) in enumerate(zip(signals, there, strict=True)):
            if known.any():
                known_values = values if known.all() else values[known]
                self._low[signal] = min(self._low[signal], known_values.min())
                self._high[signal] = max(self._high[signal], known_values.max())
        setpoint = signals[SETPOINT] if there[SETPOINT].all() else signals[SETPOINT, there[SETPOINT]]
        if len(setpoint):
            before = setpoint[0] if np.isnan(self._setpoint) else self._setpoint
            self.moves += int(setpoint[0] != before) + int(np.count_nonzero(setpoint[1:] != setpoint[:-1]))
            self._setpoint = float(setpoint[-1])
        whole = there[SETPOINT] & there[MEASUREMENT]
        if not whole.all():
            index, signals, state, there = index[whole], signals[:, whole], state[whole], there[:, whole]
        self._pictures[0].keep(index, signals, state)
        mine = there[OUTPUT]
        self.used += int(np.count_nonzero(mine))
        self.used_filled += int(np.count_nonzero(mine & (state == SampleState.FILLED)))
        if not mine.all():
            index, signals = index[mine], signals[:, mine]
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
