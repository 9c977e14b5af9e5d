"""A table of plain text in columns, the last of which is wrapped: what rich prints without colours, in a tenth of the
time, which matters for thousands of rows."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.cells import cell_len, set_cell_size

GAP = 2  # blanks between columns
LEAST = 8  # width of the last column, however long the others are
_WORD = re.compile(r"\s*\S+\s*")


@dataclass(frozen=True)
class Column:
    """right: justified to the right. least, most: width; longer texts end in an ellipsis."""

    title: str
    right: bool = False
    least: int = 1
    most: int = 1000


def lines(columns: Sequence[Column], rows: Sequence[Sequence[str]], width: int) -> Iterator[str]:
    """The lines of a table of at most `width` columns, the titles first; the last column is wrapped between words."""
    titles = [column.title for column in columns]
    widths = [
        min(max(column.least, *(cell_len(row[i]) for row in (titles, *rows))), column.most)
        for i, column in enumerate(columns)
    ]
    widths[-1] = min(widths[-1], max(width - sum(widths[:-1]) - GAP * (len(columns) - 1), LEAST))
    indent = " " * (sum(widths[:-1]) + GAP * (len(columns) - 1))
    for row in (titles, *rows):
        cells = [_fitted(text, size, column) for text, size, column in zip(row[:-1], widths, columns, strict=False)]
        first, *rest = wrapped(row[-1], widths[-1])
        yield (" " * GAP).join([*cells, first]).rstrip()
        for line in rest:
            yield (indent + line).rstrip()


def _fitted(text: str, width: int, column: Column) -> str:
    size = len(text) if text.isascii() else cell_len(text)
    if size > width:
        return set_cell_size(text, width - 1) + "…"
    blank = " " * (width - size)
    return blank + text if column.right else text + blank


def wrapped(text: str, width: int) -> list[str]:
    """Lines of at most `width` columns, broken between words, or within words that are longer.

    >>> wrapped("a longer gap than before", 10)
    ['a longer', 'gap than', 'before']
    """
    if len(text) <= width and text.isascii():
        return [text]
    found, line, used = [], "", 0
    for match in _WORD.finditer(text):
        word = match.group()
        if line and used + cell_len(word.rstrip()) > width:
            found.append(line.rstrip())
            line, used = "", 0
        while cell_len(word.rstrip()) > width - used:
            head = _head(word, width)
            found.append(head)
            word = word[len(head) :]
        line, used = line + word, used + cell_len(word)
    return [*found, line.rstrip()]


def _head(word: str, width: int) -> str:
    """As many characters as fit, one at least."""
    size = 0
    for i, character in enumerate(word):
        size += cell_len(character)
        if size > width and i:
            return word[:i]
    return word
