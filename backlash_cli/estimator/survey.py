"""One look at every sample of a loop: counts and ranges of all of them, and the samples themselves, the last ones.

From these come pictures of the record at several time scales: an even choice of stretches, each ROWS rows of the grid
long, of single samples or of means over 4, 16, 64 and 256 of them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray, Record, SampleState

MOST = 1 << 22  # samples that are kept
ROWS = 1024  # of a stretch
SLOTS = 16  # stretches of a picture at most
LEVELS = 5
SLOWER = 4  # rows of one picture in a row of the next
STATES = len(SampleState)


class Survey:
    """Takes the blocks of one loop's record; where they are cut does not matter.

    most: samples that are kept, the last ones. samples: number taken. states: (states,) how many of each SampleState.
    first, last: grid numbers. gaps: holes of more than one sample; longest: of them, in steps of the grid, 0 without
    any. moves: changes of the setpoint between usable samples. with_setpoint: samples with one.
    """

    def __init__(self, most: int = MOST) -> None:
        self.most = most
        self.states: IntArray = np.zeros(STATES, dtype=np.int64)
        self.first = self.last = self.gaps = self.longest = self.moves = self.with_setpoint = self.samples = 0
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)  # of measurement and output
        self._setpoint = np.nan  # the last usable one
        self._blocks: deque[Record] = deque()
        self._held = 0

    @property
    def used(self) -> int:
        """Number of samples that may enter an estimate."""
        return int(self.states[: SampleState.FILLED + 1].sum())

    def update(self, block: Record) -> None:
        """Take in the next block of the loop."""
        self._blocks.append(block)
        if not len(block):
            return
        index = block.index
        if not self.samples:
            self.first, self.last = int(index[0]), int(index[0]) - 1
        if index[-1] - self.last != len(index):
            steps = np.diff(index, prepend=self.last)
            self.longest = max(self.longest, int(steps.max()))
            self.gaps += int(np.count_nonzero(steps > 2))
        self.last, self.samples = int(index[-1]), self.samples + len(block)
        self.states = self.states + np.array([np.count_nonzero(block.state == state) for state in range(STATES)])
        self.with_setpoint += int(np.count_nonzero(np.isfinite(block.setpoint)))
        usable = block.usable
        for signal, values in enumerate((block.measurement, block.output)):
            known = np.zeros(0) if values is None else values[usable & np.isfinite(values)]
            if len(known):
                self._low[signal] = min(self._low[signal], known.min())
                self._high[signal] = max(self._high[signal], known.max())
        setpoint = block.setpoint[usable & np.isfinite(block.setpoint)]
        if len(setpoint):
            before = setpoint[0] if np.isnan(self._setpoint) else self._setpoint
            self.moves += int(np.count_nonzero(setpoint[1:] != setpoint[:-1])) + (setpoint[0] != before)
            self._setpoint = float(setpoint[-1])
        self._held += len(block)
        while self._held - len(self._blocks[0]) >= self.most:
            self._held -= len(self._blocks.popleft())

    @property
    def kept(self) -> Record:
        """The last `most` samples as one block."""
        one, blocks = self._blocks[0], self._blocks
        if len(blocks) > 1:
            index, setpoint, measurement, state = (
                np.concatenate([getattr(block, name) for block in blocks])
                for name in ("index", "setpoint", "measurement", "state"))
            output = None if one.output is None else np.concatenate([u for b in blocks if (u := b.output) is not None])
            one = replace(one, index=index, setpoint=setpoint, measurement=measurement, output=output, state=state,
                          disturbances={})
            self._blocks = deque([one])
        return one.slice(-self.most, len(one))

    @property
    def ranges(self) -> tuple[float, float]:
        """Largest less smallest usable value of measurement and output, 0 where there was none."""
        of_measurement, of_output = np.maximum(self._high - self._low, 0.0).tolist()
        return of_measurement, of_output


def measured(r: Record) -> tuple[IntArray, FloatArray, IntArray, FloatArray]:
    """Samples that were measured, not filled in, from a few stretches: grid numbers (rows,) and values (rows,) of the
    measurement, then of the output. More would not show better what a recorder did to them."""
    at = np.flatnonzero(r.usable & np.isfinite(r.setpoint) & np.isfinite(r.measurement))
    at = at[_even_choice(r.index[at], SLOTS // 2)]
    at = at[r.state[at] == SampleState.GOOD]
    outputs = np.full(len(at), np.nan) if r.output is None else r.output[at]
    both = np.isfinite(outputs)
    return r.index[at], r.measurement[at], r.index[at[both]], outputs[both]


def rows(r: Record, level: int) -> tuple[IntArray, FloatArray]:
    """Grid numbers (rows,) in units of SLOWER**level samples, and means (3, rows) of setpoint, measurement and output
    over groups of so many samples of which none is missing."""
    use, size = with_all_signals(r), SLOWER**level
    number = r.index[use] // size
    starts = np.flatnonzero(np.diff(number, prepend=number[:1] - 1))
    whole = np.diff(starts, append=len(number)) == size
    index = number[starts[whole]]
    chosen = _even_choice(index, SLOTS)
    sums = [np.add.reduceat(x[use], starts)[whole][chosen]
            for x in (r.setpoint, r.measurement, r.output) if x is not None]
    return index[chosen], np.array(sums) / size


def with_all_signals(r: Record) -> NDArray[np.bool_]:
    """(samples,) where setpoint, measurement and output are known and may be used."""
    known = r.usable & np.isfinite(r.setpoint) & np.isfinite(r.measurement)
    return known & (r.output is not None and np.isfinite(r.output))


def _even_choice(index: IntArray, most: int) -> NDArray[np.bool_]:
    """Which rows lie in one of `most` stretches at most: in every one of them, every second, every fourth .."""
    stretch, stride = index // ROWS, 1
    there = stretch[np.flatnonzero(np.append(stretch[1:] != stretch[:-1], len(stretch) > 0))]
    while np.count_nonzero(there % stride == 0) > most:
        stride *= 2
    chosen: NDArray[np.bool_] = stretch & (stride - 1) == 0  # many times as fast as a remainder
    return chosen
