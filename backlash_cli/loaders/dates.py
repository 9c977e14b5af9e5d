"""Written dates to microseconds: one expression for the whole column, arithmetic on its parts."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import InputError
from ..record import IntArray, Note
from .order import DAY, NAT

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


_PLACES = np.array([10**8, 10**4, 1])  # bring the three numbers of a date into one
Readings = dict[str, tuple[IntArray, ...]]  # kind -> year, month, day


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
