"""The figures of the pages as one still picture (PNG or SVG) for paper and mail, drawn by matplotlib."""

from __future__ import annotations

import html
import warnings
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from ..record import Record
from ..results import LoopReport
from . import figures
from .figures import Figure
from .files import replacing
from .safe import terminal
from .words import VERDICTS, interval, percent, size

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture

SIZE = (13.0, 8.8)  # inches
DPI = 110
PER_INCH = 9.0  # letters of the title
POINTS = 2400  # per line: what a picture of this width can show
DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-."}
MARKERS = {"circle": "o", "circle-open": "o", "x-thin-open": "x", "line-ns-open": "|", "diamond": "D"}
STYLE: Any = {
    "text.parse_math": False, "font.size": 8, "axes.grid": True, "grid.color": "#e3e7ea", "grid.linewidth": 0.6,
    "axes.axisbelow": True, "axes.spines.top": False, "axes.spines.right": False, "axes.labelsize": 9,
    "axes.titlesize": 9, "legend.fontsize": 7, "legend.frameon": False}


def loop_figure(record: Record, report: LoopReport) -> Picture:
    """Return the evidence of one loop: the whole record on top; below a close look with the stretches where the stem
    stands still, PV against OP with the dead band, and which size fits best."""
    record = figures.known_part(record)
    window, confirmed = figures.close_look(record, report), report.confirmation
    words = f"{report.loop}: {VERDICTS[report.verdict]}"
    if (d := size(report)) is not None and report.cluster is not None:
        words += f", dead band {percent(d)} of the output span ({interval(report.cluster.ci95)})"
    below = [("close look", figures.trend(record, report, window, POINTS, room=0.06))]
    if record.output is not None:
        below.append(("PV against OP (red: close look)", figures.plane(record, window, report, points=4000)))
    below.append(("which size fits best", figures.profile(report)) if confirmed is not None
                 and len(confirmed.profile) > 2 else ("sizes from half periods", figures.estimates(report)))
    return still(words, [[("", figures.trend(record, report, points=POINTS, room=0.016))], below], (1.2, 1.0), SIZE)


def write_still(path: Path, picture: Picture, dpi: int = DPI) -> None:
    """Write a picture to a .png or .svg file, whole or not at all, the same bytes for the same picture. Raises
    BacklashError when the place cannot be written."""
    suffix = path.suffix.lower()
    with replacing(path) as temporary, warnings.catch_warnings():
        # names in scripts that the font does not have, and records so short that there is no room for dates
        warnings.simplefilter("ignore", UserWarning)
        picture.savefig(temporary, format=suffix[1:], dpi=dpi,
                        metadata={"Software": None} if suffix == ".png" else {"Date": None})


