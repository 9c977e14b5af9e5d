"""A comparison or an explanation as one still picture (PNG or SVG), for documents and mail."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import UsageError
from ..record import FloatArray, LoopSettings
from ..results import Comparison, Explanation, Series
from .explain_words import error_size, fails, inside_name, plain_name, predicted_name
from .figures import EVIDENCE, MEASUREMENT, OUTPUT, QUIET, thin
from .files import replacing
from .residual_causes import causes
from .safe import terminal

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUFFIXES = (".png", ".svg")
COLOURS = (QUIET, EVIDENCE, "#2a9d5c", "#7a5bc7", "#b8578f")
DPI = 80
POINTS = 1200  # per line: what a picture of this width can show


def check_picture(path: Path | None) -> None:
    """Refuse a name that no picture can have. Raises UsageError."""
    if path is not None and path.suffix.lower() not in SUFFIXES:
        raise UsageError("a picture is .png or .svg", where=str(path), remedy=f"name it {path.stem}.png")


def write_picture(found: Comparison | Explanation, path: Path) -> None:
    """Draw the result to `path`, whole or not at all. Raises UsageError for another suffix, or without a record."""
    check_picture(path)
    if found.series is None:
        raise UsageError("the result keeps no samples to draw", where=str(path))
    figure = _comparison(found, found.series) if isinstance(found, Comparison) else _explanation(found, found.series)
    form = path.suffix.lower()[1:]
    with replacing(path) as temporary, warnings.catch_warnings():
        # Names in scripts that the font does not have.
        warnings.simplefilter("ignore", UserWarning)
        stamp = {"Software": None} if form == "png" else {"Date": None}
        figure.savefig(temporary, format=form, dpi=DPI, metadata=stamp)


def _figure(title: str, heights: Sequence[float], size: tuple[float, float]) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    figure.suptitle(terminal(title, 120), x=0.01, ha="left", fontsize=12, fontweight="bold", parse_math=False)
    return figure, figure.add_gridspec(len(heights), 2, height_ratios=heights, width_ratios=(1.3, 1.0))


def _comparison(c: Comparison, series: Series) -> Figure:
    figure, grid = _figure(f"{c.loop}: model against measurement, hold-out error {error_size(c.fitness.rmse_holdout)}",
                           (2.0, 1.1, 1.0, 1.5), (9.5, 8.0))
    top = figure.add_subplot(grid[0, :])
    span = c.settings.pv_range
    _line(top, series, series.measured, span, "PV measured", MEASUREMENT)
    _line(top, series, series.predicted, span, predicted_name(c), EVIDENCE)
    _finish(top, "PV")
    middle = figure.add_subplot(grid[1, :], sharex=top)
    _line(middle, series, series.residual, (0.0, span[1] - span[0]), "residual", "#7a5bc7")
    worst = next((r for r in fails(c.where) or c.where if r.stretches), None)
    for number, (first, last) in enumerate(worst.stretches if worst is not None else ()):
        hours = [(t - series.time[0]) / 3600.0 for t in (first, last)]
        shade = middle.axvspan(hours[0], hours[1], color=EVIDENCE, alpha=0.13, linewidth=0)
        if number == 0 and worst is not None:
            shade.set_label(terminal(worst.region, 60))
    _finish(middle, "residual")
    _output(figure.add_subplot(grid[2, :], sharex=top), series, c.settings)
    plane = figure.add_subplot(grid[3, 0])
    for values, colour in ((series.measured, MEASUREMENT), (series.predicted, EVIDENCE)):
        kept = np.where(series.used, values, np.nan)
        x = _units(series.output, c.settings.op_range)
        plane.plot(x, _units(kept, span), color=colour, linewidth=0.6, alpha=0.8)
    _finish(plane, "PV")
    plane.set_xlabel("OP")
    _turns(figure.add_subplot(grid[3, 1]), series, {"": series.residual})
    return figure


def _explanation(e: Explanation, series: Series) -> Figure:
    figure, grid = _figure(f"{e.loop}: which effect is missing?", (1.5, 2.0, 1.2, 1.0), (9.5, 8.0))
    bars = figure.add_subplot(grid[0, 0])
    names = [f"{k} {'baseline' if s.added is None else '+ ' + plain_name(s.added)}" for k, s in enumerate(e.steps)]
    errors = [100 * s.rmse_holdout for s in e.steps]
    drawn = bars.barh(names, errors, color=[COLOURS[k % len(COLOURS)] for k in range(len(names))], height=0.6)
    bars.bar_label(drawn, [error_size(s.rmse_holdout) for s in e.steps], fontsize=8, padding=2)
    bars.invert_yaxis()
    bars.axvline(100 * e.noise_floor, color=MEASUREMENT, linestyle="--", linewidth=1.2,
                 label=f"noise floor {error_size(e.noise_floor)}")
    bars.set_xlim(0, 1.25 * max([*errors, 100 * e.noise_floor]))
    bars.set_xlabel("hold-out error [% of PV span]")
    _finish(bars, "")
    steps = [s for s in (e.steps[0], e.steps[-1]) if s.prediction is not None] if e.steps else []
    rests = {("before", "after")[k]: np.where(series.used, series.measured - s.prediction, np.nan)
             for k, s in enumerate(steps) if s.prediction is not None}
    _turns(figure.add_subplot(grid[0, 1]), series, rests)
    top = figure.add_subplot(grid[1, :])
    span = e.settings.pv_range
    _line(top, series, series.measured, span, "PV measured", MEASUREMENT)
    middle = figure.add_subplot(grid[2, :], sharex=top)
    for k, s in enumerate(e.steps):
        if s.prediction is not None:
            colour = COLOURS[k % len(COLOURS)]
            _line(top, series, s.prediction, span, names[k], colour)
            rest = np.where(series.used, series.measured - s.prediction, np.nan)
            _line(middle, series, rest, (0.0, span[1] - span[0]), "", colour)
    _finish(top, "PV")
    _finish(middle, "residual")
    _output(figure.add_subplot(grid[3, :], sharex=top), series, e.settings)
    return figure


def _output(axes: Axes, series: Series, settings: LoopSettings) -> None:
    _line(axes, series, series.output, settings.op_range, "OP", OUTPUT)
    for name, values in series.moved.items():
        _line(axes, series, values, settings.op_range, inside_name(name), "#0b8a9e")
    _finish(axes, "OP")
    axes.set_xlabel("time [h]")


def _turns(axes: Axes, series: Series, residuals: dict[str, FloatArray]) -> None:
    """Mean residual against the time since OP turned, the mark of play and stiction."""
    found = causes(series, residuals)
    for curve in found[0].curves if found and residuals else ():
        up = "up" in curve.part
        colour = COLOURS[0] if curve.model == "before" else COLOURS[2] if curve.model else EVIDENCE
        axes.plot(curve.x, 100 * curve.mean, color=colour, linestyle="-" if up else "--", linewidth=1.2,
                  label=f"{curve.model} {curve.part}".strip())
    axes.axhline(0.0, color=QUIET, linewidth=0.8)
    _finish(axes, "mean residual [%]", 2)
    axes.set_xlabel("time since OP turned [s]")


def _line(axes: Axes, series: Series, values: FloatArray, span: tuple[float, float], name: str, colour: str) -> None:
    chosen, _ = thin(np.arange(len(values), dtype=np.int64), values, POINTS)
    hours = (series.time[chosen] - series.time[0]) / 3600.0
    axes.plot(hours, _units(values[chosen], span), color=colour, linewidth=0.9, label=name or "_")


def _finish(axes: Axes, label: str, columns: int = 4) -> None:
    axes.set_ylabel(label)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.2)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(fontsize=7, frameon=False, ncols=columns, loc="lower right", bbox_to_anchor=(1.0, 0.98),
                    borderaxespad=0.0)  # above the lines, not over them


def _units(values: FloatArray, span: tuple[float, float]) -> FloatArray:
    return span[0] + (span[1] - span[0]) * values
