"""Stamps of every usual kind to microseconds since 1970-01-01 UTC, block by block. Which of day and month comes first
is known at the end: until then an open date is packed from its numbers and its time of day."""

import re
from collections.abc import Callable, Sequence
from datetime import timedelta, timezone, tzinfo
from functools import lru_cache, reduce
from zoneinfo import ZoneInfo, available_timezones

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import InputError
from ..record import NAT, BoolArray, FloatArray, IntArray, Note
from .cells import Lexicon, codes_and_words, is_number, is_text, stored, to_array
from .grid import DAY, HOUR, LIKELY, SECOND
from .names import COLUMNS, FORM, WORDS, explained, noted, plain
from .options import ReadOptions

LETTER = r"[^\x00-@\[-`{-\x7f]"  # also of other alphabets; \pL takes forty times as long to compile
_DATED, _COMPACT, _OF_DAY = (form.replace("CLOCK", WORDS["stamps"]["clock"]).replace("LETTER", LETTER)
                             for form in WORDS["stamps"]["forms"])
_REWRITTEN = [(written.replace("LETTER", LETTER), usual) for written, usual in WORDS["stamps"]["rewritten"]]
_NO_DATE: str = WORDS["stamps"]["no_date"]
MONTH = {word: int(number) for number, words in WORDS["months"].items() for word in words.split()}
ZONES: dict[str, int] = WORDS["zones"]
DATES, OF_DAY = (("year", "month", "day"), ("year", "dayofyear")), ("hours", "minutes", "seconds", "millis")
DATE, _DIGITS = tuple(dict.fromkeys(sum(DATES, ()))), {"hhmm": 100, "hhmmss": 1}
_DAY_NUMBERS = 1e5  # days since 1900 are below, dates written as YYMMDD or YYYYMMDD from there on
LIMIT = 4_000_000_000_000_000_000  # differences of two stamps still fit into 64 bits
_OPEN, _SHIFT = NAT + 1, 38  # from _OPEN on, below -LIMIT: the numbers of an open date above so many bits of its clock
_FIRST_YEAR, _YEARS = 1800, 500  # of dates that may be open; with an offset they are packed so many years later
_ZONED = 92_000_000 * DAY  # added to a stamp with an offset beside which others may have none; above LIMIT
_UNITS: dict[str, tuple[float, float, bool]] = WORDS["stamps"]["unit"]


def read_dates(words: list[str]) -> tuple[IntArray, BoolArray, bool]:
    """Read texts as dates, with or without a time of day, or as times of day. Return (micros, zoned, of_day): (words,)
    NAT where nothing was read, packed where the date is open; (words,) they carry an offset; all are times of day."""
    text = pc.replace_substring_regex(pa.array(words, pa.string()), _NO_DATE, "")
    rest, of_day, micros, zoned = np.arange(len(words)), False, np.full(len(words), NAT), np.zeros(len(words), bool)
    for form, rewritten in ((_DATED, ()), (_DATED, _REWRITTEN), (_COMPACT, ()), (_OF_DAY, ())):
        for written, usual in rewritten:
            text = pc.replace_substring_regex(text, written, usual)
        fields = pc.extract_regex(text, form)
        valid = to_array(fields.is_valid())
        if form is _OF_DAY and not (of_day := len(rest) == len(words) and valid.sum() > len(rest) / 2):
            break
        micros[rest[valid]], zoned[rest[valid]] = _stamps(fields.filter(pa.array(valid)))
        text, rest = text.filter(pa.array(~valid)), rest[~valid]
    return micros, zoned, of_day


@lru_cache(1 << 14)
def stamp_kind(text: str) -> str:
    """Return "time" for a text that may be a date, with a time of day or not, "clock" for a time of day, else ""."""
    text = re.sub(_NO_DATE, "", text)
    found = re.match(_DATED, text)
    text = text if found else reduce(lambda rest, form: re.sub(form[0], form[1], rest), _REWRITTEN, text)
    found = found or re.match(_DATED, text)
    known = found and all(_whole_or_month(part) != -99 for part in found.group("a", "b"))
    clock = ":" in text and re.match(_OF_DAY, text)
    return "clock" if clock else "time" if known or re.match(_COMPACT, text) else ""


