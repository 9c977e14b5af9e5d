"""Records longer than memory should hold, made piece by piece: the same samples, states and notes as `build_record`.

Only of loops where nothing has to be looked at as a whole: even stamps, SP, PV and OP numbers everywhere, known spans,
PV within them and nowhere frozen. That is found out by reading the loop once; all others are read whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..record import Note, Record, SampleState
from .clean import marked
from .columns import ParquetColumn, StoredColumn
from .even import LONG
from .join import LoopSeries
from .loop_settings import settings_of
from .recipes import Recipe
from .scaling import SLACK, Spans, normalise, spans_of
from .series import EvenAxis, Series
from .states import BEYOND, LIMIT_RUN, Repeats, complete, saturated
from .times import SECOND

Piece = dict[str, NDArray[np.float64]]
ROLES = {"pv", "sp", "op"}
PIECE = 1 << 18  # samples looked at at once


@dataclass(frozen=True)
class LongRecord:
    """A record that is read anew by every call of `blocks`. notes: of the whole record."""

    recipe: Recipe
    axis: EvenAxis
    spans: Spans
    notes: tuple[Note, ...]

    def blocks(self, size: int) -> Iterator[Record]:
        """Yield the record in blocks of `size` samples."""
        first = 0
        interval = self.axis.step / SECOND
        pieces = _normalised(_pieces(self.recipe.series, size), self.spans.pv_range, self.spans.op_range)
        for piece, state in _with_states(pieces):
            index = np.arange(first, first + len(state))
            yield Record(self.recipe.loop, self.axis.start / 1e6, interval, index, piece["sp"], piece["pv"],
                         piece.get("op"), state, self.spans.settings, {}, self.notes)
            first += len(state)


def long_record(recipe: Recipe) -> LongRecord | None:
    """Return the record of a loop as one that is read piece by piece, None where it should be read whole.

    Raises BacklashError where the loop cannot be read.
    """
    axis = _even_axis(recipe.series)
    if axis is None or recipe.rows <= LONG or recipe.options.good_quality:
        return None
    settings = settings_of(recipe.values)
    if settings.constant_setpoint is not None:
        return None
    ranges = settings.pv_range or (0.0, 1.0), settings.op_range or (0.0, 1.0)
    look = _Look()
    for piece, state in _with_states(_normalised(_pieces(recipe.series, PIECE), *ranges)):
        if not look.add(piece, state):
            return None
    low, high = look.extremes["pv"]
    if low < -BEYOND or high > 1.0 + BEYOND or look.repeats.may_be_frozen():
        return None
    # spans that are not given are 0..1 where all values lie within; else they are guessed from the whole record
    within = {role: low >= -SLACK and high <= 1.0 + SLACK for role, (low, high) in look.extremes.items()}
    if settings.pv_range is None and not (within["pv"] and within["sp"]):
        return None
    if settings.op_range is None and not within.get("op", True):
        return None
    ends = {role: np.array(values) for role, values in look.extremes.items()}
    spans = spans_of(settings, ends["pv"], ends["sp"], ends.get("op"))
    notes = [*recipe.notes, *settings.notes, *axis.notes, *spans.notes]
    if look.limited:
        notes.append(marked(SampleState.SATURATED, look.limited, axis.rows))
    return LongRecord(recipe, axis, spans, tuple(notes))


@dataclass
class _Look:
    """What is found out by reading a loop once. extremes: of the normalised signals, by role."""

    extremes: dict[str, tuple[float, float]] = field(default_factory=dict)
    repeats: Repeats = field(default_factory=Repeats)
    limited: int = 0

    def add(self, piece: Piece, state: NDArray[np.uint8]) -> bool:
        """Take the next samples and say whether they are numbers everywhere."""
        for role, values in piece.items():
            if not complete(values):
                return False
            low, high = self.extremes.get(role, (np.inf, -np.inf))
            self.extremes[role] = min(low, float(values.min())), max(high, float(values.max()))
        self.repeats.add(piece["pv"])
        self.limited += int(np.count_nonzero(state))
        return True


def _even_axis(loop: LoopSeries) -> EvenAxis | None:
    if not {"pv", "sp"} <= loop.roles.keys() <= ROLES or loop.missing_tags:
        return None
    items = [item for items in loop.roles.values() for item in items]
    axis = items[0].axis
    one_each = len(items) == len(loop.roles) and all(item.axis is axis and _in_pieces(item) for item in items)
    return axis if one_each and isinstance(axis, EvenAxis) else None


def _in_pieces(item: Series) -> bool:
    column = item.cells.column
    if item.quality is not None or item.notes:
        return False
    return isinstance(column, ParquetColumn) or (isinstance(column, StoredColumn) and not column.words)


def _pieces(loop: LoopSeries, size: int) -> Iterator[Piece]:
    """Yield the signals in pieces of `size` rows."""
    roles = list(loop.roles)
    columns = [loop.roles[role][0].cells.column for role in roles]
    parts = [column.number_parts() for column in columns if isinstance(column, (ParquetColumn, StoredColumn))]
    waiting: list[list[NDArray[np.float64]]] = [[] for _ in roles]
    count = 0
    for part in zip(*parts, strict=True):
        for kept, values in zip(waiting, part, strict=True):
            kept.append(values)
        count += len(part[0])
        if count < size:
            continue
        joined = [kept[0] if len(kept) == 1 else np.concatenate(kept) for kept in waiting]
        cut = count // size * size
        for first in range(0, cut, size):
            yield {role: values[first : first + size] for role, values in zip(roles, joined, strict=True)}
        waiting = [[values[cut:].copy()] for values in joined]
        count -= cut
    if count:
        yield {role: np.concatenate(kept) for role, kept in zip(roles, waiting, strict=True)}


def _normalised(
    pieces: Iterator[Piece], pv_range: tuple[float, float], op_range: tuple[float, float]
) -> Iterator[Piece]:
    spans = {"pv": pv_range, "sp": pv_range, "op": op_range}
    return ({role: normalise(values, spans[role]) for role, values in piece.items()} for piece in pieces)


def _with_states(pieces: Iterator[Piece]) -> Iterator[tuple[Piece, NDArray[np.uint8]]]:
    """Yield each piece with the states of its samples; a run at the limit may go on in the next piece."""
    reach = LIMIT_RUN - 1
    before = np.empty(0)
    coming = next(pieces, None)
    while coming is not None:
        piece, coming = coming, next(pieces, None)
        state = np.zeros(len(piece["pv"]), np.uint8)
        if "op" in piece:
            after = np.empty(0) if coming is None else coming["op"][:reach]
            limit = saturated(np.concatenate([before, piece["op"], after]))
            if limit is not None:
                state[limit[len(before) : len(before) + len(state)]] = SampleState.SATURATED
            before = np.concatenate([before, piece["op"][-reach:]])[-reach:]
        yield piece, state
