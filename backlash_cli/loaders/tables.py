"""Files to signals: the columns of a file go into memory or the scratch file, named and with their stamps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import BacklashError, InputError
from ..record import Note
from .columns import Batch, ParquetTable, TextTable
from .layouts import Head, Layout, Named, layout_of, of_tag, signals_of
from .names import signal_role
from .numbers import codes_and_words, stored
from .opening import Text, kind_of, sheets
from .options import ReadOptions
from .order import CLOCK_CODES, NAT, ordered
from .scratch import Piece, Room, Store
from .signals import Axis, Lexicon, Series, StoredRows
from .sources import Source, stem_of
from .times import StampReader

FEW = 3  # steps back of the stamps of a file that may be a clock that was set back
Table = TextTable | ParquetTable


@dataclass
class Reading:
    """How files are read. needed: says of named columns, or of the tags of rows by their numbers, whose samples are.
    taken: called with the bytes of a file that were read."""

    options: ReadOptions
    needed: Callable[[list[Named]], set[int]] = lambda found: {one.column for one in found}
    taken: Callable[[int], None] | None = None
    room: Room = field(default_factory=Room)


def signals_of_file(source: Source, reading: Reading) -> tuple[list[Series], list[Note]]:
    """Return the signals of a file, and what was noticed; a sheet of remarks beside one of data is passed over.

    Raises InputError when it cannot be read.
    """
    path, options, stem = source.path, reading.options, stem_of(source.path)
    kind = kind_of(path)
    if kind == "parquet" and reading.taken is not None:
        reading.taken(path.stat().st_size)
    parts: list[tuple[str, bytes | None]] = [*sheets(path)] if kind == "workbook" else [(stem, None)]
    found: list[Series] = []
    notes: list[Note] = []
    problems: list[InputError] = []
    for name, data in parts:
        try:
            table = ParquetTable(path, stem, options, source.partition) if kind == "parquet" else TextTable(
                Text(path, options, reading.taken, data), stem if len(parts) == 1 else name, source.partition)
            layout = layout_of(table.head, options)
        except InputError as error:
            problems.append(error)
            continue
        found += (_grouped if layout.naming else _wide)(table, layout, reading)
        notes += table.notes
    if len(problems) == len(parts):
        raise problems[0]
    return found, notes


class _Kept:
    """The columns of a file in a store, with their stamps in UTC as "t0", "t1" ... and their cells as "v3", "v4" ...

    filled: columns that hold anything. about: of each set of rows what its Axis says. numbers: of the tags of a long
    file, or of the loops of a tall one; they stand in the column "group". Raises InputError when the stamps are not
    understood.
    """

    def __init__(self, table: Table, layout: Layout, columns: Sequence[int], reading: Reading) -> None:
        head, written = table.head, isinstance(table, TextTable)
        readers = [StampReader([head.names[i] for i in pair], reading.options, head.where) for pair in layout.stamps]
        raw, self.store = Store(reading.room), Store(reading.room)
        self.filled: set[int] = set()
        self.numbers: dict[str, int] = {}
        words: dict[int, dict[str, int]] = {i: {} for i in columns}
        for batch in table.batches([*columns, *layout.naming], {i for pair in layout.stamps for i in pair}):
            piece: Piece = {f"t{k}": reader.take([batch[i] for i in pair])
                            for k, (reader, pair) in enumerate(zip(readers, layout.stamps, strict=True))}
            if layout.naming:
                piece["group"] = self._tags(batch, layout.naming, head)
            for i in columns:
                values, codes = stored(batch[i], words[i], head.decimal, written=written)
                piece |= {f"v{i}": values} if codes is None else {f"v{i}": values, f"v{i}w": codes}
                if i not in self.filled and (codes is not None or not np.isnan(values).all()):
                    self.filled.add(i)
            raw.add(piece)
        self.lexicons = {f"v{i}": Lexicon(list(found), head.decimal) for i, found in words.items() if found}
        clocks = [reader.finish() for reader in readers]
        for piece in raw.emptied():
            self.store.add({**piece, **{f"t{k}": clock(piece[f"t{k}"][:]) for k, clock in enumerate(clocks)}})
        self.about: list[dict[str, Any]] = [
            {"absolute": reader.absolute, "notes": reader.all_notes, "where": head.where} for reader in readers]

    def _tags(self, batch: Batch, naming: Sequence[int], head: Head) -> NDArray[np.int32]:
        """Return the number of each row's tag, -1 for none, such as a header in between."""
        header = ".".join(head.names[i].strip() for i in naming)
        codes, words = codes_and_words(batch[naming[0]])
        if len(naming) == 2:
            second, fields = codes_and_words(batch[naming[1]])
            both = np.where((codes < 0) | (second < 0), -1, codes * max(len(fields), 1) + second)
            present, codes = np.unique(both, return_inverse=True)
            words = ["" if p < 0 else f"{words[p // len(fields)]}.{fields[p % len(fields)]}" for p in present.tolist()]
        table = np.full(len(words) + 1, -1, np.int32)
        for i in np.flatnonzero(np.bincount(codes + 1)[1:]).tolist():
            if (name := words[i].strip()) and name != header:
                table[i] = self.numbers.setdefault(name, len(self.numbers))
        return table[codes]


