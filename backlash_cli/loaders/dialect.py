"""How a CSV file is written: delimiter, lines before the header, header, units row, decimal sign."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from ..errors import InputError
from .cells import kind, lines_of, split_line
from .headers import COMMENT, column_names, score_names
from .options import ReadOptions

DELIMITERS = (",", ";", "\t", "|")
HEAD_LINES = 4000
_DECIMAL_COMMA = re.compile(r"^\s*[+-]?(?:\d{1,3}(?:\.\d{3})+|\d+),\d+(?:[eE][+-]?\d+)?\s*(?:[^\d\s].*)?$")
_DECIMAL_POINT = re.compile(r"^\s*[+-]?(?:\d*\.\d+|\d{1,3}(?:,\d{3})+\.\d*)\s*(?:[^\d\s].*)?$")
_GROUPED = re.compile(r"^\s*-?[1-9]\d{0,2},\d{3}\s*$")

Line = tuple[int, int, str]


@dataclass(frozen=True)
class Dialect:
    """names: column names as written. offset: byte where the data begin. line: number of that line.

    decimal: sign before the fraction. kinds: what each column holds in the first and last rows seen. units: line
    of units below the header. quoted_lines: cells may hold line ends.
    """

    delimiter: str
    names: tuple[str, ...]
    offset: int
    line: int
    decimal: str = "."
    kinds: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    quoted_lines: bool = False


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
    delimiter = options.delimiter or (
        declared[1] if declared else _delimiter(last, [text for _, _, text in lines[:30]])
    )
    tail = [split_line(text, delimiter) for text in last]
    width = Counter(map(len, tail)).most_common(1)[0][0]
    tail = [cells for cells in tail if len(cells) == width]
    tail = tail[-6:] if width > 300 else tail
    kinds = _column_kinds(tail, width)
    first = _first_data_row(lines, delimiter, kinds, options)
    if first is None or all(k == "text" for k in kinds if k != "empty"):
        if width < 2 and options.delimiter:
            raise InputError(
                f"the lines are not divided by {options.delimiter!r}", where=where,
                remedy="leave --delimiter out to have it found, or name another",
            )
        _refuse_without_data(lines, delimiter, width, where)
    assert first is not None
    before = [(number, at, split_line(text, delimiter)) for number, at, text in lines[:first][-HEAD_LINES // 10 :]]
    names, units = column_names(before, width, options, where)
    data = [split_line(text, delimiter) for _, _, text in lines[first : first + (6 if width > 300 else 24)]]
    kinds = _filled_in(kinds, data)
    number, at, _ = lines[first]
    return Dialect(
        delimiter,
        names,
        len(head[:at].encode("utf-8", errors="replace")),
        number,
        options.decimal or _decimal([*data, *tail], delimiter),
        kinds,
        units,
        any("\n" in text or "\r" in text for _, _, text in lines[first:]),
    )


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
        raise InputError(
            "no columns found: the lines have no common delimiter",
            where=where,
            remedy="name it with --delimiter, or export as CSV",
        )
    raise InputError(
        "no rows with a time and numbers found: this is not an export of measurements",
        where=where,
        remedy="name the time with --time-format, the decimal sign with --decimal, the header with --header-row",
    )