def still(title: str, rows: Sequence[Sequence[tuple[str, Figure]]], heights: Sequence[float],
          size: tuple[float, float]) -> Picture:
    """Return plotly figures, each with its title, in rows of these relative heights; size: inches."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure as Picture
    with rc_context(STYLE):
        whole = Picture(figsize=size, layout="constrained")
        whole.suptitle(fill(terminal(title, 240), int(PER_INCH * size[0])), x=0.01, ha="left", fontsize=12,
                       fontweight="bold")
        stripes = whole.subfigures(len(rows), 1, height_ratios=heights, squeeze=False)[:, 0]
        for row, stripe in zip(rows, stripes, strict=True):
            for (words, figure), part in zip(row, stripe.subfigures(1, len(row), squeeze=False)[0], strict=True):
                _draw(part, words, figure["data"], figure["layout"], narrow=len(row) > 1)
    return whole


def _draw(part: Any, words: str, data: Sequence[Figure], layout: Figure, *, narrow: bool) -> None:
    """One figure: its vertical axes below each other over one horizontal one, as their domains say."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
    from matplotlib.ticker import FixedLocator
    scales = {key.replace("axis", ""): axis for key, axis in layout.items()
              if key.startswith("yaxis") and "overlaying" not in axis}
    heights = [high - low for low, high in (axis.get("domain", (0.0, 1.0)) for axis in scales.values())]
    panels = part.subplots(len(scales), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    axes: dict[str, Axes] = dict(zip(scales, panels, strict=True))
    dates = layout["xaxis"].get("type") == "date"
    for trace in data:
        if trace.get("visible", True) is True:
            name = trace.get("yaxis", "y")
            _trace(axes[layout[name.replace("y", "yaxis")].get("overlaying", name)], trace, dates)
    for shape in layout.get("shapes", ()):
        _shape(axes, shape, dates)
    for one, which, axis in [(panels[-1], "x", layout["xaxis"]), *((axes[n], "y", scales[n]) for n in scales)]:
        one.set(**{f"{which}label": axis.get("title", {}).get("text", "")})
        if axis.get("type") == "log":
            one.set(**{f"{which}scale": "log"})
            getattr(one, f"{which}axis").set(major_locator=FixedLocator(axis.get("tickvals", [])),
                                             major_formatter="{x:g}", minor_formatter="")
        if "range" in axis:
            one.set(**{f"{which}lim": axis["range"]})
        if axis.get("autorange") == "reversed":
            one.invert_yaxis()
    if dates:  # a minute at least
        locator = AutoDateLocator(maxticks=5 if narrow else 10)
        panels[-1].xaxis.set(major_locator=locator, major_formatter=ConciseDateFormatter(locator))
        low, high = np.transpose([one.dataLim.intervalx for one in panels if np.isfinite(one.dataLim.intervalx).all()]
                                 or [(0.0, 0.0)])
        room = max(0.0, 60.0 / 86400.0 - (high.max() - low.min())) / 2.0
        panels[-1].set_xlim(low.min() - room, high.max() + room)
    top = panels[0]
    for note in layout.get("annotations", ()):  # words at a place of the data, or of the panel where they refer to it
        across, up = note.get("xref") == "paper", note.get("yref", "y") in ("paper", "y domain")
        top.text(note["x"] if across else _numbers([note["x"]], dates)[0], note["y"], html.unescape(note["text"]),
                 transform=top.transAxes if across and up else top.get_xaxis_transform() if up else top.transData,
                 rotation=-note.get("textangle", 0), ha=note.get("xanchor", "center"), va=note.get("yanchor", "center"))
    top.set_title(terminal(words), loc="left")
    handles = {label: handle for one in panels for handle, label in zip(*one.get_legend_handles_labels(), strict=True)}
    if handles:
        place = {"loc": "outside lower center", "ncols": 2} if narrow else {"loc": "outside upper right", "ncols": 6}
        part.legend([*handles.values()], [*handles], **place)


def _trace(one: Axes, trace: Figure, dates: bool) -> None:
    label = html.unescape(trace["name"]) if trace.get("showlegend", True) and trace.get("name") else "_"
    line, marker = trace.get("line", {}), trace.get("marker", {})
    if trace["type"] == "bar":
        drawn = one.barh(trace["y"], trace["x"], color=marker["color"], height=trace["width"])
        one.bar_label(drawn, trace["text"], fontsize=8, padding=2)
        return
    x, y = _numbers(trace["x"], dates), _numbers(trace["y"])
    if "fill" in trace:  # stretches behind the lines, from the bottom of the panel to its top
        one.fill_between(x, 0.0, y, where=np.isfinite(y).tolist(), color=trace["fillcolor"], linewidth=0, label=label,
                         transform=one.get_xaxis_transform())
        return
    colour, size = marker.get("color", line.get("color")), marker.get("size", 0.0)
    one.plot(x, y, color=line.get("color", colour), linewidth=0.7 * line.get("width", 0.0), label=label,
             alpha=trace.get("opacity"), linestyle=DASHES[line.get("dash", "solid")] if line else "",
             marker=MARKERS[marker["symbol"]] if marker else "", markersize=0.6 * size, markeredgecolor=colour,
             markerfacecolor="none" if marker and "open" in marker["symbol"] else colour,
             markeredgewidth=0.0 if size < 4 else 1.0)
    for where, height, words in zip(x, y, trace["text"] if "text" in trace["mode"] else (), strict=False):
        one.text(where, height, html.unescape(words), ha="center", va="bottom")


def _shape(axes: dict[str, Axes], shape: Figure, dates: bool) -> None:
    """A line or band across all panels, or across one of them at a height."""
    label = html.unescape(shape["name"]) if shape.get("showlegend") else "_"
    upright = shape.get("yref") == "paper"
    low, high = _numbers([shape["x0"], shape["x1"]], dates) if upright else (shape["y0"], shape["y1"])
    for one in [*axes.values()] if upright else [axes[shape.get("yref", "y")]]:
        if shape["type"] == "rect":
            span = one.axvspan if upright else one.axhspan
            span(low, high, color=shape["fillcolor"], alpha=shape["opacity"], linewidth=0, label=label)
        else:
            line, stroke = shape["line"], one.axvline if upright else one.axhline
            stroke(low, color=line["color"], linewidth=0.8 * line["width"], linestyle=DASHES[line["dash"]], label=label)
        label = "_"


def _numbers(values: Sequence[Any], dates: bool = False) -> Any:
    return np.array(values, dtype=np.float64) / (86_400_000.0 if dates else 1.0)
