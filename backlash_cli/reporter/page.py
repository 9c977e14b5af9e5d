"""Report pages: one HTML file that holds everything, works from disk and offline, and lets nothing out.

Build `Section`s from plain values and call `page`. All text is escaped by the template engine; scripts are allowed by
their fingerprint only, so markup in a tag name can neither show nor run.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import msgspec

if TYPE_CHECKING:
    import jinja2


@dataclass(frozen=True)
class Cell:
    """A table cell with more than a value: shown `text`, a link, a mark (`good`, `warn`, `bad`, `quiet`).

    `value` is what the column is sorted by (a number or text). `href` must be one the report made itself.
    """

    value: object
    text: str = ""
    href: str = ""
    mark: str = ""


@dataclass(frozen=True)
class Table:
    """Columns and rows of plain values (text, numbers, bool, None) or Cells.

    `filterable` adds a search box; `choices` names a column whose values are
    offered as a list beside it. `sortable`: for lists of the same kind of thing; not for facts with their values.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[object]]
    filterable: bool = False
    choices: str = ""
    sortable: bool = True


@dataclass(frozen=True)
class Section:
    """A heading with paragraphs, a table, a figure (plotly Figure, its dict, or JSON text) and a note below them.

    `parts` are sections inside this one. `folded` shows only the heading until it is opened; figures are drawn when
    they come into view. `anchor` is the section's address within the page, unique.
    """

    title: str
    text: Sequence[str] = ()
    table: Table | None = None
    figure: Any = None
    note: str = ""
    parts: Sequence[Section] = ()
    folded: bool = False
    anchor: str = ""
    mark: str = ""
    summary: str = ""


def drawn(sections: Sequence[Section]) -> list[Section]:
    """The same sections with figures as JSON text, a fifth of the memory that their numbers take."""
    return [replace(s, figure=None if s.figure is None else _json(s.figure), parts=drawn(s.parts)) for s in sections]


def page(
    title: str,
    sections: Sequence[Section],
    *,
    subtitle: str = "",
    plotly_file: str = "",
    back: tuple[str, str] | None = None,
) -> str:
    """Return the HTML of a whole page, self-contained: styles, scripts, data and the plotting library are inside.

    Figures and library are packed, a third of their size, and the browser unpacks them. plotly_file: relative address
    of a plotly.js beside the page, for folders of many pages, instead of the library inside. back: (address, words)
    of a link above the title.
    """
    figures = list(_figures(sections))
    inside = bool(figures) and not plotly_file
    script = _asset("page.js")
    allowed = " ".join(_fingerprint(s) for s in (*[plotly_script()] * inside, script))
    if figures and plotly_file:
        allowed += " 'self' file:"  # a page opened from disk has no origin of its own; file: is its folder
    return _template().render(
        title=title,
        subtitle=subtitle,
        sections=sections,
        style=_asset("page.css"),
        script=script,
        figures=_pack(f"[{','.join(figures)}]") if figures else "",
        plotly=_packed_plotly() if inside else "",
        plotly_file=plotly_file if figures else "",
        allowed=allowed,
        back=back,
    )


@cache
def plotly_script() -> str:
    """The plotting library's source, for `plotly_file`."""
    from plotly.offline import get_plotlyjs

    return get_plotlyjs()


@cache
def _packed_plotly() -> str:
    return _pack(plotly_script())


def _pack(text: str) -> str:
    """Text as gzip in base64, the same for the same text: letters that can stand between any tags."""
    return base64.b64encode(gzip.compress(text.encode("utf-8"), mtime=0)).decode("ascii")


def _figures(sections: Sequence[Section]) -> Iterator[str]:
    """JSON of the figures in the order in which the page shows them."""
    for s in sections:
        if s.figure is not None:
            yield _json(s.figure)
        yield from _figures(s.parts)


@cache
def _asset(name: str) -> str:
    return files("backlash_cli.reporter").joinpath("templates", name).read_text("utf-8")


def _fingerprint(script: str) -> str:
    digest = hashlib.sha256(script.encode("utf-8")).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


@cache
def _template() -> jinja2.Template:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("backlash_cli.reporter"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["cell"] = _cell
    return environment.get_template("page.html")


def _cell(value: object) -> dict[str, object]:
    """What the template needs of a cell: text, sort key, link, mark, and whether it is a number."""
    cell = value if isinstance(value, Cell) else Cell(value)
    raw = cell.value.item() if hasattr(cell.value, "item") else cell.value
    number = isinstance(raw, int | float) and not isinstance(raw, bool) and math.isfinite(raw)
    return {
        "text": cell.text or _words(raw),
        "key": repr(raw) if number else "" if raw is None or isinstance(raw, float) else _words(raw),
        "number": number,
        "href": cell.href,
        "mark": cell.mark,
    }


def _words(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}" if math.isfinite(value) else "–"
    return str(value)


def _json(figure: Any) -> str:
    """JSON of a figure; numbers that JSON does not know are null."""
    if isinstance(figure, str):
        return figure
    return figure.to_json() if hasattr(figure, "to_json") else msgspec.json.encode(figure, enc_hook=_plain).decode()


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else dict(value)
