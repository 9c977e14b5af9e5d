"""Reports for a terminal: lines and tables of a fixed width, coloured only where asked for."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ..record import Note
from .safe import clip

WIDTH = 100


class Screen:
    """A report in the making, at most `width` columns wide; nothing in a text is taken for markup."""

    def __init__(self, *, colour: bool = False, width: int = WIDTH) -> None:
        self._out = io.StringIO()
        self._console = Console(file=self._out, width=width, force_terminal=colour, highlight=False, markup=False,
                                color_system="standard" if colour else None, emoji=False, legacy_windows=False)

    def say(self, text: str = "", *, indent: int = 0, style: str = "") -> None:
        """Add a paragraph, wrapped between words; a line end in front stays an empty line."""
        self._console.print(Padding(Text(text.lstrip("\n"), style=style), (text.startswith("\n"), 0, 0, indent)))

    def table(self, columns: Sequence[str], rows: Iterable[Sequence[str]], *, styles: Sequence[Sequence[str]] = (),
              most: int | None = None) -> None:
        """Add a table; the last column is wrapped.

        columns: titles, with a `>` in front where numbers are justified to the right. styles: of the cells, row by row.
        most: width of the first column, longer names end in an ellipsis.
        """
        table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
        for place, title in enumerate(columns):
            last = place == len(columns) - 1
            table.add_column(title.removeprefix(">"), justify="right" if title.startswith(">") else "left",
                             no_wrap=not last, overflow="fold" if last else "ellipsis", ratio=1 if last else None,
                             max_width=None if place else most)
        for place, row in enumerate(rows):
            own = styles[place] if styles else [""] * len(row)
            table.add_row(*(Text(cell, style=style) for cell, style in zip(row, own, strict=True)))
        self._console.print(table)

    def notes(self, title: str, notes: Sequence[Note], most: int | None = None) -> None:
        """Add reasons or warnings below a title, the first `most` of them; nothing where there are none."""
        if not notes:
            return
        self.say(f"\n{title}")
        for note in notes[:most]:
            self.say(f"{note.code}: {clip(note.message, 400)}", indent=2)
        if most is not None and len(notes) > most:
            self.say(f"and {len(notes) - most} more; --format json lists all of them", indent=2)

    def text(self) -> str:
        """Return the report without trailing blanks, ending with a line end."""
        return "\n".join(line.rstrip() for line in self._out.getvalue().splitlines()) + "\n"
