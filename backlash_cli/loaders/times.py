"""Stamps of every usual kind to microseconds since 1970-01-01 UTC.

Dates are taken apart by one regular expression for the whole column; day and month are told apart only where
the data leave no doubt, otherwise the user is asked for --time-format.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import InputError
from ..record import Note
from .arrays import to_array
from .hourly_stamps import HourlyStamps
from .minutes import whole_minutes
from .number_units import unit_of_numbers
from .numbers import codes_and_words, to_numbers
from .options import ReadOptions

NAT = np.iinfo(np.int64).min
SECOND = 1_000_000
DAY = 86_400 * SECOND
LIMIT = 4_000_000_000_000_000_000  # differences of two stamps still fit into 64 bits


@dataclass(frozen=True)
class Times:
    """micros: (rows,) int64 microseconds since 1970 UTC, NAT where unreadable. absolute: False for seconds from
    an unknown start. zoned: the stamps carried an offset."""

    micros: NDArray[np.int64]
    absolute: bool = True
    zoned: bool = False
    notes: tuple[Note, ...] = field(default=())


def to_times(column: pa.ChunkedArray | pa.Array | HourlyStamps, name: str, options: ReadOptions, where: str) -> Times:
    """Read a column of stamps. Raises InputError when it holds none or day and month cannot be told apart."""
    if isinstance(column, HourlyStamps):
        return in_zone(_hour_by_hour(column, name, options, where), options)
    kind = column.type
    if pa.types.is_dictionary(kind) and not pa.types.is_string(kind.value_type):
        column = column.cast(kind.value_type)
        kind = column.type
    if pa.types.is_timestamp(kind):
        times = Times(_micros(column, kind.unit), zoned=kind.tz is not None)
    elif pa.types.is_date(kind):
        times = Times(_micros(column.cast(pa.timestamp("s")), "s"))
    elif pa.types.is_time(kind):
        unit = kind.unit
        integers = column.cast(pa.int32() if pa.types.is_time32(kind) else pa.int64()).cast(pa.int64())
        times = _of_day(_scaled(_integers(integers), unit))
    elif pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_dictionary(kind):
        times = _by_minutes(column, name, options, where) or from_text(column, name, options, where)
    elif pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind):
        times = from_numbers(to_numbers(column).values, name, options, where)
    else:
        raise InputError(f"column {name!r} holds no time stamps ({kind})", where=where, remedy="name the time column")
    return in_zone(times, options)


def in_zone(times: Times, options: ReadOptions) -> Times:
    """Return stamps in UTC, where they are written in the zone that the options name."""
    if not times.zoned and times.absolute and options.timezone:
        from .zones import localise

        return localise(times, options.timezone)
    return times


def _hour_by_hour(column: HourlyStamps, name: str, options: ReadOptions, where: str) -> Times:
    hours = column.hours()
    try:
        times = from_text(hours.texts, name, options, where)
    except InputError:
        return from_text(column.arrow(), name, options, where)  # says it of the stamps as they are written
    begin = times.micros[hours.which]
    return replace(times, micros=np.where(begin == NAT, NAT, begin + hours.nanos // 1000))


def _by_minutes(column: pa.ChunkedArray | pa.Array, name: str, options: ReadOptions, where: str) -> Times | None:
    """Read written stamps of one form, one text per minute; None where that cannot be done."""
    split = whole_minutes(column) if options.time_format is None else None
    if split is None:
        return None
    texts, which, seconds = split
    try:
        times = from_text(texts, name, options, where)
    except InputError:
        return None  # said once more of the stamps as they are written
    minutes = times.micros[which]
    return replace(times, micros=np.where(minutes == NAT, NAT, minutes + seconds))


def from_numbers(
    values: NDArray[np.float64], name: str, options: ReadOptions, where: str,
    unit_and_digits: tuple[str, str] | None = None,
) -> Times:
    """Read numeric stamps: epoch seconds to nanoseconds, spreadsheet days, or seconds from an unknown start.

    unit_and_digits: as `unit_of_numbers` finds it, where it is known already.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        raise InputError(f"time column {name!r} holds no time stamps", where=where, remedy="name it with --time-format")
    unit, digits = unit_and_digits or unit_of_numbers(known, name, options)
    if digits:
        return _from_digits(values, digits)
    notes: list[Note] = []
    factor, zero, absolute = {
        "epoch_s": (1e6, 0.0, True), "epoch_ms": (1e3, 0.0, True), "epoch_us": (1.0, 0.0, True),
        "epoch_ns": (1e-3, 0.0, True), "excel": (float(DAY), 25569.0, True),
        "labview": (1e6, 2082844800.0, True), "filetime": (0.1, 116444736e9, True),
        "seconds": (1e6, 0.0, False), "millis": (1e3, 0.0, False), "minutes": (6e7, 0.0, False),
        "hours": (3.6e9, 0.0, False), "days": (float(DAY), 0.0, False),
    }.get(unit, (0.0, 0.0, True))  # fmt: skip
    if not factor:
        raise InputError(
            f"column {name!r} holds numbers, not {unit!r} stamps", where=where, remedy="mend --time-format"
        )
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = (values - zero) * factor
    if unit == "excel":
        # a day number carries about 2 microseconds of rounding; stamps are written to the millisecond at best
        scaled = np.rint(scaled / 1000.0) * 1000.0
        notes.append(Note("time_format", "times are spreadsheet day numbers (days since 1899-12-30)"))
    if not absolute:
        notes.append(Note("relative_time", f"times of {name!r} count from an unknown start; shown from 1970-01-01"))
    out = np.full(len(values), NAT)
    usable = np.isfinite(scaled) & (np.abs(scaled) < LIMIT)
    out[usable] = np.rint(scaled[usable]).astype(np.int64)
    return Times(out, absolute, zoned=unit.startswith("epoch") or not absolute, notes=tuple(notes))


