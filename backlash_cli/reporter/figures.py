"""Interactive figures of one loop, as plain plotly dicts in engineering units: the evidence behind a verdict."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from ..record import FloatArray, Frozen, IntArray, Record, hold
from ..results import Estimate, LoopReport
from ..words import WORDS
from .safe import picture
from .words import interval, percent, size

POINTS = 1600  # per line: lowest and highest of each of 800 columns; a page of twelve loops stays below 3 MB
CLOSE_LOOK = 8  # half periods in the close look
CROSSED = 0.5  # share of the gap that OP has to cross while the stem stands still, for the stretch to be marked
FOLLOWS = 0.8  # share of PV's variance that the valve has to explain before its flanks are drawn
SIZES = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # per cent, labelled on the axis of sizes

SETPOINT, MEASUREMENT, OUTPUT, EVIDENCE, QUIET = "#7a8793", "#2878c8", "#c77700", "#d1345b", "#8d99a5"
STEM = "#0b8a9e"
GREEN = "#2a9d5c"
COLOURS = {"bad": EVIDENCE, "warn": OUTPUT, "watch": MEASUREMENT, "good": GREEN, "quiet": QUIET}  # by mark
Figure = dict[str, Any]
DATES: Figure = {"type": "date", "title": {"text": "time (UTC)"}}


def figure(data: Sequence[Figure], x: Figure, *panels: Figure, **layout: Any) -> Figure:
    """Traces over one horizontal axis, one vertical axis or several, top to bottom; layout, `more`: keys of plotly."""
    uprights = {f"yaxis{k}" if k > 1 else "yaxis": panel for k, panel in enumerate(panels, 1)}
    below = {"anchor": f"y{len(panels)}"} if len(panels) > 1 else {}
    return {"data": data, "layout": {"xaxis": x | below, **uprights, **layout}}


def axis(title: str, **more: Any) -> Figure:
    """An axis with its title."""
    return {"title": {"text": title}, **more}


def trace(x: Sequence[Any], y: Sequence[Any], name: str, colour: str, *, mode: str = "lines", hover: str = "%{y}",
          width: float = 1.5, dash: str = "solid", symbol: str = "circle", size: float = 8, **more: Any) -> Figure:
    """A line, or markers, or both as the mode says."""
    line = {"line": {"color": colour, "width": width, "dash": dash}} if "lines" in mode else {}
    marker = {"marker": {"color": colour, "symbol": symbol, "size": size}} if "markers" in mode else {}
    pointed = {"hovertemplate": hover} if hover else {}
    return {"type": "scatter", "mode": mode, "name": picture(name), "x": x, "y": y, **line, **marker, **pointed, **more}


def dots(points: Sequence[tuple[float, float]], name: str, colour: str, **more: Any) -> Figure:
    """(epoch seconds, size) as points in per cent of the span, counted in the legend."""
    return trace([ms(time) for time, _ in points], [round(100 * size, 4) for _, size in points],
                 f"{name} ({len(points)})", colour, mode="markers", **more)


def across(which: str, at: float | tuple[float, float], colour: str, *, name: str = "", width: float = 1.0,
           dash: str = "solid", **more: Any) -> Figure:
    """A line over the whole panel where the axis `which`, "x" or "y", is `at`; a band from one value to another. name:
    its words in the legend, if it stands there."""
    other = "y" if which == "x" else "x"
    low, high = at if isinstance(at, tuple) else (at, at)
    looks: Figure = {"type": "rect", "fillcolor": colour, "opacity": 0.15, "line": {"width": 0}} if isinstance(
        at, tuple) else {"type": "line", "line": {"color": colour, "width": width, "dash": dash}}
    return {f"{which}0": low, f"{which}1": high, f"{other}ref": "paper", f"{other}0": 0, f"{other}1": 1, **looks,
            **({"name": name, "showlegend": True} if name else {}), **more}


def written(text: str, x: float, y: float, **more: Any) -> Figure:
    """Words at a place."""
    return {"text": text, "x": x, "y": y, "showarrow": False, **more}


def trend(record: Record, report: LoopReport, window: slice | None = None, points: int = POINTS,
          room: float | None = None) -> Figure:
    """SP, PV and OP over time, with the half periods that carry the verdict drawn over the measurement.

    Of a window also the stem, as OP through a gap of the size found, with the stretches shaded where OP crosses the gap
    while the stem stands still. points: per line, smallest and largest of each piece, so that no peak is lost. room:
    least distance of the estimates that are written above, as a share of the width."""
    part = record if window is None else record.slice(window.start, window.stop)
    (pv_span, pv_unit), (op_span, op_unit) = shown(record.settings.pv_range), shown(record.settings.op_range)
    line = partial(over_time, part.time, index=part.index, points=points)
    lines = [line(part.setpoint, pv_span, "SP", SETPOINT, width=1.2, dash="dot"),
             line(part.measurement, pv_span, "PV", MEASUREMENT)]
    used, marked = used_in(part, report), np.full(len(part), np.nan)
    for first, last in np.searchsorted(part.time, [(e.start, e.end) for e in used]):
        marked[first:last] = part.measurement[first:last]
    if np.isfinite(marked).any():
        lines.append(line(marked, pv_span, "PV in the half periods used", EVIDENCE, width=3))
    panels, layout = [axis(f"SP, PV [{pv_unit}]")], {"hovermode": "x"}  # type: list[Figure], Figure
    if room is not None and used:
        beside, length, notes = part.time[0], part.time[-1] - part.time[0] or 1.0, []
        for e in used:  # where they were made, those left out that would hide each other
            if beside + room * length <= (middle := 0.5 * (e.start + e.end)) <= part.time[0] + 0.98 * length:
                beside = middle
                notes.append(written(f"{100 * e.d:.1f} %", ms(middle), 0.99, yref="y domain", yanchor="top",
                                     textangle=-90, font={"size": 10}))
        both = np.concatenate([part.measurement, part.setpoint])
        low, high = np.nanmin(both), np.nanmax(both)
        if notes and high > low:
            panels[0]["range"] = units(np.array([1.05 * low - 0.05 * high, 1.25 * high - 0.25 * low]), pv_span)
        layout["annotations"] = notes
    if part.output is not None:
        lines.append(line(part.output, op_span, "OP", OUTPUT, yaxis="y2"))
        d = size(report)
        if window is not None and d is not None and record.output is not None:
            stem = stem_of(record.output, d)[window]
            lines.append(line(stem, op_span, f"stem: OP through {percent(d)} of play", STEM, yaxis="y2"))
            layout["shapes"] = [across("x", (ms(part.time[first]), ms(part.time[last])), STEM, opacity=0.16,
                layer="below", legendgroup="still", name="stem stands still in the gap",
                showlegend=number == 0) for number, (first, last) in enumerate(stands_still(part.output, stem, d))]
        panels = [panels[0] | {"domain": [0.42, 1.0]}, axis(f"OP [{op_unit}]", domain=[0.0, 0.36])]
        layout["height"] = 480
    return figure(lines, DATES, *panels, **layout)


def stem_of(output: FloatArray, size: float) -> FloatArray:
    """Return where the stem is, (samples,) [span]: OP through a gap of `size`; it stays where OP is not known."""
    from ..kernels import play
    known = hold(output)
    return np.asarray(play(known, size, float(known[0]))) if np.isfinite(output).any() else output


def stands_still(output: FloatArray, stem: FloatArray, size: float) -> list[tuple[int, int]]:
    """Return (first, last) sample of the stretches in which OP crosses half of the gap or more and the stem stays."""
    starts = np.flatnonzero(np.diff(stem, prepend=np.nan) != 0.0)
    low, high = (f.reduceat(np.where(np.isfinite(output), output, stem), starts) for f in (np.minimum, np.maximum))
    ends = np.append(starts[1:], len(stem)) - 1
    kept = (high - low >= CROSSED * size) & (ends > starts)
    return list(zip(starts[kept].tolist(), ends[kept].tolist(), strict=True))


def plane(record: Record, window: slice, report: LoopReport, points: int = POINTS) -> Figure:
    """PV against OP: without dead band a line or a cloud, with dead band a leaning box with flat sides. A size that is
    claimed is drawn as wide as it is, with the two flanks of the valve where PV follows it."""
    (pv_span, pv_unit), (op_span, op_unit) = shown(record.settings.pv_range), shown(record.settings.op_range)
    near, every = record.slice(window.start, window.stop), slice(None, None, max(1, len(record) // points))
    assert record.output is not None and near.output is not None

    def path(op: FloatArray, pv: FloatArray, name: str, colour: str, **more: Any) -> Figure:
        return trace(units(op, op_span), units(pv, pv_span), name, colour, hover="OP %{x}, PV %{y}", **more)

    lines = [path(record.output[every], record.measurement[every], "whole record", QUIET, mode="markers", size=3),
             path(means(near.output, 150), means(near.measurement, 150), "close look", EVIDENCE)]
    d, y_axis = size(report), axis(f"PV [{pv_unit}]")
    if d is not None and np.isfinite(record.measurement).any() and np.isfinite(record.output).any():
        for (op, pv), name, dash in zip(flanks(near, d) or (), ("valve opening", "valve closing"), ("dash", "dot"),
                                        strict=False):
            lines.append(path(op, pv, name, STEM, dash=dash))
        low, high = float(np.nanmin(record.measurement)), float(np.nanmax(record.measurement))
        if high > low:
            y_axis["range"] = units(np.array([1.2 * low - 0.2 * high, 1.05 * high - 0.05 * low]), pv_span)
        gap = 0.5 * float(np.nanmin(record.output) + np.nanmax(record.output)) + d * np.array([-0.5, 0.0, 0.5])
        lines.append(path(gap, np.full(3, 1.12 * low - 0.12 * high), "", STEM, mode="lines+text", width=4,
                          showlegend=False, text=["", f"dead band {percent(d)}", ""], textposition="top center",
                          hoverinfo="skip"))
    return figure(lines, axis(f"OP [{op_unit}]"), y_axis, height=420)


def flanks(near: Record, size: float) -> list[tuple[FloatArray, FloatArray]] | None:
    """Return (OP, PV) of both flanks PV = gain (OP -+ d/2) + offset, opening and closing; None where PV does not follow
    OP through a gap of `size`, with the delay that suits best."""
    from scipy.stats import linregress
    assert near.output is not None
    good = np.isfinite(near.output) & np.isfinite(near.measurement)
    op, pv = near.output[good], near.measurement[good]
    if len(op) < 20 or np.ptp(op) <= size or np.ptp(pv) == 0.0:
        return None
    valve = stem_of(op, size)
    best = max((linregress(valve[: len(op) - delay], pv[delay:])
                for delay in range(0, len(op) // 8, max(1, len(op) // 200)) if np.ptp(valve[: len(op) - delay]) > 0.0),
               key=lambda fit: fit.rvalue**2, default=None)
    if best is None or best.rvalue**2 < FOLLOWS:
        return None
    ends = np.array([op.min(), op.max()])
    return [(ends, best.slope * (ends - side * size / 2) + best.intercept) for side in (1, -1)]


def estimates(report: LoopReport) -> Figure:
    """Every estimate over time in % of the output span: used ones, refused ones with the reason, and the cluster."""
    groups: list[Figure] = []
    looks = (False, "refused", QUIET, "x-thin-open"), (True, "used", EVIDENCE, "circle")
    for accepted, name, colour, symbol in looks:  # finite ones, and of very many the latest
        chosen = [e for e in report.estimates if e.accepted is accepted and math.isfinite(e.d)][-POINTS:]
        groups.append(dots([(e.start, e.d) for e in chosen], name, colour, symbol=symbol, hover="%{y:.2f} % (%{text})",
                           text=[picture(f"{WORDS['refused'].get(e.why, e.why)}, {e.dt_s:.4g} s") for e in chosen]))
    upright, layout, top = axis("dead band [% of OP span]"), Figure(), max(groups[1]["y"] or [0.0, *groups[0]["y"]])
    if (c := report.cluster) is not None:
        low, high = (100 * end for end in c.ci95)
        layout["shapes"] = [across("y", (low, high), EVIDENCE),
                            across("y", 100 * c.d, EVIDENCE, width=1.5, name=f"{percent(c.d)} ({interval(c.ci95)})")]
        top = max(top, high)
    if top > 0:
        upright["range"] = [0, 1.25 * top]
    if not report.estimates:
        layout["annotations"] = [written("no half period was long enough", 0.5, 0.5, xref="paper", yref="paper")]
    return figure(groups, DATES, upright, showlegend=True, **layout)


def profile(report: LoopReport) -> Figure:
    """Evidence for each size of dead band, from the test of PV against OP through a dead band of that size."""
    c, best = report.confirmation, "best size tried" if size(report) is None else "size found"
    assert c is not None
    tried = {round(100 * d, 4): evidence for d, evidence in c.profile if d > 0.0}
    x = [*tried]
    line = trace(x, [*tried.values()], "", MEASUREMENT, mode="lines+markers", size=5, showlegend=False,
                 hover="%{x} %: %{y:.3g}")
    shapes = [across("x", (100 * c.ci95[0], 100 * c.ci95[1]), EVIDENCE),
              across("x", 100 * c.d, EVIDENCE, width=2, name=f"{best}: {percent(c.d)}")]
    if used := [e.d for e in report.estimates if e.accepted and math.isfinite(e.d)]:
        middle = float(np.median(used))
        shapes.append(across("x", 100 * middle, SETPOINT, width=2, dash="dot",
                             name=f"half periods used, median: {percent(middle)}"))
    if (limit := c.limit_of_detection) is not None and x and min(x) < 100 * limit <= 100 * c.d:
        shapes.append(across("x", (min(x), 100 * limit), QUIET, name="too small to see"))
    ticks = [s for s in SIZES if x and min(x) <= s <= max(x)]
    return figure([line], axis("dead band tried [% of OP span]", type="log", tickvals=ticks),
                  axis("better prediction [points: log likelihood]"), shapes=shapes)


def close_look(record: Record, report: LoopReport) -> slice:
    """The samples around the most ordinary of the half periods used, a window of about eight of them; without any a
    tenth of the record around its middle, 200 samples at least."""
    used = sorted((e for e in used_in(record, report) if math.isfinite(e.d)), key=lambda e: e.d)
    if not used:
        reach, middle = max(len(record) // 20, 100), len(record) // 2
        return slice(max(middle - reach, 0), min(middle + reach, len(record)))
    ordinary = used[len(used) // 2]
    center, wide = 0.5 * (ordinary.start + ordinary.end), CLOSE_LOOK / 2 * ordinary.dt_s
    first, last = np.searchsorted(record.time, [center - wide, center + wide]).tolist()
    return slice(first, max(last, first + 1))


def known_part(record: Record) -> Record:
    """The record from its first to its last measurement that is a number."""
    known = np.flatnonzero(np.isfinite(record.measurement))
    return record.slice(int(known[0]), int(known[-1]) + 1) if len(known) else record


def used_in(record: Record, report: LoopReport) -> list[Estimate]:
    """The accepted half periods that lie within the record."""
    first, last = record.time[[0, -1]].tolist() if len(record) else (math.inf, -math.inf)
    return [e for e in report.estimates if e.accepted and first <= e.end and e.start <= last]


def over_time(time: FloatArray, values: FloatArray, span: tuple[float, float], name: str, colour: str, *,
              index: IntArray | None = None, points: int = POINTS, digits: int = 4, **more: Any) -> Figure:
    """A signal in engineering units; it breaks where it is not known, and where grid numbers of `index` are left out.
    time: (samples,) epoch seconds; values: (samples,) normalised."""
    chosen, gaps = thin(np.arange(len(values)) if index is None else index, values, points)
    x, y = np.insert(time[chosen], gaps, time[chosen][gaps]), np.insert(values[chosen], gaps, np.nan)
    return trace((x * 1000).astype(np.int64).tolist(), units(y, span, digits), name, colour, **more)


def thin(index: IntArray, values: FloatArray, points: int = POINTS) -> tuple[IntArray, list[int]]:
    """Return which samples to draw, at most `points`, and before which of them the line breaks at a gap: the smallest
    and the largest of each piece. index: (samples,) grid numbers, values: (samples,)."""
    n = len(values)
    chosen = np.arange(n)
    if n > points:
        width = -(-n // (points // 2))
        pieces = np.pad(values, (0, -n % width), constant_values=np.nan).reshape(-1, width)
        ends = [np.where(np.isfinite(pieces), sign * pieces, np.inf).argmin(axis=1) for sign in (1.0, -1.0)]
        chosen = np.unique(np.minimum(ends + width * np.arange(len(pieces)), n - 1))
    piece = np.cumsum(np.diff(index, prepend=index[:1]) > 1)[chosen]
    return chosen, (np.flatnonzero(np.diff(piece)) + 1).tolist()


def means(values: FloatArray, points: int) -> FloatArray:
    """Means over equal pieces, `points` at most: what is left when fast noise is of no interest."""
    size = max(1, len(values) // points)
    whole = len(values) // size * size
    return np.asarray(values[:whole].reshape(-1, size).mean(axis=1))


def units(values: FloatArray, span: tuple[float, float], digits: int = 4) -> list[float | None]:
    """Normalised values in engineering units, with the digits of the span that a plot can show; None: not known."""
    low, width = span[0], span[1] - span[0]
    places = max(0, digits - math.floor(math.log10(abs(width) or 1.0)))
    return [v if math.isfinite(v) else None for v in np.round(low + width * values, places).tolist()]


def digits(values: FloatArray) -> list[float]:
    """Five digits of each number: what a plot can show, and a page a third of the size."""
    return [float(f"{v:.5g}") for v in values.tolist()]


def shown(span: tuple[float, float]) -> tuple[tuple[float, float], str]:
    """The span that is shown, and words for its axis: per cent where no engineering range is known."""
    span = (0.0, 100.0) if span == (0.0, 1.0) else span
    return span, "%" if span == (0.0, 100.0) else f"span {span[0]:g} to {span[1]:g}"


def ms(epoch: float) -> int:
    """Epoch seconds as a figure takes them."""
    return round(1000 * float(epoch))


class PlantRow(Frozen):
    """A loop of the picture of a plant, sizes in output spans."""

    loop: str
    group: str  # words of the legend
    mark: str
    size: float | None = None
    interval: tuple[float, float] | None = None  # of size
    below: float | None = None  # what is excluded, where there is no size
    tick: float | None = None  # limit that the size is held against
    words: str = ""  # beside the row
    hover: str = ""  # when it is pointed at
    last: tuple[tuple[float, float], ...] = ()  # (epoch seconds, size) of the last weeks


def plant(rows: Sequence[PlantRow], tick: str) -> Figure:
    """Return the loops in their order, first on top: point and line, triangle, tick or words. tick: what it is."""
    data: list[Figure] = []
    for group in dict.fromkeys(row.group for row in rows):
        own = [(k, row) for k, row in enumerate(rows) if row.group == group]
        at = [100 * (row.size or row.below or 0.0) for _, row in own]
        spans = [None if row.size is None else row.interval for _, row in own]
        colour = COLOURS[own[0][1].mark]
        line = trace(at, [k for k, _ in own], f"{group} ({len(own)})", colour, mode="markers+text", size=10, hover="",
                     text=[row.words for _, row in own], textposition="middle right", cliponaxis=False,
                     showlegend=any(at), hoverinfo="text",
                     hovertext=[picture(f"{row.loop}: {row.hover}", 200) for _, row in own],
                     error_x=bars(at, spans, colour, thickness=2, visible=any(row.size is not None for _, row in own)))
        line["marker"] |= {"opacity": [float(x > 0) for x in at],
                           "symbol": ["triangle-left-open" if row.size is None else "circle" for _, row in own]}
        data.append(line)
    if ticks := {k: 100 * row.tick for k, row in enumerate(rows) if row.tick is not None}:
        data.append(trace([*ticks.values()], [*ticks], tick, QUIET, mode="markers", symbol="line-ns-open", size=16,
                          hover=f"{tick} %{{x:.2f}} %<extra></extra>"))
        data[-1]["marker"]["line"] = {"width": 3}
    sizes, weeks = axis("dead band [% of output span]", rangemode="tozero"), Figure()
    if len(times := {t for row in rows for t, _ in row.last}) > 1:
        sizes["domain"] = [0.0, 0.6]
        weeks = {"xaxis2": DATES | {"domain": [0.66, 1.0], "showgrid": False, "showticklabels": False,
                                   "title": {"text": "the last weeks"}}}
        last, limits = ([], []), ([], [])  # type: tuple[list[Any], list[Any]], tuple[list[Any], list[Any]]
        for k, row in enumerate(rows):  # a small line per loop within its row, as high as its size over its limit
            top = 1.2 * max([row.tick or 0.0, *(size for _, size in row.last)])
            limit = ((min(times), row.tick), (max(times), row.tick)) if row.last and row.tick is not None else ()
            for (x, y), points in ((last, row.last), (limits, limit)):
                x += [ms(t) for t, _ in points] + [None] * bool(points)  # no number: the line ends
                y += [round(k + 0.42 - 0.84 * size / top, 3) for _, size in points] + [None] * bool(points)
        plain: Figure = {"xaxis": "x2", "hoverinfo": "skip", "showlegend": False, "hover": ""}
        data += [trace(*limits, "", QUIET, width=1, dash="dot", **plain),
                 trace(*last, "", MEASUREMENT, width=1.6, **plain)]
    names = {"tickvals": [*range(len(rows))], "ticktext": [picture(row.loop, 16) for row in rows],
             "fixedrange": True, "range": [len(rows) - 0.4, -0.6], "zeroline": False}
    return figure(data, sizes, names, height=130 + 26 * len(rows), **weeks)


def bars(at: Sequence[float], spans: Sequence[tuple[float, float] | None], colour: str, **more: Any) -> Figure:
    """Intervals [span] of sizes [%] as error bars, none where there is no interval."""
    both = [(x, x) if span is None else (100 * span[0], 100 * span[1]) for x, span in zip(at, spans, strict=True)]
    below, above = ([round(max(sign * (span[side] - x), 0.0), 4) for x, span in zip(at, both, strict=True)]
                    for side, sign in ((0, -1.0), (1, 1.0)))
    return {"type": "data", "symmetric": False, "color": colour, "array": above, "arrayminus": below, **more}
