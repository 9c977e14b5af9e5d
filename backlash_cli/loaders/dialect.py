"""How a CSV file is written: delimiter, lines before the header, header, units row, decimal sign."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field

from ..errors import InputError
from .cells import kind, lines_of, split_line
from .names import LOOP, TAG, VALUE, is_time_name, plain, signal_role, split_tag
from .options import ReadOptions

DELIMITERS = (",", ";", "\t", "|")
_COMMENT = re.compile(r"^\s*(?:#|\*|//|--|%|!)")
_DECIMAL_COMMA = re.compile(r"^\s*[+-]?(?:\d{1,3}(?:\.\d{3})+|\d+),\d+(?:[eE][+-]?\d+)?\s*(?:[^\d\s].*)?$")


@dataclass(frozen=True)
class Dialect:
    """names: column names as written. offset: byte where the data begin. line: number of that line.

    decimal: sign before the fraction. time_columns, clock_columns: columns that look like dates (with or
    without time of day) and times of day. kinds: what each column holds in the first rows. quoted_lines: cells
    may hold line ends.
    """

    delimiter: str
    names: tuple[str, ...]
    offset: int
    line: int
    decimal: str = "."
    kinds: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    quoted_lines: bool = False
    preamble: int = 0
    time_columns: tuple[int, ...] = field(default=())
    clock_columns: tuple[int, ...] = field(default=())


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
    lines = [row for row in lines[:4000] if row[2].strip(" \t,;|")]
    if not lines:
        raise InputError("file holds no data", where=where, remedy="export it again")
    tail = [text for _, _, text in lines[-40:]]
    delimiter = options.delimiter or (declared[1] if declared else _delimiter(tail))
    rows = [(number, at, split_line(text, delimiter)) for number, at, text in lines[:400] + lines[400:][-40:]]
    width = Counter(len(cells) for _, _, cells in rows[-40:]).most_common(1)[0][0]
    full = [cells for _, _, cells in rows if len(cells) == width] or [rows[-1][2][:width]]
    kinds = _column_kinds(full[-40:], full, len(full[-1]))
    first = _first_data_row(rows, kinds, options)
    if first is None or all(k == "text" for k in kinds if k != "empty"):
        _refuse_without_data(rows, width, where)
    assert first is not None
    names, units = _header(rows[:first], width, options, where)
    data = rows[first:]
    decimal = options.decimal or _decimal([cells for _, _, cells in data], delimiter)
    number, at, _ = rows[first]
    return Dialect(
        delimiter, names, len(head[:at].encode("utf-8")), number, decimal, kinds, units,
        any("\n" in cell or "\r" in cell for _, _, cells in data for cell in cells), first,
        tuple(i for i, k in enumerate(kinds) if k == "time"),
        tuple(i for i, k in enumerate(kinds) if k == "clock"),
    )  # fmt: skip


def _delimiter(lines: list[str]) -> str:
    """The delimiter that cuts the lines into equally many cells which look like times, numbers and words."""
    best, chosen = 0.0, ","
    for candidate in DELIMITERS:
        rows = [split_line(line, candidate) for line in lines]
        width, count = Counter(map(len, rows)).most_common(1)[0]
        if width < 2:
            continue
        cells = [cell for row in rows if len(row) == width for cell in row[:60]]
        known = sum(k in ("time", "number", "clock", "empty") for k in map(kind, cells))
        filled = sum(k != "empty" for k in map(kind, cells))
        score = count / len(rows) * (known + 0.3 * (len(cells) - known)) / len(cells) * (filled / len(cells)) ** 0.1
        if score > best:
            best, chosen = score, candidate
    return chosen


def _column_kinds(rows: list[list[str]], all_rows: list[list[str]], width: int) -> tuple[str, ...]:
    """The kind of most cells of each column; a column that is empty further down is judged by its first rows."""
    kinds = []
    for column in range(width):
        counted = Counter(kind(row[column]) for row in rows)
        counted.pop("empty", 0)
        if not counted:
            counted = Counter(kind(row[column]) for row in all_rows[1:] if row[column].strip())
            counted.subtract(["text"])  # the header
        kinds.append(counted.most_common(1)[0][0] if +counted else "empty")
    return tuple(kinds)


def _first_data_row(rows: list[tuple[int, int, list[str]]], kinds: tuple[str, ...], options: ReadOptions) -> int | None:
    times = [i for i, k in enumerate(kinds) if k in ("time", "clock")]
    numbers = [i for i, k in enumerate(kinds) if k == "number"]
    if options.time_format and not times and "text" in kinds:
        times = []

    def is_data(cells: list[str]) -> bool:
        if _COMMENT.match(cells[0]) and kind(cells[0]) == "text":
            return False
        found = [kind(cells[i]) if i < len(cells) else "empty" for i in range(len(kinds))]
        if times:
            return any(found[i] == kinds[i] for i in times) and sum(found[i] in (kinds[i], "empty") for i in times) >= (
                len(times) / 2
            )
        hits = sum(found[i] == "number" for i in numbers)
        return hits >= 1 and hits >= len(numbers) / 2

    flags = [is_data(cells) for _, _, cells in rows]
    if options.header_row is not None:
        return next((i for i, (number, _, _) in enumerate(rows) if number > options.header_row and flags[i]), None)
    for i, flag in enumerate(flags):
        if flag and (i + 1 == len(flags) or any(flags[i + 1 : i + 4])):
            return i
    return None


def _header(
    before: list[tuple[int, int, list[str]]], width: int, options: ReadOptions, where: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return (names, units) from the lines above the data; a two-line header is put together."""
    if options.columns:
        return _fit(list(options.columns), width), ()
    if options.header_row is not None:
        chosen = [cells for number, _, cells in before if number == options.header_row]
        if not chosen:
            raise InputError(f"line {options.header_row} cannot be the header", where=where)
        return _fit(chosen[0], width), ()
    plain_rows = [cells for _, _, cells in before if not _COMMENT.match(cells[0])]
    rows = [cells for cells in plain_rows if _spans(cells, width)]
    if not rows:
        commented = [cells for _, _, cells in before if _COMMENT.match(cells[0]) and _spans(cells, width)]
        rows = [[_COMMENT.sub("", cells[0]).strip(), *cells[1:]] for cells in commented[-1:]]
        if not rows or _score(rows[0]) == 0:
            rows = []
    if not rows:
        raise InputError(
            "no header line found: nothing says which column is the time, the setpoint or the measurement",
            where=where,
            remedy="add a header line, or name the columns with --columns time,SP,PV,OP",
        )
    rows = rows[-8:]
    best = max(range(len(rows)), key=lambda i: (_score(rows[i]), i))
    names = _fit(rows[best], width)
    others = [_fit(row, width) for i, row in enumerate(rows) if i != best]
    if others and _needs_second_line(names):
        for other in reversed(others):
            joined = _joined(names, other, above=rows.index(list(rows[best])) > 0)
            if len(set(joined)) > len(set(names)):
                return joined, ()
    below = [_fit(row, width) for row in rows[best + 1 :]]
    return names, below[0] if below else ()


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


