"""Report pages: one HTML file that holds everything, works from disk and offline, and lets nothing out.

What a page says stands in templates/NAME.html. All text is escaped by the template engine; scripts are allowed by their
fingerprint only, so markup in a tag name can neither show nor run."""

import base64
import contextlib
import gzip
import hashlib
import math
import re
import shutil
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import msgspec
from markupsafe import Markup

from .._version import __version__
from ..record import fingerprint
from .files import make_folder, write_text
from .safe import asked, file_names
from .templates import environment

BACK: Mapping[str, Any] = {"plotly_file": "plotly.js", "back": ("../index.html", "All loops")}  # of a folder's pages
_PAGES = re.compile(r"loops-[0-9a-f]{12}")


def page(template: str, title: str, *, subtitle: str = "", plotly_file: str = "", back: tuple[str, str] | None = None,
         **content: Any) -> str:
    """Return the HTML of a whole page, self-contained: styles, scripts, data and the plotting library are inside.

    template: file that says what stands on the page; content: the values it asks for. Figures (plotly Figure, or its
    dict) and library are packed, a third of their size. plotly_file: relative address of a plotly.js beside the page
    instead of the library inside. back: (address, words) of a link above the title."""
    figures: list[str] = []  # as text, a fifth of the memory that their numbers take

    def plot(figure: Any) -> Markup:
        """Keep a figure as JSON, null for numbers that JSON does not know, and return the place where it is drawn."""
        figures.append(figure.to_json() if hasattr(figure, "to_json") else
                       msgspec.json.encode(figure, enc_hook=lambda value: value.tolist()).decode())
        return Markup('<div class="plot"></div>')

    body = environment("html").get_template(template).render(plot=plot, cell=cell, **content)
    style, script = (files(__package__).joinpath(f"templates/page.{kind}").read_text("utf-8") for kind in ("css", "js"))
    library = plotly_script() if figures and not plotly_file else ""
    allowed = [f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'" for s in (library, script)
               if s]
    if figures and plotly_file:
        allowed += ["'self'", "file:"]  # a page opened from disk has no origin of its own; file: is its folder
    return environment("html").get_template("page.html").render(
        title=title, subtitle=subtitle, body=body, style=style, script=script, allowed=" ".join(allowed), back=back,
        figures=_packed(f"[{','.join(figures)}]", 6 if plotly_file else 9) if figures else "", version=__version__,
        plotly=library and _packed_plotly(), plotly_file=plotly_file if figures else "", asked=asked())


@cache
def plotly_script() -> str:
    """The plotting library's source, for `plotly_file`."""
    from plotly.offline import get_plotlyjs

    return get_plotlyjs()


@cache
def _packed_plotly() -> str:
    return _packed(plotly_script())


def _packed(text: str, level: int = 9) -> str:  # 6 takes a quarter of the time: for one of many pages
    """Text as gzip in base64, the same for the same text: letters that can stand between any tags."""
    return base64.b64encode(gzip.compress(text.encode("utf-8"), level, mtime=0)).decode("ascii")


def cell(value: Any, text: str = "") -> dict[str, Any]:
    """Return what a table needs to know of a value: how it is shown and sorted, and whether it is a number."""
    raw = value.item() if hasattr(value, "item") else value
    number = isinstance(raw, int | float) and not isinstance(raw, bool) and math.isfinite(raw)
    shown = f"{raw:.4g}" if isinstance(raw, float) else str(raw)
    shown = {"None": "–", "nan": "–", "inf": "–", "-inf": "–", "True": "yes", "False": "no"}.get(repr(raw), shown)
    return {"text": text or shown, "key": repr(raw) if number else "" if shown == "–" else shown, "number": number}


def is_page(output: Path) -> bool:
    """Whether a name is that of one page; any other is that of a folder."""
    return output.suffix.lower() in (".html", ".htm")


def write_pages(folder: Path, told: object, loops: Iterable[str], pages: Iterable[tuple[str, Mapping[str, str]]],
                index: Callable[..., str]) -> None:
    """Write the files of each loop, (loop, {suffix: text}), into a subfolder and then index.html, in one step: until
    then the old report is whole. Pages of older runs, except those of the report just replaced, are removed at the end.

    told: tells this report from others. index: gives the HTML of index.html for `links` to pages and `plotly_file`."""
    mark = fingerprint(repr(told), 12)
    subfolder, names, links = folder / f"loops-{mark}", file_names(loops), {}
    before = ""  # the subfolder that the present index.html points to
    with contextlib.suppress(OSError, ValueError):
        before = "".join(_PAGES.findall((folder / "index.html").read_text("utf-8"))[:1])
    make_folder(subfolder)
    try:
        write_text(subfolder / "plotly.js", plotly_script())
        for loop, texts in pages:
            for suffix, text in texts.items():
                write_text(subfolder / f"{names[loop]}.{suffix}", text)
            links[loop] = f"{subfolder.name}/{names[loop]}.html"
        write_text(folder / "index.html", index(links=links, plotly_file=f"{subfolder.name}/plotly.js"))
    except BaseException:
        if subfolder.name != before:
            shutil.rmtree(subfolder, ignore_errors=True)
        raise
    for old in folder.iterdir():
        if _PAGES.fullmatch(old.name) and old.name not in (subfolder.name, before) and (old / "plotly.js").is_file():
            shutil.rmtree(old, ignore_errors=True)
