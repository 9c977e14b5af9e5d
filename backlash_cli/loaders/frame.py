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
            how = (
                "interpolated on straight lines"
                if self.options.interpolation == "linear"
                else "held until the next record"
            )
            self.notes.append(Note("expanded", f"{role.upper()} is recorded at its own times; it is {how}"))
        return self._expanded(signal, role)

    def disturbance(self, items: list[Series]) -> NDArray[np.float64] | None:
        """A further measured column in its own units; None when it holds no numbers or cannot be joined."""
        try:
            signal = self.joiner.signal(items[:1] if items[0].axis is self.axis else items, "", "")
        except LoopError:
            return None
        return self._expanded(signal, "dv") if np.isfinite(signal.values).any() else None

    def manual(self, auto_modes: tuple[str, ...]) -> NDArray[np.bool_] | None:
        """True where the controller was not in automatic; None when no mode is recorded."""
        if "mode" not in self.loop.roles:
            return None
        parts = []
        for item in self.loop.roles["mode"]:
            values, more = automatic(item.cells, auto_modes)
            self.notes += more
            parts.append((item.axis, values))
        signal = Signal(self.joiner.axis([a for a, _ in parts]), np.concatenate([v for _, v in parts]), None)
        if not np.isfinite(signal.values).any():
            self.notes.append(Note("mode_empty", "the MODE column is empty; the loop is taken to be in automatic"))
            return None
        values = self._expanded(signal, "mode")
        unknown = np.isnan(values)
        if unknown.any():
            # before the first record: a first change to manual means automatic before, and the other way round
            automatic_first = not unknown.all() and values[np.flatnonzero(~unknown)[0]] == 0.0
            values = np.where(unknown, 1.0 if automatic_first else 0.0, values)
            text = f"{int(unknown.sum())} samples before the first recorded mode are taken as "
            self.notes.append(Note("mode_unknown", text + ("automatic" if automatic_first else "not automatic")))
        return values == 0.0

    def _expanded(self, signal: Signal, role: str) -> NDArray[np.float64]:
        if signal.axis is self.axis and self.grid.kind == "regular":
            values = on_grid(signal.values, self.grid)
            if not _has_nan(values):
                return values
            if signal.bad is None and role != "sp" and np.count_nonzero(np.isnan(values)) < SPARSE_SHARE * len(values):
                return self._bridged(values)
        limit = None
        if role not in ("sp", "mode"):
            limit = max(hold_limit(signal), (self.bridge + 1.5) * self.grid.step)
        if self.options.interpolation == "linear" and role != "mode":
            return linear(signal, self.grid, float("inf") if limit is None else limit)
        # rows stamped now early, now late are still one scan each: PV and OP of a row belong together
        late = self.grid.step // 2 if self.grid.kind == "jitter" and signal.axis is self.axis else 0
        return held(signal, self.grid, limit, self.bridge, late)

    def _bridged(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Hold a few blank cells, but not across a gap."""
        out = hold_last(values, self.bridge)
        index = self.grid.index
        if index[-1] - index[0] != len(index) - 1:
            first = np.flatnonzero(np.diff(index) > 1) + 1
            for position in first[np.isnan(values[first])]:
                known = np.flatnonzero(np.isfinite(values[position:]))
                out[position : position + known[0] if len(known) else None] = np.nan
        return out


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
        edges = int(np.count_nonzero(blank[1:] & ~blank[:-1] & known[1:]))
        if edges > SPARSE_SHARE * (len(blank) - count) or count > 0.9 * len(blank):
            rows = np.flatnonzero(~blank)
            bad = None if pv.bad is None else pv.bad[rows]
            pv = replace(pv, axis=pv.axis.take(rows), values=pv.values[rows], bad=bad)
    return pv.axis.grid(pv.values), pv


def fill_limit(Ti: float | None, interval: float) -> int:
    """Longest hole in samples that is filled: half the integral time, the time constant of the estimator's own filter.

    The shortest half period it uses lasts 5 Ti, ten times that. MAX_HOLE samples when Ti is not known.
    """
    return MAX_HOLE if Ti is None else int(min(LONGEST_FILL, max(1.0, Ti / 2.0 / interval)))
