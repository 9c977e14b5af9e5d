"""One look at every sample of a loop: counts and ranges of all of them, and the samples themselves, the last ones.

From these come pictures of the record at several time scales: an even choice of stretches, each ROWS rows of the grid
long, of single samples or of means over 4, 16, 64 and 256 of them."""

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np

from ..record import BoolArray, FloatArray, IntArray, Record, SampleState

MOST = 1 << 22  # samples that are kept
ROWS = 1024  # of a stretch
SLOTS = 16  # stretches of a picture at most
LEVELS = 5
SLOWER = 4  # rows of one picture in a row of the next
STATES = len(SampleState)
MOSTLY_OWN = 0.2  # share of samples filled in between others that leaves the P part and the noise visible


class Survey:
    """Takes the blocks of one loop's record; where they are cut does not matter.

    most: samples that are kept, the last ones. states: (states,) how many of each SampleState. gaps: holes of more than
    one sample; longest: step of the grid. moves: changes of the setpoint between usable samples. with_setpoint: samples
    with one. lowest, highest: (2,) usable values of measurement and output, reversed where there are none."""

    def __init__(self, most: int = MOST) -> None:
        self.most = most
        self.states: IntArray = np.zeros(STATES, dtype=np.int64)
        self.first = self.last = self.gaps = self.moves = self.with_setpoint = self._dropped = 0
        self.longest = 1
        self.lowest, self.highest = np.full(2, np.inf), np.full(2, -np.inf)
        self._setpoint = np.zeros(0)  # the last usable one
        self._blocks: deque[Record] = deque()

    @property
    def samples(self) -> int:
        return int(self.states.sum())

    @property
    def used(self) -> int:
        """Number of samples that may enter an estimate."""
        return int(self.states[: SampleState.FILLED + 1].sum())

    def update(self, block: Record) -> None:
        """Take in the next block of the loop."""
        self._blocks.append(block)
        if not len(block):
            return
        if not self.samples:
            self.first, self.last = int(block.index[0]), int(block.index[0]) - 1
        if block.index[-1] - self.last != len(block):
            steps = np.diff(block.index, prepend=self.last)
            self.gaps, self.longest = self.gaps + int(np.sum(steps > 2)), max(self.longest, int(steps.max()))
        self.last, usable = int(block.index[-1]), block.usable
        for state in range(int(block.state.max()) + 1):
            self.states[state] += np.count_nonzero(block.state == state)
        with_setpoint = np.isfinite(block.setpoint)
        self.with_setpoint += int(np.count_nonzero(with_setpoint))
        for signal, values in enumerate((block.measurement, block.output)):
            which = usable if values is None else usable & np.isfinite(values)
            known = np.zeros(0) if values is None else values if which.all() else values[which]
            self.lowest[signal] = known.min(initial=self.lowest[signal])
            self.highest[signal] = known.max(initial=self.highest[signal])
        with_setpoint &= usable
        setpoint = block.setpoint if with_setpoint.all() else block.setpoint[with_setpoint]
        self.moves += int(np.count_nonzero(setpoint[1:] != setpoint[:-1]) + np.sum(self._setpoint != setpoint[:1]))
        self._setpoint = setpoint[-1:] if len(setpoint) else self._setpoint
        while self.samples - self._dropped - len(self._blocks[0]) >= self.most:
            self._dropped += len(self._blocks.popleft())

    @property
    def kept(self) -> Record:
        """The last `most` samples as one block."""
        one = self._blocks[0]
        if len(self._blocks) > 1:
            names = ("index", "setpoint", "measurement", "output", "state")
            columns: dict[str, Any] = {name: np.concatenate([getattr(block, name) for block in self._blocks])
                                       for name in names if getattr(one, name) is not None}
            one = replace(one, disturbances={}, **columns)
            self._blocks = deque([one])
        return one.slice(-self.most, len(one))


def measured(r: Record) -> tuple[IntArray, FloatArray, IntArray, FloatArray]:
    """Samples that were measured, not filled in, from a few stretches: grid numbers (rows,) and values (rows,) of the
    measurement, then of the output. More would not show better what a recorder did to them."""
    at = _even_choice(r.index, r.usable & np.isfinite(r.measurement), SLOTS // 2)
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
    chosen = _even_choice(number[starts], whole, SLOTS)
    sums = [np.add.reduceat(x[use], starts)[chosen] for x in (r.setpoint, r.measurement, r.output) if x is not None]
    return number[starts[chosen]], np.array(sums) / size


def with_all_signals(r: Record) -> BoolArray:
    """(samples,) where setpoint, measurement and output are known and may be used."""
    known = r.usable & np.isfinite(r.setpoint) & np.isfinite(r.measurement)
    return known & (r.output is not None and np.isfinite(r.output))


def _even_choice(index: IntArray, use: BoolArray, most: int) -> IntArray:
    """Which rows of use lie in one of `most` stretches at most: in every one of them, every second, every fourth .."""
    stretches = np.arange(index[0] // ROWS, index[-1] // ROWS + 1) if len(index) else index
    starts, ends = (np.searchsorted(index, ROWS * (stretches + after)) for after in (0, 1))
    some, stride = np.flatnonzero(starts < ends), 1
    some = some[np.logical_or.reduceat(use, starts[some])] if len(some) else some
    while np.count_nonzero(chosen := stretches[some] % stride == 0) > most:
        stride *= 2
    return np.concatenate([starts[:0], *(starts[k] + np.flatnonzero(use[starts[k] : ends[k]]) for k in some[chosen])])