def _stamps(fields: pa.StructArray) -> tuple[IntArray, BoolArray]:
    """Return (microseconds since 1970, NAT or open, has an offset) of the parts of dates and times of day."""
    hour, minute, second = (_looked_up(fields.field(name), lambda text: int(text or 0)) for name in ("h", "mi", "s"))
    half = _looked_up(fields.field("ap"), lambda text: "apsc".find(text[:1].lower()) % 2 if text else -1)  # also SA, CH
    hour = np.where((half == 1) & (hour < 12), hour + 12, np.where((half == 0) & (hour == 12), 0, hour))
    fraction = pc.utf8_slice_codeunits(pc.utf8_rpad(pc.fill_null(fields.field("f"), ""), 6, "0"), 0, 6)
    offset, undated = _looked_up(fields.field("z"), _minutes_east), fields.type.get_field_index("a") < 0
    bad = (hour > (999 if undated else 24)) | (minute > 59) | (second > 60) | (offset == NAT)  # 999: since a start
    minutes = hour * 60 + minute - np.where(bad, 0, offset)
    clock = (minutes * 60 + second) * SECOND + to_array(fraction.cast(pa.int64()))
    zoned = to_array(pc.not_equal(pc.fill_null(fields.field("z"), ""), ""))
    if undated:
        return np.where(bad, NAT, clock), zoned
    a, b, c = (_looked_up(fields.field(name), _whole_or_month) for name in "abc")
    year_first, month_first = a >= 1000, a < 0
    year = full_year(np.where(year_first, a, c))
    days = days_of(year, np.abs(np.where(month_first, a, b)), np.where(year_first, c, np.where(month_first, b, a)))
    unclear = (a >= 0) & ~year_first & (b >= 0)
    bad |= unclear & ((a >= 100) | (year < _FIRST_YEAR) | (year >= _FIRST_YEAR + _YEARS))
    packed = _OPEN + ((((year - _FIRST_YEAR + _YEARS * zoned) * 100 + b) * 100 + a) << _SHIFT) + clock + DAY
    return np.where(bad, NAT, np.where(unclear, packed, (days + clock.astype("m8[us]")).astype(np.int64))), zoned


def _open_dates(micros: IntArray) -> tuple[IntArray, IntArray, IntArray, BoolArray]:
    """(which stamps have an open date, the number of the date, time of day, has an offset)"""
    is_open = np.flatnonzero((micros < -LIMIT) & (micros != NAT))
    packed = micros[is_open] - _OPEN
    zoned, numbers = np.divmod(packed >> _SHIFT, _YEARS * 10_000)
    return is_open, numbers, (packed & ((1 << _SHIFT) - 1)) - DAY, zoned > 0


def _looked_up(texts: pa.Array, value: Callable[[str], int]) -> IntArray:
    """(texts,) What few different texts mean, each looked up once."""
    coded = pc.fill_null(texts, "").dictionary_encode()
    return np.array([value(text) for text in coded.dictionary.to_pylist()], np.int64)[to_array(coded.indices)]


def _whole_or_month(text: str) -> int:
    """A number, or that of a month's name below zero, also of the first letters of one; -99 for a word that is none."""
    word = text.lower().rstrip(".")
    longer = (number for name, number in MONTH.items() if len(word) > 3 and name.startswith(word))
    return int(text) if text.isdigit() else -MONTH.get(word, next(longer, MONTH.get(word[:3], 99)))


@lru_cache(64)
def _region(text: str) -> ZoneInfo | None:
    """The zone of a region that is named at the end of a text, or in the words of Windows."""
    found = FORM.region.search(text)
    name = (found[1] or WORDS["regions"].get(found[2], "")).lower() if found else ""
    return next((ZoneInfo(z) for z in available_timezones() if z.lower() == name), None) if name else None


