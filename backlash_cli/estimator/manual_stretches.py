"""Finds the tests of a valve in a record: stretches in manual in which a hand moved OP there and back."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..record import Record, SampleState
from .confirm import GAP, MOST_SAMPLES
from .predictor import Recording, recording_of
from .width_profile import NARROWEST

LEAD = 2000  # samples before a test, at most as many as in it: where the stem stood, and what PV still answers to
LIMIT = 1e-3  # of the span: at its limits a valve does not follow OP
MOST_TESTS = 12  # the last ones


class ManualScanner:
    """Takes the blocks of one loop's record and gives at the end the tests in manual that they hold."""

    def __init__(self) -> None:
        self._before: deque[tuple[NDArray[Any], ...]] = deque()
        self._kept: deque[tuple[NDArray[Any], ...]] = deque()
        self._samples = 0

    def update(self, block: Record) -> None:
        """Take the next block; its index goes on where the last one ended, or later."""
        if block.output is None or not len(block):
            return
        columns = (block.index, block.measurement, block.output, block.state)
        manual = block.state == SampleState.MANUAL
        last = len(block) - int(np.argmax(manual[::-1])) if manual.any() else 0
        if last:
            self._keep(self._before)
            self._before.clear()
            self._keep([tuple(c[:last] for c in columns)])
        self._before.append(tuple(c[max(last, len(block) - LEAD) :] for c in columns))
        while sum(len(c[0]) for c in self._before) - len(self._before[0][0]) >= LEAD:
            self._before.popleft()

    def _keep(self, blocks: Any) -> None:
        for columns in blocks:
            self._kept.append(columns)
            self._samples += len(columns[0])
            while self._samples - len(self._kept[0][0]) > MOST_SAMPLES:
                self._samples -= len(self._kept.popleft()[0])

    def finish(self) -> list[Recording]:
        """Return the stretches in manual in which OP went there and back, in % of span, the last MOST_TESTS of them.

        Each with what lies before it; there it is not `usable`.
        """
        if not self._kept:
            return []
        from ..kernels import gap_crossings

        index, measured, output, state = (np.concatenate(c) for c in zip(*self._kept, strict=True))
        by_hand = (state == SampleState.MANUAL) & (output > LIMIT) & (output < 1.0 - LIMIT)
        lost = (state == SampleState.MISSING) | (state == SampleState.IMPLAUSIBLE)
        rows = np.flatnonzero(by_hand)
        others = np.cumsum(~by_hand & ~lost)
        apart = np.flatnonzero((np.diff(others[rows]) > 0) | (np.diff(index[rows]) > GAP)) + 1
        holes = np.append(0, np.flatnonzero(np.diff(index) > GAP) + 1)
        found = []
        for part in np.split(rows, apart):
            if not len(part) or not gap_crossings(100.0 * output[part], NARROWEST):
                continue
            lead = min(part[-1] + 1 - part[0], LEAD)
            first = max(part[0] - lead, holes[np.searchsorted(holes, part[0], side="right") - 1])
            cut, usable = slice(first, part[-1] + 1), np.zeros(len(index), dtype=bool)
            usable[part] = np.isfinite(measured[part])
            found.append(recording_of(index[cut], output[cut], measured[cut], usable[cut], scale=100.0))
        return found[-MOST_TESTS:]
