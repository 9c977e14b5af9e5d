"""A signal with stamps of its own, brought to one stretch of a grid after the other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .grid import Grid
from .join import Signal
from .order import Ordered
from .series import Axis
from .signal_pieces import PieceSignal, is_bad
from .times import Times

Expand = Callable[[Signal, Grid], NDArray[np.float64]]


class Window:
    """The records of a signal around a stretch of a grid; stretches come in time order.

    expand: `held` or `linear` with its limits. ahead: records after the stretch matter too. late: microseconds by which
    a record may be stamped late.
    """

    def __init__(self, signal: PieceSignal, expand: Expand, *, ahead: bool, late: int = 0) -> None:
        self._rows = signal.rows()
        self._expand, self._ahead, self._late = expand, ahead, late
        self._stamps = np.zeros(0, np.int64)
        self._values = np.zeros(0)
        self._ended = False

    def at(self, grid: Grid) -> NDArray[np.float64]:
        """Return the values on a grid of one sample or more."""
        times = grid.times
        end = int(times[-1]) + self._late
        while not self._ended and not self._enough(end):
            stamps, values = next(self._rows, (None, None))
            if stamps is None or values is None:
                self._ended = True
                break
            record = np.isfinite(values) | is_bad(values)
            self._stamps = np.concatenate([self._stamps, stamps[record]])
            self._values = np.concatenate([self._values, values[record]])
        out = self._expand(_signal(self._stamps, self._values), grid)
        self._forget(end)
        return out

    def _enough(self, end: int) -> bool:
        beyond = np.searchsorted(self._stamps, end, side="right")
        if not self._ahead:
            return bool(beyond < len(self._stamps))
        return int(np.count_nonzero(np.isfinite(self._values[beyond:]))) >= 2

    def _forget(self, end: int) -> None:
        """Keep of what lies before the end only the last good records and the last bad one."""
        beyond = int(np.searchsorted(self._stamps, end, side="right"))
        good = np.isfinite(self._values[:beyond])
        kept = np.sort(np.concatenate([np.flatnonzero(good)[-2:], np.flatnonzero(~good)[-1:]]))
        self._stamps = np.concatenate([self._stamps[kept], self._stamps[beyond:]])
        self._values = np.concatenate([self._values[kept], self._values[beyond:]])


def _signal(stamps: NDArray[np.int64], values: NDArray[np.float64]) -> Signal:
    axis = Axis(Times(stamps), "")
    axis._order = Ordered(stamps, None)
    bad = is_bad(values)
    return Signal(axis, values, bad if bad.any() else None)
