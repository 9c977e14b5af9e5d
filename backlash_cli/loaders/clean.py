"""One loop: its signals on one uniform grid, normalised, every sample with its state, everything assumed in notes.

A loop longer than CHUNK rows is made in chunks of that size: its grid and spans are those of the first one.
"""

from __future__ import annotations

import hashlib
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import LoopError
from ..record import FloatArray, LoopSettings, Note, Record
from ..settings import LoopValues, Settings, settings_of
from .grid import Grid, GridPlan, Steps
from .join import Joiner, LoopSeries, Signal
from .options import ReadOptions
from .order import NAT
from .resample import Frame, fill_limit, grid_of
from .signals import Axis, Series
from .states import MEASURED, Samples, state_notes

CHUNK = 2_000_000  # rows of a loop that are in memory at once
SLACK = 0.05  # of a span: noise around the end of a range
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
        record = build(self.series, settings, joiner or Joiner(self.options.good_quality), self.options, Going())
        return replace(record, notes=(*self.notes, *record.notes)) if self.notes else record

    def is_long(self) -> bool:
        """Say whether the record is better made in chunks: it is long, and all its stamps rise."""
        return self.rows > CHUNK and all(_one_after_the_other(_in_turn(item.axis for item in items if item.count))
                                         for items in self.series.roles.values())

    def chunks(self) -> Iterator[Record]:
        """Yield the record in chunks; the notes of the last one are those of the whole.

        Raises BacklashError when the loop cannot be read.
        """
        settings, going = settings_of(self.values), Going()
        refuse_missing(self.series)
        joiner = Joiner(self.options.good_quality)
        axes = _in_turn(item.axis for item in self.series.roles["pv"])
        begins = [int(axis.read(row, row + 1)[0]) for axis in axes for row in range(0, len(axis), CHUNK)]
        ends = [*begins[1:], (axes[-1].last() or 0) + 1]
        for begin, end in zip(begins, ends, strict=True):
            going.end = end
            joiner.next_chunk(begin, end)
            record = build(_window(self.series, begin, end), settings, joiner, self.options, going)
            yield replace(record, notes=(*self.notes, *record.notes) if end == ends[-1] else ())

    def keyed(self, marks: Mapping[str, str], common: tuple[object, ...]) -> Recipe:
        """Return the recipe with its key; without one where a file cannot be known again.

        marks: what changes when the content of a file does, by its name. common: what else a report depends on.
        """
        items = [(role, item) for role, items in sorted(self.series.roles.items()) for item in items]
        if not all(marks.get(item.where) for _, item in items):
            return self
        parts = [(role, i.tag, i.loop, i.signal, i.where, marks[i.where]) for role, i in items]
        # which loops are wanted is not how they are read
        how = replace(self.options, only_loops=(), loops_matching=(), sample=None, sample_seed=0, since=None)
        values = self.values
        settings = None if values is None else (dict(values.values), values.where, sorted(values.from_defaults))
        whole = repr((common, how, self.loop, settings, [(note.code, note.message) for note in self.notes],
                      sorted(self.series.missing_tags.items()), parts))
        return replace(self, key=hashlib.sha256(whole.encode("utf-8", "backslashreplace")).hexdigest()[:32])

    def packed(self) -> Recipe:
        """Return the recipe with its samples, to be sent to another machine; columns of Parquet files are read there.
        """
        return replace(self, series=self.series.packed())

    @property
    def rows(self) -> int:
        """Rows of the measurement, about the samples of its record."""
        return sum(item.count for item in self.series.roles.get("pv", ()))


@dataclass(frozen=True)
class Spans:
    """pv_range, op_range: values that map to 0 and 1. settings: with gains on normalised signals. notes: guesses."""

    pv_range: tuple[float, float]
    op_range: tuple[float, float]
    settings: LoopSettings
    notes: tuple[Note, ...]


@dataclass
class Going:
    """What a chunk of a loop goes on from, and adds to. end: stamp that ends it, None for the whole loop; begin: that
    ended the one before.

    plan, spans, output: of the first chunk. place: a stamp near the end of the last one and its grid number. until: the
    grid number of its last sample. The rest is counted for the notes. carried: setpoint and mode that still hold.
    """

    end: int | None = None
    begin: int = NAT
    plan: GridPlan | None = None
    spans: Spans | None = None
    output: bool = False
    place: tuple[int, int] = (0, 0)
    until: int = -1
    counts: Counter[str] = field(default_factory=Counter)
    samples: int = 0
    recorded: int = 0
    steps: list[Steps] = field(default_factory=list)
    carried: dict[str, float] = field(default_factory=dict)


