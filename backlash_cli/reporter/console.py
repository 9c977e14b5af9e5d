"""Reports for a terminal: lines and tables of a fixed width, coloured only where asked for.

What a report says stands in templates/NAME.txt. A line of it is a paragraph, wrapped and indented as it begins, or as
far as `hang`; `style("bold")` in front of a line or of a cell colours it; `table` makes a table of its lines, cells
parted by |.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from .templates import environment

WIDTH = 100
_STYLED = re.compile(r"((?:.*\t)? *)(?:\x02(.*?)\x02)?(.*)")


def screen(template: str, *, colour: bool = False, width: int = WIDTH, **content: Any) -> str:
    """Return a report, at most `width` columns wide, without trailing blanks; nothing in a text is taken for markup.

    template: file that says what stands in the report; content: the values it asks for.
    """
    from markupsafe import Markup

    out, tables = io.StringIO(), list[Table]()
    console = Console(file=out, width=width, force_terminal=colour, highlight=False, markup=False, emoji=False,
                      color_system="standard" if colour else None, legacy_windows=False)

    def style(name: str) -> Markup:
        return Markup(f"\x02{name}\x02" if name else "")

    def table(columns: str, caller: Callable[[], str], most: int | None = None) -> Markup:
        tables.append(_table(columns.split("|"), caller().splitlines(), most))
        return Markup("\x00\n")

    text = environment("txt").get_template(template).render(table=table, style=style, hang=Markup("\t"), **content)
    for line in text.rstrip("\n").split("\n"):
        if line == "\x00":
            console.print(tables.pop(0))
            continue
        lead, styled = _styled(line)
        for part in styled.wrap(console, width - len(lead)):
            console.print(lead + part)
            lead = Text(" " * len(lead))
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def _styled(text: str) -> tuple[Text, Text]:
    """What stands in front of a paragraph, and the paragraph."""
    found = _STYLED.fullmatch(text.replace("\ue000", "|"))
    assert found is not None
    return Text(found[1].replace("\t", "")), Text(found[3], style=found[2] or "")


def _table(columns: list[str], lines: list[str], most: int | None) -> Table:
    """The last column is wrapped; > in front of a title: numbers, justified to the right. most: width of the first."""
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    for place, title in enumerate(map(str.strip, columns)):
        last = place == len(columns) - 1
        table.add_column(title.removeprefix(">"), justify="right" if title.startswith(">") else "left",
                         no_wrap=not last, overflow="fold" if last else "ellipsis", ratio=1 if last else None,
                         max_width=None if place else most)
    for line in lines:
        table.add_row(*(_styled(cell.strip())[1] for cell in line.split("|")))
    return table
