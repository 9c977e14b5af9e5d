"""The signals of one loop brought to the grid of its measurement: held until the next record, or on straight lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import FloatArray, IntArray, Note
from .grid import GAP_FACTOR, MAX_HOLE, SPARSE_SHARE, Grid, Steps
from .join import Joiner, LoopSeries, Signal
from .options import ReadOptions
from .order import NAT
from .quality import automatic
from .signals import Axis, Series

LONGEST_FILL = 60  # samples, however slow the controller


@dataclass
class Frame:
    """The grid of one loop. axis: that of the measurement. bridge: longest hole in samples that is filled.

    carried: setpoint and mode of the chunk before.

    Every method returns (samples,) values on the grid, nan where there are none, and adds to `notes` what it assumed.
    """

    loop: LoopSeries
    joiner: Joiner
    options: ReadOptions
    axis: Axis
    grid: Grid
    bridge: int
    notes: list[Note] = field(default_factory=list)
    carried: dict[str, float] = field(default_factory=dict)

    def measurement(self, pv: Signal) -> tuple[FloatArray, NDArray[np.bool_] | None]:
        """Return the measurement, and which samples were interpolated between records."""
        if self.grid.kind == "regular":
            return on_grid(pv.values, self.grid), None
        limit = (MAX_HOLE + 1.5) * self.grid.step
        if self.grid.kind == "compressed":
            steps = _good_steps(pv)  # 99 % of the records keep this spacing
            limit = max(limit, GAP_FACTOR * (0.0 if steps is None else steps.quantile(0.99)))
        if self.options.interpolation == "hold":
            values = held(pv, self.grid, limit, self.bridge)
        else:
            values = linear(pv, self.grid, limit)
        assert self.grid.recorded is not None
        return values, ~self.grid.recorded & np.isfinite(values)

    def companion(self, role: str) -> FloatArray | None:
        """Setpoint or output, held between its records unless the user says linear; None when not recorded."""
        if role not in self.loop.roles:
            return None
        signal = self.joiner.signal(self.loop.roles[role], role, self.loop.name)
        self.notes += signal.notes
        if signal.axis is not self.axis:
            how = "interpolated on straight lines" if self.options.interpolation == "linear" else (
                "held until the next record")
            self.notes.append(Note("expanded", f"{role.upper()} is recorded at its own times; it is {how}"))
        return self._expanded(signal, role)

    def disturbance(self, items: list[Series]) -> FloatArray | None:
        """A further measured column in its own units; None when it holds no numbers or cannot be joined."""
        try:
            signal = self.joiner.signal(items[:1] if items[0].axis is self.axis else items, "", "")
        except LoopError:
            return None
        return self._expanded(signal, "dv") if np.isfinite(signal.values).any() else None

    def manual(self, auto_modes: tuple[str, ...]) -> tuple[NDArray[np.bool_] | None, list[Note]]:
        """True where the controller was not in automatic, None when no mode is recorded; and what is to be said."""
        if "mode" not in self.loop.roles:
            return None, []
        parts = []
        notes: list[Note] = []
        for item in self.loop.roles["mode"]:
            values, more = automatic(item.cells(), auto_modes)
            notes += more
            parts.append((item.axis, values))
        signal = Signal(self.joiner.axis([a for a, _ in parts]), np.concatenate([v for _, v in parts]), None)
        if not np.isfinite(signal.values).any() and "mode" not in self.carried:
            return None, [*notes, Note("mode_empty", "the MODE column is empty; the loop is taken to be in automatic")]
        values = self._expanded(signal, "mode")
        unknown = np.isnan(values)
        if unknown.any():
            # a first change to manual means automatic before, and the other way round
            before = not unknown.all() and float(values[~unknown][0]) == 0.0
            values = np.where(unknown, before, values)
            notes.append(Note("mode_unknown", f"{int(unknown.sum())} samples before the first recorded mode are taken "
                              f"as {'automatic' if before else 'not automatic'}"))
        return values == 0.0, notes

    def _expanded(self, signal: Signal, role: str) -> FloatArray:
        """The values of a signal; a setpoint or mode of the chunk before holds until the first one that is known."""
        values = self._on_grid(signal, role)
        if role in ("sp", "mode"):
            known = np.isfinite(values)
            if role in self.carried and not known.all():
                first = int(np.argmax(known)) if known.any() else len(values)
                values = np.concatenate([np.full(first, self.carried[role]), values[first:]])
            if known.any():
                self.carried[role] = float(values[known][-1])
        return values

    def _on_grid(self, signal: Signal, role: str) -> FloatArray:
        if signal.axis is self.axis and self.grid.kind == "regular":
            values = on_grid(signal.values, self.grid)
            if not np.isnan(values).any():
                return values
        limit = None
        if role not in ("sp", "mode"):
            limit = max(hold_limit(signal), (self.bridge + 1.5) * self.grid.step)
        if self.options.interpolation == "linear" and role != "mode":
            return linear(signal, self.grid, float("inf") if limit is None else limit)
        # rows stamped now early, now late are still one scan each: PV and OP of a row belong together
        late = self.grid.step // 2 if self.grid.kind == "jitter" and signal.axis is self.axis else 0
        return held(signal, self.grid, limit, self.bridge, late)


def grid_of(pv: Signal, made: Callable[[Signal], Grid] | None = None) -> tuple[Grid, Signal]:
    """The grid is that of the measurement; blank cells in many places mean that it was recorded less often.

    made: gives the grid where it is known already.
    """
    blank = np.isnan(pv.values) if pv.bad is None else np.isnan(pv.values) & ~pv.bad
    count = int(blank.sum())
    if count and count < len(blank):
        known = pv.axis.micros != NAT
        edges = int(np.count_nonzero(blank[1:] & ~blank[:-1] & known[1:]))
        if edges > SPARSE_SHARE * (len(blank) - count) or count > 0.9 * len(blank):
            rows = np.flatnonzero(~blank)
            bad = None if pv.bad is None else pv.bad[rows]
            pv = replace(pv, axis=pv.axis.part(rows), values=pv.values[rows], bad=bad)
    return (pv.axis.grid(pv.values) if made is None else made(pv)), pv


def fill_limit(Ti: float | None, interval: float) -> int:
    """Longest hole in samples that is filled: half the integral time, the time constant of the estimator's own filter.

    The shortest half period it uses lasts 5 Ti, ten times that. MAX_HOLE samples when Ti is not known.
    """
    return MAX_HOLE if Ti is None else int(min(LONGEST_FILL, max(1.0, Ti / 2.0 / interval)))


def on_grid(values: FloatArray, grid: Grid) -> FloatArray:
    """Put the values of a regular grid's own rows at their grid points; absent rows are nan."""
    if grid.rows is None:
        return values
    if len(grid.rows) and grid.rows.min() >= 0:
        return values[grid.rows]
    return np.where(grid.rows >= 0, values[grid.rows], np.nan)


