"""Layouts in which rows belong to different tags or loops, or columns have times of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .names import IGNORED, LOOP, QUALITY, SIGNALS, TAG, VALUE, plain, signal_role, split_tag
from .options import ReadOptions
from .order import CLOCK_CODES, moved_on
from .series import Axis, Cells, Series
from .tables import Table
from .timecolumns import is_time_like, time_axis, time_columns
from .times import NAT

GROUPS = LOOP | {"measurement", "device", "unit", "block"}


def name_columns(table: Table, texts: list[int]) -> list[int]:
    """Return the columns that name the tag of each row: one with whole tags, or loop and signal apart; [] if none.

    texts: the text columns beside the stamps. What stands in a column counts more than its header.
    """
    words = {i: plain(table.names[i]) for i in texts}
    heads = {i: [w for w in Cells(table.columns[i].slice(0, 4000)).texts()[1] if w.strip()] for i in texts}
    whole = [
        i for i in texts if _share(heads[i], lambda w: bool(split_tag(w).loop) and split_tag(w).role in SIGNALS) >= 0.5
    ]
    roles = [i for i in texts if _share(heads[i], lambda w: signal_role(w) != "") >= 0.5]
    if roles:
        rest = [i for i in texts if i not in roles and heads[i] and words[i] not in QUALITY | IGNORED]
        groups = [i for i in rest if words[i] in GROUPS] or [i for i in rest if words[i] in TAG] or rest
        if groups:
            return [max(groups, key=lambda i: (words[i] in LOOP, len(heads[i]))), roles[0]]
    if whole:
        return [next((i for i in whole if words[i] in TAG), whole[0])]
    return [i for i in texts if words[i] in TAG and heads[i]][:1]


def _share(words: list[str], test: object) -> float:
    return sum(map(test, words)) / len(words) if words else 0.0  # type: ignore[call-overload]


@dataclass(frozen=True)
class LongColumns:
    """Columns of a table whose rows belong to different tags or loops. naming: the tag, or loop and signal apart.

    values: of a tag one column, of a loop one for each signal.
    """

    naming: tuple[int, ...]
    values: tuple[int, ...]
    quality: int | None = None


def long_columns(table: Table, used: set[int]) -> LongColumns:
    """Return the columns of rows of tag, time and value; used: those of stamps. Raises InputError if one is missing."""
    words = [plain(name) for name in table.names]
    columns = range(len(words))
    texts = [i for i in columns if table.is_text(i) and i not in used]
    naming = name_columns(table, texts)
    if not naming:
        raise InputError("no column of tag names found", where=table.where, remedy="name it 'tag'")
    taken = {*naming, *used}
    quality = next((i for i in columns if words[i] in QUALITY and i not in taken), None)
    free = [
        i for i in columns if i not in taken and i != quality and words[i] not in IGNORED and not is_time_like(table, i)
    ]
    named = [i for i in free if words[i] in VALUE]
    values = named or [i for i in free if not table.is_text(i)] or free
    if not values:
        raise InputError("no column of values found", where=table.where, remedy="name it 'value'")
    return LongColumns(tuple(naming), (values[0],), quality)


def tall_columns(table: Table, used: set[int]) -> LongColumns:
    """Return the columns of rows of loop, time and signals; used: those of stamps. Raises InputError without loops."""
    words = [plain(name) for name in table.names]
    texts = [i for i in range(len(words)) if table.is_text(i) and i not in used]
    which = next((i for i in texts if words[i] in GROUPS), next((i for i in texts if words[i] in TAG), None))
    if which is None:
        raise InputError("no column of loop names found", where=table.where, remedy="name it 'loop'")
    signals = [i for i, word in enumerate(words) if i not in used and i != which and word not in IGNORED | QUALITY]
    return LongColumns((which,), tuple(signals))


def long_series(table: Table, options: ReadOptions) -> list[Series]:
    """One row per sample: tag, time, value and perhaps a quality."""
    axis, used = time_axis(table, options)
    found_in = long_columns(table, used)
    naming, quality = list(found_in.naming), found_in.quality
    codes, names = _names(table, naming)
    cells = Cells(table.columns[found_in.values[0]], table.decimal).split()
    marks = None if quality is None else Cells(table.columns[quality]).split()
    if np.any(axis.micros == NAT):  # headers in between are no samples
        codes = np.where(axis.micros == NAT, -1, codes)
    rows_of = _rows_by_code(codes)
    axis = _one_clock(axis, rows_of, cells)
    found = []
    for code, rows in rows_of.items():
        name = names[code].strip()
        if name:
            found.append(
                tag_series(name, axis.take(rows), cells.take(rows), None if marks is None else marks.take(rows),
                           table.where)
            )
    return found


def _names(table: Table, naming: list[int]) -> tuple[NDArray[np.int64], list[str]]:
    codes, names = Cells(table.columns[naming[0]]).texts()
    if len(naming) == 1:
        return codes, names
    second, fields = Cells(table.columns[naming[1]]).texts()
    both = np.where((codes < 0) | (second < 0), -1, codes * len(fields) + second)
    return both, [f"{name}.{field}" for name in names for field in fields]


def _rows_by_code(codes: NDArray[np.int64]) -> dict[int, NDArray[np.int64]]:
    order = np.argsort(codes, kind="stable")
    present, starts = np.unique(codes[order], return_index=True)
    ends = np.append(starts[1:], len(order))
    return {int(code): order[start:end] for code, start, end in zip(present, starts, ends, strict=True) if code >= 0}


def _one_clock(axis: Axis, rows_of: dict[int, NDArray[np.int64]], cells: Cells) -> Axis:
    """A clock that was set back in a file written in time order went back for all tags, the rarely recorded too."""
    back = np.flatnonzero((np.diff(axis.micros) < 0) & (axis.micros[1:] != NAT) & (axis.micros[:-1] != NAT))
    if not 0 < len(back) <= 3 or not rows_of:
        return axis
    rows = max(rows_of.values(), key=len)
    numbers = cells.take(rows).numbers().values
    clock = [note for note in axis.take(rows).order(numbers).notes if note.code in CLOCK_CODES]
    if len(clock) != len(back):
        return axis
    return axis.moved(moved_on(axis.micros, back, [float(note.values["seconds"]) for note in clock]), clock)


def tag_series(name: str, axis: Axis, cells: Cells, marks: Cells | None, where: str) -> Series:
    """The signal that a tag names."""
    tag = split_tag(name)
    return Series(name, tag.loop, tag.role if tag.role in SIGNALS else "", tag.signal, axis, cells, marks, where)


def tall_series(table: Table, options: ReadOptions) -> list[Series]:
    """A column names the loop; SP, PV and OP stand beside it."""
    axis, used = time_axis(table, options)
    found_in = tall_columns(table, used)
    (which,) = found_in.naming
    codes, names = Cells(table.columns[which]).texts()
    header = [code for code, name in enumerate(names) if name.strip() == table.names[which].strip()]
    if header:  # in between, it is no loop
        codes = np.where((axis.micros == NAT) & np.isin(codes, header), -1, codes)
    columns = [i for i in found_in.values if table.columns[i].null_count < table.rows]
    parts = {i: Cells(table.columns[i], table.decimal).split() for i in columns}
    found = []
    for code, rows in _rows_by_code(codes).items():
        loop = names[code].strip()
        own = axis.take(rows)
        for i in columns if loop else ():
            name = table.names[i]
            tag = f"{loop}.{name}"
            found.append(Series(tag, loop, signal_role(name), name, own, parts[i].take(rows), None, table.where))
    return found


def pair_series(table: Table, options: ReadOptions) -> list[Series]:
    """Every tag has a time column of its own, shorter ones padded with empty cells."""
    times = time_columns(table)
    found = []
    for position, column in enumerate(times):
        end = times[position + 1] if position + 1 < len(times) else len(table.names)
        block = [i for i in range(column + 1, end) if table.columns[i].null_count < table.rows or table.names[i]]
        marks = [i for i in block if split_tag(table.names[i]).role == "quality" or plain(table.names[i]) in QUALITY]
        values = [i for i in block if i not in marks]
        if not values:
            continue
        name = table.names[values[0]]
        if not name or plain(name) in VALUE or plain(name.rpartition(".")[2]) in VALUE:
            name = split_tag(table.names[column]).of or name.rpartition(".")[0] or table.names[column]
        axis, _ = time_axis(table, options, only=column)
        keep = np.flatnonzero(axis.micros != NAT)
        cells = Cells(table.columns[values[0]], table.decimal).split().take(keep)
        quality = Cells(table.columns[marks[0]]).split().take(keep) if marks else None
        found.append(tag_series(name, axis.take(keep), cells, quality, table.where))
    return found
