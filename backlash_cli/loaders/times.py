"""Stamps of every usual kind to microseconds since 1970-01-01 UTC, block by block.

Written dates are read by one expression for the whole column and arithmetic on its parts. What only the whole file can
tell (which of day and month comes first, times of day past midnight, the hour that occurs twice) is found out when all
blocks were seen: until then a stamp with an open date stands as the number of its date.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import InputError
from ..record import FloatArray, IntArray, Note
from .names import plain
from .numbers import codes_and_words, is_number, is_text, plain_numbers, to_array
from .options import ReadOptions
from .order import DAY, HOUR, NAT, SECOND

_WEEKDAY = r"(?:\pL{2,10}\.?,?\s+)?"
_CLOCK = (r"(?P<h>\d{1,2})[:.h](?P<mi>\d{2})(?:[:.](?P<s>\d{2})(?:[.,:](?P<f>\d{1,9})\d*)?)?"
          r"\s*(?P<ap>[AaPp]\.?\s?[Mm]\.?)?\s*"
          r"(?P<z>Z|z|[+-]\d{1,2}:?\d{0,2}|[A-Z]{2,5}(?:[+-]\d{1,2}(?::?\d{2})?)?)?")  # fmt: skip
_MONTH_WORD = r"|\pL{3,12}\.?"
_DATED = (rf"^\s*{_WEEKDAY}(?P<a>\d{{1,4}}{_MONTH_WORD})(?P<sep>[-/. ]+)(?P<b>\d{{1,2}}{_MONTH_WORD})[-/. ,]+"
          rf"(?P<c>\d{{1,4}})(?:[T_ ,:]+{_CLOCK})?\s*(?:\[[^\]]*\]|\([^)]*\))?\s*$")  # fmt: skip
# narrower ones first: it takes 25 ms to compile an expression with the letters of all alphabets
_DATES = (_DATED.replace(_WEEKDAY, "").replace(_MONTH_WORD, ""), _DATED.replace(r"\pL", "[A-Za-z]"), _DATED)
_COMPACT = (r"^\s*(?P<y>(?:19|20)\d{2})(?P<m>\d{2})(?P<d>\d{2})(?:[T_ -]?(?P<h>\d{2}):?(?P<mi>\d{2})(?::?(?P<s>\d{2})"
            r"(?:[.,]?(?P<f>\d{1,9}))?)?)?\s*(?P<z>Z|[+-]\d{2}:?\d{0,2})?\s*$")  # fmt: skip
_UNIX_DATE = r"^\s*\pL{3}\s+(\pL{3}\s+\d{1,2})\s+(\d{1,2}:\d{2}:\d{2})\s+((?:[A-Z]{3,4}\s+)?)(\d{4})\s*$"
_CLOCK_ONLY = rf"^\s*{_CLOCK}\s*$"
_MONTHS = ("jan ene gen jän january januar janvier enero gennaio januari janeiro",
           "feb fév fev february februar février febrero febbraio februari fevereiro",
           "mar mär mrz maa march märz mars marzo maart março maerz", "apr avr abr april avril abril aprile",
           "may mai maj mei mag mayo maggio maio", "jun jui giu june juni juin junio giugno junho",
           "jul lug july juli juillet julio luglio julho juil",
           "aug aoû ago aou august août agosto augustus augusti aout",
           "sep set sept september septembre septiembre settembre setembro",
           "oct okt ott out october oktober octobre octubre ottobre outubro",
           "nov november novembre noviembre novembro",
           "dec dez déc dic des december dezember décembre diciembre dicembre dezembro")
MONTH = {word: number for number, words in enumerate(_MONTHS, 1) for word in words.split()}
ZONES = {"Z": 0, "UTC": 0, "GMT": 0, "UT": 0, "WET": 0, "WEST": 60, "BST": 60, "CET": 60, "MEZ": 60, "CEST": 120,
         "MESZ": 120, "EET": 120, "EEST": 180, "MSK": 180, "EST": -300, "EDT": -240, "CST": -360, "CDT": -300,
         "MST": -420, "MDT": -360, "PST": -480, "PDT": -420, "AKST": -540, "AKDT": -480, "HST": -600, "JST": 540,
         "KST": 540, "SGT": 480, "HKT": 480, "AEST": 600, "AEDT": 660, "AWST": 480}
_PLACES = np.array([10**8, 10**4, 1])  # bring the three numbers of a date into one
Readings = dict[str, tuple[IntArray, ...]]  # kind -> year, month, day
LIMIT = 4_000_000_000_000_000_000  # differences of two stamps still fit into 64 bits
_FACTORS = {  # unit of numbers: (microseconds, zero, counted from a known moment)
    "epoch_s": (1e6, 0.0, True), "epoch_ms": (1e3, 0.0, True), "epoch_us": (1.0, 0.0, True),
    "epoch_ns": (1e-3, 0.0, True), "excel": (float(DAY), 25569.0, True), "labview": (1e6, 2082844800.0, True),
    "filetime": (0.1, 116444736e9, True), "seconds": (1e6, 0.0, False), "millis": (1e3, 0.0, False),
    "minutes": (6e7, 0.0, False), "hours": (3.6e9, 0.0, False), "days": (float(DAY), 0.0, False),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Dates:
    """Texts read as stamps. micros: (words,) microseconds, NAT where nothing was read or where day and month are open.
    zoned: (words,) they carry an offset. open: words whose date has three numbers without a year in front; parts:
    (open, 3) these numbers; clock: (open,) microseconds after midnight UTC. short: all their years have two digits.
    separator, am_pm: how the first of them is written. of_day: the texts are times of day only.
    """

    micros: IntArray
    zoned: NDArray[np.bool_]
    open: IntArray
    parts: IntArray
    clock: IntArray
    short: bool = True
    separator: str = ""
    am_pm: bool = False
    of_day: bool = False


def read_dates(words: list[str]) -> Dates:
    """Read texts as dates with or without a time of day, or as times of day."""
    text = _tidy(pa.array(words, pa.string()))
    micros = np.full(len(words), NAT)
    zoned = np.zeros(len(words), bool)
    for expression in _DATES:
        fields = pc.extract_regex(text, expression)
        if not fields.null_count:
            break
    dated = np.flatnonzero(_numpy(fields.is_valid()))
    unclear = Dates(micros, zoned, np.zeros(0, np.int64), np.zeros((0, 3), np.int64), np.zeros(0, np.int64))
    if len(dated):
        unclear = _dated(fields.take(pa.array(dated)), dated, micros, zoned)
    unread = micros == NAT
    unread[unclear.open] = False
    rest = np.flatnonzero(unread)
    of_day = False
    if len(rest):
        compact = pc.extract_regex(text.take(pa.array(rest)), _COMPACT)
        valid = _numpy(compact.is_valid())
        clock = None if valid.any() or len(dated) else pc.extract_regex(text.take(pa.array(rest)), _CLOCK_ONLY)
        if valid.any():
            fields = compact.filter(pa.array(valid))
            days = days_of(_int(fields, "y"), _int(fields, "m"), _int(fields, "d"))
            micros[rest[valid]], zoned[rest[valid]] = _with_clock(days, fields)
        elif clock is not None and (valid := _numpy(clock.is_valid())).sum() > len(rest) / 2:
            fields = clock.filter(pa.array(valid))
            micros[rest[valid]] = _with_clock(np.zeros(int(valid.sum()), np.int64), fields)[0]
            of_day = True
    return replace(unclear, of_day=of_day)


def _tidy(text: pa.Array) -> pa.Array:
    """Bring rare ways of writing to the common ones: quotes, East Asian date signs, and the year at the end."""
    text = pc.replace_substring_regex(text, r"^\s*['\"]|['\"]\s*$", "")
    text = pc.replace_substring_regex(text, r"^(\d{4})年(\d{1,2})月(\d{1,2})日", r"\1-\2-\3")
    if pc.any(pc.match_substring_regex(text, r"^\s*[^\d\s]")).as_py():
        text = pc.replace_substring_regex(text, _UNIX_DATE, r"\1 \4 \2 \3")
    return text


def _dated(fields: pa.StructArray, at: IntArray, micros: IntArray, zoned: NDArray[np.bool_]) -> Dates:
    """Put clear dates into `micros` and `zoned` where they belong, and return those that are not."""
    a, a_month = _month_or_int(fields, "a")
    b, b_month = _month_or_int(fields, "b")
    c = _int(fields, "c")
    year_first = (_length(fields, "a") == 4) & ~a_month
    year = full_year(np.where(year_first, a, c))
    days = days_of(year, np.where(a_month, a, b), np.where(year_first, c, np.where(a_month, b, a)))
    unclear = ~year_first & ~a_month & ~b_month
    out, has_zone = _with_clock(np.where(unclear, 0, days), fields)
    micros[at[~unclear]] = out[~unclear]
    zoned[at] = has_zone
    rows = np.flatnonzero(unclear)
    first = fields[int(rows[0])].as_py() if len(rows) else {}
    good = rows[out[rows] != NAT]
    return Dates(micros, zoned, at[good], np.stack([a, b, c], 1)[good], out[good], bool(len(rows))
                 and bool((_length(fields, "c")[rows] <= 2).all()), first.get("sep") or "", bool(first.get("ap")))


class DateOrder:
    """Finds out which of day, month and year comes first, from all dates of a file in their order.

    Every date has a number; `first` and `last` are the times of day it was seen with.
    """

    def __init__(self) -> None:
        self.codes: dict[tuple[int, int, int], int] = {}
        self.first: list[int] = []
        self.last: list[int] = []
        self.texts: list[int] = []  # how many have this date
        self.short, self.separator, self.am_pm = True, "", False

    def take(self, found: Dates) -> IntArray:
        """Return the numbers of the open dates."""
        if len(found.open):
            if not self.codes:
                self.separator, self.am_pm = found.separator, found.am_pm
            self.short &= found.short
        parts, place, counts = np.unique(found.parts @ _PLACES, return_inverse=True, return_counts=True)
        begins, ends = np.full(len(parts), -1), np.full(len(parts), -1)
        ends[place] = np.arange(len(place))
        begins[place[::-1]] = np.arange(len(place))[::-1]
        codes = np.zeros(len(parts), np.int64)
        for k in np.argsort(begins).tolist():
            a, b, c = found.parts[begins[k]].tolist()
            key = a, b, c
            if key not in self.codes:
                self.codes[key] = len(self.codes)
                self.first.append(int(found.clock[begins[k]]))
                self.last.append(0)
                self.texts.append(0)
            codes[k] = self.codes[key]
            self.last[codes[k]] = int(found.clock[ends[k]])
            self.texts[codes[k]] += int(counts[k])
        return codes[place]

    def days(self, order: str | None, where: str, name: str, notes: list[Note]) -> IntArray:
        """(dates,) Return the days since 1970 of all dates. Raises InputError when two readings are possible."""
        if not self.codes:
            return np.zeros(0, np.int64)
        a, b, c = np.array(list(self.codes), np.int64).T
        readings: Readings = {"dmy": (c, b, a), "mdy": (c, a, b), "ymd": (a, b, c)}
        chosen = order if order in readings else self._decided(readings, where, name, notes)
        year, month, day = readings[chosen]
        return days_of(full_year(year), month, day)

    def _decided(self, readings: Readings, where: str, name: str, notes: list[Note]) -> str:
        def possible(parts: tuple[IntArray, ...]) -> bool:
            _, month, day = parts
            fits = (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31)
            return float(np.average(fits, weights=self.texts)) > 0.99

        a, _, c = readings["ymd"]
        fitting = [kind for kind, parts in readings.items() if possible(parts) and (kind != "ymd" or self.short)]
        if len(fitting) > 1 and self.short and "ymd" in fitting:
            # two-digit years: only dates of this century are read, so a part above 31 decides
            decided = [kind for kind in fitting if kind != "ymd" and (c > 31).any()]
            fitting = decided or (["ymd"] if (a > 31).any() else fitting)
        if len(fitting) < 2:
            return fitting[0] if fitting else "dmy"
        even = self._even({kind: readings[kind] for kind in fitting})
        if even:
            return even
        if self.separator.strip() == "." and "dmy" in fitting:
            return "dmy"
        if self.am_pm and self.separator.strip() in ("/", "-") and "mdy" in fitting:
            notes.append(Note("time_format", "dates with AM/PM are read as month/day/year; --time-format dmy if not"))
            return "mdy"
        first = next(iter(self.codes))
        raise InputError(
            f"dates like {first[0]:02d}{self.separator}{first[1]:02d}{self.separator}{first[2]:02d} in {name!r} are "
            "ambiguous: is the day first?", where=where, code="ambiguous_dates",
            remedy="say it with --time-format dmy, mdy or a pattern such as '%d/%m/%Y %H:%M:%S'")

    def _even(self, readings: Readings) -> str:
        """The reading with which the time goes on over midnight where every other one jumps, "" if there is none."""
        if len(self.codes) < 2:
            return ""
        clock = (np.array(self.first[1:]) - np.array(self.last[:-1])) / DAY
        jumps = {}
        for kind, (year, month, day) in readings.items():
            days = days_of(full_year(year), month, day)
            ahead = np.abs(np.diff(days) + clock) if days.min() != NAT else np.array([np.inf])
            jumps[kind] = float(np.sum(ahead)), float(np.max(ahead))
        best = min(jumps, key=lambda kind: jumps[kind])
        others = [total for kind, (total, _) in jumps.items() if kind != best]
        return best if jumps[best][1] < 3.0 and min(others) > 5.0 * jumps[best][0] else ""


def full_year(year: IntArray) -> IntArray:
    """Years of two digits as they are meant."""
    return np.where(year < 70, year + 2000, np.where(year < 100, year + 1900, year))


def _with_clock(days: IntArray, fields: pa.StructArray) -> tuple[IntArray, NDArray[np.bool_]]:
    hour, minute, second = _int(fields, "h", 0), _int(fields, "mi", 0), _int(fields, "s", 0)
    bad = (days == NAT) | (hour > 24) | (minute > 59) | (second > 60)
    if "ap" in [fields.type.field(i).name for i in range(fields.type.num_fields)]:
        half = pc.utf8_lower(pc.utf8_slice_codeunits(fields.field("ap"), 0, 1))
        pm = _numpy(pc.equal(half, "p").fill_null(False))
        am = _numpy(pc.equal(half, "a").fill_null(False))
        hour = np.where(pm & (hour < 12), hour + 12, np.where(am & (hour == 12), 0, hour))
    fraction = pc.utf8_slice_codeunits(pc.utf8_rpad(pc.fill_null(fields.field("f"), ""), 6, "0"), 0, 6)
    micros = np.asarray(_numpy(fraction.cast(pa.int64())), np.int64)
    offset, zoned, unknown = _offsets(fields.field("z"))
    out = ((np.where(bad, 0, days) * 24 + hour) * 60 + minute - offset) * 60_000_000 + second * 1_000_000 + micros
    out[bad | unknown] = NAT
    return out, zoned


def _offsets(zone: pa.Array) -> tuple[IntArray, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return (minutes east of UTC, has a zone, zone is not known) for every stamp; zones are few and looked up once."""
    coded = pc.fill_null(zone, "").dictionary_encode()
    minutes, known = [], []
    for text in coded.dictionary.to_pylist():
        match = re.match(r"^([A-Za-z]*)([+-]\d{1,2})?:?(\d{2})?$", text)
        base = ZONES.get(text.upper()) if text else 0
        if base is None and match and match[2] and match[1].upper() in ("", "UTC", "GMT"):
            sign = -1 if match[2][0] == "-" else 1
            base = int(match[2]) * 60 + sign * int(match[3] or 0)
        minutes.append(base or 0)
        known.append(base is not None)
    index = _numpy(coded.indices)
    given = np.array([bool(t) for t in coded.dictionary.to_pylist()], bool)[index]
    return np.array(minutes, np.int64)[index], given, ~np.array(known, bool)[index]