def _from_digits(values: NDArray[np.float64], pattern: str) -> Times:
    from .dates import days_of

    present = np.isfinite(values)
    whole = np.where(present, values, 0.0).astype(np.int64) * (1 if pattern == "ymdhms" else 100)
    days = days_of(whole // 10**10, whole // 10**8 % 100, whole // 10**6 % 100)
    known = present & (days != NAT)
    clock = ((whole // 10**4 % 100) * 60 + whole // 100 % 100) * 60 + whole % 100
    return Times(np.where(known, np.where(known, days, 0) * DAY + clock * SECOND, NAT))


def from_text(column: pa.ChunkedArray | pa.Array, name: str, options: ReadOptions, where: str) -> Times:
    """Read written stamps. Raises InputError when they are not understood."""
    codes, words = codes_and_words(column)
    if options.time_format and "%" in options.time_format:
        micros, zoned = _by_pattern(words, options.time_format), False
        notes: tuple[Note, ...] = ()
    else:
        from .dates import parse_dates

        micros, zoned, clock_only, notes = parse_dates(words, options.time_format, codes, where, name)
        if clock_only:
            times = _of_day(np.append(micros, NAT)[codes])
            return Times(times.micros, True, zoned, (*times.notes, *notes))
        if not np.any(micros != NAT) and words:
            numbers = to_numbers(column)
            if np.isfinite(numbers.values).mean() > 0.5:
                return from_numbers(numbers.values, name, options, where)
    if not np.any(micros != NAT):
        shown = next((w for w in words if w.strip()), "")[:40]
        raise InputError(
            f"time column {name!r} holds no readable time stamps (for example {shown!r})",
            where=where,
            remedy="describe them with --time-format, for example --time-format '%d/%m/%Y %H:%M:%S'",
        )
    return Times(np.append(micros, NAT)[codes], True, zoned, notes)


def _by_pattern(words: list[str], pattern: str) -> NDArray[np.int64]:
    import pandas as pd

    try:
        stamps = pd.to_datetime(pd.Series(words, dtype="str").str.strip(), format=pattern, errors="coerce", utc=True)
    except (ValueError, TypeError, OverflowError) as error:
        raise InputError(f"bad --time-format {pattern!r}: {error}", remedy="for example '%d/%m/%Y %H:%M:%S'") from None
    values = stamps.to_numpy(dtype="datetime64[us]")
    return values.astype(np.int64)


def _of_day(micros: NDArray[np.int64]) -> Times:
    """Times of day without a date: count on past midnight."""
    known = np.flatnonzero(micros != NAT)
    out = micros.copy()
    if len(known):
        steps = np.diff(micros[known])
        days = np.concatenate([[0], np.cumsum(steps < -DAY // 2)])
        out[known] = micros[known] + days * DAY
    note = Note("relative_time", "times of day without a date: shown from 1970-01-01")
    return Times(out, True, True, (note,))


def _micros(column: pa.ChunkedArray | pa.Array, unit: str) -> NDArray[np.int64]:
    return _scaled(_integers(column.cast(pa.int64())), unit)


def _integers(column: pa.ChunkedArray | pa.Array) -> NDArray[np.int64]:
    if column.null_count:
        column = pc.fill_null(column, NAT)
    return to_array(column)


def _scaled(integers: NDArray[np.int64], unit: str) -> NDArray[np.int64]:
    missing = integers == NAT
    if unit == "us":
        far = (integers > LIMIT) | (integers < -LIMIT)
        return np.where(far, NAT, integers) if far.any() else integers
    if unit == "ns":
        out = integers // 1000
    else:
        factor = SECOND if unit == "s" else 1000
        far = np.abs(integers.astype(np.float64)) > LIMIT / factor
        out = np.where(far, 0, integers) * factor
        missing = missing | far
    if missing.any():
        out[missing] = NAT
    return out
