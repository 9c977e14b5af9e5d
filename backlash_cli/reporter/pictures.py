"""One picture per loop for paper and mail: the evidence behind the verdict, drawn on the trend (PNG or SVG).

    draw_loop(record, report, folder) -> Path

Top: setpoint and measurement with the half periods that carry the verdict shaded and their estimates written where
they were made; below, the output. Bottom: a close look, PV against OP with the dead band, and the evidence for each
size of dead band with the interval.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..record import Record
from ..results import LoopReport, Verdict
from .figures import EVIDENCE, MEASUREMENT, OUTPUT, QUIET, SETPOINT, close_look
from .files import replacing
from .picture_axes import draw_line, legend_above, plain, shade, time_axis, units, used_in, write_estimates
from .picture_data import gap_lines, known_part, means, middle_part, per_unit
from .safe import file_name, terminal
from .words import VERDICTS, interval, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (13.0, 8.6)  # inches
DPI = 110
SIZES = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # per cent, labelled on the axis of sizes
POINTS = 150  # of the close look in the plane
CLAIMS = (Verdict.BACKLASH, Verdict.SUSPECTED)  # the verdicts that name a size


def draw_loop(
    record: Record, report: LoopReport, folder: Path, *, name: str | None = None, suffix: str = ".png"
) -> Path:
    """Draw the evidence of one loop into `folder` and return the file's path.

    name: file name without suffix, made safe from the loop's name when not given. suffix: ".png" or ".svg". The folder
    must exist. Raises BacklashError when it cannot be written.
    """
    path = Path(folder) / f"{file_name(report.loop) if name is None else name}{suffix}"
    figure = loop_figure(record, report)
    stamp = {"Software": None} if suffix == ".png" else {"Date": None}
    with replacing(path) as temporary, warnings.catch_warnings():
        # Names in scripts that the font does not have, and records so short that there is no room for dates.
        warnings.simplefilter("ignore", UserWarning)
        figure.savefig(temporary, format=suffix[1:], dpi=DPI, metadata=stamp)
    return path


def loop_figure(record: Record, report: LoopReport) -> Figure:
    """Return the picture as a matplotlib Figure that belongs to no window."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    figure = Figure(figsize=SIZE, layout=ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.06))
    record = known_part(record)
    rows = 3 if record.output is not None else 2
    heights = [2.2, 1.2, 2.2] if rows == 3 else [2.4, 2.2]
    grid = figure.add_gridspec(rows, 3, height_ratios=heights)
    trend = figure.add_subplot(grid[0, :])
    _measurement(trend, record, report)
    if record.output is not None:
        below = figure.add_subplot(grid[1, :], sharex=trend)
        _output(below, record, report)
        trend.tick_params(labelbottom=False)
    window = close_look(record, report) if used_in(report, record) else middle_part(record)
    near = record.slice(window.start, window.stop)
    _close_look(figure.add_subplot(grid[-1, 0]), near, report)
    if record.output is not None:
        _plane(figure.add_subplot(grid[-1, 1]), record, near, report)
    _evidence(figure.add_subplot(grid[-1, 2]), report)
    figure.suptitle(_title(report), x=0.01, ha="left", fontsize=13, fontweight="bold", parse_math=False)
    return figure


def _title(report: LoopReport) -> str:
    words = f"{terminal(report.loop, 60)}: {VERDICTS[report.verdict]}"
    size, ci95 = _size(report)
    if size is not None and ci95 is not None and report.verdict in CLAIMS:
        words += f", dead band {percent(size)} of the output span ({interval(ci95)})"
    return words


def _size(report: LoopReport) -> tuple[float | None, tuple[float, float] | None]:
    found = report.cluster or report.confirmation
    return (None, None) if found is None else (found.d, found.ci95)


def _measurement(axes: Axes, record: Record, report: LoopReport, *, legend: bool = True) -> None:
    span = record.settings.pv_range
    draw_line(axes, record, record.setpoint, span, SETPOINT, "setpoint SP", linestyle=(0, (4, 2)), linewidth=1.1)
    draw_line(axes, record, record.measurement, span, MEASUREMENT, "measurement PV", linewidth=1.0)
    used = used_in(report, record)
    shade(axes, used)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.22 * (high - low))
    axes.set_ylabel(f"SP, PV ({per_unit(span)})")
    time_axis(axes, record)
    write_estimates(axes, used, room=0.016 if legend else 0.06)
    if legend:
        legend_above(axes, shaded=bool(used))


def _output(axes: Axes, record: Record, report: LoopReport) -> None:
    assert record.output is not None
    span = record.settings.op_range
    draw_line(axes, record, record.output, span, OUTPUT, "output OP", linewidth=1.0)
    shade(axes, used_in(report, record))
    axes.set_ylabel(f"OP ({per_unit(span)})")
    time_axis(axes, record)


def _close_look(axes: Axes, near: Record, report: LoopReport) -> None:
    _measurement(axes, near, report, legend=False)
    axes.set_title("close look", loc="left", fontsize=10)
    if near.output is None:
        return
    other = axes.twinx()
    draw_line(other, near, near.output, near.settings.op_range, OUTPUT, "OP", linewidth=1.0)
    other.set_ylabel(f"OP ({per_unit(near.settings.op_range)})", color=OUTPUT)
    other.tick_params(axis="y", colors=OUTPUT, labelsize=8)
    low, high = other.get_ylim()
    other.set_ylim(low - 0.1 * (high - low), high + 0.5 * (high - low))
    other.spines["top"].set_visible(False)


