"""A report on many loops: one page with every loop folded below the overview, or a folder with a page per loop."""

from __future__ import annotations

import contextlib
import hashlib
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from .._version import __version__
from .files import make_folder, write_text
from .page import Section, drawn, page, plotly_script
from .safe import file_names, shorten

Overview = Callable[[Mapping[str, str]], list[Section]]  # from the address of every loop
_PAGES = re.compile(r"loops-[0-9a-f]{12}")


@dataclass(frozen=True)
class LoopPart:
    """One loop of a report: its name, its mark, one line on it, and what makes its sections when they are written."""

    name: str
    mark: str
    brief: str
    sections: Callable[[], list[Section]]


def one_page(title: str, subtitle: str, loops: Sequence[LoopPart], overview: Overview) -> str:
    """Return one self-contained page."""
    parts = [Section(shorten(one.name, 120), folded=True, anchor=f"loop-{i}", mark=one.mark, summary=one.brief,
                     parts=drawn(one.sections())) for i, one in enumerate(loops)]
    links = {one.name: f"#loop-{i}" for i, one in enumerate(loops)}
    return page(title, [*overview(links), Section("Loops", parts=parts)], subtitle=subtitle)


def write_folder_of(folder: Path, title: str, subtitle: str, loops: Sequence[LoopPart], overview: Overview,
                    content: object, step: Callable[[], None] = lambda: None) -> None:
    """Write index.html and a page per loop, which is loaded when it is opened; `step` is called after each page.

    content: tells this report from others. The old report is whole until the new one is; see `write_pages`.
    """
    names = file_names(one.name for one in loops)

    def pages() -> Iterator[tuple[str, str]]:
        for one in loops:
            yield names[one.name], page(shorten(one.name, 120), one.sections(), subtitle=one.brief,
                                        plotly_file="plotly.js", back=("../index.html", "All loops"))
            step()

    write_pages(folder, fingerprint(content), pages(), lambda subfolder: page(
        title, overview(links_to(names, subfolder)), subtitle=subtitle, plotly_file=f"{subfolder}/plotly.js"))


def fingerprint(content: object) -> str:
    """Return 12 hexadecimal digits that tell reports apart by what they say and which version made them."""
    return hashlib.sha256(repr((__version__, content)).encode("utf-8", "backslashreplace")).hexdigest()[:12]


def write_pages(folder: Path, mark: str, pages: Iterable[tuple[str, str]], index: Callable[[str], str]) -> None:
    """Write `pages`, (file name without suffix, HTML), into a subfolder and then index.html.

    mark: fingerprint of this report. index: gives the HTML of index.html for the subfolder's name. index.html is
    replaced last, in one step: until then the old report is whole. Pages of older runs, except those of the report just
    replaced, are removed at the end.
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
