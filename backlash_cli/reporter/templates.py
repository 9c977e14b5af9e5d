"""The templates of all reports, the words they have in common, and reports for a terminal.

A line of templates/NAME.txt is a paragraph, wrapped and indented as it begins, or as far as `hang`; `style("bold")` in
front of a line or of a cell colours it; `table` makes a table of its lines, cells parted by |."""

import io
import re
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import jinja2
from markupsafe import Markup
from rich.console import Console
from rich.table import Table
from rich.text import Text

from .. import record
from . import safe, words

WIDTH = 100
_STYLED = re.compile(r"\A((?:.*\t)? *)(?:\x02(.*?)\x02)?(.*)")


@cache
def environment(kind: str) -> jinja2.Environment:
    """Return the environment of "html" or "txt" templates, in which foreign text is harmless wherever it is put.

    Functions of `words` and `safe` are both filters and functions there; so are the sentences, which are templates of
    the environment "words", in which everything is left as it is."""
    def shown(value: Any) -> Any:
        # | parts the cells of a table on a terminal; terminal() lets nothing through that stands for it here
        return value if isinstance(value, Markup) else safe.visible(str(value), "\n\t") if kind == "html" else Markup(
            safe.terminal(value).replace("|", "\ue000"))

    made = jinja2.Environment(
        loader=jinja2.PackageLoader("backlash_cli.reporter"), autoescape=kind != "words", trim_blocks=True,
        lstrip_blocks=True, undefined=jinja2.StrictUndefined, finalize=None if kind == "words" else shown)
    known = {name: value for module in (words, safe, record) for name, value in vars(module).items()
             if name.isupper() or (callable(value) and value.__module__.startswith("backlash_cli"))}
    made.globals |= known
    made.filters |= {name: value for name, value in known.items() if callable(value)}
    if kind != "words":
        own = vars(environment("words").get_template("sentences.txt").module)
        made.globals |= {"lines": lines} | {name: partial(sentence, name) for name in own if not name.startswith("_")}
    return made


def lines(name: str, *about: Any) -> list[str]:
    """Return the lines that sentences.txt has under this name."""
    said = getattr(environment("words").get_template("sentences.txt").module, name)(*about)
    return [line for line in said.splitlines() if line.strip()]


def sentence(name: str, *about: Any) -> str:
    """Return them as one text, as they are: foreign names in it are made harmless where it is put."""
    return " ".join(" ".join(lines(name, *about)).split())


def screen(template: str, *, colour: bool = False, width: int = WIDTH, **content: Any) -> str:
    """A report of at most `width` columns; no text is taken for markup. template: NAME.txt; content: its values."""
    out, tables = io.StringIO(), list[Table]()
    console = Console(file=out, width=width, force_terminal=colour, highlight=False, markup=False, emoji=False,
                      color_system="standard" if colour else None, legacy_windows=False)

    def style(name: str) -> Markup:
        return Markup(f"\x02{name}\x02" if name else "")

    def table(columns: str, caller: Callable[[], str], most: int | None = None) -> Markup:
        """The last column is wrapped; > in front of a title: justified to the right. most: width of the first."""
        made = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
        titles = [*map(str.strip, columns.split("|"))]
        for place, title in enumerate(titles):
            how: dict[str, Any] = {"overflow": "fold", "ratio": 1} if place == len(titles) - 1 else {
                "no_wrap": True, "overflow": "ellipsis", "max_width": None if place else most}
            made.add_column(title.removeprefix(">"), justify="right" if title.startswith(">") else "left", **how)
        for row in caller().splitlines():
            made.add_row(*(_styled(cell.strip())[1] for cell in row.split("|")))
        tables.append(made)
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
    ((lead, style, words),) = _STYLED.findall(text.replace("\ue000", "|"))
    return Text(lead.replace("\t", "")), Text(words, style=style)
