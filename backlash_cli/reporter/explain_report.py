"""Comparison and explanation as text, as pages and as still pictures: one model against one record, and how an
explanation was found."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import UsageError
from ..record import FloatArray
from ..results import Comparison, Explanation, Series
from . import explain_figures as figures
from .console import WIDTH, screen
from .figures import Figure
from .page import page
from .residual_causes import Cause, causes
from .still import still, write_still
from .templates import sentence
from .words import error_size

DPI = 80


def comparison_text(c: Comparison, *, verbose: bool = False, colour: bool = False, width: int = WIDTH) -> str:
    """Return how well the model fits, what is the best to hope for, and where it fails, worst first."""
    return screen("compare.txt", colour=colour, width=min(width, WIDTH), c=c, verbose=verbose)


def explanation_text(e: Explanation, *, verbose: bool = False, colour: bool = False, width: int = WIDTH) -> str:
    """Return the ladder, the answer, what each effect means in the plant, and what stays unexplained."""
    return screen("explain.txt", colour=colour, width=min(width, WIDTH), e=e, verbose=verbose)


def compare_page(c: Comparison) -> str:
    """Return the page of a comparison."""
    drawn: dict[str, Any] = dict.fromkeys(("overlay", "plane", "drawn"))
    if c.series is not None:
        drawn = {"overlay": figures.overlay(c.series, c.settings, c.where, c.noise_floor, sentence("predicted", c)),
                 "plane": figures.plane(c.series, c.settings),
                 "drawn": _causes(c.series, {"this model": c.series.predicted}, c.noise_floor)}
    return page("compare.html", f"{c.loop}: model against measurement", subtitle=sentence("span", c), c=c, **drawn)


def explain_page(e: Explanation, *, plotly_file: str = "", back: tuple[str, str] | None = None) -> str:
    """Return the page of an explanation; plotly_file and back as in `page`, for a folder of many pages."""
    overlay = drawn = None
    if e.series is not None:
        first = e.steps[0].prediction if e.steps else None
        if any(s.prediction is not None for s in e.steps):
            overlay = figures.ladder_overlay(e.series, e.steps, e.settings, e.noise_floor)
        both = {"plain model": first, "final model": e.series.predicted}
        drawn = _causes(e.series, both if first is not None and e.effects else {"model": e.series.predicted},
                        e.noise_floor)
    return page("explain.html", f"{e.loop}: which effect is missing?", subtitle=sentence("span", e), back=back,
                plotly_file=plotly_file, e=e, overlay=overlay, drawn=drawn,
                bars=figures.ladder_bars(e.steps, e.noise_floor))


def _causes(series: Series, predictions: Mapping[str, FloatArray | None], floor: float) -> list[tuple[Cause, Figure]]:
    """The residual against each of its candidate causes."""
    rests = {name: np.where(series.used, series.measured - p, np.nan) for name, p in predictions.items()
             if p is not None}
    return [(cause, figures.cause_figure(cause, floor)) for cause in causes(series, rests)] if rests else []


def check_picture(path: Path | None) -> None:
    """Refuse a name that no picture can have. Raises UsageError."""
    if path is not None and path.suffix.lower() not in (".png", ".svg"):
        raise UsageError("a picture is .png or .svg", where=str(path), remedy=f"name it {path.stem}.png")


def write_picture(found: Comparison | Explanation, path: Path) -> None:
    """Draw the result to `path`, whole or not at all. Raises UsageError for another suffix, or without a record."""
    check_picture(path)
    if (series := found.series) is None:
        raise UsageError("the result keeps no samples to draw", where=str(path))
    floor = found.noise_floor
    predictions: dict[str, FloatArray | None]
    if isinstance(found, Comparison):
        title = f"{found.loop}: model against measurement, hold-out error {error_size(found.fitness.rmse_holdout)}"
        lines = figures.overlay(series, found.settings, found.where, floor, sentence("predicted", found))
        beside = ("PV against OP", figures.plane(series, found.settings))
        predictions = {"this model": series.predicted}
    else:
        title = f"{found.loop}: which effect is missing?"
        lines = figures.ladder_overlay(series, found.steps, found.settings, floor)
        beside = ("", figures.ladder_bars(found.steps, floor))
        ends = zip(("before", "after"), found.steps[:1] + found.steps[1:][-1:], strict=False)
        predictions = {word: step.prediction for word, step in ends}
    # mean residual against the time since OP turned, the mark of play and stiction
    turns = [(cause.title, figure) for cause, figure in _causes(series, predictions, floor)[:1]]
    write_still(path, still(title, [[beside, *turns], [("", lines)]], (1.0, 2.2), (9.5, 8.5)), DPI)