def build(loop: LoopSeries, settings: Settings, joiner: Joiner, options: ReadOptions, going: Going) -> Record:
    """Make the Record of one loop, or a chunk of it, which goes on from the chunk before; the notes are those of all
    chunks so far. Raises LoopError when it has no measurement, no times or no usable scale."""
    refuse_missing(loop)
    later, whole = going.plan is not None, going.end is None
    pv = joiner.signal(loop.roles["pv"], "pv", loop.name)
    grid, pv = grid_of(pv, None if not later else lambda signal: goes_on(signal, going))
    first, last = (0, len(grid.index)) if going.end is None else _own_samples(pv, grid, going, going.end)
    on_grid = grid.notes if going.end is None else _of_chunks(pv, grid, going, going.end, first, last)
    notes: list[Note] = [*settings.notes, *pv.axis.notes, *on_grid, *pv.notes]
    frame = Frame(loop, joiner, options, pv.axis, grid, fill_limit(settings.loop.Ti, grid.interval), notes,
                  going.carried)
    measured, interpolated = frame.measurement(pv)
    if not later and not np.isfinite(measured).any():
        raise LoopError("the measurement (PV) holds no number at all", code="no_measurement",
                        remedy="check the column and the export")
    setpoint = frame.companion("sp")
    if setpoint is None and settings.constant_setpoint is not None:
        setpoint = np.full(len(measured), settings.constant_setpoint)
    output = frame.companion("op")
    if output is not None and not (going.output if later else np.isfinite(output).any()):
        notes.append(Note("no_output", "the output (OP) holds no number at all"))
        output = None
    spans = going.spans
    if spans is None:
        spans = spans_of(settings, _finite(measured, setpoint) if settings.pv_range is None else measured[:0],
                         None if output is None else _finite(output) if settings.op_range is None else output[:0])
    notes += spans.notes
    manual, on_mode = frame.manual((*options.auto_modes, *settings.auto_modes))
    samples = Samples(
        grid.index, None if setpoint is None else normalised(setpoint, spans.pv_range),
        normalised(measured, spans.pv_range), None if output is None else normalised(output, spans.op_range),
        interpolated, manual, frame.bridge)
    going.counts.update(samples.count(first, last))
    counts, total = going.counts, going.samples + last - first
    going.plan, going.spans, going.output = going.plan or grid.plan, spans, output is not None
    going.samples, going.begin = total, going.end or NAT
    missing = [] if setpoint is not None else [Note(
        "no_setpoint", "no setpoint (SP) column: what needs the control error cannot be done", {"loop": loop.name})]
    extra = {name: frame.disturbance(items) for name, items in loop.extra.items()}
    record = Record(
        loop.name, grid.start / 1e6, grid.interval, grid.index, samples.setpoint, samples.measurement, samples.output,
        samples.state, spans.settings, {name: values for name, values in extra.items() if values is not None},
        (*notes, *state_notes(counts, total, *MEASURED), *missing, *state_notes(counts, total, "setpoint", "output"),
         *on_mode, *state_notes(counts, total, "manual")),
    )  # fmt: skip
    return record if whole else record.slice(first, last)


def goes_on(pv: Signal, going: Going) -> Grid:
    """Return the points of the grid of an earlier chunk that lie among the stamps of a later one."""
    plan, order = going.plan, pv.axis.order(pv.values)
    assert plan is not None
    stamps = order.stamps
    if plan.kind == "regular":
        begin = int(np.searchsorted(stamps, going.place[0], side="right"))
        index, places = plan.rows(stamps[begin:], going.place)
        own = np.arange(begin, len(stamps)) if order.rows is None else order.rows[begin:]
        return Grid(plan, index, np.where(places >= 0, own[places], -1))
    index = plan.points(stamps)
    return Grid(plan, index, order.rows, stamps, plan.recorded(stamps, plan.start + plan.step * index))


def _own_samples(pv: Signal, grid: Grid, going: Going, end: int) -> tuple[int, int]:
    """Return the first sample of a chunk and the one after its last, and note where it ends."""
    first = int(np.searchsorted(grid.index, going.until, side="right"))
    if grid.kind == "regular":
        at = grid.index if grid.rows is None else grid.index[grid.rows >= 0]
        stamps = pv.axis.order(pv.values).stamps[-len(at) :]
        row = int(np.searchsorted(stamps, end)) - 1
        near = max(row - MARGIN, 0)
        going.place, going.until = (int(stamps[near]), int(at[near])), int(at[row])
    else:
        going.until = (end - 1 - grid.start) // grid.step
    return first, int(np.searchsorted(grid.index, going.until, side="right"))


