"""A bounded, even sample of stretches of a long record, kept while blocks arrive."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..record import FloatArray, IntArray

STRETCH_ROWS = 1024
MAX_STRETCHES = 16


class StretchSample:
    """Keeps whole stretches of consecutive rows, spread evenly over the record, in bounded memory.

    Rows are means over `size` samples of the grid (`size` 1: the samples themselves); a row with an unusable
    sample is left out. Stretch s covers the rows s * STRETCH_ROWS ... of the grid. When more than MAX_STRETCHES
    are held, every second one is dropped and only every second one is taken from then on. What is kept depends on
    grid numbers alone, so the cut of the record into blocks does not matter.
    """

    def __init__(self, size: int, columns: int) -> None:
        self.size = size
        self._columns = columns
        self._stride = 1
        self._kept: dict[int, list[tuple[IntArray, FloatArray]]] = {}
        self._rest_index = np.empty(0, dtype=np.int64)
        self._rest = np.empty((0, columns))

    def update(self, index: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
        """Take in samples: index (samples,) strictly increasing over all calls, values (samples, columns) finite.

        Returns the rows they made: a slower picture can be made from these.
        """
        if self.size > 1:
            index, values = self._means(index, values)
        if len(index):
            self._keep(index, values)
        return index, values

    def _keep(self, index: IntArray, values: FloatArray) -> None:
        stretch = index // STRETCH_ROWS
        wanted = stretch % self._stride == 0
        edges = np.flatnonzero(np.diff(stretch)) + 1
        bounds = [0, *edges.tolist(), len(index)]
        for lo, hi in pairwise(bounds):
            if wanted[lo]:
                self._kept.setdefault(int(stretch[lo]), []).append((index[lo:hi].copy(), values[lo:hi].copy()))
        while len(self._kept) > MAX_STRETCHES:
            self._stride *= 2
            self._kept = {s: parts for s, parts in self._kept.items() if s % self._stride == 0}

    def _means(self, index: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
        """Means over complete groups of `size` samples; the open group waits for the next block."""
        index = np.concatenate([self._rest_index, index])
        values = np.concatenate([self._rest, values])
        group = index // self.size
        open_from = int(np.searchsorted(group, group[-1])) if len(group) else 0
        if len(group) and index[-1] % self.size == self.size - 1:
            open_from = len(group)
        self._rest_index, self._rest = index[open_from:].copy(), values[open_from:].copy()
        group, values = group[:open_from], values[:open_from]
        if not len(group):
            return group, values
        if len(group) == self.size * (group[-1] - group[0] + 1):  # no sample is missing
            mean = np.tile(np.eye(self._columns) / self.size, (self.size, 1))
            return group[:: self.size], values.reshape(-1, self.size * self._columns) @ mean
        starts = np.concatenate([[0], np.flatnonzero(np.diff(group)) + 1])
        counts = np.diff(np.append(starts, len(group)))
        means = np.add.reduceat(values, starts, axis=0) / counts[:, None]
        full = counts == self.size
        return group[starts][full], means[full]

    def rows(self) -> tuple[IntArray, FloatArray]:
        """Return the kept rows: their grid numbers in units of `size` samples, and (rows, columns) values."""
        parts = [part for s in sorted(self._kept) for part in self._kept[s]]
        if not parts:
            return np.empty(0, dtype=np.int64), np.empty((0, self._columns))
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