def _plane(axes: Axes, record: Record, near: Record, report: LoopReport) -> None:
    assert record.output is not None and near.output is not None
    s = record.settings
    step = max(1, len(record) // 4000)
    op, pv = units(record.output[::step], s.op_range), units(record.measurement[::step], s.pv_range)
    axes.plot(op, pv, ".", color=QUIET, markersize=1.5, alpha=0.5, rasterized=True)
    x, y = units(means(near.output, POINTS), s.op_range), units(means(near.measurement, POINTS), s.pv_range)
    axes.plot(x, y, color=EVIDENCE, linewidth=0.9, alpha=0.9)
    axes.set_title("PV against OP (red: close look)", loc="left", fontsize=10)
    axes.set_xlabel(f"OP ({per_unit(s.op_range)})")
    axes.set_ylabel(f"PV ({per_unit(s.pv_range)})")
    size, _ = _size(report)
    if size and report.verdict in CLAIMS:
        _gap(axes, record, near, size)
    plain(axes)


def _gap(axes: Axes, record: Record, near: Record, size: float) -> None:
    """The two flanks of the valve where PV follows it, else a bar as wide as the dead band."""
    s = record.settings
    limits = axes.get_xlim(), axes.get_ylim()
    lines = gap_lines(near, size)
    width = size * (s.op_range[1] - s.op_range[0])
    if lines is not None:
        for op, pv, label in (lines.rising, lines.falling):
            style = "--" if label == "valve opening" else ":"
            axes.plot(units(op, s.op_range), units(pv, s.pv_range), style, color="black", linewidth=1.2, label=label)
        axes.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    (left, right), (low, high) = limits
    room = high - low
    middle, level = 0.5 * (left + right), low - 0.1 * room
    axes.annotate(
        "", (middle - width / 2, level), (middle + width / 2, level), arrowprops={"arrowstyle": "<->", "color": "black"}
    )
    axes.text(middle, level + 0.02 * room, f"dead band {percent(size)}", ha="center", va="bottom", fontsize=8)
    axes.set_xlim(min(left, middle - 0.6 * width), max(right, middle + 0.6 * width))
    axes.set_ylim(low - 0.18 * room, high + 0.05 * room)


def _evidence(axes: Axes, report: LoopReport) -> None:
    confirmation = report.confirmation
    if confirmation is not None and len(confirmation.profile) > 2:
        size, evidence = np.array(confirmation.profile).T
        axes.plot(100 * size, evidence, ".-", color=MEASUREMENT, linewidth=1.2, markersize=4)
        axes.axhline(0.0, color=QUIET, linewidth=0.8)
        axes.set_xscale("log")
        axes.set_title("evidence for each size of dead band", loc="left", fontsize=10)
        axes.set_ylabel("evidence (log likelihood gained)")
        _interval(axes, confirmation.d, confirmation.ci95, f"PV against OP: {percent(confirmation.d)}", EVIDENCE)
        used = [e.d for e in report.estimates if e.accepted and math.isfinite(e.d)]
        if used:
            middle = float(np.median(used))
            words = f"half periods, median: {percent(middle)}"
            axes.axvline(100 * middle, color="black", linestyle=":", linewidth=1.2, label=words)
        limit = confirmation.limit_of_detection
        if limit is not None and size.min() < limit <= confirmation.d:
            axes.axvspan(100 * size.min(), 100 * limit, color=QUIET, alpha=0.15, linewidth=0, label="too small to see")
        axes.set_xticks([s for s in SIZES if 100 * size.min() <= s <= 100 * size.max()])
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("")
    else:
        _strip(axes, report)
    axes.set_xlabel("dead band (% of the output span)")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)
    plain(axes)


def _strip(axes: Axes, report: LoopReport) -> None:
    """Without a fit over d: every estimate as a point, by the order in which they were made."""
    from matplotlib.ticker import MaxNLocator

    axes.set_title("estimates from the half periods", loc="left", fontsize=10)
    axes.set_ylabel("number of the half period")
    for accepted, colour, words in ((False, QUIET, "refused"), (True, EVIDENCE, "used")):
        chosen = [(k, 100 * e.d) for k, e in enumerate(report.estimates, 1) if e.accepted is accepted]
        if chosen:
            number, size = np.array(chosen).T
            axes.plot(size, number, "o" if accepted else "x", color=colour, markersize=4, label=words)
    if not report.estimates:
        axes.text(0.5, 0.5, "no half period was long enough", ha="center", va="center", transform=axes.transAxes)
    elif report.cluster is not None:
        words = f"{percent(report.cluster.d)} ({interval(report.cluster.ci95)})"
        _interval(axes, report.cluster.d, report.cluster.ci95, words, EVIDENCE)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    used = [100 * e.d for e in report.estimates if e.accepted and math.isfinite(e.d)]
    if used:
        axes.set_xlim(0.0, 1.4 * max(used))


def _interval(axes: Axes, size: float, ci95: tuple[float, float], words: str, colour: str) -> None:
    axes.axvspan(100 * ci95[0], 100 * ci95[1], color=colour, alpha=0.15, linewidth=0)
    axes.axvline(100 * size, color=colour, linewidth=1.5, label=words)
