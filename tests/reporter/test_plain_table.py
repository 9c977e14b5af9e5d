"""The plain table against the one that rich prints, for any texts: wide letters, words longer than a column."""

import io

from hypothesis import example, given, settings
from hypothesis import strategies as st
from rich.console import Console
from rich.table import Table
from rich.text import Text

from backlash_cli.reporter.plain_table import GAP, Column, lines, wrapped

COLUMNS = (Column("Loop", least=6, most=20), Column("Size", right=True), Column("Advice or reason"))
LETTERS = st.sampled_from("abcd xyz  -./…–%9流量ü")
NAMES = st.text(LETTERS, max_size=30).map(str.strip)
TEXTS = st.lists(st.text(LETTERS.filter(lambda c: c != " "), min_size=1, max_size=60), max_size=12).map(" ".join)
ROWS = st.lists(st.tuples(NAMES, st.integers(0, 10**6).map(str), TEXTS), max_size=8)


def by_rich(rows: list[tuple[str, ...]], width: int) -> list[str]:
    out = io.StringIO()
    console = Console(file=out, width=width, color_system=None, highlight=False, markup=False, emoji=False,
                      legacy_windows=False)
    table = Table(box=None, pad_edge=False, padding=(0, GAP, 0, 0))
    for column in COLUMNS[:-1]:
        table.add_column(column.title, justify="right" if column.right else "left", min_width=column.least,
                         max_width=column.most, no_wrap=True, overflow="ellipsis")
    table.add_column(COLUMNS[-1].title, ratio=1, overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    console.print(table)
    return [line.rstrip() for line in out.getvalue().splitlines()]


@given(ROWS, st.integers(60, 110))
@example([("FIC1", "3", "word " * 30)], 60)
@example([("流" * 15, "3", "流" * 60)], 61)
@settings(deadline=None)
def test_the_lines_are_those_of_rich(rows, width):
    assert list(lines(COLUMNS, rows, width)) == by_rich(rows, width)


def test_no_text_is_one_empty_line():
    assert wrapped("", 10) == [""]