def _score(cells: list[str]) -> float:
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


def _joined(names: tuple[str, ...], other: tuple[str, ...], above: bool) -> tuple[str, ...]:
    def filled(row: tuple[str, ...]) -> list[str]:
        """Carry a name to the empty cells on its right, as a merged spreadsheet cell means it."""
        result, last = [], ""
        for cell in row:
            last = cell.strip() or last
            result.append(last)
        return result

    lower_has_roles = _score(list(names)) >= _score(list(other))
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


def _decimal(rows: list[list[str]], delimiter: str) -> str:
    if delimiter == ",":
        cells = [cell for row in rows for cell in row if "," in cell]
        # quoted "405,12": a comma before other than three digits is no thousands separator
        return "," if cells and all(re.match(r"^\s*-?\d+,\d+\s*$", c) for c in cells) and any(
            not re.match(r"^\s*-?[1-9]\d{0,2},\d{3}\s*$", c) for c in cells
        ) else "."  # fmt: skip
    comma = point = 0
    for row in rows:
        for cell in row:
            if kind(cell) == "number":
                comma += bool(_DECIMAL_COMMA.match(cell))
                point += bool(re.match(r"^\s*[+-]?\d*\.\d+\s*$", cell)) or bool(
                    re.match(r"^\s*-?\d{1,3}(,\d{3})+\.", cell)
                )
    return "," if comma > point else "."


def _refuse_without_data(rows: list[tuple[int, int, list[str]]], width: int, where: str) -> None:
    if len(rows) == 1 or all(_score(cells) > 0 for _, _, cells in rows):
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
