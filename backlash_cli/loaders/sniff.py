"""How a text file is written: delimiter, lines before the header, header, units row, decimal sign.

Looks at some dozens of lines at the beginning and the end of the first megabytes.
"""

from __future__ import annotations

import contextlib
import csv
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..errors import InputError
from .names import LOOP, TAG, VALUE, is_time_name, plain, signal_role, split_tag
from .options import ReadOptions

_NUMBER = re.compile(
    r"^[+-]?(?:\d{1,3}(?:[ .,'’\u00a0\u202f]\d{3})+(?:[.,]\d+)?|\d+(?:[.,]\d*)?|[.,]\d+)(?:[eEdD][+-]?\d+)?$"
)
_WITH_UNIT = re.compile(r"^[+-]?\d[\d.,'’]*(?:[eE][+-]?\d+)?\s?[^\d\s:;,|][^:;,|]{0,15}$")
_WORDS = re.compile(r"^[+-]?(?:inf(?:inity)?|nan|1\.#\w+)$", re.IGNORECASE)
_DATE = (r"(?:\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4}"
         r"|\d{1,2}[-/. ]+[^\W\d]{3,12}\.?[-/. ,]+\d{2,4}"
         r"|\d{4}[-/. ][^\W\d]{3,12}\.?[-/. ]\d{1,2}|[^\W\d]{3,12}\.? \d{1,2},? \d{4}|(?:19|20)\d{6})")  # fmt: skip
_CLOCK = r"\d{1,2}[:.h]\d{2}(?:[:.]\d{2}(?:[.,:]\d+)?)?\s*(?:[AaPp]\.?\s?[Mm]\.?)?"
_ODD = re.compile(r"^(?:[^\W\d]{3} [^\W\d]{3}\s+\d{1,2} (?:[\d:]+ .*\d{4}|\d{4} [\d:]+.*)|\d{4}年.*)$")
_TIME = re.compile(
    rf"^(?:[^\W\d]{{2,10}},?\s+)?(?:{_DATE}(?:[T_ ,]+{_CLOCK}|T?\d{{6}}(?:\.\d+)?)?)\s*[A-Za-z0-9+:\-]{{0,8}}$"
)
_COMPACT = re.compile(r"^(?:19|20)\d{6}[T ]?\d{4,6}(?:[.,]\d+)?Z?$")
_CLOCK_ONLY = re.compile(r"^\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?\s*(?:[AaPp]\.?\s?[Mm]\.?)?$")
COMMENT = re.compile(r"^\s*(?:#|\*|//|--|%|!)")
DELIMITERS = (",", ";", "\t", "|")
HEAD_LINES = 4000
_DECIMAL_COMMA = re.compile(r"^\s*[+-]?(?:\d{1,3}(?:\.\d{3})+|\d+),\d+(?:[eE][+-]?\d+)?\s*(?:[^\d\s].*)?$")
_DECIMAL_POINT = re.compile(r"^\s*[+-]?(?:\d*\.\d+|\d{1,3}(?:,\d{3})+\.\d*)\s*(?:[^\d\s].*)?$")
_GROUPED = re.compile(r"^\s*-?[1-9]\d{0,2},\d{3}\s*$")

Line = tuple[int, int, str]
Row = tuple[int, list[str]]
HEAD_SIZES = (256 << 10, 4 << 20)


@dataclass(frozen=True)
class Dialect:
    """names: column names as written. offset: byte where the data begin. line: number of that line.

    decimal: sign before the fraction. kinds: what each column holds in the first and last rows seen.
    """

    delimiter: str
    names: tuple[str, ...]
    offset: int
    line: int
    decimal: str = "."
    kinds: tuple[str, ...] = ()


def find_dialect(text: bytes, complete: bool, options: ReadOptions, where: str) -> Dialect:
    """Find how a text is written from as many of its first lines as that takes; complete: it is all of the file.

    Raises InputError when there is no header line, no data, or nothing that looks like columns.
    """
    for size in HEAD_SIZES:
        head, last = text[:size], len(text) <= size or size == HEAD_SIZES[-1]
        if head.count(b"\n") + head.count(b"\r") < 40 and not last:
            continue
        whole = complete and len(text) <= size
        try:
            return sniff(head.decode("utf-8", errors="replace" if whole else "ignore"), whole, options, where)
        except InputError:
            if last:
                raise
    raise AssertionError("the last size raises")


