"""How far stamps lie apart, counted: all that the choice of a grid needs, however many stamps there are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MOST_STEPS = 1 << 21  # different distances that are counted


@dataclass(frozen=True, eq=False)
class Steps:
    """values: (distinct,) distances in microseconds, ascending; counts: how often each occurs.

    first, last: the ends of the stamps. before_longest: the stamp before the first of the longest distances.
    """

    values: NDArray[np.int64]
    counts: NDArray[np.int64]
    first: int
    last: int
    before_longest: int

    @staticmethod
    def of(stamps: NDArray[np.int64]) -> Steps:
        """Count the distances of two or more stamps."""
        tally = StepTally()
        tally.add(stamps)
        return tally.steps()

    @property
    def total(self) -> int:
        """Number of distances."""
        return int(self.counts.sum())

    @property
    def longest(self) -> int:
        return int(self.values[-1])

    def share(self, which: NDArray[np.bool_]) -> float:
        """Return the share of the distances that are of the chosen values."""
        return float(self.counts[which].sum() / self.total)

    def sum(self, which: NDArray[np.bool_], of: NDArray[np.float64] | NDArray[np.int64]) -> float:
        """Return the sum of something over the distances of the chosen values; of: (distinct,)."""
        return float((of[which].astype(np.float64) * self.counts[which]).sum())

    def quantile(self, share: float) -> float:
        """Return a quantile, between two distances on a straight line, as NumPy does."""
        place = share * (self.total - 1)
        low = int(np.floor(place))
        a, b = self._at(low), self._at(min(low + 1, self.total - 1))
        rest = place - low
        return a + (b - a) * rest if rest < 0.5 else b - (b - a) * (1.0 - rest)

    @property
    def median(self) -> float:
        return (self._at((self.total - 1) // 2) + self._at(self.total // 2)) / 2.0

    def _at(self, rank: int) -> float:
        return float(self.values[np.searchsorted(np.cumsum(self.counts), rank, side="right")])


class StepTally:
    """Counts the distances of stamps that come piece by piece. rising: each is later than the one before."""

    def __init__(self) -> None:
        self.rows = 0
        self.rising = True
        self._values: list[NDArray[np.int64]] = []
        self._counts: list[NDArray[np.int64]] = []
        self._kept = 0
        self._first = self._last = self._before = 0
        self._longest = -1

    def add(self, stamps: NDArray[np.int64]) -> None:
        """Take the next stamps. Raises OverflowError when they lie at too many different distances."""
        if not len(stamps):
            return
        if self.rows:
            steps = np.diff(stamps, prepend=self._last)
            befores = 1
        else:
            steps, self._first, befores = np.diff(stamps), int(stamps[0]), 0
        before_first = self._last
        self.rows += len(stamps)
        self._last = int(stamps[-1])
        if not len(steps):
            return
        low, high = int(steps.min()), int(steps.max())
        self.rising &= low > 0
        if high > self._longest:
            place = int(np.argmax(steps)) - befores
            self._longest, self._before = high, before_first if place < 0 else int(stamps[place])
        if low == high:
            values, counts = np.array([low]), np.array([len(steps)])
        else:
            values, counts = np.unique(steps, return_counts=True)
        self._values.append(values)
        self._counts.append(counts)
        self._kept += len(values)
        if self._kept > MOST_STEPS:
            self._merge()
            if self._kept > MOST_STEPS // 2:
                raise OverflowError("too many different distances")

    def _merge(self) -> None:
        values, place = np.unique(np.concatenate(self._values), return_inverse=True)
        counts = np.bincount(place, np.concatenate(self._counts), len(values)).astype(np.int64)
        self._values, self._counts, self._kept = [values], [counts], len(values)

    def steps(self) -> Steps:
        """Return what was counted; there are two stamps at least."""
        self._merge()
        return Steps(self._values[0], self._counts[0], self._first, self._last, self._before)
