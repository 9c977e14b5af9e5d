"""How a text is written: delimiter, header, units row, decimal sign; told from its first thousands of lines."""

from __future__ import annotations

import contextlib
import csv
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import islice

from ..errors import InputError
from .cells import decimal_sign
from .names import COLUMNS, is_quality_name, is_time_name, plain, signal_role, split_tag
from .options import ReadOptions
from .times import stamp_kind

_NUMBER = re.compile(
    r"^[+-]?(?:\d{1,3}(?:[ .,'’\u00a0\u202f]\d{3})+(?:[.,]\d+)?|\d+(?:[.,]\d*)?|[.,]\d+)(?:[eEdD][+-]?\d+)?$"
    r"|^[+-]?(?:inf(?:inity)?|nan|1\.#\w+)$", re.IGNORECASE)
_WITH_UNIT = re.compile(r"^[+-]?\d[\d.,'’]*(?:[eE][+-]?\d+)?\s?[^\d\s:;,|][^:;,|]{0,15}$")
_LINE = re.compile(rb"[^\r\n]*(?:\r\n?|\n)|[^\r\n]+")
COMMENT = re.compile(r"^\s*(?:#|\*|//|--|%|!)")
DELIMITERS = (",", ";", "\t", "|")
HEAD_LINES = 4000
Line = tuple[int, int, str]


@dataclass(frozen=True)
class Dialect:
    """names: of columns. offset, line: where the data begin. end: of what was looked at. kinds: what each column
    holds."""

    delimiter: str
    names: tuple[str, ...]
    offset: int
    end: int
    line: int
    decimal: str
    kinds: tuple[str, ...]


