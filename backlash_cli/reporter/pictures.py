"""One picture per loop for paper and mail: the evidence behind the verdict, drawn on the trend (PNG or SVG).

    draw_loop(record, report, folder) -> Path

Top: setpoint and measurement with the half periods that carry the verdict shaded and their estimates written where
they were made; below, the output. Bottom: a close look, PV against OP with the dead band, and the evidence for each
size of dead band with the interval.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..record import FloatArray, Record
from ..results import Estimate, LoopReport, Verdict
from .figures import EVIDENCE, MEASUREMENT, OUTPUT, QUIET, SETPOINT, close_look, thin
from .files import replacing
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
FALLING = "#5b7f95"


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
    window = close_look(record, report) if _used(report, record) else middle_part(record)
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
    _line(axes, record, record.setpoint, span, SETPOINT, "setpoint SP", linestyle=(0, (4, 2)), linewidth=1.1)
    _line(axes, record, record.measurement, span, MEASUREMENT, "measurement PV", linewidth=1.0)
    used = _used(report, record)
    _shade(axes, used)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.22 * (high - low))
    axes.set_ylabel(f"SP, PV ({per_unit(span)})")
    _finish(axes, record)
    _write(axes, used, room=0.016 if legend else 0.06)
    if legend:
        _legend(axes, shaded=bool(used))


def _output(axes: Axes, record: Record, report: LoopReport) -> None:
    assert record.output is not None
    span = record.settings.op_range
    _line(axes, record, record.output, span, OUTPUT, "output OP", linewidth=1.0)
    _shade(axes, _used(report, record))
    axes.set_ylabel(f"OP ({per_unit(span)})")
    _finish(axes, record)


def _close_look(axes: Axes, near: Record, report: LoopReport) -> None:
    _measurement(axes, near, report, legend=False)
    axes.set_title("close look", loc="left", fontsize=10)
    if near.output is None:
        return
    other = axes.twinx()
    _line(other, near, near.output, near.settings.op_range, OUTPUT, "OP", linewidth=1.0)
    other.set_ylabel(f"OP ({per_unit(near.settings.op_range)})", color=OUTPUT)
    other.tick_params(axis="y", colors=OUTPUT, labelsize=8)
    low, high = other.get_ylim()
    other.set_ylim(low - 0.1 * (high - low), high + 0.5 * (high - low))
    other.spines["top"].set_visible(False)


def _plane(axes: Axes, record: Record, near: Record, report: LoopReport) -> None:
    assert record.output is not None and near.output is not None
    s = record.settings
    step = max(1, len(record) // 4000)
    op, pv = _units(record.output[::step], s.op_range), _units(record.measurement[::step], s.pv_range)
    axes.plot(op, pv, ".", color=QUIET, markersize=1.5, alpha=0.5, rasterized=True)
    x, y = _units(means(near.output, POINTS), s.op_range), _units(means(near.measurement, POINTS), s.pv_range)
    axes.plot(x, y, color=EVIDENCE, linewidth=0.9, alpha=0.9)
    axes.set_title("PV against OP (red: close look)", loc="left", fontsize=10)
    axes.set_xlabel(f"OP ({per_unit(s.op_range)})")
    axes.set_ylabel(f"PV ({per_unit(s.pv_range)})")
    size, _ = _size(report)
    if size and report.verdict in CLAIMS:
        _gap(axes, record, near, size)
    _plain(axes)


def _gap(axes: Axes, record: Record, near: Record, size: float) -> None:
    """The two flanks of the valve where PV follows it, else a bar as wide as the dead band."""
    s = record.settings
    limits = axes.get_xlim(), axes.get_ylim()
    lines = gap_lines(near, size)
    width = size * (s.op_range[1] - s.op_range[0])
    if lines is not None:
        for op, pv, label in (lines.rising, lines.falling):
            style = "--" if label == "valve opening" else ":"
            axes.plot(_units(op, s.op_range), _units(pv, s.pv_range), style, color="black", linewidth=1.2, label=label)
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
    _plain(axes)


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


def _used(report: LoopReport, record: Record) -> list[Estimate]:
    """The accepted half periods that lie within the record shown."""
    if not len(record):
        return []
    first, last = record.time[[0, -1]]
    return [e for e in report.estimates if e.accepted and e.end >= first and e.start <= last]


def _shade(axes: Axes, used: Sequence[Estimate]) -> None:
    for estimate in used:
        colour = EVIDENCE if estimate.direction > 0 else FALLING
        axes.axvspan(_date(estimate.start), _date(estimate.end), color=colour, alpha=0.16, linewidth=0)


def _write(axes: Axes, used: Sequence[Estimate], *, room: float) -> None:
    """Write estimates where they were made; one closer than `room` (share of the width) to the last is left out."""
    first, last = axes.get_xlim()
    written = 0.0
    for estimate in used:
        middle = _date(0.5 * (estimate.start + estimate.end))
        place = (middle - first) / (last - first)
        if written + room <= place <= 0.98:
            written = place
            axes.text(
                middle, 0.97, f"{100 * estimate.d:.1f} %", transform=axes.get_xaxis_transform(), ha="center", va="top",
                rotation=90, fontsize=8, color="black",
            )


def _line(
    axes: Axes, record: Record, values: FloatArray, span: tuple[float, float], colour: str, label: str, **style: Any
) -> None:
    """A line thinned to its smallest and largest values, broken at gaps."""
    chosen, gaps = thin(record.index, values)
    x = np.insert(_date(record.time[chosen]), gaps, np.nan)
    y = np.insert(_units(values[chosen], span), gaps, np.nan)
    axes.plot(x, y, color=colour, label=label, **style)


def _units(values: FloatArray, span: tuple[float, float]) -> FloatArray:
    """Engineering units; a span of 0..1 is shown in per cent."""
    low, high = span if span != (0.0, 1.0) else (0.0, 100.0)
    return low + (high - low) * values


def _date(epoch: Any) -> Any:
    """Matplotlib's days since 1970 from UTC epoch seconds."""
    return np.asarray(epoch) / 86400.0


def _legend(axes: Axes, *, shaded: bool) -> None:
    from matplotlib.patches import Patch

    handles, labels = axes.get_legend_handles_labels()
    if shaded:
        handles += [Patch(color=EVIDENCE, alpha=0.3), Patch(color=FALLING, alpha=0.3)]
        labels += ["used, SP above PV", "used, SP below PV"]
    axes.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, fontsize=8, frameon=False)


def _finish(axes: Axes, record: Record) -> None:
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    locator = AutoDateLocator(maxticks=10)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    if len(record):
        room = max(0.0, 60.0 - (record.time[-1] - record.time[0])) / 2.0  # dates need a minute at least
        axes.set_xlim(_date(record.time[0] - room), _date(record.time[-1] + room))
    _plain(axes)


def _plain(axes: Axes) -> None:
    axes.grid(True, color="#e3e7ea", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
