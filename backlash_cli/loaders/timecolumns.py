"""Which columns of a table hold the time, and the axis they make."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import InputError
from .arrays import to_array
from .columns import LazyColumn
from .even import LONG, StampColumn, even_stamps
from .hourly_stamps import HourlyStamps
from .kept_axis import kept_axis, kept_parts
from .names import is_time_name, plain, split_tag
from .options import ReadOptions
from .parquet_columns import ParquetColumn
from .series import Axis, EvenAxis, LazyAxis
from .tables import Table
from .times import DAY, NAT, Times, to_times

_BOUNDS = ("start", "stop", "end", "from", "to", "begin", "starttime", "endtime", "stoptime", "intervalstart")


_STAMPS = {pa.lib.Type_TIMESTAMP, pa.lib.Type_DATE32, pa.lib.Type_DATE64, pa.lib.Type_TIME32, pa.lib.Type_TIME64}


@lru_cache(1 << 16)
def _of_time(name: str) -> tuple[bool, bool]:
    """Whether a column is called after the begin or end of something, and whether after the time."""
    return plain(name) in _BOUNDS, is_time_name(name) or split_tag(name).role == "time"


def is_time_like(table: Table, column: int) -> bool:
    """Say whether a column holds dates or times of day (by type, or by what its first cells look like)."""
    kind = table.columns[column].type
    return kind.id in _STAMPS or (table.kind(column) in ("time", "clock") and not _is_number(kind))


def _arrow(table: Table, column: int) -> pa.ChunkedArray:
    cells = table.columns[column]
    return cells.arrow() if isinstance(cells, LazyColumn) else cells


def _is_number(kind: pa.DataType) -> bool:
    return pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)


def time_columns(table: Table) -> list[int]:
    """Return the columns that hold stamps, numeric ones only when their header says so."""
    found = []
    for i, name in enumerate(table.names):
        bound, named = _of_time(name)
        if bound or pa.types.is_null(table.columns[i].type):
            continue
        if is_time_like(table, i) or (named and _is_number(table.columns[i].type)):
            found.append(i)
    if not found:
        found = [i for i, name in enumerate(table.names) if is_time_name(name)][:1]
    if (
        not found
        and _is_number(table.columns[0].type)
        and not split_tag(table.names[0]).role
        and _rising(_arrow(table, 0))
    ):
        found = [0]
    return found


def _rising(column: pa.ChunkedArray) -> bool:
    head = to_array(column.slice(0, 200).cast(pa.float64(), safe=False))
    return len(head) > 1 and bool(np.all(np.diff(head) > 0))


def time_axis(table: Table, options: ReadOptions, only: int | None = None) -> tuple[Axis, set[int]]:
    """Return the axis of a table and the columns it uses. Raises InputError when the table has no time column."""
    columns = time_columns(table) if only is None else [only]
    if not columns:
        raise InputError(
            "no time column found",
            where=table.where,
            remedy="name the column of time stamps 'timestamp', or say how they are written with --time-format",
        )
    if only is None and len(columns) > 1:
        joined = _date_and_clock(table, columns, options)
        if joined is not None:
            return joined
    chosen = columns[0] if only is not None else _preferred(table, columns)
    return _axis(table, chosen, options), set(columns)


def _preferred(table: Table, columns: list[int]) -> int:
    """Of several columns of stamps, the one that says most."""
    utc = [i for i in columns if "utc" in plain(table.names[i]) or "epoch" in plain(table.names[i])]
    named = [i for i in columns if is_time_name(table.names[i])]
    return (utc or named or columns)[0] if len(columns) > 1 else columns[0]


def stamp_columns(table: Table, options: ReadOptions) -> tuple[int, ...]:
    """Return the columns that `time_axis` reads the stamps from: one, or those of date and time of day.

    None of them where there is no such column, or where the first rows do not tell.
    """
    columns = time_columns(table)
    dates, clocks = _dates_and_clocks(table, columns)
    if not dates or not clocks:
        return (_preferred(table, columns),) if columns else ()
    return (dates[0], clocks[0]) if _date_and_clock(table, columns, options) is not None else ()


def _dates_and_clocks(table: Table, columns: list[int]) -> tuple[list[int], list[int]]:
    clocks = [i for i in columns if pa.types.is_time(table.columns[i].type) or table.kind(i) == "clock"]
    return [i for i in columns if i not in clocks], clocks


def _axis(table: Table, column: int, options: ReadOptions) -> Axis:
    """The axis of one column of stamps; those of a Parquet file that need no interpretation stay in the file."""
    cells = table.columns[column]
    if isinstance(cells, LazyColumn):
        kind = cells.type
        if pa.types.is_timestamp(kind) and (kind.tz is not None or not options.timezone):
            if isinstance(cells, StampColumn):
                return LazyAxis(cells.times, kind.tz is not None, table.where, cells.pieces, table.first_line)
            even = even_stamps(cells)
            if even is not None and even.micros[1]:
                return EvenAxis(*even.micros, len(even), kind.tz is not None, table.where, table.first_line)
            pieces = partial(_stamp_pieces, cells, options, table.where) if isinstance(cells, ParquetColumn) else None
            return LazyAxis(partial(_stamps, cells, options, table.where), kind.tz is not None, table.where, pieces)
        if len(cells) > LONG:
            kept = kept_axis(cells, table.names[column], options, table.where, table.first_line)
            if kept is not None:
                return kept
        cells = cells if isinstance(cells, HourlyStamps) else cells.arrow()
    return Axis(to_times(cells, table.names[column], options, table.where), table.where, table.first_line)


def _stamps(cells: LazyColumn, options: ReadOptions, where: str) -> Times:
    return to_times(cells.arrow(), "", options, where)


def _stamp_pieces(cells: ParquetColumn, options: ReadOptions, where: str) -> Iterator[NDArray[np.int64]]:
    return (to_times(piece, "", options, where).micros for piece in cells.file.pieces(cells.index, cells.first))


def _date_and_clock(table: Table, columns: list[int], options: ReadOptions) -> tuple[Axis, set[int]] | None:
    dates, clocks = _dates_and_clocks(table, columns)
    if not clocks or not dates:
        return None
    apart = _arrow(table, dates[0]), _arrow(table, clocks[0])
    if table.rows > LONG and pa.types.is_date(apart[0].type) and pa.types.is_time(apart[1].type):
        kept = kept_parts(*apart, options, table.where, table.first_line)
        return None if kept is None else (kept, {dates[0], clocks[0]})
    bare = replace(options, timezone=None)
    date = to_times(apart[0], table.names[dates[0]], bare, table.where)
    known = date.micros != NAT
    if np.any(date.micros[known] % DAY):
        return None
    clock = to_times(apart[1], table.names[clocks[0]], replace(bare, time_format=None), table.where)
    both = known & (clock.micros != NAT)
    micros = np.where(both, date.micros + clock.micros % DAY, NAT)
    times = Times(micros, True, False, date.notes)
    if options.timezone:
        from .zones import localise

        times = localise(times, options.timezone)
    return Axis(times, table.where, table.first_line), {dates[0], clocks[0]}