def find_dialect(text: bytes | bytearray, options: ReadOptions, where: str) -> Dialect:
    """Find how a text is written. Raises InputError without a header, data, or anything that looks like columns."""
    lines = lines_of(text)
    end = lines[HEAD_LINES][1] if len(lines) > HEAD_LINES else len(text)
    declared = re.match(r"^sep=(.)$", lines[0][2].strip()) if lines else None
    lines = [row for row in lines[1 if declared else 0 : HEAD_LINES] if row[2].strip(" \t,;|")]
    if not lines:
        raise InputError("file holds no data", where=where, remedy="export it again")
    last = range(len(lines) - min(24, max(1, len(lines) // 2)), len(lines))
    delimiter = options.delimiter or (declared[1] if declared else _delimiter(
        [lines[i][2] for i in last], [row[2] for row in lines[:30]]))
    cells = cache(lambda i: split_line(lines[i][2], delimiter))
    width = Counter(len(cells(i)) for i in last).most_common(1)[0][0]
    enough = 6 if width > 300 else 24
    tail = [cells(i) for i in last if len(cells(i)) == width][-enough:]
    kinds = _column_kinds(tail, width)
    first = _first_row(lines, cells, kinds, options.header_row or 0)
    if first is None or all(k == "text" for k in kinds if k != "empty"):
        raise _without_data([cells(i) for i in range(min(10, len(lines)))], width, options, where)
    before = {lines[i][0]: cells(i) for i in range(max(first - HEAD_LINES // 10, 0), first)}
    data = [cells(i) for i in range(first, min(first + enough, len(lines)))]
    # a tag that is recorded less often is empty in the last rows: the first ones tell what it holds
    begun = _column_kinds([row for row in data if len(row) == width], width)
    return Dialect(delimiter, column_names(before, width, options, where), lines[first][1], end, lines[first][0],
                   options.decimal or _decimal([*data, *tail], delimiter),
                   tuple(b if k == "empty" else k for k, b in zip(kinds, begun, strict=True)))


def _delimiter(lines: list[str], first: list[str]) -> str:
    """The one that cuts the lines into equally many times and numbers, and one of the `first` into names."""
    scores = dict.fromkeys(DELIMITERS, 0.0)
    for candidate in DELIMITERS:
        rows = [split_line(line, candidate) for line in lines]
        width, count = Counter(map(len, rows)).most_common(1)[0]
        if width < 2:
            continue
        kinds = [kind(cell) for row in rows if len(row) == width for cell in row[:40]]
        known, filled = len(kinds) - kinds.count("text"), len(kinds) - kinds.count("empty")
        begun = [{*map(kind, row[:40])} for row in (split_line(line, candidate) for line in first) if len(row) == width]
        scores[candidate] = (count / len(rows) * (0.7 * known / len(kinds) + 0.3) * (filled / len(kinds)) ** 0.1
                             * (1.3 if {"text"} in begun or {"text", "empty"} in begun else 1.0))
    return max(DELIMITERS, key=scores.__getitem__)


def _column_kinds(rows: list[list[str]], width: int) -> tuple[str, ...]:
    counted = [Counter(k for row in rows if (k := kind(row[column])) != "empty") for column in range(width)]
    return tuple(found.most_common(1)[0][0] if found else "empty" for found in counted)


def _first_row(lines: list[Line], cells: Callable[[int], list[str]], kinds: tuple[str, ...], header: int) -> int | None:
    """The first row with stamps, or half of its numbers, where the last rows have them, as has another soon after."""
    times = [i for i, k in enumerate(kinds) if k in ("time", "clock")]
    wanted = times or [i for i, k in enumerate(kinds) if k == "number"][:50]

    @cache
    def is_data(row: int) -> bool:
        own = cells(row)
        found = [kind(own[i]) if i < len(own) else "empty" for i in wanted]
        hits = [f == kinds[i] for f, i in zip(found, wanted, strict=True)]
        return any(hits) and sum(hits) + (found.count("empty") if times else 0) >= len(wanted) / 2 and not (
            COMMENT.match(own[0]) and kind(own[0]) == "text")

    count = len(lines)
    return next((i for i in range(count) if lines[i][0] > header and is_data(i)
                 and (i + 1 == count or any(map(is_data, range(i + 1, min(i + 4, count)))))), None)


def _decimal(rows: list[list[str]], delimiter: str) -> str:
    numbers = [c for row in rows for c in row if kind(c) == "number" and (delimiter != "," or "," in c)]
    only_commas = delimiter != "," and any("," in c for c in numbers) and not any("." in c for c in numbers)
    return decimal_sign(numbers, "," if only_commas else ".")


def _without_data(begun: list[list[str]], width: int, options: ReadOptions, where: str) -> InputError:
    what = "no rows with a time and numbers found: this is not an export of measurements"
    remedy = "name the time with --time-format, the decimal sign with --decimal, the header with --header-row"
    if width < 2 and options.delimiter:
        what = f"the lines are not divided by {options.delimiter!r}"
        remedy = "leave --delimiter out to have it found, or name another"
    elif all(score_names(cells) > 0 for cells in begun):
        what, remedy = "only a header: no rows of data", "export it again with samples"
    elif width < 2:
        what = "no columns found: the lines have no common delimiter"
        remedy = "name it with --delimiter, or export a table of time stamps and values"
    return InputError(what, where=where, remedy=remedy)


def column_names(before: dict[int, list[str]], width: int, options: ReadOptions, where: str) -> tuple[str, ...]:
    """Return the names from the lines above the data, by their numbers; a two-line header is put together."""
    if options.columns or options.header_row is not None:
        given = list(options.columns) or before.get(options.header_row or 0)
        if not given:
            raise InputError(f"line {options.header_row} cannot be the header", where=where)
        return tuple(_fit(given, width))
    rows = [cells for cells in before.values() if _spans(cells, width)]
    commented = [[COMMENT.sub("", cells[0]).strip(), *cells[1:]] for cells in rows if COMMENT.match(cells[0])][-1:]
    rows = [cells for cells in rows if not COMMENT.match(cells[0])] or [row for row in commented if score_names(row)]
    if not rows:
        raise InputError("no header line found: nothing says which column is the time, the setpoint or the measurement",
                         where=where, remedy="add a header line, or name the columns with --columns time,SP,PV,OP")
    rows = [_fit(row, width) for row in rows[-8:]]
    best = max(range(len(rows)), key=lambda i: (score_names(rows[i]), i))
    names = rows[best]
    words = [plain(name) for name in names if name]
    if len(set(words)) < len(words) or names.count("") > width / 3:  # the header goes on in another line
        for other in (*reversed(rows[:best]), *rows[best + 1 :]):
            joined = _joined(names, other)
            if len(set(joined)) > len(set(names)):
                return tuple(joined)
    return tuple(names)


def _spans(cells: list[str], width: int) -> bool:
    """A header covers the columns, give or take empty ones at the end."""
    filled = [i for i, cell in enumerate(cells) if cell.strip()]
    used = filled[-1] + 1 if filled else 1
    return (used <= width and (len(cells) >= width - 1 or used >= max(2, width // 2))
            and len(filled) >= max(1, min(width, 3) - 1))


def score_names(cells: list[str]) -> float:
    """How much a line looks like a header: points for names that are known, off for numbers and times."""
    points = 0.0
    for i, cell in enumerate(cells):
        if split_tag(cell).role or signal_role(cell):
            points += 1.0
        elif is_time_name(cell) or any(plain(cell) in COLUMNS[kind] for kind in ("tag", "value", "loop")):
            points += 1.5 if i == 0 else 1.0
        elif kind(cell) in ("number", "time", "clock"):
            points -= 1.0
    return points


def _joined(names: list[str], other: list[str]) -> list[str]:
    """Two lines of names as one; a name counts for the empty cells on its right, as a merged spreadsheet cell does."""
    high, low = (other, names) if score_names(names) >= score_names(other) else (names, other)
    result, upper = [], ""
    for cell, word in zip(high, low, strict=True):
        upper = cell or upper
        tag = split_tag(upper)
        part = bool(word) and plain(word) not in COLUMNS["value"] and (  # below a whole tag a unit may stand
            not (tag.loop and tag.role) or is_time_name(word) or is_quality_name(plain(word)))
        result.append(f"{upper}.{word}" if upper and part else upper or word)
    return result


def _fit(cells: Sequence[str], width: int) -> list[str]:
    names = [cell.strip().lstrip("\ufeff") for cell in cells[:width]]
    return names + [""] * (width - len(names))


@lru_cache(1 << 14)
def kind(cell: str) -> str:
    """Return "empty", "time" (date, with or without clock), "clock", "number" or "text".

    >>> [kind(c) for c in ("17-Mar-26 08:00:00", "08:00:00", "4,050.7", "405.3 m3/h", "Bad Input", "")]
    ['time', 'clock', 'number', 'number', 'text', 'empty']
    """
    text = cell.strip(" \t\"'")
    if not text or len(text) > 60:
        return "text" if text else "empty"
    if _NUMBER.match(text):
        return "time" if len(text) >= 14 and stamp_kind(text) else "number"
    return stamp_kind(text) or ("number" if _WITH_UNIT.match(text) else "text")


def split_line(line: str, delimiter: str) -> list[str]:
    """Split one line into cells; quotes are honoured."""
    if '"' in line:
        with contextlib.suppress(csv.Error):  # of quotes that are none
            return next(csv.reader([line], delimiter=delimiter), [""])
    return line.split(delimiter)


def lines_of(text: bytes | bytearray) -> list[Line]:
    """Return (line number from 1, offset in bytes, text) of the first logical lines; quotes may hold line ends."""
    found: list[Line] = []
    lines, at, offset = [match[0] for match in islice(_LINE.finditer(text), 2 * HEAD_LINES)], 0, 0
    while at < len(lines) and len(found) <= HEAD_LINES:
        line, count = lines[at], 1
        if line.count(b'"') % 2:  # an open quote: go on to the line that closes it, if one comes soon
            count = next((k for k in range(2, 9) if b"".join(lines[at : at + k]).count(b'"') % 2 == 0), 1)
            line = b"".join(lines[at : at + count])
        found.append((at + 1, offset, line.decode().rstrip("\r\n")))
        offset += len(line)
        at += count
    return found