def days_of(year: IntArray, month: IntArray, day: IntArray) -> IntArray:
    """Days since 1970-01-01; NAT where there is no such day."""
    bad = (month < 1) | (month > 12) | (day < 1) | (day > 31) | (year < 1) | (year > 9999)
    months = (12 * (np.where(bad, 1970, year) - 1970) + np.where(bad, 1, month) - 1).astype("datetime64[M]")
    days = months.astype("datetime64[D]") + (np.where(bad, 1, day) - 1)
    return np.where(bad | (days.astype("datetime64[M]") != months), NAT, days.astype(np.int64))


def _int(fields: pa.StructArray, name: str, missing: int = -1) -> IntArray:
    column = fields.field(name)
    filled = pc.if_else(pc.equal(pc.fill_null(column, ""), ""), str(missing), column)
    return np.asarray(_numpy(filled.cast(pa.int64())), np.int64)


def _month_or_int(fields: pa.StructArray, name: str) -> tuple[IntArray, NDArray[np.bool_]]:
    """Numbers of a part that may be a month's name (one of few words, looked up once each)."""
    coded = fields.field(name).dictionary_encode()
    numbers, names = [], []
    for word in coded.dictionary.to_pylist():
        if word.isdigit():
            numbers.append(int(word))
            names.append(False)
        else:
            key = word.lower().rstrip(".")
            numbers.append(MONTH.get(key, MONTH.get(key[:3], -1)))
            names.append(True)
    index = _numpy(coded.indices)
    return np.array(numbers, np.int64)[index], np.array(names, bool)[index]


