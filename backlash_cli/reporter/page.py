"""Report pages: one HTML file that holds everything, works from disk and offline, and lets nothing out.

What a page says stands in templates/NAME.html, built from the sections, tables and figures of templates/parts.html.
All text is escaped by the template engine; scripts are allowed by their fingerprint only, so markup in a tag name can
neither show nor run.
"""

from __future__ import annotations

import base64
import contextlib
import gzip
import hashlib
import math
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from .._version import __version__
from .files import make_folder, write_text
from .safe import file_names, shorten
from .templates import environment

if TYPE_CHECKING:
    from markupsafe import Markup


_PAGES = re.compile(r"loops-[0-9a-f]{12}")


@dataclass(frozen=True)
class LoopPart:
    """One loop of a report: name, mark, one line on it; template of its part, and what makes the content of that."""

    name: str
    mark: str
    brief: str
    template: str
    content: Callable[[], Mapping[str, Any]]


def page(template: str, title: str, *, subtitle: str = "", plotly_file: str = "", back: tuple[str, str] | None = None,
         **content: Any) -> str:
    """Return the HTML of a whole page, self-contained: styles, scripts, data and the plotting library are inside.

    template: file that says what stands on the page; content: the values it asks for. Figures (plotly Figure, or its
    dict) and library are packed, a third of their size, and the browser unpacks them. plotly_file: relative address of
    a plotly.js beside the page, for folders of many pages, instead of the library inside. back: (address, words) of a
    link above the title.
    """
    figures: list[str] = []  # as text, a fifth of the memory that their numbers take
    body = environment("html").get_template(template).render(plot=partial(_plot, figures), cell=cell, **content)
    inside = bool(figures) and not plotly_file
    script = _asset("page.js")
    allowed = " ".join(_fingerprint(s) for s in (*[plotly_script()] * inside, script))
    if figures and plotly_file:
        allowed += " 'self' file:"  # a page opened from disk has no origin of its own; file: is its folder
    return environment("html").get_template("page.html").render(
        title=title, subtitle=subtitle, body=body, style=_asset("page.css"), script=script, allowed=allowed, back=back,
        figures=_pack(f"[{','.join(figures)}]") if figures else "", plotly=_packed_plotly() if inside else "",
        plotly_file=plotly_file if figures else "")


def _plot(figures: list[str], figure: Any) -> Markup:
    """Keep a figure as JSON, where numbers that JSON does not know are null, and return the place where it is drawn."""
    from markupsafe import Markup

    figures.append(figure.to_json() if hasattr(figure, "to_json") else
                   msgspec.json.encode(figure, enc_hook=lambda value: value.tolist()).decode())
    return Markup('<div class="plot"></div>')


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


@cache
def _asset(name: str) -> str:
    return files("backlash_cli.reporter").joinpath("templates", name).read_text("utf-8")


def _fingerprint(script: str) -> str:
    digest = hashlib.sha256(script.encode("utf-8")).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def cell(value: Any, text: str = "") -> dict[str, Any]:
    """Return what a table needs to know of a value: how it is shown and sorted, and whether it is a number."""
    raw = value.item() if hasattr(value, "item") else value
    number = isinstance(raw, int | float) and not isinstance(raw, bool) and math.isfinite(raw)
    shown = str(raw)
    if raw is None or (isinstance(raw, float) and not number):
        shown = "–"
    elif isinstance(raw, bool):
        shown = "yes" if raw else "no"
    elif isinstance(raw, float):
        shown = f"{raw:.4g}"
    return {"text": text or shown, "key": repr(raw) if number else "" if shown == "–" else shown, "number": number}


def one_page(title: str, subtitle: str, loops: Sequence[LoopPart], overview: str, content: Mapping[str, Any]) -> str:
    """Return one self-contained page with every loop folded below the overview, the template of that name."""
    links = {one.name: f"#loop-{i}" for i, one in enumerate(loops)}
    return page("loops.html", title, subtitle=subtitle, loops=loops, overview=overview, links=links, **content)


def write_folder_of(folder: Path, title: str, subtitle: str, loops: Sequence[LoopPart], overview: str,
                    content: Mapping[str, Any], told: object, step: Callable[[], None] = lambda: None) -> None:
    """Write index.html and a page per loop, which is loaded when it is opened; `step` is called after each page.

    told: tells this report from others. The old report is whole until the new one is; see `write_pages`.
    """
    names = file_names(one.name for one in loops)

    def pages() -> Iterator[tuple[str, str]]:
        for one in loops:
            yield names[one.name], page(one.template, shorten(one.name, 120), subtitle=one.brief, x=one.content(),
                                        plotly_file="plotly.js", back=("../index.html", "All loops"))
            step()

    write_pages(folder, (__version__, told), pages(), lambda subfolder: page(
        overview, title, subtitle=subtitle, links=links_to(names, subfolder), plotly_file=f"{subfolder}/plotly.js",
        **content))


def write_pages(folder: Path, told: object, pages: Iterable[tuple[str, str]], index: Callable[[str], str]) -> None:
    """Write `pages`, (file name without suffix, HTML), into a subfolder and then index.html.

    told: tells this report from others by what it says. index: gives the HTML of index.html for the subfolder's name.
    index.html is replaced last, in one step: until then the old report is whole. Pages of older runs, except those of
    the report just replaced, are removed at the end.
    """
    mark = hashlib.sha256(repr(told).encode("utf-8", "backslashreplace")).hexdigest()[:12]
    subfolder = folder / f"loops-{mark}"
    previous = ""  # the subfolder that the present index.html points to
    with contextlib.suppress(OSError, ValueError):
        found = _PAGES.search((folder / "index.html").read_text("utf-8"))
        previous = found.group() if found else ""
    make_folder(subfolder)
    try:
        write_text(subfolder / "plotly.js", plotly_script())
        for name, text in pages:
            write_text(subfolder / f"{name}.html", text)
        write_text(folder / "index.html", index(subfolder.name))
    except BaseException:
        if subfolder.name != previous:
            shutil.rmtree(subfolder, ignore_errors=True)
        raise
    for old in folder.iterdir():
        if _PAGES.fullmatch(old.name) and old.name not in (subfolder.name, previous):
            shutil.rmtree(old, ignore_errors=True)


def links_to(names: Mapping[str, str], subfolder: str) -> dict[str, str]:
    """Return the address of every item's page as seen from index.html."""
    return {item: f"{subfolder}/{name}.html" for item, name in names.items()}