def zone_of(name: str) -> tzinfo | None:
    """The zone that the name of a column of stamps tells."""
    found = FORM.zone.search(name)
    east = _minutes_east(found[found.lastindex]) if found and found.lastindex else NAT
    return timezone(timedelta(minutes=east)) if east != NAT else _region(name)


def _minutes_east(zone: str) -> int:
    """Minutes of a zone east of UTC, NAT for one that is not known."""
    if not zone or zone.upper() in ZONES:
        return ZONES.get(zone.upper(), 0)
    match = re.match(r"^(|UTC|GMT)([+-]\d{1,2}):?(\d{2})?$", zone.upper())
    return int(match[2]) * 60 + int(f"{match[2][0]}{match[3] or 0}") if match else NAT


def full_year(year: IntArray) -> IntArray:
    """Years of two digits as they are meant."""
    return np.where(year < 70, year + 2000, np.where(year < 100, year + 1900, year))


def days_of(year: IntArray, month: IntArray, day: IntArray) -> NDArray[np.datetime64]:
    """Days as datetime64, NaT where there is no such day; in the month of `dayofyear` counted through the year."""
    whole = month == MONTH["dayofyear"]
    bad = (month < 1) | ((month > 12) & ~whole) | (day < 1) | (day > 366) | (year < 1) | (year > 9999)
    months = (12 * (np.where(bad, 1970, year) - 1970) + np.where(bad | whole, 1, month) - 1).astype("datetime64[M]")
    days = months.astype("datetime64[D]") + (np.where(bad, 1, day) - 1)
    other = np.where(whole, days.astype("M8[Y]") != months.astype("M8[Y]"), days.astype("M8[M]") != months)
    return np.where(bad | other, np.datetime64("NaT"), days)


def _readings(numbers: IntArray) -> dict[str, tuple[IntArray, ...]]:
    """(year, month, day) of the numbers of dates in each order in which they may stand."""
    rest, a = np.divmod(numbers, 100)
    c, b = np.divmod(rest, 100)
    year = c + _FIRST_YEAR
    return {"dmy": (year, b, a), "mdy": (year, a, b), "ymd": (full_year(a), b, year % 100)}


