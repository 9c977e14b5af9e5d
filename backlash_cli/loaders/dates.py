"""Written dates to microseconds: one expression for the whole column, arithmetic on its parts."""

from __future__ import annotations

import re

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import InputError
from ..record import Note
from .arrays import to_array, to_texts

NAT = np.iinfo(np.int64).min
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
_MONTHS = (
    "jan ene gen jän january januar janvier enero gennaio januari janeiro",
    "feb fév fev february februar février febrero febbraio februari fevereiro",
    "mar mär mrz maa march märz mars marzo maart março maerz",
    "apr avr abr april avril abril aprile",
    "may mai maj mei mag mayo maggio maio",
    "jun jui giu june juni juin junio giugno junho",
    "jul lug july juli juillet julio luglio julho juil",
    "aug aoû ago aou august août agosto augustus augusti aout",
    "sep set sept september septembre septiembre settembre setembro",
    "oct okt ott out october oktober octobre octubre ottobre outubro",
    "nov november novembre noviembre novembro",
    "dec dez déc dic des december dezember décembre diciembre dicembre dezembro",
)
MONTH = {word: number for number, words in enumerate(_MONTHS, 1) for word in words.split()}
ZONES = {
    "Z": 0, "UTC": 0, "GMT": 0, "UT": 0, "WET": 0, "WEST": 60, "BST": 60, "CET": 60, "MEZ": 60, "CEST": 120,
    "MESZ": 120, "EET": 120, "EEST": 180, "MSK": 180, "EST": -300, "EDT": -240, "CST": -360, "CDT": -300,
    "MST": -420, "MDT": -360, "PST": -480, "PDT": -420, "AKST": -540, "AKDT": -480, "HST": -600, "JST": 540,
    "KST": 540, "SGT": 480, "HKT": 480, "AEST": 600, "AEDT": 660, "AWST": 480,
}  # fmt: skip


def parse_dates(
    words: list[str], order: str | None, codes: NDArray[np.int64], where: str, name: str
) -> tuple[NDArray[np.int64], bool, bool, tuple[Note, ...]]:
    """Return (micros of every word, stamps carry offsets, they are times of day only, notes).

    order: None, or "ymd", "dmy", "mdy" (or "iso") when the user says it. codes: which word each row holds; rows
    in file order help to tell day from month. Raises InputError when both readings are possible.
    """
    text = _tidy(to_texts(words))
    micros = np.full(len(words), NAT)
    zoned = np.zeros(len(words), bool)
    notes: list[Note] = []
    for expression in _DATES:
        parts = pc.extract_regex(text, expression)
        if not parts.null_count:
            break
    dated = to_array(parts.is_valid())
    if dated.any():
        chosen = np.flatnonzero(dated)
        found = _dated(parts.take(chosen), order, where, name, notes)
        micros[chosen], zoned[chosen] = found
    rest = np.flatnonzero(micros == NAT)
    clock_only = False
    if len(rest):
        compact = pc.extract_regex(text.take(rest), _COMPACT)
        valid = to_array(compact.is_valid())
        if valid.any():
            chosen = rest[valid]
            fields = compact.take(np.flatnonzero(valid))
            days = days_of(_int(fields, "y"), _int(fields, "m"), _int(fields, "d"))
            micros[chosen], zoned[chosen] = _with_clock(days, fields)
        elif not dated.any():
            clock = pc.extract_regex(text.take(rest), _CLOCK_ONLY)
            valid = to_array(clock.is_valid())
            if valid.sum() > len(rest) / 2:
                fields = clock.take(np.flatnonzero(valid))
                micros[rest[valid]], _ = _with_clock(np.zeros(valid.sum(), np.int64), fields)
                clock_only = True
    known = micros != NAT
    mixed = known.any() and zoned.any() and not zoned[known].all()
    if mixed:
        notes.append(Note("mixed_zones", "some time stamps carry an offset and some do not; the others count as UTC"))
    return micros, bool(known.any() and zoned[known].all()), clock_only, tuple(notes)


def _tidy(text: pa.Array) -> pa.Array:
    """Bring rare ways of writing to the common ones: quotes, East Asian date signs, and the year at the end."""
    text = pc.replace_substring_regex(text, r"^\s*['\"]|['\"]\s*$", "")
    text = pc.replace_substring_regex(text, r"^(\d{4})年(\d{1,2})月(\d{1,2})日", r"\1-\2-\3")
    if pc.any(pc.match_substring_regex(text, r"^\s*[^\d\s]")).as_py():
        text = pc.replace_substring_regex(text, _UNIX_DATE, r"\1 \4 \2 \3")
    return text


