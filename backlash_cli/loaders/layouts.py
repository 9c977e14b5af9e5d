"""Which column is what: wide, single-loop, long, tag pairs or one tag per file; tables become Series."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pyarrow as pa

from ..errors import InputError
from .names import IGNORED, LOOP, QUALITY, SIGNALS, TAG, VALUE, Tag, plain, signal_role, split_tag
from .options import ReadOptions
from .series import Axis, Cells, Series
from .tables import Table
from .timecolumns import is_time_like, time_axis, time_columns


def series_of(table: Table, options: ReadOptions) -> list[Series]:
    """Take a table apart into signals. Raises InputError when there is no time column or no signal."""
    layout = options.layout or _recognise(table)
    found = {"long": _long, "pairs": _pairs, "tall": _tall, "wide": _wide, "single": _wide}[layout](table, options)
    if not found:
        raise InputError(
            f"no signal columns found beside the time (columns: {_shown(table.names)})",
            where=table.where,
            remedy="name columns LOOP.SP, LOOP.PV, LOOP.OP, or name the tags in loops.toml",
        )
    return found


def _recognise(table: Table) -> str:
    words = [plain(name) for name in table.names]
    times = time_columns(table)
    texts = [i for i, column in enumerate(table.columns) if _is_text(column) and i not in times]
    roles = [split_tag(name) for name in table.names]
    alone = {tag.role for tag in roles if not tag.loop and tag.role in SIGNALS}
    has_tag = any(words[i] in TAG or words[i] in ("measurement", "field") for i in texts)
    has_value = any(word in VALUE for word in words)
    wide = sum(bool(tag.loop) and tag.role in SIGNALS for tag in roles)
    if has_tag and (has_value or not wide) and times and not ("pv" in alone and "value" not in words):
        return "long"
    if any(words[i] in LOOP for i in texts) and "pv" in alone:
        return "tall"
    if len(times) >= 2 and _paired(table, times):
        return "pairs"
    if times and not wide and not alone and _tag_column(table, texts) is not None and has_number(table, times):
        return "long"
    return "wide"


def has_number(table: Table, times: list[int]) -> bool:
    """Say whether some column beside the stamps holds numbers."""
    return any(i not in times and not _is_text(column) for i, column in enumerate(table.columns))


def _is_text(column: pa.ChunkedArray) -> bool:
    kind = column.type
    return pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_dictionary(kind)


def _paired(table: Table, times: list[int]) -> bool:
    """Time columns that are each followed by a value of their own."""
    followed = all(i + 1 < len(table.names) and i + 1 not in times for i in times)
    return followed and not _clocks(table, times)


def _clocks(table: Table, times: list[int]) -> bool:
    return any(table.kind(i) == "clock" for i in times)


def _tag_column(table: Table, texts: list[int]) -> int | None:
    for i in texts:
        _, words = Cells(table.columns[i].slice(0, 2000)).texts()
        tags = [split_tag(w) for w in words]
        if words and sum(tag.role in SIGNALS and bool(tag.loop) for tag in tags) >= max(1, len(words) / 2):
            return i
    return None


def _wide(table: Table, options: ReadOptions) -> list[Series]:
    axis, used = time_axis(table, options)
    roles = [split_tag(name) for name in table.names]
    values = [
        i
        for i, name in enumerate(table.names)
        if i not in used
        and not (table.columns[i].null_count == table.rows and not roles[i].role)
        and plain(name) not in IGNORED
        and not is_time_like(table, i)
    ]
    quality: dict[int, int] = {}
    by_name = {name: i for i, name in enumerate(table.names)}
    for i in values:
        tag = roles[i]
        if tag.role == "quality" and tag.of in by_name:
            quality[by_name[tag.of]] = i
        elif (
            (tag.role == "quality" or plain(table.names[i]) in QUALITY)
            and i > 0
            and i - 1 in values
            and (not tag.of or roles[i - 1].loop == tag.loop)
        ):
            quality[i - 1] = i
    of_quality = set(quality.values())
    signals = [i for i in values if i not in of_quality]
    alone = {roles[i].role for i in signals if not roles[i].loop and roles[i].role in SIGNALS}
    home = table.partition.get("loop") or next((v for k, v in table.partition.items() if plain(k) in LOOP | TAG), "")
    if not alone and len(signals) == 1 and not (roles[signals[0]].loop and roles[signals[0]].role):
        return [_per_tag(table, axis, signals[0], quality.get(signals[0]), home)]
    found = []
    for i in signals:
        tag = roles[i]
        loop = tag.loop
        if not loop:
            loop = home or table.stem
            if not alone and tag.role not in SIGNALS:
                loop = ""
        elif alone and tag.role not in SIGNALS:
            loop, tag = home or table.stem, Tag("", "", table.names[i])
        elif home and alone:
            loop = home
        found.append(_series(table, axis, i, quality.get(i), table.names[i], loop, tag))
    return found


def _per_tag(table: Table, axis: Axis, value: int, quality: int | None, home: str) -> Series:
    """A file with one signal: its header, or else the file name, is the tag."""
    header = table.names[value]
    generic = plain(header) in VALUE or not header
    name = (home or table.stem) if generic else header
    tag = split_tag(name)
    if not generic and not tag.loop and split_tag(table.stem).role in SIGNALS:
        name, tag = table.stem, split_tag(table.stem)
    return _series(table, axis, value, quality, name, tag.loop, tag)


def _series(table: Table, axis: Axis, column: int, quality: int | None, name: str, loop: str, tag: Tag) -> Series:
    role = tag.role if tag.role in SIGNALS else ""
    return Series(
        name,
        loop,
        role,
        tag.signal,
        axis,
        Cells(table.columns[column], table.decimal),
        None if quality is None else Cells(table.columns[quality]),
        table.where,
    )


def _long(table: Table, options: ReadOptions) -> list[Series]:
    words = [plain(name) for name in table.names]
    axis, used = time_axis(table, options)
    texts = [i for i, column in enumerate(table.columns) if _is_text(column) and i not in used]
    field = [i for i in texts if words[i] in ("field", "signal", "parameter", "variable")]
    group = [i for i in texts if words[i] in LOOP or words[i] == "measurement"]
    tags = [i for i in texts if words[i] in TAG]
    if field and group:
        name_columns = [group[0], field[0]]
    elif tags:
        name_columns = [tags[0]]
    else:
        guess = _tag_column(table, texts)
        if guess is None:
            raise InputError("no column of tag names found", where=table.where, remedy="name it 'tag'")
        name_columns = [guess]
    quality = next((i for i, w in enumerate(words) if w in QUALITY and i not in name_columns and i not in used), None)
    taken = {*name_columns, *used, quality}
    named = [i for i, w in enumerate(words) if w in VALUE and i not in taken]
    numeric = [
        i
        for i, c in enumerate(table.columns)
        if i not in taken and not _is_text(c) and words[i] not in IGNORED and not is_time_like(table, i)
    ]
    rest = [i for i in texts if i not in taken]
    candidates = named or numeric or rest
    if not candidates:
        raise InputError("no column of values found", where=table.where, remedy="name it 'value'")
    codes, names = Cells(table.columns[name_columns[0]]).texts()
    if len(name_columns) == 2:
        second, fields = Cells(table.columns[name_columns[1]]).texts()
        joined = np.where((codes < 0) | (second < 0), -1, codes * len(fields) + second)
        names = [f"{name}.{field_name}" for name in names for field_name in fields]
        codes = joined
    cells = Cells(table.columns[candidates[0]], table.decimal).split()
    marks = None if quality is None else Cells(table.columns[quality]).split()
    order = np.argsort(codes, kind="stable")
    present, starts = np.unique(codes[order], return_index=True)
    ends = np.append(starts[1:], len(order))
    found = []
    for code, start, end in zip(present, starts, ends, strict=True):
        if code < 0 or not names[code].strip():
            continue
        rows = order[start:end]
        name = names[code].strip()
        tag = split_tag(name)
        found.append(
            Series(
                name,
                tag.loop,
                tag.role if tag.role in SIGNALS else "",
                tag.signal,
                axis.take(rows),
                cells.take(rows),
                None if marks is None else marks.take(rows),
                table.where,
            )
        )
    return _without_echo(found)


def _without_echo(found: list[Series]) -> list[Series]:
    """Two spellings of one tag (blank at the end, for example) are one signal; leave them for the joining step."""
    return found


def _tall(table: Table, options: ReadOptions) -> list[Series]:
    """A column names the loop; SP, PV and OP stand beside it."""
    axis, used = time_axis(table, options)
    words = [plain(name) for name in table.names]
    which = next(i for i, w in enumerate(words) if w in LOOP and _is_text(table.columns[i]))
    codes, names = Cells(table.columns[which]).texts()
    columns = [
        i
        for i, w in enumerate(words)
        if i not in used
        and i != which
        and w not in IGNORED
        and w not in QUALITY
        and table.columns[i].null_count < table.rows
    ]
    parts = {i: Cells(table.columns[i], table.decimal).split() for i in columns}
    found = []
    for code in np.unique(codes):
        if code < 0 or not names[code].strip():
            continue
        rows = np.flatnonzero(codes == code)
        own = axis.take(rows)
        for i in columns:
            role = signal_role(table.names[i])
            loop = names[code].strip()
            found.append(
                Series(
                    f"{loop}.{table.names[i]}", loop, role, table.names[i], own, parts[i].take(rows), None, table.where
                )
            )
    return found


def _pairs(table: Table, options: ReadOptions) -> list[Series]:
    """Every tag has a time column of its own, shorter ones padded with empty cells."""
    times = time_columns(table)
    found = []
    for position, column in enumerate(times):
        end = times[position + 1] if position + 1 < len(times) else len(table.names)
        block = [i for i in range(column + 1, end) if table.columns[i].null_count < table.rows or table.names[i]]
        values = [
            i for i in block if split_tag(table.names[i]).role != "quality" and plain(table.names[i]) not in QUALITY
        ]
        if not values:
            continue
        value = values[0]
        marks = next((i for i in block if i not in values), None)
        owner = split_tag(table.names[column])
        name = table.names[value]
        if plain(name) in VALUE or not name or plain(name.rpartition(".")[2]) in VALUE:
            name = owner.of or name.rpartition(".")[0] or table.names[column]
        axis, _ = time_axis(table, options, only=column)
        keep = np.flatnonzero(axis.micros != np.iinfo(np.int64).min)
        tag = split_tag(name)
        found.append(
            Series(
                name,
                tag.loop,
                tag.role if tag.role in SIGNALS else "",
                tag.signal,
                axis.take(keep),
                Cells(table.columns[value], table.decimal).split().take(keep),
                None if marks is None else Cells(table.columns[marks]).split().take(keep),
                table.where,
            )
        )
    return found


def repeated(found: list[Series]) -> dict[str, int]:
    """Tags that stand in one file more than once."""
    counted = Counter(series.tag for series in found)
    return {tag: count for tag, count in counted.items() if count > 1}


def _shown(names: tuple[str, ...]) -> str:
    shown = ", ".join((name or "(blank)")[:40] for name in names[:8])
    return shown + (", ..." if len(names) > 8 else "")
