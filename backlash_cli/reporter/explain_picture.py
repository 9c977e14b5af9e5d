"""A comparison or an explanation as one still picture (PNG or SVG), for documents and mail."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import UsageError
from ..record import FloatArray
from ..results import Comparison, Explanation, Series
from . import explain_figures as figures
from .explain_words import error_size, predicted_name
from .figures import Figure
from .residual_causes import causes
from .still import still, write_still

SUFFIXES = (".png", ".svg")
DPI = 80


def check_picture(path: Path | None) -> None:
    """Refuse a name that no picture can have. Raises UsageError."""
    if path is not None and path.suffix.lower() not in SUFFIXES:
        raise UsageError("a picture is .png or .svg", where=str(path), remedy=f"name it {path.stem}.png")


def write_picture(found: Comparison | Explanation, path: Path) -> None:
    """Draw the result to `path`, whole or not at all. Raises UsageError for another suffix, or without a record."""
    check_picture(path)
    if (series := found.series) is None:
        raise UsageError("the result keeps no samples to draw", where=str(path))
    floor = found.noise_floor
    if isinstance(found, Comparison):
        title = f"{found.loop}: model against measurement, hold-out error {error_size(found.fitness.rmse_holdout)}"
        lines = figures.overlay(series, found.settings, found.where, floor, predicted_name(found))
        beside = ("PV against OP", figures.plane(series, found.settings))
        rests = {"this model": series.residual}
    else:
        title = f"{found.loop}: which effect is missing?"
        lines = figures.ladder_overlay(series, found.steps, found.settings, floor)
        beside = ("", figures.ladder_bars(found.steps, floor))
        ends = zip(("before", "after"), found.steps[:1] + found.steps[1:][-1:], strict=False)
        rests = {word: np.where(series.used, series.measured - step.prediction, np.nan)
                 for word, step in ends if step.prediction is not None}
    rows = [[beside, *_turns(series, rests, floor)], [("", lines)]]
    write_still(path, still(title, rows, (1.0, 2.2), (9.5, 8.5)), DPI)


def _turns(series: Series, residuals: dict[str, FloatArray], noise_floor: float) -> list[tuple[str, Figure]]:
    """Mean residual against the time since OP turned, the mark of play and stiction."""
    found = causes(series, residuals)[:1] if residuals else []
    return [(cause.title, figures.cause_figure(cause, noise_floor)) for cause in found]