def sniff(head: str, complete: bool, options: ReadOptions, where: str) -> Dialect:
    """Find the dialect in the first part of a file. `complete`: `head` is the whole file.

    Raises InputError when there is no header line, no data, or nothing that looks like columns.
    """
    lines = lines_of(head)
    if not complete and len(lines) > 1:
        lines = lines[:-1]
    declared = re.match(r"^sep=(.)$", lines[0][2].strip()) if lines else None
    if declared:
        lines = lines[1:]
    lines = [row for row in lines[:HEAD_LINES] if row[2].strip(" \t,;|")]
    if not lines:
        raise InputError("file holds no data", where=where, remedy="export it again")
    last = [text for _, _, text in lines[-min(24, max(1, len(lines) // 2)) :]]
    delimiter = options.delimiter or (declared[1] if declared else _delimiter(last, [row[2] for row in lines[:30]]))
    tail = [split_line(text, delimiter) for text in last]
    width = Counter(map(len, tail)).most_common(1)[0][0]
    tail = [cells for cells in tail if len(cells) == width]
    tail = tail[-6:] if width > 300 else tail
    kinds = _column_kinds(tail, width)
    first = _first_data_row(lines, delimiter, kinds, options)
    if first is None or all(k == "text" for k in kinds if k != "empty"):
        if width < 2 and options.delimiter:
            raise InputError(f"the lines are not divided by {options.delimiter!r}", where=where,
                             remedy="leave --delimiter out to have it found, or name another")
        _refuse_without_data(lines, delimiter, width, where)
    assert first is not None
    before = [(number, split_line(text, delimiter)) for number, _, text in lines[:first][-HEAD_LINES // 10 :]]
    names = column_names(before, width, options, where)
    data = [split_line(text, delimiter) for _, _, text in lines[first : first + (6 if width > 300 else 24)]]
    number, at, _ = lines[first]
    return Dialect(delimiter, names, len(head[:at].encode("utf-8", errors="replace")), number,
                   options.decimal or _decimal([*data, *tail], delimiter), _filled_in(kinds, data))


def _delimiter(lines: list[str], first: list[str]) -> str:
    """The delimiter that cuts the lines into equally many cells which look like times, numbers and words.

    first: the first lines; a line of as many names among them speaks for a delimiter.
    """
    best, chosen = 0.0, ","
    for candidate in DELIMITERS:
        rows = [split_line(line, candidate) for line in lines[-24:]]
        width, count = Counter(map(len, rows)).most_common(1)[0]
        if width < 2:
            continue
        kinds = [kind(cell) for row in rows if len(row) == width for cell in row[:40]]
        known = sum(k != "text" for k in kinds)
        filled = sum(k != "empty" for k in kinds)
        score = count / len(rows) * (known + 0.3 * (len(kinds) - known)) / len(kinds) * (filled / len(kinds)) ** 0.1
        if any(len(row) == width and _is_names(row) for row in (split_line(line, candidate) for line in first)):
            score *= 1.3
        if score > best:
            best, chosen = score, candidate
    return chosen


def _is_names(cells: list[str]) -> bool:
    kinds = {kind(cell) for cell in cells[:40]}
    return "text" in kinds and kinds <= {"text", "empty"}


def _column_kinds(rows: list[list[str]], width: int) -> tuple[str, ...]:
    """The kind of most filled cells of each column."""
    kinds = []
    for column in range(width):
        counted = Counter(kind(row[column]) for row in rows if row[column])
        counted.pop("empty", 0)
        kinds.append(counted.most_common(1)[0][0] if counted else "empty")
    return tuple(kinds)


def _filled_in(kinds: tuple[str, ...], data: list[list[str]]) -> tuple[str, ...]:
    """Judge a column that is empty in the last rows by the first ones (tags recorded less often are padded)."""
    empty = [i for i, k in enumerate(kinds) if k == "empty"]
    rows = [cells for cells in data if len(cells) == len(kinds)]
    found = dict(zip(empty, _column_kinds([[cells[i] for i in empty] for cells in rows], len(empty)), strict=True))
    return tuple(found.get(i, k) for i, k in enumerate(kinds))


def _first_data_row(lines: list[Line], delimiter: str, kinds: tuple[str, ...], options: ReadOptions) -> int | None:
    is_data = _data_test(kinds)
    start = 0 if options.header_row is None else options.header_row
    seen: dict[int, bool] = {}

    def flag(i: int) -> bool:
        if i not in seen:
            seen[i] = is_data(split_line(lines[i][2], delimiter))
        return seen[i]

    for i, (number, _, _) in enumerate(lines):
        if number > start and flag(i) and (i + 1 == len(lines) or any(map(flag, range(i + 1, min(i + 4, len(lines)))))):
            return i
    return None


def _data_test(kinds: tuple[str, ...]) -> Callable[[list[str]], bool]:
    """A row of data has its stamps where the last rows have them, or numbers in half of their number columns."""
    times = [i for i, k in enumerate(kinds) if k in ("time", "clock")]
    numbers = [i for i, k in enumerate(kinds) if k == "number"][:50]

    def is_data(cells: list[str]) -> bool:
        if COMMENT.match(cells[0]) and kind(cells[0]) == "text":
            return False
        if times:
            found = [kind(cells[i]) if i < len(cells) else "empty" for i in times]
            hits = [f == kinds[i] for f, i in zip(found, times, strict=True)]
            return any(hits) and sum(h or f == "empty" for h, f in zip(hits, found, strict=True)) >= len(times) / 2
        hits = [i < len(cells) and kind(cells[i]) == "number" for i in numbers]
        return any(hits) and sum(hits) >= len(numbers) / 2

    return is_data


def _decimal(rows: list[list[str]], delimiter: str) -> str:
    if delimiter == ",":
        # quoted "405,12": a comma before other than three digits is no thousands separator
        cells = [cell for row in rows for cell in row if "," in cell]
        commas = all(re.match(r"^\s*-?\d+,\d+\s*$", cell) for cell in cells)
        return "," if cells and commas and not all(_GROUPED.match(cell) for cell in cells) else "."
    with_mark = [cell for row in rows for cell in row if ("," in cell or "." in cell) and kind(cell) == "number"]
    with_mark = [re.sub(r"[ '’\u00a0\u202f](?=\d{3})", "", cell) for cell in with_mark]
    comma = sum(bool(_DECIMAL_COMMA.match(cell)) for cell in with_mark)
    return "," if comma > sum(bool(_DECIMAL_POINT.match(cell)) for cell in with_mark) else "."


def _refuse_without_data(lines: list[Line], delimiter: str, width: int, where: str) -> None:
    if all(score_names(split_line(text, delimiter)) > 0 for _, _, text in lines[:10]):
        raise InputError("only a header: no rows of data", where=where, remedy="export it again with samples")
    if width < 2:
        raise InputError("no columns found: the lines have no common delimiter", where=where,
                         remedy="name it with --delimiter, or export as CSV")
    raise InputError("no rows with a time and numbers found: this is not an export of measurements", where=where,
                     remedy="name the time with --time-format, the decimal sign with --decimal, the header with "
                     "--header-row")


def column_names(before: Sequence[Row], width: int, options: ReadOptions, where: str) -> tuple[str, ...]:
    """Return the names from the lines above the data; a two-line header is put together."""
    if options.columns:
        return _fit(list(options.columns), width)
    if options.header_row is not None:
        chosen = [cells for number, cells in before if number == options.header_row]
        if not chosen:
            raise InputError(f"line {options.header_row} cannot be the header", where=where)
        return _fit(chosen[0], width)
    rows = [cells for _, cells in before if not COMMENT.match(cells[0]) and _spans(cells, width)]
    if not rows:
        commented = [cells for _, cells in before if COMMENT.match(cells[0]) and _spans(cells, width)]
        rows = [[COMMENT.sub("", cells[0]).strip(), *cells[1:]] for cells in commented[-1:]]
        if not rows or score_names(rows[0]) == 0:
            rows = []
    if not rows:
        raise InputError("no header line found: nothing says which column is the time, the setpoint or the measurement",
                         where=where, remedy="add a header line, or name the columns with --columns time,SP,PV,OP")
    rows = rows[-8:]
    best = max(range(len(rows)), key=lambda i: (score_names(rows[i]), i))
    names = _fit(rows[best], width)
    others = [_fit(row, width) for row in (*reversed(rows[:best]), *rows[best + 1 :])]
    if others and _needs_second_line(names):
        for other in others:
            joined = _joined(names, other)
            if len(set(joined)) > len(set(names)):
                return joined
    return names


def _spans(cells: list[str], width: int) -> bool:
    """A header covers the columns, give or take empty ones at the end."""
    used = len(cells)
    while used > 1 and not cells[used - 1].strip():
        used -= 1
    filled = sum(bool(cell.strip()) for cell in cells)
    return (
        used <= width
        and (len(cells) >= width - 1 or used >= max(2, width // 2))
        and (filled >= max(1, min(width, 3) - 1))
    )


def score_names(cells: list[str]) -> float:
    points = 0.0
    for i, cell in enumerate(cells):
        if not cell.strip():
            continue
        word = plain(cell)
        if split_tag(cell).role or signal_role(cell):
            points += 1.0
        elif is_time_name(cell) or word in TAG or word in VALUE or word in LOOP:
            points += 1.5 if i == 0 else 1.0
        elif kind(cell) in ("number", "time", "clock"):
            points -= 1.0
    return points


def _needs_second_line(names: tuple[str, ...]) -> bool:
    words = [plain(name) for name in names if name.strip()]
    blanks = sum(not name.strip() for name in names)
    return len(set(words)) < len(words) or blanks > len(names) / 3


def _joined(names: tuple[str, ...], other: tuple[str, ...]) -> tuple[str, ...]:
    def filled(row: tuple[str, ...]) -> list[str]:
        """Carry a name to the empty cells on its right, as a merged spreadsheet cell means it."""
        result, last = [], ""
        for cell in row:
            last = cell.strip() or last
            result.append(last)
        return result

    lower_has_roles = score_names(list(names)) >= score_names(list(other))
    low, top = (names, other) if lower_has_roles else (other, names)
    high = filled(top)
    result = []
    for upper, lower in zip(high, low, strict=True):
        word = lower.strip()
        if not upper or (is_time_name(word) and not upper):
            result.append(word)
        elif plain(word) in VALUE:
            result.append(upper)
        else:
            result.append(f"{upper}.{word}" if word else upper)
    return tuple(result)


def _fit(cells: list[str], width: int) -> tuple[str, ...]:
    names = [cell.strip().lstrip("\ufeff") for cell in cells[:width]]
    return tuple(names + [""] * (width - len(names)))


def kind(cell: str) -> str:
    """Return "empty", "time" (date, with or without clock), "clock", "number" or "text".

    >>> [kind(c) for c in ("17-Mar-26 08:00:00", "08:00:00", "4,050.7", "405.3 m3/h", "Bad Input", "")]
    ['time', 'clock', 'number', 'number', 'text', 'empty']
    """
    text = cell.strip(" \t\"'")
    if not text:
        return "empty"
    if len(text) > 60:
        return "text"
    if _NUMBER.match(text) or _WORDS.match(text):
        return "time" if _COMPACT.match(text) and len(text) >= 14 else "number"
    if _CLOCK_ONLY.match(text):
        return "clock"
    if _TIME.match(text) or _COMPACT.match(text) or _ODD.match(text):
        return "time"
    return "number" if _WITH_UNIT.match(text) else "text"


def split_line(line: str, delimiter: str) -> list[str]:
    """Split one line into cells; quotes are honoured."""
    if '"' in line:
        with contextlib.suppress(csv.Error):  # of quotes that are none
            return next(csv.reader([line], delimiter=delimiter), [""])
    return line.split(delimiter)


def lines_of(text: str) -> list[tuple[int, int, str]]:
    """Return (line number from 1, character offset, text) of every logical line; quotes may hold line ends."""
    found: list[tuple[int, int, str]] = []
    position, number = 0, 1
    ends = re.compile(r"\r\n|\n|\r")
    while position < len(text):
        end = ends.search(text, position)
        stop, following, breaks = (end.start(), end.end(), 1) if end else (len(text), len(text), 1)
        if text.count('"', position, stop) % 2 and end:
            # an open quote: go on to the line end that closes it, if one comes soon
            probe, count = following, 1
            while count < 8 and probe < len(text):
                end = ends.search(text, probe)
                until, probe_next = (end.start(), end.end()) if end else (len(text), len(text))
                count += 1
                if text.count('"', position, until) % 2 == 0:
                    stop, following, breaks = until, probe_next, count
                    break
                probe = probe_next
        found.append((number, position, text[position:stop]))
        number += breaks
        position = following
    return found
