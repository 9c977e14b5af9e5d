"""One loop: its signals on one uniform grid, normalised, every sample with its state, everything assumed in notes."""

import contextlib
from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Self

import numpy as np

from ..errors import LoopError, some
from ..record import NAT, BoolArray, FloatArray, Frozen, IntArray, LoopSettings, Note, Record, fingerprint, utc_text
from ..samples import MAX_HOLE, STRANGE, held, is_copy, judged, linear, state_notes
from ..settings import LoopValues, settings_of
from ..settings.spans import normalised, spans_of
from .grid import GAP_FACTOR, LIKELY, SECOND, SPARSE_SHARE, Grid, Ordered, Times, make_grid
from .names import explained, noted, span_of
from .options import ReadOptions
from .signals import Axis, Faults, Joiner, LoopSeries, Series, Signal, add_faults, agreed, one_per_file
from .states import automatic

CHUNK, MARGIN = 2_000_000, 2000  # rows in memory at once; around them, that tell of holes, limits, what still holds
LONGEST_FILL = 60  # samples, however slow the controller


class Recipe(Frozen):
    """All that makes the record of one loop, when its turn comes, also in another process. key: of its kept report."""

    loop: str
    series: LoopSeries
    values: LoopValues | None
    options: ReadOptions
    notes: tuple[Note, ...] = ()
    key: str = ""

    def record(self, joiner: Joiner | None = None) -> Record:
        """Read the loop. Raises BacklashError when it cannot be read. joiner: shared by loops of the same files."""
        return _Making(self, joiner or Joiner(self.options.good_quality)).record(self.series)

    def is_long(self) -> bool:
        """Say whether the record is better made in chunks: it is long, and all its stamps rise."""
        return self.rows > CHUNK and all(_one_after_the_other(_in_turn(items)) for items in self.series.roles.values())

    def chunks(self) -> Iterator[Record]:
        """Yield the record of a long loop in chunks; the notes of the last are those of the whole."""
        joiner, axes = Joiner(self.options.good_quality), _in_turn(self.series.roles["pv"])
        pieces = [(axis, row) for axis in axes for row in range(0, len(axis), CHUNK)]
        rows = np.cumsum([0, *(min(CHUNK, len(axis) - row) for axis, row in pieces[:-1])])
        turns = zip(pieces, np.diff(rows // CHUNK, prepend=-1), strict=True)
        begins = [int(axis.read(row, row + 1)[0]) for (axis, row), more in turns if more]
        ends = [*begins[1:], axes[-1].last() + 1]
        # a look at some places all over: the first chunk alone does not tell ranges, codes, and what is recorded
        count, share = max(1, 16 // len(axes)), CHUNK // 6 / self.rows
        places = [self.series.changed(lambda axis, k=k: axis.part(slice(  # type: ignore[misc]
            first := len(axis) * (2 * k + 1) // (2 * count), first + 1 + int(len(axis) * share / count)))).roles
            for k in range(count)]
        look, joiner.only = _Making(self, joiner), (NAT, ends[-1])
        with contextlib.suppress(LoopError):
            look.record(replace(self.series, extra={}, roles={
                role: [item for roles in places for item in roles.get(role, ())] for role in self.series.roles}))
        making = _Making(self, joiner, spans=look.spans, recorded=look.recorded)
        for begin, end in zip(begins, ends, strict=True):
            record = making.record(_window(self.series, begin, end), begin, end)
            yield record if end == ends[-1] else replace(record, notes=())

    def keyed(self, marks: Mapping[str, str], common: tuple[object, ...]) -> Self:
        """Return it with its key, if all files have marks: they change with the content. common: what else matters."""
        parts = [(role, item.tag, item.loop, item.signal, item.axis.where, marks.get(item.axis.where))
                 for role, items in sorted(self.series.roles.items()) for item in items]
        if not all(part[-1] for part in parts):
            return self
        # which loops are wanted is not how they are read
        how = replace(self.options, only_loops=(), loops_matching=(), sample=None, sample_seed=0, since=None)
        values = self.values and (dict(self.values.values), self.values.where, sorted(self.values.from_defaults))
        whole = repr((common, how, self.loop, values, [(note.code, note.message) for note in self.notes],
                      sorted(self.series.missing_tags.items()), parts))
        return replace(self, key=fingerprint(whole))

    @property
    def rows(self) -> int:
        """Rows of the measurement, about the samples of its record."""
        return sum(len(item.axis) for item in self.series.roles.get("pv", ()))


@dataclass
class _Making:
    """Makes the record of a loop, or chunk after chunk of it, on the grid of the first one and with the same spans.
    recorded: setpoint and output, where there is some. known, until: stamps of the last chunk with their grid numbers,
    and the number of its last sample. carried: what still holds. times, order: of PV. bridge: longest hole to fill."""

    recipe: Recipe
    joiner: Joiner
    grid: Grid | None = None
    spans: tuple[LoopSettings, list[Note]] | None = None
    recorded: set[str] = field(default_factory=set)
    known: tuple[IntArray, IntArray] = (np.zeros(1, np.int64), np.zeros(1, np.int64))
    until: int = -1
    counts: Counter[str] = field(default_factory=Counter)
    tally: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    faults: Faults = field(default_factory=dict)
    carried: dict[str, float] = field(default_factory=dict)
    times: Times | None = None
    order: Ordered = field(default_factory=lambda: Ordered(np.zeros(0, np.int64), None))
    bridge: int = 0
    notes: list[Note] = field(default_factory=list)

    def record(self, loop: LoopSeries, begin: int = NAT, end: int | None = None) -> Record:
        """Make the record of a loop, or of its chunk between two stamps from rows around it. Raises LoopError."""
        for role, tag in loop.missing_tags.items():
            raise LoopError(**explained("tag_not_found", role=role, tag=tag))
        tags = Counter(tag for role in ("sp", "pv", "op") for tag in {item.tag for item in loop.roles.get(role, ())})
        if tags.total() > len(tags):
            raise LoopError(**explained("same_tag", tag=tags.most_common(1)[0][0]))
        more = f" (further columns: {some([*loop.extra])})" if loop.extra else ""
        if "pv" not in loop.roles:
            raise LoopError(**explained("no_pv", there=", ".join(loop.roles).upper(), more=more, loop=loop.name[:40]))
        settings = settings_of(self.recipe.values)
        if end is not None:
            self.joiner.only = begin, end
            self.joiner.times.cache_clear()
        pv = _where_recorded(self.joiner.signal(loop.roles["pv"], "pv"))
        self.order = pv.times.order(pv.values)
        if self.grid is None:
            grid = make_grid(self.order)
        else:
            row = min(int(np.searchsorted(self.known[0], self.order.stamps[0])), len(self.known[1]) - 1)
            grid = self.grid.laid(self.order, int(self.known[1][row]))
        self.grid = self.grid or replace(grid, index=grid.index[:0], rows=None, recorded=None)
        first, last, on_grid = (0, len(grid.index), grid.notes) if end is None else self._own_samples(grid, begin, end)
        self.times, Ti = pv.times, settings.loop.Ti
        # half of Ti is a tenth of the shortest half period that is used
        self.bridge = MAX_HOLE if Ti is None else int(min(LONGEST_FILL, max(1.0, Ti / 2.0 / grid.step * SECOND)))
        told = [*pv.notes, *add_faults(self.faults, pv.faults)]
        odd = [stamp for stamp in (grid.start, int(self.order.stamps[-1])) if stamp not in LIKELY]
        if odd and not any(note.code == "relative_time" for note in pv.times.notes):
            told.append(noted("unlikely_dates", stamp=utc_text(odd[0])))
        self.notes = [*self.recipe.notes, *settings.notes, *pv.times.notes, *on_grid, *told]
        measured = self._on_grid(pv, "pv", grid)
        if self.spans is None and not np.isfinite(measured).any():
            why = "".join(f"; {note.message}" for note in told)
            raise LoopError(**explained("no_good_pv" if "quality" in why else "no_pv_number", why=why))
        setpoint, output = self._companion(loop, "sp", grid), self._companion(loop, "op", grid)
        if setpoint is None and settings.constant_setpoint is not None:
            setpoint = np.full(len(measured), settings.constant_setpoint)
        by_unit = {f"{role}_range": span_of(items[0].tag, role) for role, items in loop.roles.items()}
        self.spans = self.spans or spans_of(settings, [measured] if setpoint is None else [measured, setpoint],
                                            [] if output is None else [output], by_unit)
        scaled, guessed = self.spans
        self.notes += guessed
        manual, on_mode = self._manual(loop, (*self.recipe.options.auto_modes, *settings.auto_modes), grid)
        sp, op = (None if values is None else normalised(values, span)
                  for values, span in ((setpoint, scaled.pv_range), (output, scaled.op_range)))
        between = None if grid.recorded is None else ~grid.recorded & np.isfinite(measured)
        y = normalised(measured, scaled.pv_range)
        y, state, marks = judged(grid.index, sp, y, op, between, manual, self.bridge,
                                 None if output is None else (output == measured) | is_copy(output, measured))
        self.counts.update(samples=last - first, **{k: int(np.count_nonzero(x[first:last])) for k, x in marks.items()})
        missing = [noted(blank if role in loop.roles else absent, {"loop": loop.name}, more=more)
                   for role, values, absent, blank in (("sp", sp, "no_setpoint", "no_setpoint:blank"), (
                       "op", op, "no_output", "no_output:blank")) if values is None]
        said = [state_notes(self.counts, *kinds) for kinds in (("wild", "filled", "frozen", "saturated", "missing"),
            ("repeated", *STRANGE, "beyond", "setpoint", "output"), ("manual",))]
        extra = {name: own for name, items in loop.extra.items() if (own := self._disturbance(items, grid)) is not None}
        sp = np.full(len(y), np.nan) if sp is None else sp
        record = Record(loop.name, grid.start / SECOND, grid.step / SECOND, grid.index, sp, y, op, state, scaled, extra,
                        (*self.notes, *said[0], *missing, *said[1], *on_mode, *said[2]))
        return record if end is None else record.slice(first, last)

    def _own_samples(self, grid: Grid, begin: int, end: int) -> tuple[int, int, list[Note]]:
        """The first sample of a chunk, the one after its last, and what is to be said of all stamps so far."""
        stamps, first = self.order.stamps, int(np.searchsorted(grid.index, self.until, side="right"))
        self.until = (end - 1 - grid.start) // grid.step
        if grid.kind == "regular":
            self.known = stamps, grid.index if grid.rows is None else grid.index[grid.rows >= 0]
            self.until = int(self.known[1][np.searchsorted(stamps, end) - 1])
        last, begun = int(np.searchsorted(grid.index, self.until, side="right")), int(np.searchsorted(stamps, begin))
        own = stamps[max(begun - 1, 0) : int(np.searchsorted(stamps, end))]
        return first, last, grid.said(own, None if grid.recorded is None else grid.recorded[first:last], self.tally)

    def _companion(self, loop: LoopSeries, role: str, grid: Grid) -> FloatArray | None:
        """Setpoint or output, held between its records unless the user says linear; None when not recorded."""
        if role not in loop.roles:
            return None
        signal = self.joiner.signal(loop.roles[role], role)
        self.notes += [*signal.notes, *add_faults(self.faults, signal.faults)]
        if self.times and signal.times is not self.times and np.array_equal(signal.times.micros, self.times.micros):
            signal = replace(signal, times=self.times)  # rows of two files
        if signal.times is not self.times:
            self.notes.append(noted(f"expanded:{self.recipe.options.interpolation or 'hold'}", role=role.upper()))
            own, stamps = signal.times.micros[np.isfinite(signal.values)], self.order.stamps
            begun = np.max(own[own <= stamps[0]], initial=NAT)  # what holds when PV begins
            outside = float(np.mean((own < begun) | (own > stamps[-1]))) if len(own) else 0.0
            if outside > 0.02 and self.joiner.only is None:
                self.notes.append(noted("outside_pv", percent=100 * outside, role=role.upper()))
        values = self._carried_on(signal, role, grid)
        if not self.counts and np.isfinite(values).any():  # in the look, or in the first chunk
            self.recorded.add(role)
        return values if role in self.recorded else None

    def _disturbance(self, items: list[Series], grid: Grid) -> FloatArray | None:
        """A further measured column in its own units; None when it holds no numbers or cannot be joined."""
        with contextlib.suppress(LoopError):
            signal = self.joiner.signal([*{item.axis: item for item in reversed(items)}.values()])
            if np.isfinite(signal.values).any():
                return self._on_grid(signal, "dv", grid)
        return None

    def _manual(self, loop: LoopSeries, auto_modes: tuple[str, ...], grid: Grid) -> tuple[BoolArray | None, list[Note]]:
        """True where the controller was not in automatic, None when no mode is recorded; and what is to be said."""
        items, notes = one_per_file(loop.roles.get("mode", []), "mode")
        if not items:
            return None, []
        found = [automatic(item.cells(), auto_modes, item.tag) for item in items]
        notes += [note for _, more in found for note in more]
        times = self.joiner.times(*(item.axis for item in items))
        states = np.concatenate([auto for auto, _ in found])
        signal = agreed(Signal(times, states, np.zeros(len(states), bool)), items[0].tag)
        if not np.isfinite(signal.values).any() and "mode" not in self.carried:
            return None, [*notes, noted("mode_empty")]
        if (unknown := np.isnan(values := self._carried_on(signal, "mode", grid))).any():
            before = not unknown.all() and float(values[~unknown][0]) == 0.0  # a change to manual: automatic
            values = np.where(unknown, before, values)
            notes.append(noted("mode_unknown", count=unknown.sum(), how="automatic" if before else "not automatic"))
        return values == 0.0, notes

    def _carried_on(self, signal: Signal, role: str, grid: Grid) -> FloatArray:
        """The values of a signal; a setpoint or mode of the chunk before holds until the first one that is known."""
        values = self._on_grid(signal, role, grid)
        known = np.isfinite(values)
        if role in self.carried and not known.all():
            first = int(np.argmax(known)) if known.any() else len(values)
            values = np.concatenate([np.full(first, self.carried[role]), values[first:]])
        if role != "op" and known.any():
            self.carried[role] = float(values[~np.argmax(known[::-1])])
        return values

    def _on_grid(self, signal: Signal, role: str, grid: Grid) -> FloatArray:
        """(samples,) A signal as it was recorded, nan where it was not: in its rows, on straight lines, or held."""
        own = signal.times is self.times
        if own and grid.recorded is None:
            found = signal.values if grid.rows is None else np.where(grid.rows >= 0, signal.values[grid.rows], np.nan)
            if role == "pv" or not np.isnan(found).any():
                return found
        order = self.order if own else signal.times.order(signal.values)
        rows = slice(None) if order.rows is None else order.rows
        record = np.isfinite(signal.values[rows]) | signal.bad[rows]  # blank cells are no records
        stamps, values = order.stamps[record], signal.values[rows][record]
        few, limit, points = (self.bridge + 0.5) * grid.step, float("inf"), grid.start + grid.step * grid.index
        steps = np.diff(stamps[np.isfinite(values)])
        if role == "pv":
            limit = (MAX_HOLE + 1.5) * grid.step
            if grid.kind == "compressed" and len(steps):  # 99 % of the records keep this spacing
                limit = max(limit, GAP_FACTOR * float(np.quantile(steps, 0.99)))
        elif role not in ("sp", "mode") and len(steps):
            middle, usual = np.quantile(steps, [0.5, 0.95]).tolist()  # on change: it holds; else silence is a loss
            limit = max(GAP_FACTOR * usual if usual <= 3.0 * middle else float(steps.max()), few + grid.step)
        if role != "mode" and (self.recipe.options.interpolation or ("hold", "linear")[role == "pv"]) == "linear":
            return linear(points, stamps, values, limit, few)
        # rows stamped now early, now late are still one scan each: PV and OP of a row belong together
        late = grid.step // 2 if grid.kind == "jitter" and own and role != "pv" else 0
        return held(points + late, stamps, values, limit, few)


def _where_recorded(pv: Signal) -> Signal:
    """The rows of the measurement: blank cells in many places mean that it was recorded less often."""
    blank = np.isnan(pv.values) & ~pv.bad
    count = int(np.count_nonzero(blank))
    if 0 < count < len(blank) and (count > 0.9 * len(blank) or np.count_nonzero(
            blank[1:] & ~blank[:-1] & (pv.times.micros[1:] != NAT)) > SPARSE_SHARE * (len(blank) - count)):
        at = np.flatnonzero(~blank)
        return replace(pv, times=Times(pv.times.micros[at], pv.times.notes), values=pv.values[at], bad=pv.bad[at])
    return pv


def _in_turn(items: Iterable[Series]) -> list[Axis]:
    return sorted({item.axis for item in items if len(item.axis)}, key=attrgetter("first"))


def _one_after_the_other(axes: list[Axis]) -> bool:
    """Say whether all stamps rise from row to row and from file to file, and none is unreadable."""
    last = -(1 << 62)
    for piece in (piece for axis in axes for piece in axis.pieces()):
        if np.any(np.diff(piece, prepend=last) <= 0):
            return False
        last = int(piece[-1])
    return True


def _window(loop: LoopSeries, begin: int, end: int) -> LoopSeries:
    """The rows of a loop that tell of the samples between two stamps, with a margin on both sides."""
    near = set[Axis]()
    for items in loop.roles.values():
        axes = _in_turn(items)
        first, last = (bisect_left(axes, stamp, key=attrgetter("first")) for stamp in (begin, end))
        near |= {*axes[max(first - 2, 0) : last + 1]}

    def part(axis: Axis) -> Axis:
        first, last = (bisect_left(range(len(axis)), stamp, key=lambda row: int(axis.read(row, row + 1)[0]))
                       for stamp in (begin, end)) if axis in near else (len(axis) + MARGIN, 0)
        return axis.part(slice(max(first - MARGIN, 0), min(last + MARGIN, len(axis))))

    cut = replace(loop, extra={}).changed(part)
    nothing = {role: [replace(items[0], axis=items[0].axis.part(slice(0, 0)))] for role, items in loop.roles.items()}
    return replace(cut, roles=nothing | cut.roles)