def _dated(
    fields: pa.StructArray, order: str | None, where: str, name: str, notes: list[Note]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    a, a_month = _month_or_int(fields, "a")
    b, b_month = _month_or_int(fields, "b")
    c = _int(fields, "c")
    year_first = _length(fields, "a") == 4
    year_first &= ~a_month
    year = np.where(year_first, a, c)
    month = np.where(a_month, a, b)
    day = np.where(year_first, c, np.where(a_month, b, a))
    unclear = ~year_first & ~a_month & ~b_month
    if unclear.any():
        short = _length(fields, "c") <= 2
        separator, am_pm = _first(fields, "sep", unclear), _has(fields, "ap", unclear)
        parts = (a[unclear], b[unclear], c[unclear])
        kind = _order(*parts, bool(short[unclear].all()), separator, am_pm, order, where, name, notes)
        positions = {"dmy": (c, b, a), "mdy": (c, a, b), "ymd": (a, b, c), "ydm": (a, c, b)}[kind]
        year = np.where(unclear, positions[0], year)
        month = np.where(unclear, positions[1], month)
        day = np.where(unclear, positions[2], day)
    elif order == "ydm":
        month, day = np.where(year_first, day, month), np.where(year_first, month, day)
    year = np.where(year < 70, year + 2000, np.where(year < 100, year + 1900, year))
    return _with_clock(days_of(year, month, day), fields)


def _order(
    a: NDArray[np.int64], b: NDArray[np.int64], c: NDArray[np.int64], short: bool, separator: str, am_pm: bool,
    order: str | None, where: str, name: str, notes: list[Note],
) -> str:  # fmt: skip
    """Which of day, month and year comes first, from what the numbers allow."""
    if order in ("dmy", "mdy", "ymd"):
        return order

    def possible(year: NDArray[np.int64], month: NDArray[np.int64], day: NDArray[np.int64]) -> bool:
        fits = (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31)
        return bool(fits.mean() > 0.99)

    fitting = [kind for kind, parts in (("dmy", (c, b, a)), ("mdy", (c, a, b)), ("ymd", (a, b, c)))
               if possible(*parts) and (kind != "ymd" or short)]  # fmt: skip
    if len(fitting) > 1 and short and "ymd" in fitting:
        # two-digit years: the year is the part that never changes and is nearest to now; only dates of this
        # century are read, so a part above 31 decides, else the user is asked
        decided = [kind for kind in fitting if kind != "ymd" and (c > 31).any()]
        fitting = decided or ([kind for kind in fitting if kind == "ymd"] if (a > 31).any() else fitting)
    if len(fitting) == 1:
        return fitting[0]
    if not fitting:
        return "dmy"
    if separator.strip() == "." and "dmy" in fitting:
        return "dmy"
    if separator.strip() == "/" and am_pm and "mdy" in fitting:
        notes.append(Note("time_format", "dates with / and AM/PM are read as month/day/year; --time-format dmy if not"))
        return "mdy"
    raise InputError(
        f"dates like {a[0]:02d}{separator}{b[0]:02d}{separator}{c[0]:02d} in {name!r} are ambiguous: is the day first?",
        where=where,
        remedy="say it with --time-format dmy, mdy or a pattern such as '%d/%m/%Y %H:%M:%S'",
        code="ambiguous_dates",
    )


def _with_clock(days: NDArray[np.int64], fields: pa.StructArray) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    hour, minute, second = _int(fields, "h", 0), _int(fields, "mi", 0), _int(fields, "s", 0)
    bad = (days == NAT) | (hour > 24) | (minute > 59) | (second > 60)
    if "ap" in [fields.type.field(i).name for i in range(fields.type.num_fields)]:
        half = pc.utf8_lower(pc.utf8_slice_codeunits(fields.field("ap"), 0, 1))
        pm = to_array(pc.equal(half, "p").fill_null(False))
        am = to_array(pc.equal(half, "a").fill_null(False))
        hour = np.where(pm & (hour < 12), hour + 12, np.where(am & (hour == 12), 0, hour))
    fraction = pc.utf8_slice_codeunits(pc.utf8_rpad(pc.fill_null(fields.field("f"), ""), 6, "0"), 0, 6)
    micros = np.asarray(to_array(fraction.cast(pa.int64())), np.int64)
    offset, zoned, unknown = _offsets(fields.field("z"))
    out = ((np.where(bad, 0, days) * 24 + hour) * 60 + minute - offset) * 60_000_000 + second * 1_000_000 + micros
    out[bad | unknown] = NAT
    return out, zoned


def _offsets(zone: pa.Array) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.bool_]]:
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
    index = to_array(coded.indices)
    given = np.array([bool(t) for t in coded.dictionary.to_pylist()], bool)[index]
    return np.array(minutes, np.int64)[index], given, ~np.array(known, bool)[index]


def days_of(year: NDArray[np.int64], month: NDArray[np.int64], day: NDArray[np.int64]) -> NDArray[np.int64]:
    """Days since 1970-01-01 of the Gregorian calendar; NAT where there is no such day (H. Hinnant's algorithm)."""
    bad = (month < 1) | (month > 12) | (day < 1) | (day > 31) | (year < 1) | (year > 9999)
    y = np.where(month <= 2, year - 1, year)
    era = y // 400
    yoe = y - era * 400
    doy = (153 * (month + np.where(month > 2, -3, 9)) + 2) // 5 + day - 1
    out = era * 146097 + yoe * 365 + yoe // 4 - yoe // 100 + doy - 719468
    last = np.array([0, 31, 29, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31])[np.clip(month, 0, 12)]
    leap = (year % 4 == 0) & ((year % 100 != 0) | (year % 400 == 0))
    bad |= (day > last) | ((month == 2) & (day == 29) & ~leap)
    out[bad] = NAT
    return out


def _int(fields: pa.StructArray, name: str, missing: int = -1) -> NDArray[np.int64]:
    column = fields.field(name)
    filled = pc.if_else(pc.equal(pc.fill_null(column, ""), ""), str(missing), column)
    return np.asarray(to_array(filled.cast(pa.int64())), np.int64)


def _month_or_int(fields: pa.StructArray, name: str) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
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
    index = to_array(coded.indices)
    return np.array(numbers, np.int64)[index], np.array(names, bool)[index]


def _length(fields: pa.StructArray, name: str) -> NDArray[np.int64]:
    return to_array(pc.utf8_length(fields.field(name)))


def _first(fields: pa.StructArray, name: str, rows: NDArray[np.bool_]) -> str:
    return fields.field(name)[int(np.flatnonzero(rows)[0])].as_py() or ""


def _has(fields: pa.StructArray, name: str, rows: NDArray[np.bool_]) -> bool:
    return bool(_first(fields, name, rows))