def _of_chunks(pv: Signal, grid: Grid, going: Going, end: int, first: int, last: int) -> list[Note]:
    """What is to be said of the stamps of all chunks so far."""
    stamps = pv.axis.order(pv.values).stamps
    own = stamps[max(int(np.searchsorted(stamps, going.begin)) - 1, 0) : int(np.searchsorted(stamps, end))]
    going.steps += [Steps.of(own)] if len(own) > 1 else []
    going.recorded += last - first if grid.recorded is None else int(grid.recorded[first:last].sum())
    share = going.recorded / max(going.samples + last - first, 1)
    return replace(grid.plan, steps=Steps.joined(going.steps)).notes(share) if going.steps else []


def _finite(*parts: FloatArray | None) -> FloatArray:
    return np.concatenate([part[np.isfinite(part)] for part in parts if part is not None])


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
    return bisect_left(range(len(axis)), stamp, key=lambda row: int(axis.read(row, row + 1)[0]))


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


def spans_of(settings: Settings, measured: FloatArray, output: FloatArray | None) -> Spans:
    """Decide the spans of one loop after the contract. measured: finite values of PV and SP; output: of OP, None if not
    recorded.

    Raises LoopError (missing_range) when a gain is given but the spans it refers to are not known.
    """
    notes: list[Note] = []
    source = dict(settings.loop.source)
    gain_given = settings.loop.K is not None
    guessed = []
    pv_range = settings.pv_range
    if pv_range is None:
        low, high = _bounds(measured)
        if low >= -SLACK and high <= 1.0 + SLACK:
            pv_range = (0.0, 1.0)
        else:
            pv_range = _round_range(low, high)
            guessed.append("pv_range")
        source["pv_range"] = "data"
    op_range = settings.op_range
    if op_range is None:
        op_range = (0.0, 1.0)
        if output is not None:
            low, high = _bounds(output)
            if low >= -SLACK and high <= 1.0 + SLACK:
                pass
            elif low >= -5.0 and high <= 105.0 and float(np.quantile(output, 0.05)) >= -SLACK:
                op_range = (0.0, 100.0)
                notes.append(Note("op_percent", "op_range is not given: output within 0..100 is taken as percent"))
            else:
                op_range = _round_range(low, high)
                guessed.append("op_range")
        source["op_range"] = "data"
    if guessed and gain_given and not settings.engineering:
        names = " and ".join(guessed)
        raise LoopError(
            f"K is given but {names} is not, and the values are not within 0..1: K has no meaning without its span",
            remedy=f'add {names} = [low, high] to loops.toml, or units = "engineering" if K is in output units per '
            "measurement unit",
            code="missing_range",
        )
    for name in guessed:
        low, high = pv_range if name == "pv_range" else op_range
        notes.append(Note(f"guessed_{name}", f"{name} is not given: scaled by {low:g}..{high:g}, a guess from the data",
                          {"low": low, "high": high}))
    loop = replace(settings.loop, pv_range=pv_range, op_range=op_range, source=source)
    if settings.engineering:
        ratio = (pv_range[1] - pv_range[0]) / (op_range[1] - op_range[0])
        loop = replace(loop, K=None if loop.K is None else loop.K * ratio, Kp=None if loop.Kp is None
                       else loop.Kp / ratio)
    return Spans(pv_range, op_range, loop, tuple(notes))


def normalised(values: FloatArray, span: tuple[float, float]) -> FloatArray:
    """Map a range to 0..1; always a new array."""
    low, high = span
    with np.errstate(over="ignore", invalid="ignore"):
        return (values - low) * (1.0 / (high - low))


def _bounds(values: FloatArray) -> tuple[float, float]:
    """Lowest and highest value, without the outermost thousandth and without spikes far from all others.

    values: finite.
    """
    if not len(values):
        return 0.0, 1.0
    ends = float(values.min()), float(values.max())
    if ends[0] >= -SLACK and ends[1] <= 1.0 + SLACK:
        return ends  # normalised: nobody asks further
    # a setpoint that stands still is half of all values: quartiles would say no more than where it stands
    low, first, last, high = np.quantile(values, [0.001, 0.05, 0.95, 0.999]).tolist()
    reach = 8.0 * max(last - first, 1e-9 * max(abs(last), abs(first)))
    if low < first - reach or high > last + reach:
        near = values[(values >= first - reach) & (values <= last + reach)]
        if len(near):
            low, high = np.quantile(near, [0.001, 0.999]).tolist()
    return low, high


def _round_range(low: float, high: float) -> tuple[float, float]:
    """A round range that holds the values: from zero when they do not come near it, else round at both ends."""
    if low >= 0.0:
        return 0.0, _round_up(high * 1.05 or 1.0)
    if high <= 0.0:
        return -_round_up(-low * 1.05), 0.0
    return -_round_up(-low * 1.05), _round_up(high * 1.05)


def _round_up(value: float) -> float:
    power = 10.0 ** np.floor(np.log10(value))
    for factor in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0):
        if factor * power >= value * (1 - 1e-12):
            return float(factor * power)
    return float(10.0 * power)