def linear(signal: Signal, grid: Grid, limit: float) -> FloatArray:
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


def held(signal: Signal, grid: Grid, limit: float | None, bridge: int, late: int = 0) -> FloatArray:
    """The last good record at or before each grid point; nan before the first, after `limit` microseconds, and from
    a bad record on when no good one follows within `bridge` samples or a few records. late: microseconds by which a
    record may be stamped late and still belong to its grid point."""
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
        spacing = float(np.median(np.diff(stamps))) if len(stamps) > 1 else float(grid.step)
        few = max((bridge + 0.5) * grid.step, (MAX_HOLE + 0.5) * spacing)
        out[stale & (age > few)] = np.nan
    return out


def hold_limit(signal: Signal) -> float:
    """How long in microseconds a value holds: while it is recorded on change, until the next record; while it is
    recorded at regular times, GAP_FACTOR intervals, for then a longer silence is a loss."""
    steps = _good_steps(signal)
    if steps is None:
        return float("inf")
    usual = steps.quantile(0.95)
    return GAP_FACTOR * usual if usual <= 3.0 * steps.median else float(steps.longest)


def _good_steps(signal: Signal) -> Steps | None:
    stamps, _, good = _records(signal)
    stamps = stamps[good]
    return Steps.of(stamps) if len(stamps) > 1 else None


def _records(signal: Signal) -> tuple[IntArray, FloatArray, NDArray[np.bool_]]:
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