class StampReader:
    """Takes the stamps of a file block by block. names: of their column, or of those of date and time of day.
    units: of each that holds a part of them, what part it is. start, interval: as in Head. comma: numbers have one."""

    def __init__(self, names: Sequence[str], options: ReadOptions, where: str, units: Sequence[str] = ("",),
                 start: int = 0, interval: int = 0, comma: bool = False) -> None:
        self.name, self.units, self.options, self.where = " ".join(names), [*units], options, where
        self.form, self.notes, self._comma = options.time_format or "", list[Note](), comma
        self._zones: set[bool | None] = set()  # stamps carry an offset, carry none, or need none
        self._shown = self._shown_open = ""  # a text that is none, and one with an open date
        self._open: dict[int, list[int]] = {}  # open date -> first and last time of day, and number of its texts
        self._unit, self._interval = "", 0 if self.form else interval  # of stamps that are numbers
        self._scale: tuple[float, float, bool] | None = None  # as in _UNITS, where the interval tells it
        self._start, self._from = start, np.datetime64(start // SECOND, "s")
        self._of_day: int | None = None  # last time of day without a date, counted on past midnight
        self._doubled = self._skipped = self._back = 0  # rows in the hour shown twice, in one never shown; steps back
        own, named = zone_of(self.name), options.timezone  # of stamps without an offset
        self._zone = ZoneInfo(named) if named else own
        self.notes += [noted("zone_overruled", own=own, zone=named)] * bool(own and named and str(own) != named)
        self._last, self._within = -LIMIT, False  # stamp of the last row, and whether it lay in such an hour

    def take(self, columns: Sequence[pa.ChunkedArray]) -> IntArray:
        """Return the stamps of the next rows, to be given to what `finish` returns."""
        if "half" in self.units:  # AM and PM stand in a column of their own
            texts = [column.cast(pa.string()).combine_chunks() for column in columns]
            columns = [pc.binary_join_element_wise(*texts, " ")]
        if len(columns) > 1:
            return self._joined(columns)
        (column,) = columns
        if pa.types.is_dictionary(column.type) and not is_text(column.type.value_type):
            column = column.cast(column.type.value_type)
        kind = column.type
        if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
            if self.form in _UNITS:
                raise InputError(**explained("time_format:dates", column=self.name, form=self.form), where=self.where)
            return self._seen(micros_of(column), np.full(len(column), getattr(kind, "tz", None) is not None))
        if pa.types.is_time(kind):
            return self._past_midnight(micros_of(column))
        digits = pa.types.is_int64(kind) and not self.form and (pc.max(column).as_py() or 0) // 10**16 == 2
        if digits or is_text(kind):  # 20260317080000125: no float64 holds it
            return self._texts(column.cast(pa.string()) if digits else column)
        if is_number(kind) or pa.types.is_null(kind):
            return self._numbers(to_array(column.cast(pa.float64(), safe=False)))
        if pa.types.is_duration(kind):
            self.name += " (s)" * (not self._unit)
            return self._numbers(to_array(column.cast(pa.duration("us")).cast(pa.int64()).cast(pa.float64())) / SECOND)
        raise InputError(**explained("no_stamps", column=self.name, kind=kind), where=self.where)

    def _joined(self, columns: Sequence[pa.ChunkedArray]) -> IntArray:
        """Stamps of columns that hold the date, or its year, month and day, and the time of day, or parts of it."""
        before = {*self._zones}
        numbers = [np.where(np.abs(values := stored(column, {})[0]) < LIMIT, values, np.nan) for column in columns]
        if "hhmm" in self.units and (numbers[self.units.index("hhmm")] >= 2400).any():
            if self._zones:
                raise InputError(**explained("hhmm", column=self.name), where=self.where)
            self.units = ["hhmmss" if unit == "hhmm" else unit for unit in self.units]  # which no row showed before
        given = dict(zip(self.units, numbers, strict=True))
        if "year" in given:
            part = {u: np.clip(np.nan_to_num(given[u]), 0.0, 9999.0).astype(np.int64) for u in DATE if u in given}
            day = part["dayofyear" if "dayofyear" in part else "day"]
            days = days_of(full_year(part["year"]), part.get("month", np.full_like(day, MONTH["dayofyear"])), day)
            stamps = days.astype("M8[us]").astype(np.int64)
            self._seen(stamps, np.zeros(len(stamps), bool))
        elif 2 * np.isfinite(numbers[0]).sum() > len(numbers[0]):
            self._unit = self._unit or ("excel" if np.nanmedian(numbers[0]) < _DAY_NUMBERS else "digits")
            stamps = self._numbers(numbers[0])
        else:
            stamps = self.take(columns[:1])
        clock, own = np.zeros(len(stamps)), np.zeros(len(stamps), np.int64)
        for column, values, unit in zip(columns[1:], numbers[1:], self.units[1:], strict=True):
            if unit in _DIGITS:
                clock += _of_digits(values * _DIGITS[unit])
            elif unit in _UNITS:  # parts of a day are rounded, as in a spreadsheet
                clock += np.rint(values * _UNITS[unit][0] / 1000) * 1000
            elif not unit:
                codes, words = codes_and_words(column.cast(pa.string()))
                micros, zoned, _ = read_dates([FORM.dotted.sub(r"\1:\2:\3", word) for word in words])
                clock += np.append(micros, NAT)[codes]
                self._zones = before | {*zoned[micros != NAT].tolist()}  # a date has none: its time of day tells
                own = np.append(zoned, False)[codes] * np.where(stamps < -LIMIT, _YEARS * 10_000 << _SHIFT, _ZONED)
                self._shown_open += f" {words[0]}" if self._shown_open and words else ""
        known = (stamps != NAT) & (np.abs(clock) <= DAY)
        return np.where(known, stamps + own + np.where(known, clock, 0.0).astype(np.int64), NAT)

    def finish(self) -> Callable[[IntArray], IntArray]:
        """Return what gives UTC, to be called for all rows in file order. Raises InputError for none, or open dates."""
        if not self._zones:
            what = f"readable time stamps (for example {self._shown!r})" if self._shown else "time stamps"
            what += f" that fit --time-format {self.form!r}" * ("%" in self.form)
            raise InputError(**explained("unreadable_stamps", column=self.name, what=what), where=self.where)
        order = self.form if self.form in ("dmy", "mdy", "ymd") or not self._open else self._date_order()
        if self._open:
            days = {kind: days_of(*own) for kind, own in _readings(np.array([*self._open], np.int64)).items()}
            if np.isnat(days[order]).all():
                raise InputError(**explained("time_format:order", shown=self._shown_open, column=self.name,
                                             order=order), where=self.where)
            own, turned = days[order], days["mdy" if order == "dmy" else "dmy"]
            goes_on, *others = (np.abs(b[1:] - a[:-1]) <= np.timedelta64(most, "D") for a, b, most in (
                (own, own, 3), (own, turned, 1), (turned, own, 1)))  # a spreadsheet turns what it takes for dates
            if np.any(wrong := ~goes_on & np.any(others, axis=0)):
                told = {"column": self.name, "order": order, "day": np.where(np.isnat(own), turned, own)[:-1][wrong][0]}
                if not self.form:
                    raise InputError(**explained("dates_turned", **told), where=self.where)
                self.notes.append(noted("dates_turned", **told))
        zone = self._zone if False in self._zones else None
        asked, form = self.options.timezone, order * (order in ("dmy", "mdy") and not self._open)
        self.notes += [noted("timezone_unused", zone=asked)] * (bool(asked) and False not in self._zones)
        self.notes += [noted("time_format:unused", column=self.name, form=form)] * bool(form)
        self.notes += [noted("mixed_zones", others=f"are read in {zone}")] * (bool(zone) and True in self._zones)
        self.zones = frozenset({True} if zone else self._zones)  # known as well where the column names it

        def resolved(stamps: IntArray) -> IntArray:
            zoned, (is_open, numbers, clock, own) = stamps > LIMIT, _open_dates(stamps)
            stamps, zoned[is_open] = np.where(zoned, stamps - _ZONED, stamps), own
            if len(is_open):
                stamps[is_open] = (days_of(*_readings(numbers)[order]) + clock.astype("m8[us]")).astype(np.int64)
            return stamps if zone is None else np.where(zoned, stamps, self._utc(np.where(zoned, NAT, stamps), zone))

        return resolved

    @property
    def all_notes(self) -> tuple[Note, ...]:
        """What is to be said of all stamps, when they were resolved."""
        said, zone = {"dst_repeated_hour": self._doubled, "dst_skipped_hour": self._skipped}, self._zone
        return (*self.notes, *(noted(code, rows=rows, zone=zone) for code, rows in said.items() if rows))

    def _utc(self, micros: IntArray, zone: tzinfo) -> IntArray:
        """The next rows in UTC; after a step back of half an hour in the doubled hour the second offset holds."""
        known = np.flatnonzero(micros != NAT)
        known = known[::-1] if 2 * np.count_nonzero(np.diff(micros[known]) < 0) > len(known) else known  # newest first
        if not len(known):
            return micros
        import pandas as pd
        local = micros[known]
        near = local.clip(-DAY * 700_000, DAY * 2_900_000)  # what a calendar knows
        walls = pd.DatetimeIndex(near.astype("datetime64[us]"))
        first, second = (walls.tz_localize(zone, ambiguous=np.full(len(local), summer), nonexistent=pd.Timedelta("1h"))
                         for summer in (True, False))
        self._skipped += int(np.count_nonzero(first.tz_localize(None) != walls))
        first, second = local - near + first.asi8, local - near + second.asi8
        doubled, back = first != second, np.diff(local, prepend=self._last) < -HOUR // 2
        count, begins = self._back + np.cumsum(back), doubled & ~np.concatenate([[self._within], doubled[:-1]])
        since = count - np.maximum.accumulate(np.where(begins, count - back, 0))
        self._doubled += int(np.count_nonzero(doubled))
        self._last, self._within, self._back, out = int(local[-1]), bool(doubled[-1]), int(since[-1]), micros.copy()
        out[known] = np.where(doubled & (since > 0), second, first)
        return out

    def _seen(self, micros: IntArray, zoned: BoolArray) -> IntArray:
        self._zones |= {zone for zone in (True, False) if np.any((micros != NAT) & (zoned == zone))}
        return micros

    def _past_midnight(self, micros: IntArray) -> IntArray:
        if self._of_day is None:
            self.notes.append(noted("day_above" if self._start else "relative_time:of_day", start=self._from))
            first, clock = int(micros[micros != NAT][:1].sum()), self._start % DAY
            self._since = clock * (100 * first < abs(first - clock))  # elapsed: near 0, and not the clock at the start
        micros = np.where(micros == NAT, NAT, micros + self._since)
        known, out = np.flatnonzero(micros != NAT), micros.copy()
        last = self._of_day or self._start // DAY * DAY or int(micros[known[:1]].sum())
        steps = np.diff(micros[known], prepend=last % DAY)
        forward = 2 * np.count_nonzero(steps < 0) <= len(steps)  # else the newest stand first
        out[known] += (last // DAY + np.cumsum(steps < -DAY // 2 if forward else -1 * (steps > DAY // 2))) * DAY
        self._zones |= {False if self._start else None} if len(known) else set()
        self._of_day = int(out[known[-1]] - max(micros[known[-1]] - 1, 0) // DAY * DAY) if len(known) else last
        return out

    def _texts(self, column: pa.ChunkedArray | pa.Array) -> IntArray:
        codes, words = codes_and_words(column)
        self._shown = self._shown or next((word for word in words if word.strip()), "")[:40]
        self._zone = self._zone or _region(words[0] if words else "")
        if "%" in self.form:
            import pandas as pd
            try:
                found = pd.to_datetime(pd.Series(words).str.strip(), format=self.form, errors="coerce", utc=True)
            except (ValueError, TypeError, OverflowError) as error:
                raise InputError(**explained("time_format", form=self.form, error=error)) from None
            micros = found.to_numpy(dtype="datetime64[us]").astype(np.int64)
            return np.append(self._seen(micros, np.zeros(len(words), bool)), NAT)[codes]
        if (self._unit or self.form) in _UNITS:
            return self._numbers(np.append(Lexicon(words).parsed[0], np.nan)[codes])
        micros, zoned, of_day = read_dates(words)
        if of_day and (self._of_day is not None or not self._zones):
            return self._past_midnight(np.append(micros, NAT)[codes])
        if words and not self._zones and np.all(micros == NAT):
            values, _, units = Lexicon(words).parsed
            if 2 * np.isfinite(values).sum() > len(values) and self._unit != "digits":
                self.name += f" ({units[0]})" * bool(units[0])  # 0 sec, as MATLAB writes durations
                return self._numbers(np.append(values, np.nan)[codes])
        is_open, numbers, clocks, _ = _open_dates(micros)
        self._shown_open = self._shown_open or (words[is_open[0]].strip() if len(is_open) else "")
        for day in dict.fromkeys(numbers.tolist()):  # in the order in which they stand in the file
            own = clocks[numbers == day]
            seen = self._open.setdefault(day, [int(own[0]), 0, 0])
            seen[1:] = int(own[-1]), seen[2] + len(own)
        return np.append(self._seen(micros, zoned) + _ZONED * (zoned & (micros > -LIMIT)), NAT)[codes]

    def _date_order(self) -> str:
        """Which of day, month and year comes first, from all open dates. Raises InputError when it may be either."""
        parts = re.search(r"\d+\s*([-/.]?)[-/. ]*\d+[-/. ,]+(\d+)", re.sub(r"\d+:[\d:.,]+", "", self._shown_open))
        separator, short = (parts[1], len(parts[2]) < 3) if parts else ("", False)  # short: years of two digits
        readings = _readings(np.array(list(self._open), np.int64))
        first, last, counts = np.array(list(self._open.values())).T
        fitting = [kind for kind, (_, month, day) in readings.items() if (kind != "ymd" or short) and np.average(
            (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31), weights=counts) > 0.99]
        if (own := FORM.order.search(self.name)) and (order := "".join(p[0] for p in own.groups()).lower()) in fitting:
            return order
        if len({days_of(*readings[kind]).tobytes() for kind in fitting}) < 2:  # 06/06/2024 is one day either way
            return fitting[0] if fitting else "dmy"
        jumps = {}  # with the right one the time goes on over midnight, where every other one jumps
        for kind in fitting if len(self._open) > 1 else ():
            days = days_of(*readings[kind]).astype(np.int64)
            ahead = np.abs(np.diff(days) + (first[1:] - last[:-1]) / DAY) if days.min() != NAT else np.array([np.inf])
            jumps[kind] = float(np.sum(ahead)), float(np.max(ahead))
        best, *others = sorted(jumps, key=lambda kind: jumps[kind]) or [""]
        if best and jumps[best][1] < 3.0 and min(jumps[kind][0] for kind in others) > 5.0 * jumps[best][0]:
            return best
        if "dmy" in fitting and (separator == "." or self._comma):
            self.notes += [noted("time_format:comma")] * (separator != ".")
            return "dmy"
        if separator == "/" and "mdy" in fitting and re.search(r"\d\s*[AaPp]\.?\s?[Mm]", self._shown_open):
            first = "dmy" if "dmy" in fitting and re.match(r"\d/0", self._shown_open) else "mdy"  # Australia: 5/03
            self.notes.append(noted("time_format:am_pm" if first == "mdy" else "time_format:am_pm_day"))
            return first
        year, b, a = (int(part[0]) for part in readings["dmy"])
        date = separator.join((f"{a:02d}", f"{b:02d}", f"{year % 100 if short else year:02d}"))
        raise InputError(**explained("ambiguous_dates", date=date, column=self.name), where=self.where)

    def _numbers(self, values: FloatArray) -> IntArray:
        known = values[np.isfinite(values)]
        if not len(known):
            return np.full(len(values), NAT)
        if not self._unit:
            self._unit = self.form or unit_of(known, self.name)
            if self._unit not in _UNITS and self._unit != "digits":
                raise InputError(**explained("number_stamps", column=self.name, unit=self._unit), where=self.where)
            if self._unit.startswith("epoch") and not self.form and (
                    int(np.median(known) * _UNITS[self._unit][0]) not in LIKELY
                    or (np.all(known % 100 < 60) and np.any(np.diff(known) == 41))):  # 0859 is followed by 0900
                raise InputError(**explained("digit_stamps", column=self.name, stamp=round(known[0])), where=self.where)
            if self._unit == "excel":
                self.notes.append(noted("time_format:excel"))
            if not _UNITS.get(self._unit, (0, 0, True))[2]:
                step = float(np.median(np.diff(known[:1000]))) if self._interval and len(known) > 1 else 0.0
                counts = step == 1.0 and plain(self.name) in COLUMNS["counter"]  # rows
                # or the interval is written in the unit of the times, which their name does not tell
                if counts or (step > 0 and not re.search(r"[\[(]", self.name) and any(
                        self._interval == step * factor for factor, *_ in _UNITS.values())):
                    self._scale = self._interval / step, float(known[0]) * counts, False
                code = "day_above:counted" if self._start else "relative_time"
                unit = f"steps of {self._interval / 1e6:g} s" if self._scale else self._unit
                self.notes.append(noted(code, column=self.name, unit=unit, start=self._from))
        if self._unit == "digits":
            text = pa.array(values, from_pandas=True).cast(pa.int64(), safe=False).cast(pa.string())
            if np.median(known) < 1e6:  # 260317 may be open, as 26-03-17 is
                text = pc.replace_substring_regex(pc.utf8_lpad(text, 6, "0"), r"^(\d\d)(\d\d)(\d\d)$", r"\1-\2-\3")
            return self._texts(text)
        factor, zero, absolute = self._scale or _UNITS[self._unit]
        self._zones.add(None if self._unit.startswith("epoch") or not absolute else False)
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = (values - zero) * factor + self._start * (not absolute)
            if self._unit in ("excel", "matlab", "ticks"):
                scaled = np.rint(scaled / 1000.0) * 1000.0  # they carry some microseconds of rounding
            return np.where(np.abs(scaled) < LIMIT, np.rint(scaled).astype(np.int64), NAT)


def _of_digits(values: FloatArray) -> FloatArray:
    """Microseconds of times of day written as HHMMSS, nan for what is none."""
    hour, minute, second = values // 10_000, values // 100 % 100, values % 100
    return np.where((hour < 24) & (minute < 60) & (second < 60), (hour * 3600 + minute * 60 + second) * SECOND, np.nan)


def unit_of_day(column: pa.ChunkedArray, name: str) -> str:
    """Return what numbers in a column of times of day are: HHMMSS, HHMM, parts of a day, what the name says, or ""."""
    values, unit = stored(column, {})[0], unit_of(np.zeros(1), name)
    known = values[np.isfinite(values)].clip(-LIMIT, LIMIT)
    form = plain(name) if plain(name) in _DIGITS else "days" if np.max(known, initial=0.0) <= 1.0 else (
        "hhmm" if known.max() < 2400 else "hhmmss")
    digits = unit == "seconds" and not np.isnan(_of_digits(known * _DIGITS.get(form, 1))).any()
    return form if digits else unit if np.max(known, initial=0.0) * _UNITS[unit][0] <= DAY else ""


def are_whole(column: pa.ChunkedArray, name: str, options: ReadOptions, where: str, unit: int = DAY) -> bool:
    """Say whether stamps are dates without a time of day, or whole units [microseconds]. Raises InputError."""
    if is_number(column.type):  # 20260317, 260317, 46098
        known = (values := stored(column, {})[0])[np.isfinite(values)]
        days = np.any([(known >= low) & (known < high) for low, high in WORDS["stamps"]["dates"]], axis=0)
        repeated = np.count_nonzero(np.diff(known) == 0) > 0.5 * len(known)  # many rows a day
        return bool(len(known) and np.all(days & (known % 1 == 0)) and (repeated or known[0] >= 1.9e7))
    stamps = np.array(StampReader([name], options, where).take([column]))
    is_open, _, stamps[is_open], _ = _open_dates(stamps)
    return not np.any(stamps[stamps != NAT] % unit)


def unit_of(known: FloatArray, name: str) -> str:
    """What numeric stamps count: told from their size, their steps and the name of the column."""
    if any(known.min() >= size and known.max() < 1.16 * size for size in (1.9e13, 1.9e11)) and not np.any(known % 1):
        return "digits"  # 20260317080000 or 202603170800
    middle, steps = float(np.median(np.abs(known))), np.abs(np.diff(known[:1000]))
    short = np.any(known % 1 != 0) and np.any(steps != 0) and float(np.median(steps[steps != 0])) < 0.5
    sizes = WORDS["stamps"]["size"] + WORDS["stamps"]["days"] * int(short)
    least = min(middle, *np.abs(known[[0, -1]]).tolist())  # what is counted from a start begins, or ends, at about 0
    if of_size := [unit for low, high, unit in sizes if low <= least and middle < high]:
        return str(of_size[0])
    bracket = name.lower().rstrip(")] ").replace("[", "(").rpartition("(")[2].strip()
    return next((unit for unit, ends, words in WORDS["stamps"]["name"]
                 if plain(name).endswith(tuple(ends)) or bracket in words), "seconds")


def micros_of(column: pa.ChunkedArray | pa.Array) -> IntArray:
    """Return dates, stamps or times of day as microseconds, NAT where they are empty or too far off."""
    kind = column.type
    usual = pa.time64("us") if pa.types.is_time(kind) else pa.timestamp("us", getattr(kind, "tz", None))
    micros = (column if kind == usual else column.cast(usual, safe=False)).cast(pa.int64())
    micros = to_array(pc.fill_null(micros, NAT) if micros.null_count else micros)
    return micros if np.all(near := np.abs(micros) < LIMIT) else np.where(near, micros, NAT)
