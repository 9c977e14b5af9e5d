"""What is found out of a signal of a long loop by reading it once: its cells, and how far its stamps lie apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .grid_plan import ABSENT_ROWS
from .pieces import NotInPieces, in_blocks
from .signal_pieces import PieceSignal, is_bad
from .steps import Steps, StepTally
from .times import DAY, NAT


class OutOfOrder(NotInPieces):
    """Stamps do not rise, or some lie far from all others."""


@dataclass(frozen=True, eq=False)
class SeldomSignal(PieceSignal):
    """A measurement without its blank rows."""

    def stamps(self) -> Iterator[NDArray[np.int64]]:
        return (stamps for stamps, _ in self._rows())

    def rows(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        pieces = ({"stamps": stamps, "values": values} for stamps, values in self._rows())
        return ((piece["stamps"], piece["values"]) for piece in in_blocks(pieces))

    def _rows(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        for stamps, values in PieceSignal(self.axes, self.values).rows():
            keep = ~np.isnan(values) | is_bad(values)
            yield stamps[keep], values[keep]


def absent_rows(steps: Steps, step: int) -> int:
    """Number of samples of a regular grid that have no row but a place in short holes."""
    advance = np.maximum(1, np.rint(steps.values / step)).astype(np.int64)
    holes = (advance > 1) & (advance <= ABSENT_ROWS + 1)
    return int((steps.counts[holes] * (advance[holes] - 1)).sum())


class Facts:
    """What is found out of a signal by reading it once. blank, bad: cells. edges: where blank cells begin.

    good, records: distances between good records, and between all that are no blank cells; None for less than two.
    """

    def __init__(self, signal: PieceSignal, *, steps: bool = False) -> None:
        self.rows = self.blank = self.bad = self.edges = 0
        good, records = StepTally(), StepTally()
        last_blank = True
        stream = signal.rows() if steps else ((None, values) for values in signal.values())
        for stamps, values in stream:
            self.rows += len(values)
            empty = np.isnan(values)
            if empty.any():
                bad = is_bad(values)
                blank = empty & ~bad
                self.bad += int(np.count_nonzero(bad))
                self.blank += int(np.count_nonzero(blank))
                self.edges += int(np.count_nonzero(blank & ~np.append(last_blank, blank[:-1])))
                last_blank = bool(blank[-1])
            elif len(values):
                blank = empty
                last_blank = False
            if stamps is not None:
                good.add(stamps[np.isfinite(values)])
                records.add(stamps[~blank])
        self.good = good.steps() if good.rows > 1 else None
        self.records = records.steps() if records.rows > 1 else None


def steps_in_order(signal: PieceSignal, rows: int, rising: bool) -> Steps:
    """Return the distances of its stamps. Raises OutOfOrder unless they rise, with none far from all others.

    rising: they are known to do so, and stamps far from others to be meant.
    """
    tally = StepTally()
    picks = {rows // 20: 0, rows - 1 - rows // 20: 0}
    for stamps in signal.stamps():
        if len(stamps) and stamps.min() == NAT:
            raise OutOfOrder
        for row in picks:
            if tally.rows <= row < tally.rows + len(stamps):
                picks[row] = int(stamps[row - tally.rows])
        tally.add(stamps)
        if not tally.rising:
            raise OutOfOrder
    if tally.rows < 2 or tally.rows != rows:
        raise NotInPieces
    steps = tally.steps()
    low, high = picks.values() if len(picks) == 2 else (0, 0)
    far = float(steps.last) - float(steps.first) > 10.0 * (float(high) - float(low)) + 2.0 * DAY
    if rows >= 20 and far and not rising:
        raise OutOfOrder
    return steps
