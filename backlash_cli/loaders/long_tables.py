"""Long files of any size: rows of tag, time and value (or of loop, time, SP, PV, OP) go to their tags through a store.

`LongReader` takes the blocks of a file in order and gives, at the end, the signals that `series_of` gives for the table
of the whole file. What only that table can tell makes it raise ForeignText; the caller then reads the file whole.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import BacklashError, InputError
from ..record import Note
from .arrays import to_column
from .columns import LazyColumn
from .csv_signal import ForeignText, Signal
from .layouts import layout_of
from .long_layouts import LongColumns, long_columns, tag_series, tall_columns
from .long_stamps import stamps_for
from .names import signal_role
from .numbers import codes_and_words
from .options import ReadOptions
from .order import CLOCK_CODES
from .series import Cells, Series
from .store import Room
from .stored_columns import StoredColumn
from .tables import Table
from .tag_names import TagNames
from .tag_store import VALUE, Clock, TagAxis, TagRows, TagStore
from .timecolumns import stamp_columns, time_columns
from .times import SECOND

FEW = 3  # steps back of the stamps that may be a clock that was set back


@dataclass(frozen=True)
class LongTable:
    """The signals of a long file, whose samples are in a store, and what was noticed."""

    series: list[Series]
    notes: tuple[Note, ...] = ()


@dataclass(frozen=True)
class LongLayout:
    """What is read of a long file. tall: rows of a loop with its signals. times: columns of the stamps."""

    columns: LongColumns
    times: tuple[int, ...]
    tall: bool

    @property
    def stored(self) -> list[int]:
        """Columns whose cells are stored, in the order of the store."""
        quality = self.columns.quality
        return [*self.columns.values, *(() if quality is None else (quality,))]

    @property
    def others(self) -> list[int]:
        """Columns of stamps and names, in the order of the file."""
        return sorted({*self.times, *self.columns.naming})


def long_layout(head: Table, options: ReadOptions) -> LongLayout | None:
    """Return what is read of a file with these first rows, None where it is no long file that can be read in blocks."""
    layout = layout_of(head, options)
    times = stamp_columns(head, options) if layout in ("long", "tall") else ()
    if not times:
        return None
    tall = layout == "tall"
    used = set(times if len(times) > 1 else time_columns(head))
    try:
        columns = (tall_columns if tall else long_columns)(head, used)
    except InputError:
        return None  # said again, of the whole file
    return LongLayout(columns, times, tall)


class LongReader:
    """Takes a long file block by block. head: its first rows. wanted: says of a tag whether its rows are needed.

    Raises ForeignText where the file has to be read whole.
    """

    def __init__(
        self, head: Table, layout: LongLayout, options: ReadOptions, wanted: Callable[[str], bool], room: Room
    ) -> None:
        self.head, self.layout = head, layout
        self.signals = [Signal() for _ in layout.stored]
        self._stamps = stamps_for(head, layout.times, options)
        self._names = TagNames(wanted)
        self._store = TagStore(room)
        self._back = 0  # steps back of the stamps
        self._cuts: list[int] = []  # pieces that begin after one
        self._last: tuple[int, bool] | None = None

    def take(self, columns: Mapping[int, pa.ChunkedArray], values: NDArray[np.float64]) -> None:
        """Take a block. columns: of stamps and names. values: (stored, rows) as `signals` put them."""
        raw, known = self._stamps.take([columns[i] for i in self.layout.times])
        if known is not None and self.layout.tall and not self._headers(columns, ~known):
            raise ForeignText
        codes = self._names.codes([columns[i] for i in self.layout.columns.naming], known)
        begin = 0
        for place in self._steps_back(raw, known):
            self._add(codes, raw, values, begin, place)
            self._cuts.append(self._store.cut())
            begin = place
        self._add(codes, raw, values, begin, len(raw))

    def _headers(self, columns: Mapping[int, pa.ChunkedArray], which: NDArray[np.bool_]) -> bool:
        """Whether rows of a block are headers: their loop is called as its column."""
        naming = self.layout.columns.naming[0]
        words = codes_and_words(columns[naming].take(to_column(np.flatnonzero(which), pa.int64())).cast(pa.string()))[1]
        return {word.strip() for word in words} <= {self.head.names[naming].strip()}

    def _add(self, codes: NDArray[np.int32], raw: NDArray[np.int64], values: NDArray[np.float64], first: int, last: int
             ) -> None:
        fields = [raw.view(np.float64), *values]
        self._store.add(codes[first:last], [field[first:last] for field in fields])

    def _steps_back(self, raw: NDArray[np.int64], known: NDArray[np.bool_] | None) -> list[int]:
        """Return where the stamps of a block go back, as long as that is seldom: the clock may have been set back."""
        if not len(raw) or self._back > FEW:
            return []
        fell = np.diff(raw, prepend=raw[0] if self._last is None else self._last[0]) < 0
        if known is not None or (self._last is not None and not self._last[1]):
            there = np.ones(len(raw), bool) if known is None else known
            fell &= there & np.append(self._last is None or self._last[1], there[:-1])
        self._last = int(raw[-1]), known is None or bool(known[-1])
        places = np.flatnonzero(fell).tolist()
        self._back += len(places)
        return [] if self._back > FEW else places

    def finish(self) -> list[Series]:
        """Return the signals of all tags; those that are not wanted have no samples."""
        tags = self._names.in_order()
        self._store.cut()
        clock = self._clock([code for code, _ in tags])
        found: list[Series] = []
        for code, name in tags:
            if name := name.strip():
                found += self._of_tag(name, self._store.tag(code), clock, self._names.kept[code])
        return found

    def _of_tag(self, name: str, rows: TagRows, clock: Clock, kept: bool) -> list[Series]:
        axis = TagAxis(rows, clock, self.head.where)
        names = self.head.names
        if self.layout.tall:
            there = [(k, names[i]) for k, i in enumerate(self.layout.columns.values) if self.signals[k].filled]
            return [Series(f"{name}.{column}", name, signal_role(column), column, axis, self._cells(rows, k, kept),
                           None, self.head.where) for k, column in there]
        marks = None if self.layout.columns.quality is None else replace(self._cells(rows, 1, kept), decimal=".")
        return [tag_series(name, axis, self._cells(rows, 0, kept), marks, self.head.where)]

    def _cells(self, rows: TagRows, slot: int, kept: bool = True) -> Cells:
        signal = self.signals[slot]
        if not kept:
            return Cells(LazyColumn(pa.float64(), 0), self.head.decimal)
        return Cells(StoredColumn(rows, VALUE + slot, list(signal.words), not signal.filled), self.head.decimal)

    def _clock(self, codes: list[int]) -> Clock:
        """Return how the stamps are read; a clock that was set back in a file in time order went back for all tags."""
        clock = self._stamps.clock()
        if self.layout.tall or self._back > FEW:
            return clock
        if not self._stamps.rising or (self._back and not all(self._names.kept)):
            raise ForeignText
        if not self._back or not codes:
            return clock
        rows = max((self._store.tag(code) for code in codes), key=lambda tag: tag.rows)
        axis = TagAxis(rows, clock, self.head.where)
        try:
            notes = axis.order(self._cells(rows, 0).numbers().values).notes
        except BacklashError:
            raise ForeignText from None
        back = tuple(note for note in notes if note.code in CLOCK_CODES)
        if len(back) != self._back:
            return clock
        later = [round(float(note.values["seconds"]) * SECOND) for note in back]
        assert self._last is not None
        last = int(clock.decode(np.array([self._last[0]]).view(np.float64))[0]) + sum(later)
        return replace(clock, last=last, moved=tuple(zip(self._cuts, later, strict=True)), notes=back)
