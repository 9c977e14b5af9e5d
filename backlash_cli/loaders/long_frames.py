"""The signals of one long loop on the grid of its measurement, piece by piece: what `Frame` does with them whole."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..record import Note
from . import pieces as flow
from .expand import held, linear, longest_hold
from .frame import bridged, fill_limit, own_times, seldom_recorded
from .grid import Grid
from .grid_plan import GAP_FACTOR, MAX_GROWTH, MAX_HOLE, SPARSE_SHARE, GridPlan, plan_grid
from .join import LoopSeries
from .long_facts import Facts, OutOfOrder, SeldomSignal, absent_rows, steps_in_order
from .loop_settings import Settings
from .options import ReadOptions
from .pieces import MARGIN, Piece, cut, in_step, with_margins
from .signal_pieces import PieceSignal, measured_signal, mode_signal
from .sorted_rows import arranged
from .states import hold_last
from .windows import Expand, Window

# values of the rows as they are, with small holes bridged, held till the next one; or from records around
DIRECT, BRIDGED, HELD, OWN = "direct", "bridged", "held", "own"


@dataclass(frozen=True)
class Companion:
    """A signal beside the measurement. how: one of the four; expand, ahead, late: as for a Window, if OWN."""

    signal: PieceSignal
    how: str
    expand: Expand | None = None
    ahead: bool = False
    late: int = 0

    def window(self) -> Window:
        assert self.expand is not None
        return Window(self.signal, self.expand, ahead=self.ahead, late=self.late)


@dataclass(frozen=True)
class LongFrames:
    """The signals of a loop on one grid. bridge: longest hole in samples that is filled. notes: by role.

    mode_known: a mode is recorded somewhere. on_order: what is to be said of how stamps were brought into order.
    """

    pv: PieceSignal
    own: Companion | None  # how the measurement is brought to a grid that is not its own
    plan: GridPlan
    companions: dict[str, Companion]
    bridge: int
    notes: dict[str, tuple[Note, ...]]
    mode_known: bool = True
    on_order: tuple[Note, ...] = ()

    def only(self, roles: Collection[str]) -> LongFrames:
        """Return the same with some of the companions."""
        return replace(self, companions={role: one for role, one in self.companions.items() if role in roles})

    def pieces(self) -> Iterator[Piece]:
        """Yield the samples in time order, about PIECE at a time.

        Each has "index" and the signals by role, as recorded, nan where there is nothing; and "recorded", where a row
        stands at the grid point, if the grid is not that of the stamps.
        """
        pieces = self._regular() if self.own is None else self._between()
        roles = [role for role, one in self.companions.items() if one.how == BRIDGED]
        return self._bridged(pieces, roles) if roles else pieces

    def _bridged(self, pieces: Iterator[Piece], roles: list[str]) -> Iterator[Piece]:
        for piece, first, last in with_margins(pieces, MARGIN):
            more = {role: bridged(piece[role], piece["index"], self.bridge) for role in roles}
            yield cut(piece | more, first, last)

    def _regular(self) -> Iterator[Piece]:
        beside = [role for role, one in self.companions.items() if one.how != OWN]
        windows = {role: one.window() for role, one in self.companions.items() if one.how == OWN}
        stamps_and_pv = self.pv.rows() if not beside else in_step(
            [self.pv.stamps(), self.pv.values(), *(self.companions[role].signal.values() for role in beside)])
        last = {role: np.full(1, np.nan) for role in beside if self.companions[role].how == HELD}
        before: tuple[int, int] | None = None
        for stamps, *columns in stamps_and_pv:
            index, rows = self.plan.rows(stamps, before)
            before = int(stamps[-1]), int(index[-1])
            if len(rows) > len(stamps):
                columns = [np.where(rows >= 0, values[rows], np.nan) for values in columns]
            values = dict(zip(["pv", *beside], columns, strict=True))
            for role, held_on in last.items():
                values[role] = hold_last(np.concatenate([held_on, values[role]]))[1:]
                last[role] = values[role][-1:]
            grid = Grid(self.plan.start, self.plan.step, index, self.plan.kind)
            yield {"index": index, **values, **{role: window.at(grid) for role, window in windows.items()}}

    def _between(self) -> Iterator[Piece]:
        assert self.own is not None
        windows = {role: one.window() for role, one in {"pv": self.own, **self.companions}.items()}
        steps = self.plan.steps
        growth = (steps.last - steps.first) / self.plan.step / max(steps.total, 1)
        size = int(flow.PIECE / min(max(growth, 1.0), MAX_GROWTH))
        coming = in_step([self.pv.stamps()], size)
        earlier = np.zeros(0, np.int64)
        following = next(coming, None)
        while following is not None:
            (stamps,), following = following, next(coming, None)
            index = self.plan.points(stamps, int(earlier[-1]) if len(earlier) else None)
            around = np.concatenate([earlier, stamps, *([] if following is None else [following[0][:1]])])
            earlier = stamps[-1:]
            if not len(index):
                continue
            grid = Grid(self.plan.start, self.plan.step, index, self.plan.kind)
            values = {role: window.at(grid) for role, window in windows.items()}
            yield {"index": index, **values, "recorded": self.plan.recorded(around, grid.times)}


def long_frames(loop: LoopSeries, settings: Settings, options: ReadOptions) -> LongFrames:
    """Lay out a loop. Raises NotInPieces where it must be seen as a whole, LoopError where it has no grid."""
    signals: dict[str, PieceSignal] = {}
    for role in ("pv", "sp", "op"):
        if role in loop.roles:
            signals[role] = measured_signal(loop.roles[role], options.good_quality)
    mode_known = False
    if "mode" in loop.roles:
        signals["mode"] = mode_signal(loop.roles["mode"], (*options.auto_modes, *settings.auto_modes))
        mode_known = any(np.isfinite(values).any() for values in signals["mode"].values())
    facts = Facts(signals["pv"])
    seldom = seldom_recorded(facts.rows, facts.blank, facts.edges)
    try:
        frames = _laid_out(signals, facts, settings, options, seldom=seldom)
    except OutOfOrder:
        if seldom:
            raise
        signals, said = arranged(signals)
        facts = Facts(signals["pv"])
        frames = replace(_laid_out(signals, facts, settings, options, seldom=False, rising=True), on_order=said)
    return replace(frames, mode_known=mode_known)


def _laid_out(
    signals: dict[str, PieceSignal], facts: Facts, settings: Settings, options: ReadOptions, *, seldom: bool,
    rising: bool = False,
) -> LongFrames:
    """Lay out signals. seldom: the measurement has rows of its own. rising: the stamps do for sure."""
    pv = signals["pv"]
    rows = facts.rows
    if seldom:
        pv = SeldomSignal(pv.axes, pv.values, pv.notes, apart=True)
        rows -= facts.blank
    plan = plan_grid(steps_in_order(pv, rows, rising))
    bridge = fill_limit(settings.loop.Ti, plan.step / 1e6)
    own = None
    if plan.kind != "regular":
        limit = (MAX_HOLE + 1.5) * plan.step
        around = Facts(pv, steps=True)
        if plan.kind == "compressed" and around.good is not None:
            limit = max(limit, GAP_FACTOR * around.good.quantile(0.99))
        hold = options.interpolation == "hold"
        own = Companion(pv, OWN, _expand(not hold, limit, bridge, 0, around, plan.step), ahead=not hold)
    notes: dict[str, tuple[Note, ...]] = {"pv": pv.notes}
    companions: dict[str, Companion] = {}
    for role in ("sp", "op", "mode"):
        if role not in signals:
            continue
        signal = signals[role]
        same = signal.beside(pv)
        notes[role] = (*signal.notes, *(() if same or role == "mode" else (own_times(role, options),)))
        companions[role] = _companion(role, signal, same, plan, bridge, options, rising)
    return LongFrames(pv, own, plan, companions, bridge, notes)


def _companion(
    role: str, signal: PieceSignal, same: bool, plan: GridPlan, bridge: int, options: ReadOptions, rising: bool
) -> Companion:
    if same and plan.kind == "regular":
        facts = Facts(signal)
        plain = not facts.bad and not signal.spoilt
        absent = absent_rows(plan.steps, plan.step)
        empty = facts.blank + facts.bad + absent
        if not empty:
            return Companion(signal, DIRECT)
        if plain and role != "sp" and empty < SPARSE_SHARE * (facts.rows + absent):
            return Companion(signal, BRIDGED)
        if plain and role != "op" and options.interpolation != "linear" and not np.any(
                plan.steps.values % plan.step):
            return Companion(signal, HELD)  # every record stands at a grid point
    around = Facts(signal, steps=True)
    if not same and around.rows > 1:
        steps_in_order(signal, around.rows, rising)
    limit = None if role in ("sp", "mode") else max(longest_hold(around.good), (bridge + 1.5) * plan.step)
    straight = options.interpolation == "linear" and role != "mode"
    late = plan.step // 2 if plan.kind == "jitter" and same and not straight else 0
    return Companion(signal, OWN, _expand(straight, limit, bridge, late, around, plan.step), straight, late)


def _expand(
    straight: bool, limit: float | None, bridge: int, late: int, around: Facts, step: int
) -> Expand:
    if straight:
        return partial(linear, limit=float("inf") if limit is None else limit)
    spacing = float(step) if around.records is None else around.records.median
    return partial(held, limit=limit, bridge=bridge, late=late, spacing=spacing)
