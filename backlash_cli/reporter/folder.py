"""A report as a folder: index.html and a page per item that is loaded when it is opened."""

from __future__ import annotations

import contextlib
import re
import shutil
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from .files import make_folder, write_text
from .page import plotly_script

_PAGES = re.compile(r"loops-[0-9a-f]{12}")


def write_pages(folder: Path, mark: str, pages: Iterable[tuple[str, str]],
                index: Callable[[str], str]) -> None:
    """Write `pages`, (file name without suffix, HTML), into a subfolder and then index.html.

    mark: 12 hexadecimal digits that tell this report from others. index: gives the HTML of index.html for the
    subfolder's name. index.html is replaced last, in one step: until then the old report is whole. Pages of older
    runs, except those of the report just replaced, are removed at the end.
    """
    subfolder = folder / f"loops-{mark}"
    previous = _pages_of(folder / "index.html")
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


def _pages_of(index: Path) -> str:
    """Name of the subfolder that the present index.html points to, empty if there is none."""
    with contextlib.suppress(OSError, ValueError):
        found = _PAGES.search(index.read_text("utf-8"))
        return found.group() if found else ""
    return ""
