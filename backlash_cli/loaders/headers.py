"""Names of the columns from the lines above the data: one header line, or two put together."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ..errors import InputError
from .cells import kind
from .names import LOOP, TAG, VALUE, is_time_name, plain, signal_role, split_tag
from .options import ReadOptions

Row = tuple[int, int, list[str]]
COMMENT = re.compile(r"^\s*(?:#|\*|//|--|%|!)")


def column_names(
    before: Sequence[Row], width: int, options: ReadOptions, where: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return (names, units) from the lines above the data; a two-line header is put together."""
    if options.columns:
        return _fit(list(options.columns), width), ()
    if options.header_row is not None:
        chosen = [cells for number, _, cells in before if number == options.header_row]
        if not chosen:
            raise InputError(f"line {options.header_row} cannot be the header", where=where)
        return _fit(chosen[0], width), ()
    plain_rows = [cells for _, _, cells in before if not COMMENT.match(cells[0])]
    rows = [cells for cells in plain_rows if _spans(cells, width)]
    if not rows:
        commented = [cells for _, _, cells in before if COMMENT.match(cells[0]) and _spans(cells, width)]
        rows = [[COMMENT.sub("", cells[0]).strip(), *cells[1:]] for cells in commented[-1:]]
        if not rows or score_names(rows[0]) == 0:
            rows = []
    if not rows:
        raise InputError(
            "no header line found: nothing says which column is the time, the setpoint or the measurement",
            where=where,
            remedy="add a header line, or name the columns with --columns time,SP,PV,OP",
        )
    rows = rows[-8:]
    best = max(range(len(rows)), key=lambda i: (score_names(rows[i]), i))
    names = _fit(rows[best], width)
    others = [_fit(row, width) for row in (*reversed(rows[:best]), *rows[best + 1 :])]
    if others and _needs_second_line(names):
        for other in others:
            joined = _joined(names, other)
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
