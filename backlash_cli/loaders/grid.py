"""A uniform grid for stamps that are nearly, or by intention not, uniform.

regular: the stamps lie on a grid; rows are put at their grid number, nothing is interpolated.
jitter: at least 90 % of the spacings lie within 0.3 to 1.7 of the usual one; values are interpolated to the grid.
compressed: the historian left rows out (exception or swinging-door compression); values in between are taken as
the historian means it. Anything else is refused.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import Note
from .grid_plan import plan_grid
from .order import Ordered
from .steps import Steps
from .times import SECOND


@dataclass(frozen=True, eq=False)
class Grid:
    """start, step: microseconds. index: (samples,) grid numbers, jumps are gaps. kind: see the module.

    regular: rows (samples,) row of each sample, -1 for an absent one, None when sample i is row i.
    jitter, compressed: stamps and rows of the recorded samples, to interpolate between; recorded (samples,) True
    where a row stands at (or, with jitter, next to) the grid point.
    """

    start: int
    step: int
    index: NDArray[np.int64]
    kind: str
    rows: NDArray[np.int64] | None = None
    stamps: NDArray[np.int64] | None = None
    recorded: NDArray[np.bool_] | None = None
    notes: tuple[Note, ...] = field(default=())

    @property
    def times(self) -> NDArray[np.int64]:
        """(samples,) microseconds since 1970 UTC."""
        return self.start + self.step * self.index

    @property
    def interval(self) -> float:
        return self.step / SECOND


def make_grid(order: Ordered) -> Grid:
    """Find the grid of strictly increasing stamps. Raises LoopError when they are too few or too irregular."""
    stamps = order.stamps
    if len(stamps) < 2:
        raise LoopError(f"only {len(stamps)} sample: too few", code="too_few_samples", remedy="export a longer time")
    plan = plan_grid(Steps.of(stamps))
    rows: NDArray[np.int64] | None = None
    recorded = None
    if plan.even:
        index, rows = np.arange(len(stamps)), order.rows
    elif plan.kind == "regular":
        index, places = plan.rows(stamps)
        own = np.arange(len(stamps)) if order.rows is None else order.rows
        rows = own if len(places) == len(own) else np.where(places >= 0, own[places], -1)
    else:
        index, rows = plan.points(stamps), order.rows
        recorded = plan.recorded(stamps, plan.start + plan.step * index)
    share = 1.0 if recorded is None else float(recorded.mean())
    return Grid(plan.start, plan.step, index, plan.kind, rows, None if recorded is None else stamps, recorded,
                (*order.notes, *plan.notes(share)))
