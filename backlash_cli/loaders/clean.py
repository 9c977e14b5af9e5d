"""One loop: its signals on one uniform grid, normalised, every sample with its state, everything assumed in notes.

A loop longer than CHUNK rows is made in chunks of that size: its grid and spans are those of the first one.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import Note, Record
from ..settings import LoopValues, Settings, settings_of
from .grid import Grid, GridPlan, Steps
from .join import Joiner, LoopSeries, Signal
from .options import ReadOptions
from .order import NAT
from .resample import Frame, fill_limit, grid_of
from .signals import Axis, Series
from .spans import Spans, normalised, spans_of
from .states import Counts, Samples

CHUNK = 2_000_000  # rows of a loop that are in memory at once
MARGIN = 2000  # rows around a chunk that decide on its samples: holes, limits, records that still hold


@dataclass(frozen=True)
class Recipe:
    """All that makes the record of one loop; its samples are read when it is made.

    It can be sent to another process of this machine. key: by which a finished report of the loop is known again, where
    such are kept.
    """

    loop: str
    series: LoopSeries
    values: LoopValues | None
    options: ReadOptions
    notes: tuple[Note, ...] = ()
    key: str = ""

    def record(self, joiner: Joiner | None = None) -> Record:
        """Read the loop. Raises BacklashError when it cannot be read. joiner: shared by loops of the same files."""
        settings = settings_of(self.values)
        found = build(self.series, settings, joiner or Joiner(self.options.good_quality), self.options)
        return replace(found.record, notes=(*self.notes, *found.record.notes)) if self.notes else found.record

    def records(self, joiner: Joiner | None = None) -> Callable[[], Iterator[Record]]:
        """Return what yields the record in blocks, each time it is called: one, or chunks of a long loop. Their notes
        stand in the last one. Raises BacklashError when the loop cannot be read."""
        if self.rows <= CHUNK or not all(_one_after_the_other(_in_turn(item.axis for item in items if item.count))
                                         for items in self.series.roles.values()):
            record = self.record(joiner)
            return lambda: iter((record,))
        settings = settings_of(self.values)
        refuse_missing(self.series)
        return partial(_chunks, self, settings)

    @property
    def rows(self) -> int:
        """Rows of the measurement, about the samples of its record."""
        return sum(item.count for item in self.series.roles.get("pv", ()))


@dataclass(frozen=True)
class Built:
    """The record of a loop, or of a chunk of it. plan: of its grid. output: OP holds a number somewhere.

    place: a stamp near the end of the chunk and its grid number. until: grid number of its last sample. end: stamp that
    ended it.
    """

    record: Record
    plan: GridPlan
    spans: Spans
    output: bool
    place: tuple[int, int] = (0, 0)
    until: int = 0
    end: int = NAT


def build(loop: LoopSeries, settings: Settings, joiner: Joiner, options: ReadOptions, *, before: Built | None = None,
          end: int | None = None) -> Built:
    """Make the Record of one loop. Raises LoopError when it has no measurement, no times or no usable scale.

    before: the chunk before, None for the first one. end: stamp that ends the chunk, None for the whole loop.
    """
    refuse_missing(loop)
    pv = joiner.signal(loop.roles["pv"], "pv", loop.name)
    grid, pv = grid_of(pv)
    if before is not None:
        grid = goes_on(pv, before)
    on_grid = grid.notes if end is None else _of_chunk(pv, grid, NAT if before is None else before.end, end)
    notes: list[Note] = [*settings.notes, *pv.axis.notes, *on_grid, *pv.notes]
    frame = Frame(loop, joiner, options, pv.axis, grid, fill_limit(settings.loop.Ti, grid.interval), notes)
    measured, interpolated = frame.measurement(pv)
    if not np.isfinite(measured).any() and before is None:
        raise LoopError("the measurement (PV) holds no number at all", code="no_measurement",
                        remedy="check the column and the export")
    setpoint = frame.companion("sp")
    if setpoint is None and settings.constant_setpoint is not None:
        setpoint = np.full(len(measured), settings.constant_setpoint)
    output = frame.companion("op")
    if before is not None and not before.output:
        output = None
    if output is not None and before is None and not np.isfinite(output).any():
        notes.append(Note("no_output", "the output (OP) holds no number at all"))
        output = None
    if before is None:
        spans = spans_of(settings, _finite(measured, setpoint) if settings.pv_range is None else measured[:0],
                         None if output is None else _finite(output) if settings.op_range is None else output[:0])
        notes += spans.notes
    else:
        spans = before.spans
    manual, on_mode = frame.manual((*options.auto_modes, *settings.auto_modes))
    samples = Samples(
        grid.index, None if setpoint is None else normalised(setpoint, spans.pv_range),
        normalised(measured, spans.pv_range), None if output is None else normalised(output, spans.op_range),
        interpolated, manual, frame.bridge)
    first, last, place, until = 0, len(measured), (0, 0), 0
    if end is not None:
        place, until = _end_of(pv, grid, end)
        first = 0 if before is None else int(np.searchsorted(grid.index, before.until, side="right"))
        last = int(np.searchsorted(grid.index, until, side="right"))
    counts, total = samples.count(Counts(), first, last), last - first
    missing = [] if setpoint is not None else [Note(
        "no_setpoint", "no setpoint (SP) column: what needs the control error cannot be done", {"loop": loop.name})]
    extra = {name: frame.disturbance(items) for name, items in loop.extra.items()} if end is None else {}
    record = Record(
        loop.name, grid.start / 1e6, grid.interval, grid.index, samples.setpoint, samples.measurement, samples.output,
        samples.state, spans.settings, {name: values for name, values in extra.items() if values is not None},
        (*notes, *counts.notes(total), *missing, *counts.companion_notes(total), *on_mode, *counts.manual_notes(total)),
    )  # fmt: skip
    return Built(record if end is None else record.slice(first, last), grid.plan, spans, output is not None, place,
                 until, NAT if end is None else end)


def _of_chunk(pv: Signal, grid: Grid, begin: int, end: int) -> list[Note]:
    """What is to be said of the stamps of a chunk alone."""
    stamps = pv.axis.order(pv.values).stamps
    own = stamps[max(int(np.searchsorted(stamps, begin)) - 1, 0) : int(np.searchsorted(stamps, end))]
    share = 1.0 if grid.recorded is None else float(grid.recorded.mean())
    return replace(grid.plan, steps=Steps.of(own)).notes(share) if len(own) > 1 else []


def _end_of(pv: Signal, grid: Grid, end: int) -> tuple[tuple[int, int], int]:
    """Return a stamp a margin before the end of a chunk with its grid number, and the grid number of its last sample."""
    if grid.kind != "regular":
        return (0, 0), (end - 1 - grid.start) // grid.step
    stamps = pv.axis.order(pv.values).stamps
    at = grid.index if grid.rows is None else grid.index[grid.rows >= 0]
    stamps = stamps[-len(at) :]
    last = int(np.searchsorted(stamps, end)) - 1
    near = max(last - MARGIN, 0)
    return (int(stamps[near]), int(at[near])), int(at[last])


def _finite(*parts: NDArray[np.float64] | None) -> NDArray[np.float64]:
    return np.concatenate([part[np.isfinite(part)] for part in parts if part is not None])


def goes_on(pv: Signal, before: Built) -> Grid:
    """Return the points of the grid of an earlier chunk that lie among the stamps of a later one."""
    plan, order = before.plan, pv.axis.order(pv.values)
    stamps = order.stamps
    if plan.kind == "regular":
        begin = int(np.searchsorted(stamps, before.place[0], side="right"))
        index, places = plan.rows(stamps[begin:], before.place)
        own = np.arange(begin, len(stamps)) if order.rows is None else order.rows[begin:]
        return Grid(plan, index, np.where(places >= 0, own[places], -1))
    index = plan.points(stamps)
    return Grid(plan, index, order.rows, stamps, plan.recorded(stamps, plan.start + plan.step * index))


def _chunks(recipe: Recipe, settings: Settings) -> Iterator[Record]:
    """Yield the chunks of a loop; what is said of each is put together in the notes of the last one."""
    before: Built | None = None
    said: list[Note] = list(recipe.notes)
    axes = _in_turn(item.axis for item in recipe.series.roles["pv"])
    begins = [int(axis.read(row, row + 1)[0]) for axis in axes for row in range(0, len(axis), CHUNK)]
    ends = [*begins[1:], (axes[-1].last() or 0) + 1]
    for begin, end in zip(begins, ends, strict=True):
        built = build(_window(recipe.series, begin, end), settings, Joiner(recipe.options.good_quality), recipe.options,
                      before=before, end=end)
        said += built.record.notes
        yield replace(built.record, notes=tuple(summed(said)) if end == ends[-1] else ())
        before = built if before is None else replace(built, plan=before.plan, output=before.output)


def _in_turn(axes: Iterable[Axis]) -> list[Axis]:
    """Each axis once, by its first stamp."""
    return sorted({id(axis): axis for axis in axes}.values(), key=lambda axis: int(axis.read(0, 1)[0]))


def _one_after_the_other(axes: list[Axis]) -> bool:
    """Say whether all stamps rise from row to row and from file to file, and none is unreadable."""
    last = NAT
    for axis in axes:
        for piece in axis.pieces():
            if piece[0] <= last or np.any(np.diff(piece) <= 0):
                return False
            last = int(piece[-1])
    return True


def _window(loop: LoopSeries, begin: int, end: int) -> LoopSeries:
    """The rows of a loop that tell of the samples between two stamps, with a margin on both sides."""
    parts: dict[int, tuple[Axis, slice]] = {}

    def some(item: Series) -> Series:
        axis = item.axis
        if id(axis) not in parts:
            rows = slice(max(_row_at(axis, begin) - MARGIN, 0), min(_row_at(axis, end) + MARGIN, len(axis)))
            parts[id(axis)] = axis.part(rows), rows
        own, rows = parts[id(axis)]
        return item.part(own, rows)

    roles = {role: [some(item) for item in items] for role, items in loop.roles.items()}
    roles = {role: [item for item in items if item.count] or items[:1] for role, items in roles.items()}
    return LoopSeries(loop.name, roles, {}, loop.missing_tags)


def _row_at(axis: Axis, stamp: int) -> int:
    """The first row of rising stamps at or after one."""
    low, high = 0, len(axis)
    while low < high:
        middle = (low + high) // 2
        if int(axis.read(middle, middle + 1)[0]) < stamp:
            low = middle + 1
        else:
            high = middle
    return low


_COUNT = re.compile(r"^\d+(?= )|(?<= of )\d+(?= samples)")


def summed(notes: list[Note]) -> list[Note]:
    """Put together what was said of the chunks of a loop: counts of samples, rows and gaps are added."""
    groups: dict[tuple[str, str], list[Note]] = {}
    for note in notes:
        groups.setdefault((note.code, _COUNT.sub("", note.message) if "longest_s" not in note.values else ""),
                          []).append(note)
    out = []
    for same in groups.values():
        note = max(same, key=lambda one: float(one.values.get("longest_s", 0.0)))
        if len(same) > 1 and _COUNT.match(note.message):
            added = {name: sum(float(one.values.get(name, 0.0)) for one in same)
                     for name in ("samples", "rows", "gaps") if name in note.values}
            numbers = [[int(text) for text in _COUNT.findall(one.message)] for one in same]
            totals = iter([sum(column) for column in zip(*numbers, strict=False)])
            message = _COUNT.sub(lambda found: str(next(totals)), note.message)  # noqa: B023
            note = Note(note.code, message, {**note.values, **added})
        out.append(note)
    return out


def refuse_missing(loop: LoopSeries) -> None:
    """Raise LoopError for a loop without a measurement, or without a tag that the loops file names."""
    for role, tag in loop.missing_tags.items():
        if role not in loop.roles:
            raise LoopError(f"{role} = {tag!r} from the metadata is not found in the data", code="tag_not_found",
                            remedy=f"write the tag as it stands in the file, or leave {role} out")
    if "pv" not in loop.roles:
        there = ", ".join(role.upper() for role in loop.roles)
        raise LoopError(f"no measurement (PV) column; there is {there} only", code="no_measurement",
                        remedy=f'name the column {loop.name[:40]}.PV, or give pv = "TAG" in loops.toml')
