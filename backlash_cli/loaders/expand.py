"""Recorded values to grid values: held until the next record, or on a line between two of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .grid import Grid
from .grid_plan import GAP_FACTOR, MAX_HOLE
from .join import Signal
from .steps import Steps


def on_grid(values: NDArray[np.float64], grid: Grid) -> NDArray[np.float64]:
    """Put the values of a regular grid's own rows at their grid points; absent rows are nan."""
    if grid.rows is None:
        return values
    if len(grid.rows) and grid.rows.min() >= 0:
        return values[grid.rows]
    return np.where(grid.rows >= 0, values[grid.rows], np.nan)


def linear(signal: Signal, grid: Grid, limit: float) -> NDArray[np.float64]:
    """Values on straight lines between good records; nan where the records are more than `limit` microseconds apart
    or a bad one lies between."""
    stamps, values, good = _records(signal)
    times = grid.times
    if good.sum() < 2:
        return np.full(len(times), np.nan)
    known, heights = stamps[good], values[good]
    zero = known[0]
    out = np.interp((times - zero).astype(float), (known - zero).astype(float), heights, left=np.nan, right=np.nan)
    after = np.searchsorted(known, times).clip(1, len(known) - 1)
    wide = known[after] - known[after - 1] > limit
    exact = known[after] == times
    exact |= known[after - 1] == times
    out[wide & ~exact] = np.nan
    return out


def held(signal: Signal, grid: Grid, limit: float | None, bridge: int, late: int = 0,
         spacing: float | None = None) -> NDArray[np.float64]:
    """The last good record at or before each grid point; nan before the first, after `limit` microseconds, and from
    a bad record on when no good one follows within `bridge` samples or a few records. late: microseconds by which a
    record may be stamped late and still belong to its grid point. spacing: between its records, where only some of
    them are given [microseconds]."""
    stamps, values, good = _records(signal)
    times = grid.times + late
    if not good.any():
        return np.full(len(times), np.nan)
    known, heights = stamps[good], values[good]
    last = np.searchsorted(known, times, side="right") - 1
    out = np.where(last >= 0, heights[last], np.nan)
    age = times - known[last.clip(0)]
    if limit is not None:
        out[age > limit] = np.nan
    if not good.all():
        # bad from its stamp on: bridged for a short while only
        faults = stamps[~good]
        fault = np.searchsorted(faults, times, side="right") - 1
        stale = (fault >= 0) & (faults[fault.clip(0)] > known[last.clip(0)])
        if spacing is None:
            spacing = float(np.median(np.diff(stamps))) if len(stamps) > 1 else float(grid.step)
        few = max((bridge + 0.5) * grid.step, (MAX_HOLE + 0.5) * spacing)
        out[stale & (age > few)] = np.nan
    return out


def usual_spacing(signal: Signal) -> float:
    """The spacing in microseconds that 99 % of the records of a signal keep."""
    steps = _good_steps(signal)
    return 0.0 if steps is None else steps.quantile(0.99)


def hold_limit(signal: Signal) -> float:
    """How long in microseconds a value holds: while it is recorded on change, until the next record; while it is
    recorded at regular times, GAP_FACTOR intervals, for then a longer silence is a loss."""
    return longest_hold(_good_steps(signal))


def longest_hold(steps: Steps | None) -> float:
    """As `hold_limit`, from the distances between the good records; None if there are none."""
    if steps is None:
        return float("inf")
    usual = steps.quantile(0.95)
    return GAP_FACTOR * usual if usual <= 3.0 * steps.median else float(steps.longest)


def _good_steps(signal: Signal) -> Steps | None:
    stamps, _, good = _records(signal)
    stamps = stamps[good]
    return Steps.of(stamps) if len(stamps) > 1 else None


def _records(signal: Signal) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return (stamps, values, good) of all records in time order; blank cells are no records."""
    order = signal.axis.order(signal.values)
    values, bad = signal.values, signal.bad
    if order.rows is not None:
        values = values[order.rows]
        bad = None if bad is None else bad[order.rows]
    good = np.isfinite(values)
    record = good if bad is None else good | bad
    if record.all():
        return order.stamps, values, good
    return order.stamps[record], values[record], good[record]
