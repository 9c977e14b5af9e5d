"""The signals of one loop brought to the grid of its measurement."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import Note
from .expand import held, hold_limit, linear, on_grid, usual_spacing
from .grid import Grid
from .grid_plan import GAP_FACTOR, MAX_HOLE, SPARSE_SHARE
from .join import Joiner, LoopSeries, Signal
from .options import ReadOptions
from .quality import automatic
from .series import Axis, Series
from .states import hold_last
from .times import NAT

LONGEST_FILL = 60  # samples, however slow the controller


MODE_EMPTY = Note("mode_empty", "the MODE column is empty; the loop is taken to be in automatic")


def mode_before(first: float | None, samples: int) -> tuple[float, Note]:
    """Return the mode before the first recorded one (1 automatic), and what is to be said of so many samples.

    A first change to manual means automatic before, and the other way round.
    """
    automatic_first = first == 0.0
    text = f"{samples} samples before the first recorded mode are taken as "
    note = Note("mode_unknown", text + ("automatic" if automatic_first else "not automatic"))
    return (1.0 if automatic_first else 0.0), note


@dataclass
class Frame:
    """The grid of one loop. axis: that of the measurement. bridge: longest hole in samples that is filled.

    Every method returns (samples,) values on the grid, nan where there are none, and adds to `notes` what it assumed.
    """

    loop: LoopSeries
    joiner: Joiner
    options: ReadOptions
    axis: Axis
    grid: Grid
    bridge: int
    notes: list[Note] = field(default_factory=list)

    def measurement(self, pv: Signal) -> tuple[NDArray[np.float64], NDArray[np.bool_] | None]:
        """Return the measurement, and which samples were interpolated between records."""
        if self.grid.kind == "regular":
            return on_grid(pv.values, self.grid), None
        limit = (MAX_HOLE + 1.5) * self.grid.step
        if self.grid.kind == "compressed":
            limit = max(limit, GAP_FACTOR * usual_spacing(pv))
        if self.options.interpolation == "hold":
            values = held(pv, self.grid, limit, self.bridge)
        else:
            values = linear(pv, self.grid, limit)
        assert self.grid.recorded is not None
        return values, ~self.grid.recorded & np.isfinite(values)

    def companion(self, role: str) -> NDArray[np.float64] | None:
        """Setpoint or output, held between its records unless the user says linear; None when not recorded."""
        if role not in self.loop.roles:
            return None
        signal = self.joiner.signal(self.loop.roles[role], role, self.loop.name)
        self.notes += signal.notes
        if signal.axis is not self.axis:
            self.notes.append(own_times(role, self.options))
        return self._expanded(signal, role)

    def disturbance(self, items: list[Series]) -> NDArray[np.float64] | None:
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
            values, more = automatic(item.cells, auto_modes)
            notes += more
            parts.append((item.axis, values))
        signal = Signal(self.joiner.axis([a for a, _ in parts]), np.concatenate([v for _, v in parts]), None)
        if not np.isfinite(signal.values).any():
            return None, [*notes, MODE_EMPTY]
        values = self._expanded(signal, "mode")
        unknown = np.isnan(values)
        if unknown.any():
            before, note = mode_before(None if unknown.all() else float(values[~unknown][0]), int(unknown.sum()))
            values = np.where(unknown, before, values)
            notes.append(note)
        return values == 0.0, notes

    def _expanded(self, signal: Signal, role: str) -> NDArray[np.float64]:
        if signal.axis is self.axis and self.grid.kind == "regular":
            values = on_grid(signal.values, self.grid)
            if not _has_nan(values):
                return values
            if signal.bad is None and role != "sp" and np.count_nonzero(np.isnan(values)) < SPARSE_SHARE * len(values):
                return bridged(values, self.grid.index, self.bridge)
        limit = None
        if role not in ("sp", "mode"):
            limit = max(hold_limit(signal), (self.bridge + 1.5) * self.grid.step)
        if self.options.interpolation == "linear" and role != "mode":
            return linear(signal, self.grid, float("inf") if limit is None else limit)
        # rows stamped now early, now late are still one scan each: PV and OP of a row belong together
        late = self.grid.step // 2 if self.grid.kind == "jitter" and signal.axis is self.axis else 0
        return held(signal, self.grid, limit, self.bridge, late)


def bridged(values: NDArray[np.float64], index: NDArray[np.int64], bridge: int) -> NDArray[np.float64]:
    """Hold a few blank cells, but not across a gap. index: (samples,) grid numbers."""
    out = hold_last(values, bridge)
    if index[-1] - index[0] != len(index) - 1:
        first = np.flatnonzero(np.diff(index) > 1) + 1
        for position in first[np.isnan(values[first])]:
            known = np.flatnonzero(np.isfinite(values[position:]))
            out[position : position + known[0] if len(known) else None] = np.nan
    return out


def own_times(role: str, options: ReadOptions) -> Note:
    """Say how a signal that has stamps of its own is brought to those of the measurement."""
    how = "interpolated on straight lines" if options.interpolation == "linear" else "held until the next record"
    return Note("expanded", f"{role.upper()} is recorded at its own times; it is {how}")


def seldom_recorded(rows: int, blank: int, edges: int) -> bool:
    """Whether blank cells mean that a measurement was recorded less often. edges: where blank cells begin."""
    return 0 < blank < rows and (edges > SPARSE_SHARE * (rows - blank) or blank > 0.9 * rows)


def _has_nan(values: NDArray[np.float64]) -> bool:
    from .signal_kernel import UNKNOWN, holds

    return bool(holds(values) & UNKNOWN)


def grid_of(pv: Signal) -> tuple[Grid, Signal]:
    """The grid is that of the measurement; blank cells in many places mean that it was recorded less often."""
    from .signal_kernel import FINITE, holds

    if holds(pv.values) == FINITE:
        return pv.axis.grid(pv.values), pv
    blank = np.isnan(pv.values) if pv.bad is None else np.isnan(pv.values) & ~pv.bad
    count = int(blank.sum())
    if count and count < len(blank):
        known = pv.axis.micros != NAT
        if seldom_recorded(len(blank), count, int(np.count_nonzero(blank[1:] & ~blank[:-1] & known[1:]))):
            rows = np.flatnonzero(~blank)
            bad = None if pv.bad is None else pv.bad[rows]
            pv = replace(pv, axis=pv.axis.take(rows), values=pv.values[rows], bad=bad)
    return pv.axis.grid(pv.values), pv


def fill_limit(Ti: float | None, interval: float) -> int:
    """Longest hole in samples that is filled: half the integral time, the time constant of the estimator's own filter.

    The shortest half period it uses lasts 5 Ti, ten times that. MAX_HOLE samples when Ti is not known.
    """
    return MAX_HOLE if Ti is None else int(min(LONGEST_FILL, max(1.0, Ti / 2.0 / interval)))
