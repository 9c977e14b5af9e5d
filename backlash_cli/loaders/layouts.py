"""Which column is what: wide, single-loop, long, tag pairs or one tag per file; tables become Series."""

from __future__ import annotations

from ..errors import InputError
from .long_layouts import long_series, name_columns, pair_series, tall_series
from .names import IGNORED, LOOP, QUALITY, SIGNALS, TAG, VALUE, Tag, plain, signal_role, split_tag
from .options import ReadOptions
from .series import Axis, Cells, Series
from .tables import Table
from .timecolumns import is_time_like, time_axis, time_columns


def series_of(table: Table, options: ReadOptions) -> list[Series]:
    """Take a table apart into signals. Raises InputError when there is no time column or no signal."""
    layout = layout_of(table, options)
    readers = {"long": long_series, "pairs": pair_series, "tall": tall_series, "wide": _wide, "single": _wide}
    found = readers[layout](table, options)
    if not found:
        raise InputError(
            f"no signal columns found beside the time (columns: {_shown(table.names)})",
            where=table.where,
            remedy="name columns LOOP.SP, LOOP.PV, LOOP.OP, or name the tags in loops.toml",
        )
    return found


def layout_of(table: Table, options: ReadOptions) -> str:
    """Return the arrangement of a table: as the user says, else as its columns look."""
    return options.layout or _recognise(table)


def _recognise(table: Table) -> str:
    words = [plain(name) for name in table.names]
    times = time_columns(table)
    texts = [i for i in range(len(words)) if table.is_text(i) and i not in times]
    roles = [split_tag(name) for name in table.names]
    alone = {tag.role for tag in roles if not tag.loop and tag.role in SIGNALS}
    wide = any(tag.loop and tag.role in SIGNALS for tag in roles)
    if "pv" in alone and not any(word in VALUE for word in words):
        return "tall" if any(words[i] in TAG | LOOP | {"measurement"} for i in texts) else "wide"
    if len(times) >= 2 and _paired(table, times):
        return "pairs"
    if texts and times and not wide and name_columns(table, texts):
        return "long"
    return "wide"


def _paired(table: Table, times: list[int]) -> bool:
    """Time columns that are each followed by a value of their own."""
    followed = all(i + 1 < len(table.names) and i + 1 not in times for i in times)
    return followed and not any(table.kind(i) == "clock" for i in times)


def _wide(table: Table, options: ReadOptions) -> list[Series]:
    axis, used = time_axis(table, options)
    roles = [split_tag(name) for name in table.names]
    values = [
        i
        for i, name in enumerate(table.names)
        if i not in used
        and (roles[i].role or table.columns[i].null_count != table.rows)
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
    home = _partition_name(table)
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


def _partition_name(table: Table) -> str:
    """The loop or tag that the folders name: loop=FIC101, tag=FIC101.PV, or loop=FIC101/signal=PV."""
    loop = next((v for k, v in table.partition.items() if plain(k) in LOOP), "")
    rest = [v for k, v in table.partition.items() if plain(k) in TAG]
    role = next((v for v in rest if signal_role(v)), "")
    if role and (loop or len(rest) > 1):
        return f"{loop or next(v for v in rest if v != role)}.{role}"
    return loop or (rest[0] if rest else "")


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


def _shown(names: tuple[str, ...]) -> str:
    shown = ", ".join((name or "(blank)")[:40] for name in names[:8])
    return shown + (", ..." if len(names) > 8 else "")