def _wide(table: Table, layout: Layout, reading: Reading) -> list[Series]:
    """A column per signal; of Parquet with stamps that are UTC it stays in the file until it is needed."""
    head = table.head
    empty = {i for i in layout.stored if pa.types.is_null(head.columns[i].type)}
    kinds = [head.columns[i].type for pair in layout.stamps for i in pair]
    if isinstance(table, ParquetTable) and len(kinds) == len(layout.stamps) and all(
            pa.types.is_timestamp(kind) and (kind.tz or not reading.options.timezone) for kind in kinds):
        axes = [Axis(table, f"v{pair[0]}", range(table.count), where=head.where) for pair in layout.stamps]
    else:
        needed = reading.needed(signals_of(head, layout))
        needed |= {layout.quality[i] for i in needed if i in layout.quality}
        # what is still empty may be a tag of the loops file
        columns = sorted((needed | empty).intersection(layout.stored))
        kept = _Kept(table, layout, columns, reading)
        rows, count = StoredRows(kept.store, kept.lexicons), int(kept.store.rows().sum())
        axes = [Axis(rows, f"t{k}", range(count), first_line=head.first_line, **about)
                for k, about in enumerate(kept.about)]
        empty = set(columns) - kept.filled
    if layout.kind == "pairs":  # shorter ones are padded with rows without a stamp
        for k, axis in enumerate(axes):
            known = np.flatnonzero(axis.read() != NAT)
            axes[k] = axis.part(slice(0, len(known)) if not len(known) or known[-1] == len(known) - 1 else known)
    return [_series(one, head, layout, axes[one.stamps]) for one in signals_of(head, layout, empty)]


def _series(one: Named, head: Head, layout: Layout, axis: Axis) -> Series:
    mark = layout.quality.get(one.column)
    quality, name = ("", "") if mark is None else (f"v{mark}", head.names[mark])
    return Series(one.tag, one.loop, one.role, one.signal, axis, f"v{one.column}", quality, name)


def _grouped(table: Table, layout: Layout, reading: Reading) -> list[Series]:
    """Rows that belong to different tags or loops: they are put together by tag."""
    head, tall = table.head, layout.kind == "tall"
    kept = _Kept(table, layout, layout.stored, reading)
    about: dict[str, Any] = kept.about[0]
    moved: list[tuple[int, int]] = []
    if not tall:
        moved, more = _one_clock(kept.store, f"v{layout.values[0]}", len(kept.numbers))
        about["notes"] = (*about["notes"], *more)
    named = [[Named(k, f"{name}.{head.names[i]}", name, signal_role(head.names[i]), head.names[i])
              for i in layout.values] if tall else [of_tag(name, k)] for k, name in enumerate(kept.numbers)]
    needed = reading.needed([one for ones in named for one in ones])
    wanted = np.array([k in needed for k in range(len(named))] + [False])
    grouped, first, last = Store(reading.room, groups=True), 0, NAT
    for piece in kept.store.emptied():
        arrays = {name: column[:] for name, column in piece.items()}
        micros = arrays["t0"].astype(np.int64, copy=False)
        for row, shift in moved:
            later = (np.arange(first, first + len(micros)) > row) & (micros != NAT)
            micros = np.where(later, micros + shift, micros)
        first, last = first + len(micros), max(last, int(micros.max(initial=NAT)))
        keep = wanted[arrays["group"]]
        if not tall:  # rows without a stamp, such as headers in between, are no samples
            keep &= micros != NAT
        arrays["t0"] = micros
        grouped.add(arrays if keep.all() else {name: column[keep] for name, column in arrays.items()})
    found = []
    for number, ones in enumerate(named):
        count = int(grouped.rows(number).sum())
        if count or not wanted[number]:
            axis = Axis(StoredRows(grouped, kept.lexicons, number), "t0", range(count), **about)
            axis = axis if wanted[number] else replace(axis, end=last)
            found += [_series(replace(one, column=i), head, layout, axis)
                      for i, one in zip(layout.values, ones, strict=True) if not tall or i in kept.filled]
    return found


def _one_clock(store: Store, column: str, tags: int) -> tuple[list[tuple[int, int]], list[Note]]:
    """A clock that was set back in a file written in time order went back for all tags, the rarely recorded too.

    Return after which rows by how much [microseconds] it did, and what is to be said of it.
    """
    back: list[int] = []
    first, before = 0, NAT
    counts = np.zeros(tags, np.int64)
    for piece in store.pieces:
        micros, group = piece["t0"][:], piece["group"][:]
        known = np.flatnonzero(micros != NAT)
        fell = np.diff(micros[known], prepend=micros[known[:1]] if before == NAT else before) < 0
        back += (first - 1 + known[fell]).tolist()
        before, first = int(micros[known[-1]]) if len(known) else before, first + len(micros)
        counts += np.bincount(group[group >= 0], minlength=tags)
    if not 0 < len(back) <= FEW:
        return [], []
    times, values = [], []
    for piece in store.pieces:
        rows = np.flatnonzero(piece["group"][:] == int(np.argmax(counts)))
        times.append(piece["t0"][:][rows])
        values.append(piece[column][:][rows])
    try:
        notes = ordered(np.concatenate(times), np.concatenate(values)).notes
    except BacklashError:
        return [], []
    clock = [note for note in notes if note.code in CLOCK_CODES]
    if len(clock) != len(back):
        return [], []
    return [(row, round(float(note.values["seconds"]) * 1e6)) for row, note in zip(back, clock, strict=True)], clock