def _length(fields: pa.StructArray, name: str) -> IntArray:
    return _numpy(pc.utf8_length(fields.field(name)))


def _numpy(cells: pa.Array) -> NDArray[Any]:
    return cells.to_numpy(zero_copy_only=False)


_OPEN, _SHIFT = -(1 << 62), 38  # stamps with an open date: from _OPEN on, the number of the date above so many bits


class StampReader:
    """Takes the stamps of a file block by block. names: of their column, or of those of date and time of day."""

    def __init__(self, names: Sequence[str], options: ReadOptions, where: str) -> None:
        self.name, self.options, self.where = names[0], options, where
        self.notes: list[Note] = []
        self.absolute = True
        self._known = False  # there was a stamp
        self._shown = ""  # a text that is none
        self._zoned = self._bare = False  # some stamps carry an offset, some do not
        self._order = DateOrder()
        self._unit = ""  # of stamps that are numbers
        self._of_day: tuple[int, int] | None = None  # last time of day without a date, and days since the first

    def take(self, columns: Sequence[pa.ChunkedArray]) -> IntArray:
        """Return the stamps of the next rows, to be given to what `finish` returns."""
        pattern = self.options.time_format or ""
        if len(columns) == 2 and "%" in pattern:
            date = self._texts(columns[0], pattern)
            clock = read_dates(words := [text or "" for text in columns[1].cast(pa.string()).to_pylist()]).micros
            return np.where((date == NAT) | (clock == NAT), NAT, date + clock % DAY) if words else date
        column = columns[0]
        if len(columns) == 2:
            column = pc.binary_join_element_wise(*(part.cast(pa.string()) for part in columns), " ")
        kind = column.type
        if pa.types.is_dictionary(kind) and not is_text(kind.value_type):
            column = column.cast(kind.value_type)
            kind = column.type
        if pa.types.is_timestamp(kind):
            return self._clear(_micros(column, kind.unit), kind.tz is not None)
        if pa.types.is_date(kind):
            return self._clear(_micros(column.cast(pa.timestamp("s")), "s"), False)
        if pa.types.is_time(kind):
            width = pa.int32() if pa.types.is_time32(kind) else pa.int64()
            return self._past_midnight(_scaled(_integers(column.cast(width).cast(pa.int64())), kind.unit))
        if pa.types.is_null(kind):
            return np.full(len(column), NAT)
        if is_text(kind):
            return self._texts(column, pattern)
        if is_number(kind):
            return self._numbers(to_array(column.cast(pa.float64(), safe=False)))
        raise InputError(f"column {self.name!r} holds no time stamps ({kind})", where=self.where,
                         remedy="name the time column")

    def finish(self) -> Callable[[IntArray], IntArray]:
        """Return what gives the stamps in UTC, to be called for all rows in file order. `notes` are complete after
        that. Raises InputError when there were no stamps, or when day and month cannot be told apart."""
        if not self._known:
            if self._unit or not self._shown:
                raise InputError(f"time column {self.name!r} holds no time stamps", where=self.where,
                                 remedy="name it with --time-format")
            raise InputError(f"time column {self.name!r} holds no readable time stamps (for example {self._shown!r})",
                             where=self.where,
                             remedy="describe them with --time-format, for example --time-format '%d/%m/%Y %H:%M:%S'")
        days = self._order.days(self.options.time_format, self.where, self.name, self.notes)
        if self._zoned and self._bare:
            self.notes.append(Note(
                "mixed_zones", "some time stamps carry an offset and some do not; the others count as UTC"))
        counted = self._unit.startswith("epoch") or not self.absolute or self._of_day is not None
        zoned = counted or (self._zoned and not self._bare)
        clock = WallClock(self.options.timezone) if self.options.timezone and not zoned and self.absolute else None
        self._clock = clock

        def resolved(stamps: IntArray) -> IntArray:
            if len(days):
                is_open = (stamps < -LIMIT) & (stamps != NAT)
                if is_open.any():
                    number = stamps[is_open] - _OPEN
                    day = days[number >> _SHIFT]
                    stamps = stamps.copy()
                    stamps[is_open] = np.where(day == NAT, NAT, day * DAY + (number & ((1 << _SHIFT) - 1)) - DAY)
            return stamps if clock is None else clock.utc(stamps)

        return resolved

    @property
    def all_notes(self) -> tuple[Note, ...]:
        """What is to be said of all stamps, when they were resolved."""
        clock = getattr(self, "_clock", None)
        return (*self.notes, *(clock.notes if clock is not None else ()))

    def _clear(self, micros: IntArray, zoned: bool) -> IntArray:
        if self._known and self._zoned and self._bare:
            return micros
        if bool(np.any(micros != NAT)):
            self._known = True
            self._zoned |= zoned
            self._bare |= not zoned
        return micros

    def _past_midnight(self, micros: IntArray) -> IntArray:
        """Times of day without a date: count on past midnight."""
        known = np.flatnonzero(micros != NAT)
        if self._of_day is None:
            self.notes.append(Note("relative_time", "times of day without a date: shown from 1970-01-01"))
        last, days = self._of_day or (0, 0)
        out = micros.copy()
        if len(known):
            self._known = True
            steps = np.diff(micros[known], prepend=last if self._of_day else micros[known[0]])
            passed = days + np.cumsum(steps < -DAY // 2)
            out[known] = micros[known] + passed * DAY
            last, days = int(micros[known[-1]]), int(passed[-1])
        self._of_day = last, days
        return out

    def _texts(self, column: pa.ChunkedArray | pa.Array, pattern: str) -> IntArray:
        codes, words = codes_and_words(column)
        if not words:
            return np.full(len(codes), NAT)
        self._shown = self._shown or next((word for word in words if word.strip()), "")[:40]
        if "%" in pattern:
            return self._clear(np.append(_by_pattern(words, pattern), NAT)[codes], False)
        if self._unit:
            return self._numbers(np.append(plain_numbers(words), np.nan)[codes])
        found = read_dates(words)
        if found.of_day and (self._of_day is not None or not self._known):
            return self._past_midnight(np.append(found.micros, NAT)[codes])
        if not len(found.open) and not np.any(found.micros != NAT) and not self._known:
            values = plain_numbers(words)
            if not np.isfinite(values).any():
                values = plain_numbers(words, ",")
            if np.isfinite(np.append(values, np.nan)[codes]).mean() > 0.5:
                return self._numbers(np.append(values, np.nan)[codes])
        return self._dates(codes, words, found)

    def _dates(self, codes: IntArray, words: list[str], found: Dates | None = None) -> IntArray:
        """The stamps of texts; they count in the order in which they first stand in the file."""
        found = read_dates(words) if found is None else found
        out = np.append(found.micros, NAT)
        out[found.open] = _OPEN + (self._order.take(found) << _SHIFT) + found.clock + DAY
        there = out[:-1] != NAT
        if there.any():
            self._known = True
            self._zoned |= bool(found.zoned[there].any())
            self._bare |= not found.zoned[there].all()
        return out[codes]

    def _numbers(self, values: FloatArray) -> IntArray:
        """Numeric stamps: epoch seconds to nanoseconds, spreadsheet days, or seconds from an unknown start."""
        known = values[np.isfinite(values)]
        out = np.full(len(values), NAT)
        if not len(known):
            return out
        if not self._unit and not self.options.time_format and _are_dates(known):
            self._unit = "digits"
        if self._unit == "digits":  # 20260317080000
            return self._dates(*codes_and_words(pa.array(values, from_pandas=True).cast(pa.int64(), safe=False).cast(
                pa.string())))
        if not self._unit:
            self._unit = self.options.time_format or _unit_of(known, self.name)
            if self._unit not in _FACTORS:
                raise InputError(f"column {self.name!r} holds numbers, not {self._unit!r} stamps", where=self.where,
                                 remedy="mend --time-format")
            if self._unit == "excel":
                self.notes.append(Note("time_format", "times are spreadsheet day numbers (days since 1899-12-30)"))
            self.absolute = _FACTORS.get(self._unit, (0, 0, True))[2]
            if not self.absolute:
                self.notes.append(Note("relative_time", f"times of {self.name!r} count from an unknown start; shown "
                                       "from 1970-01-01"))
        self._known = True
        factor, zero, _ = _FACTORS[self._unit]
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = (values - zero) * factor
        if self._unit == "excel":
            # a day number carries about 2 microseconds of rounding; stamps are written to the millisecond at best
            scaled = np.rint(scaled / 1000.0) * 1000.0
        usable = np.isfinite(scaled) & (np.abs(scaled) < LIMIT)
        out[usable] = np.rint(scaled[usable]).astype(np.int64)
        return out


def is_midnight(column: pa.ChunkedArray, name: str, options: ReadOptions, where: str) -> bool:
    """Say whether the stamps of a column are dates without a time of day. Raises InputError."""
    reader = StampReader([name], replace(options, timezone=None), where)
    packed = reader.take([column])
    micros = reader.finish()(packed)
    return not np.any(micros[micros != NAT] % DAY)


def _by_pattern(words: list[str], pattern: str) -> IntArray:
    import pandas as pd

    try:
        stamps = pd.to_datetime(pd.Series(words, dtype="str").str.strip(), format=pattern, errors="coerce", utc=True)
    except (ValueError, TypeError, OverflowError) as error:
        raise InputError(f"bad --time-format {pattern!r}: {error}", remedy="for example '%d/%m/%Y %H:%M:%S'") from None
    return stamps.to_numpy(dtype="datetime64[us]").astype(np.int64)


def _are_dates(known: FloatArray) -> bool:
    """Say whether numbers are stamps written as one number, 20260317080000 or 202603170800."""
    for low, high, rest in ((1.9e13, 2.2e13, known), (1.9e11, 2.2e11, known * 100)):
        if known.min() >= low and known.max() < high and not np.any(known % 1):
            day, month = rest // 1e6 % 100, rest // 1e8 % 100
            fits = (rest % 100 < 60) & (rest // 100 % 100 < 60) & (rest // 1e4 % 100 < 24)
            return bool(np.all(fits & (day >= 1) & (day <= 31) & (month >= 1) & (month <= 12)))
    return False


def _unit_of(known: FloatArray, name: str) -> str:
    """What numeric stamps count: told from their size, their steps and the name of the column."""
    middle = float(np.median(np.abs(known)))
    for low, high, unit in ((1.2e17, 1.5e17, "filetime"), (1e17, 1e19, "epoch_ns"), (1e14, 1e17, "epoch_us"),
                            (1e11, 1e14, "epoch_ms"), (3.4e9, 4.2e9, "labview"), (1e8, 3.4e9, "epoch_s")):  # fmt: skip
        if low <= middle < high:
            return unit
    steps = np.diff(known[:1000])
    step = float(np.median(np.abs(steps[steps != 0]))) if np.any(steps != 0) else 1.0
    if 20_000 < middle < 80_000 and step < 0.5 and np.any(known % 1 != 0):
        return "excel"
    word = plain(name)
    bracket = name.lower().rstrip(")] ").replace("[", "(").rpartition("(")[2].strip()
    for unit, ends, brackets in (("millis", ("ms",), ("ms", "msec")), ("minutes", ("min", "minutes"), ("min",)),
                                 ("hours", ("hours", "timeh"), ("h", "hours"))):  # fmt: skip
        if word.endswith(ends) or bracket in brackets:
            return unit
    return "seconds"


def _micros(column: pa.ChunkedArray | pa.Array, unit: str) -> IntArray:
    return _scaled(_integers(column.cast(pa.int64())), unit)


def _integers(column: pa.ChunkedArray | pa.Array) -> IntArray:
    return to_array(pc.fill_null(column, NAT) if column.null_count else column)


def _scaled(integers: IntArray, unit: str) -> IntArray:
    """Whole numbers of a unit as microseconds."""
    if unit == "ns":
        return np.where(integers == NAT, NAT, integers // 1000)
    factor = {"us": 1, "ms": 1000, "s": SECOND}[unit]
    far = np.abs(integers.astype(np.float64)) > LIMIT / factor
    return np.where(far, NAT, np.where(far, 0, integers) * factor) if far.any() else integers * factor


class WallClock:
    """Stamps as the clocks of a zone show them to UTC, some rows of a file after the other."""

    def __init__(self, zone: str) -> None:
        self.zone = zone
        self._info = ZoneInfo(zone)
        self._rows = 0  # in the hour that occurs twice
        self._last: int | None = None
        self._within = False  # the last row lay in such an hour
        self._back = 0  # steps back since the rows came to lie there

    def utc(self, micros: IntArray) -> IntArray:
        """Return the next rows in UTC, (rows,); unreadable ones stay unreadable."""
        known = np.flatnonzero(micros != NAT)
        if not len(known):
            return micros
        local = micros[known]
        hours, inverse = np.unique(local // HOUR, return_inverse=True)
        first = np.array([_offset(self._info, int(h), 0) for h in hours], np.int64)[inverse]
        second = np.array([_offset(self._info, int(h), 1) for h in hours], np.int64)[inverse]
        doubled = first != second
        out = micros.copy()
        out[known] = local - np.where(self._gone_back(local, doubled), second, first)
        return out

    def _gone_back(self, local: IntArray, doubled: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """After the clock went back (a step of more than half an hour in the doubled hour) the second offset holds."""
        back = np.diff(local, prepend=local[0] if self._last is None else self._last) < -HOUR // 2
        within = np.concatenate([[self._within], doubled])
        before = np.cumsum(back)
        begins = np.flatnonzero(~within[:-1] & within[1:])
        # steps back before the rows that lie in the hour now came there; less than none: there were some already
        earlier = np.concatenate([[-self._back], before[begins] - back[begins]])
        since = before - earlier[np.cumsum(~within[:-1] & within[1:])]
        self._rows += int(np.count_nonzero(doubled))
        self._last, self._within, self._back = int(local[-1]), bool(doubled[-1]), int(since[-1])
        return doubled & (since > 0)

    @property
    def notes(self) -> tuple[Note, ...]:
        """What is to be said of the rows so far."""
        if not self._rows:
            return ()
        text = f"{self._rows} rows lie in the hour that occurs twice in {self.zone}; they are taken in file order"
        return (Note("dst_repeated_hour", text),)


def _offset(info: ZoneInfo, hour: int, fold: int) -> int:
    try:
        moment = (datetime(1970, 1, 1) + timedelta(hours=hour)).replace(tzinfo=info, fold=fold)
        return int((moment.utcoffset() or timedelta()).total_seconds() * SECOND)
    except (OverflowError, ValueError):
        return 0
