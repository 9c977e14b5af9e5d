"""Comparison and explanation as text, as pages and as still pictures: one model against one record, and how an
explanation was found."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import UsageError
from ..record import FloatArray
from ..results import Comparison, Explanation, Series
from . import explain_figures as figures
from .console import WIDTH, screen
from .figures import Figure
from .page import page
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
    return page("compare.html", f"{c.loop}: model against measurement", subtitle=sentence("span", c), c=c, **_drawn(c))


def explain_page(e: Explanation, *, plotly_file: str = "", back: tuple[str, str] | None = None) -> str:
    """Return the page of an explanation; plotly_file and back as in `page`, for a folder of many pages."""
    return page("explain.html", f"{e.loop}: which effect is missing?", subtitle=sentence("span", e), back=back,
                plotly_file=plotly_file, e=e, **_drawn(e))


def _drawn(found: Comparison | Explanation) -> dict[str, Any]:
    """Model over measurement, what is beside it, and what the residual depends on; None without a record."""
    series, floor = found.series, found.noise_floor
    if isinstance(found, Comparison):
        if series is None:
            return dict.fromkeys(("overlay", "beside", "causes"))
        return {"overlay": figures.overlay(series, found.settings, found.where, floor, sentence("predicted", found)),
                "beside": figures.plane(series, found.settings),
                "causes": _causes(series, {"this model": series.predicted}, floor)}
    bars, steps = figures.ladder_bars(found.steps, floor), found.steps
    if series is None:
        return {"overlay": None, "beside": bars, "causes": None}
    known = any(s.prediction is not None for s in steps)
    first = steps[0].prediction if steps and found.effects else None
    models = {"model": series.predicted} if first is None else {"plain model": first, "final model": series.predicted}
    return {"overlay": figures.ladder_overlay(series, steps, found.settings, floor) if known else None, "beside": bars,
            "causes": _causes(series, models, floor)}


def _causes(series: Series, predictions: Mapping[str, FloatArray], floor: float) -> list[tuple[figures.Cause, Figure]]:
    """The residual against each of its candidate causes."""
    rests = {name: series.residual(p) for name, p in predictions.items()}
    return [(cause, figures.cause_figure(cause, floor)) for cause in figures.causes(series, rests)]


def check_picture(path: Path | None) -> None:
    """Refuse a name that no picture can have. Raises UsageError."""
    if path is not None and path.suffix.lower() not in (".png", ".svg"):
        raise UsageError("a picture is .png or .svg", where=str(path), remedy=f"name it {path.stem}.png")


def write_picture(found: Comparison | Explanation, path: Path) -> None:
    """Draw the result to `path`, whole or not at all. Raises UsageError for another suffix, or without a record."""
    check_picture(path)
    if found.series is None:
        raise UsageError("the result keeps no samples to draw", where=str(path))
    title, words = f"{found.loop}: which effect is missing?", ""
    if isinstance(found, Comparison):
        title = f"{found.loop}: model against measurement, hold-out error {error_size(found.fitness.rmse_holdout)}"
        words = "PV against OP"
    drawn = _drawn(found)
    # mean residual against the time since OP turned, the mark of play and stiction
    turns = [(cause.title, figure) for cause, figure in drawn["causes"][:1]]
    rows = [[(words, drawn["beside"]), *turns], [("", drawn["overlay"])]]
    write_still(path, still(title, rows, (1.0, 2.2), (9.5, 8.5)), DPI)
