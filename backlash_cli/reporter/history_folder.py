"""The report of a history as a folder: overview and a page per loop, for plants with many loops."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from .._version import __version__
from ..results.history import HalfPeriod, Night, Place, Wear
from .folder import links_to, write_pages
from .history_page import TITLE, brief, loop_parts, overview, subtitle
from .page import page
from .safe import file_names, shorten


def write_history_folder(folder: Path, places: Sequence[Place], wears: Mapping[str, Wear],
                         nights: Mapping[str, Sequence[Night]],
                         half_periods: Callable[[str], Sequence[HalfPeriod]]) -> None:
    """Write index.html and a page per loop; `half_periods` gives those of one loop when its page is written."""
    names = file_names(p.loop for p in places)
    content = repr((__version__, places, [[n.digest for n in nights[p.loop]] for p in places],
                    [wears[p.loop] for p in places]))
    mark = hashlib.sha256(content.encode("utf-8", "backslashreplace")).hexdigest()[:12]
    pages = ((names[p.loop], page(shorten(p.loop, 120), loop_parts(p, wears[p.loop], nights[p.loop],
                                                                   half_periods(p.loop)),
                                  subtitle=brief(p, wears[p.loop]), plotly_file="plotly.js",
                                  back=("../index.html", "All loops"))) for p in places)
    write_pages(folder, mark, pages, lambda subfolder: page(
        TITLE, overview(places, wears, links_to(names, subfolder)), subtitle=subtitle(nights)))
