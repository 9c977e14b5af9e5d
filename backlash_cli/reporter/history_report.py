"""The report of a history, as one file or as a folder, by the name it is given."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ..results.history import HalfPeriod, Night, Place, Wear
from .files import write_text
from .history_folder import write_history_folder
from .history_page import DRAWN, history_page


def write_report(output: Path, places: Sequence[Place], wears: Mapping[str, Wear],
                 nights: Mapping[str, Sequence[Night]], half_periods: Callable[[str], Sequence[HalfPeriod]]) -> None:
    """Write one .html file, or a folder for any other name; the old report stays until the new one is whole.

    half_periods: gives the recent half periods of a loop by its name.
    """
    if output.suffix.lower() in (".html", ".htm"):
        shown = {p.loop: half_periods(p.loop) for p in places[:DRAWN]}
        write_text(output, history_page(places, wears, nights, shown))
    else:
        write_history_folder(output, places, wears, nights, half_periods)
