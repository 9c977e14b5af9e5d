"""One look at every sample of a loop: counts, ranges, and an even sample of stretches at several time scales.

What is kept is bounded and does not depend on where the record is cut into blocks (see survey_walk).
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray, IntArray, Record
from .survey_rows import gather
from .survey_walk import (
    FIRST,
    GOOD,
    HELD,
    IN_SLOTS,
    LAST_SETPOINT,
    LEVELS,
    NOWHERE,
    NUMBERS,
    OPEN,
    ROOM,
    ROWS,
    SLOT,
    SLOTS,
    STATES,
    STRIDE,
    SUMS,
    look,
)

_NUMBERS = np.zeros(NUMBERS, dtype=np.int64)
_NUMBERS[[FIRST, *range(OPEN, NUMBERS, 2)]] = NOWHERE
_SIGNALS = np.zeros(SUMS + 3 * LEVELS)
_SIGNALS[[0, 2, 4]], _SIGNALS[[1, 3, 5]] = np.inf, -np.inf
_SIGNALS[LAST_SETPOINT] = np.nan
_HELD = np.full((LEVELS, IN_SLOTS + SLOTS), NOWHERE, dtype=np.int64)
_HELD[:, [STRIDE, SLOT, HELD]] = 1, -1, 0


class Survey:
    """Takes the blocks of one loop's record; signals are setpoint, measurement and output, in this order.

    slower: keep the slower pictures as well, from which the settings of the controller can be read.
    """

    def __init__(self, interval: float, *, slower: bool = True) -> None:
        self.interval = interval
        self.numbers, self._signals = _NUMBERS.copy(), _SIGNALS.copy()
        levels = LEVELS if slower else 1
        self._held = _HELD[:levels].copy()
        self._raw = np.empty((3, SLOTS, ROWS))
        self._kinds = np.empty((SLOTS, ROWS), dtype=np.uint8)
        self._slower = np.empty((levels - 1, 3, SLOTS, ROWS))

    def update(self, block: Record) -> None:
        """Take in the next block of the loop."""
        output = np.empty(0) if block.output is None else block.output
        r, y, u = (np.ascontiguousarray(x, dtype=np.float64) for x in (block.setpoint, block.measurement, output))
        look(np.ascontiguousarray(block.index, dtype=np.int64), r, y, u,
             np.ascontiguousarray(block.state, dtype=np.uint8), self.numbers, self._signals, self._held, self._raw,
             self._kinds, self._slower, np.empty(ROOM, np.int64), np.empty((3, ROOM)), np.empty((3, 2), np.int64))

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
        index, (_, measured, outputs) = self._rows(0, most=SLOTS // 2, only=GOOD)
        there = np.isfinite(outputs)
        return (index, measured, index, outputs) if there.all() else (index, measured, index[there], outputs[there])

    def rows(self, level: int) -> tuple[IntArray, FloatArray]:
        """Grid numbers (rows,) in units of SLOWER**level samples, and means (3, rows) of all three signals."""
        index, rows = self._rows(level)
        mine = np.isfinite(rows[2])
        return (index, rows) if mine.all() else (index[mine], rows[:, mine])

    def _rows(self, level: int, most: int = SLOTS, only: int = STATES) -> tuple[IntArray, FloatArray]:
        """What is kept of one picture, in time order; every second stretch where it is more than `most`.

        Grid numbers (rows,) and signals (3, rows). only: highest state of the samples wanted.
        """
        return gather(self._held[level, IN_SLOTS:], most, self._slower[level - 1] if level else self._raw, self._kinds,
                      STATES if level else only)
