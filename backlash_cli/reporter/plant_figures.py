"""Figures of many loops and nights: the plant in one picture, and the wear of one loop over the nights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..results import Verdict
from ..results.history import HalfPeriod, Night, Wear
from .figures import EVIDENCE, GREEN, MEASUREMENT, OUTPUT, QUIET, SETPOINT, Figure, across, axis, ms, trace, written
from .safe import picture

COLOURS = {"bad": EVIDENCE, "warn": OUTPUT, "good": GREEN, "quiet": QUIET}  # by mark
WEEKS = 8  # of the small lines beside the sizes


@dataclass(frozen=True)
class PlantRow:
    """A loop of the picture, sizes in output spans.

    group: words of the legend. size: None where there is none; interval: of size. below: what is excluded, where there
    is no size. tick: limit that the size is held against. words: beside the row; hover: when it is pointed at.
    last: (epoch seconds, size) of the last weeks.
    """

    loop: str
    group: str
    mark: str
    size: float | None = None
    interval: tuple[float, float] | None = None
    below: float | None = None
    tick: float | None = None
    words: str = ""
    hover: str = ""
    last: tuple[tuple[float, float], ...] = ()


def plant_figure(rows: Sequence[PlantRow], tick: str) -> Figure:
    """Return the loops in their order, first on top: point and line, triangle, tick or words. tick: what it is."""
    data: list[Figure] = []
    for group in dict.fromkeys(row.group for row in rows):
        own = [(k, row) for k, row in enumerate(rows) if row.group == group]
        at = [100 * (row.size or row.below or 0.0) for _, row in own]
        spans = [None if row.size is None or row.interval is None else (100 * row.interval[0], 100 * row.interval[1])
                 for _, row in own]
        colour = COLOURS[own[0][1].mark]
        line = trace(at, [k for k, _ in own], f"{group} ({len(own)})", colour, mode="markers+text", size=10, hover="",
                     text=[row.words for _, row in own], textposition="middle right", cliponaxis=False,
                     showlegend=any(at), hoverinfo="text",
                     hovertext=[picture(f"{row.loop}: {row.hover}", 200) for _, row in own],
                     error_x=_bars(at, spans, colour, thickness=2, visible=any(row.size is not None for _, row in own)))
        line["marker"] |= {"opacity": [float(x > 0) for x in at],
                           "symbol": ["triangle-left-open" if row.size is None else "circle" for _, row in own]}
        data.append(line)
    if ticks := [(k, 100 * row.tick) for k, row in enumerate(rows) if row.tick is not None]:
        line = trace([x for _, x in ticks], [k for k, _ in ticks], tick, QUIET, mode="markers", symbol="line-ns-open",
                     size=16, hover=f"{tick} %{{x:.2f}} %<extra></extra>")
        line["marker"]["line"] = {"width": 3}
        data.append(line)
    layout: Figure = {
        "xaxis": axis("dead band [% of output span]", rangemode="tozero"),
        "yaxis": {"tickvals": [*range(len(rows))], "ticktext": [picture(row.loop, 16) for row in rows],
                  "fixedrange": True, "range": [len(rows) - 0.4, -0.6], "zeroline": False},
        "hovermode": "closest", "height": 130 + 26 * len(rows)}
    if any(row.last for row in rows):
        data += _last_weeks(rows)
        layout["xaxis"]["domain"] = [0.0, 0.6]
        layout["xaxis2"] = {"type": "date", "domain": [0.66, 1.0], "showgrid": False, "showticklabels": False}
    return {"data": data, "layout": layout}


def _bars(at: Sequence[float], spans: Sequence[tuple[float, float] | None], colour: str, **more: Any) -> Figure:
    """Intervals as error bars, none where there is no interval."""
    both = [span or (x, x) for x, span in zip(at, spans, strict=True)]
    above, below = ([round(max(sign * (span[side] - x), 0.0), 4) for x, span in zip(at, both, strict=True)]
                    for side, sign in ((1, 1.0), (0, -1.0)))
    return {"type": "data", "symmetric": False, "color": colour, "array": above, "arrayminus": below, **more}


def _last_weeks(rows: Sequence[PlantRow]) -> list[Figure]:
    """A small line per loop within its row, as high as its size over its limit; the limit dotted across it."""
    sizes, limits = ([], []), ([], [])  # type: tuple[list[Any], list[Any]], tuple[list[Any], list[Any]]
    first, last = (edge(t for row in rows for t, _ in row.last) for edge in (min, max))
    for k, row in enumerate(rows):
        if not row.last:
            continue
        top = 1.2 * max(row.tick or 0.0, *(size for _, size in row.last))
        parts = [(sizes, row.last)]
        if row.tick is not None:
            parts.append((limits, ((first, row.tick), (last, row.tick))))
        for (x, y), points in parts:
            x += [*(ms(t) for t, _ in points), None]
            y += [*(round(k + 0.42 - 0.84 * size / top, 3) for _, size in points), None]
    plain: Figure = {"xaxis": "x2", "hoverinfo": "skip", "showlegend": False, "hover": ""}
    return [trace(*limits, "", QUIET, width=1, dash="dot", **plain), trace(*sizes, "", MEASUREMENT, width=1.6, **plain)]


def wear_figure(nights: Sequence[Night], wear: Wear) -> Figure:
    """Return dead band over time in % of the output span, with the lines between repairs and the limit."""
    below = [n for n in nights if n.below_detection]
    first, last = min(n.time for n in nights), max([*(n.time for n in nights), *(p[0] for p in wear.forecast)])
    limit = 100 * wear.limit.value
    lines = [_nights([n for n in nights if n.measured and (n.verdict is Verdict.SUSPECTED) is suspected], *looks)
             for suspected, *looks in ((False, "night", "circle"), (True, "suspected", "circle-open"))]
    lines.append(trace([ms(n.time) for n in below], [round(100 * (n.limit_of_detection or 0.0), 4) for n in below],
                       f"below detection ({len(below)})", SETPOINT, mode="markers", symbol="triangle-down-open",
                       hover="%{x|%Y-%m-%d}: below %{y:.2f} %"))
    for number, path in enumerate(s.path for s in wear.segments if s.path):
        lines += _band(path, "wear", shown=number == 0, width=3)  # the level between repairs
    if wear.forecast:  # what comes if it goes on, to the limit or as far as the figure goes
        lines += _band(wear.forecast, "if it goes on", dash="dot", width=2)
    lines.append(trace([ms(first), ms(last)], [limit, limit], f"limit {limit:.2g} %", OUTPUT, dash="dash", width=2,
                       hoverinfo="name", hover=""))
    shapes, words = [], []
    for repair in wear.repairs:
        note = "repair found" if repair.found else f"repair: {repair.note}" if repair.note else "repair"
        shapes.append(across("x", ms(repair.time), QUIET, width=2, dash="dashdot"))
        words.append(written(picture(note, 30), ms(repair.time), 1.0, yref="paper", xanchor="left", yanchor="top",
                             xshift=4))
    return {"data": [line for line in lines if line["x"]], "layout": {
        "xaxis": {"type": "date"}, "yaxis": axis("dead band [% of output span]", rangemode="tozero"),
        "hovermode": "closest", "height": 420, "shapes": shapes, "annotations": words, "margin": {"t": 60}}}


def half_period_figure(half_periods: Sequence[HalfPeriod]) -> Figure:
    """Return the accepted estimates of the half periods over time, in % of the output span."""
    groups = []
    for joined, name, symbol in ((False, "half period", "circle"), (True, "across the cut of two nights", "diamond")):
        part = [p for p in half_periods if p.accepted and p.joined is joined]
        groups.append(trace([ms(p.start) for p in part], [round(100 * p.d, 4) for p in part], f"{name} ({len(part)})",
                            EVIDENCE, mode="markers", symbol=symbol, size=6, hover="%{y:.2f} % (%{text})",
                            text=[f"{p.dt_s:.4g} s long" for p in part]))
    return {"data": [g for g in groups if g["x"]], "layout": {
        "xaxis": {"type": "date"}, "yaxis": axis("estimate [% of output span]", rangemode="tozero"),
        "hovermode": "closest", "height": 320}}


def _nights(nights: Sequence[Night], name: str, symbol: str) -> Figure:
    d = [round(100 * (n.d or 0.0), 4) for n in nights]
    spans = [None if n.ci95 is None else (100 * n.ci95[0], 100 * n.ci95[1]) for n in nights]
    return trace([ms(n.time) for n in nights], d, f"{name} ({len(nights)})", EVIDENCE, mode="markers", symbol=symbol,
                 size=7, hover="%{x|%Y-%m-%d}: %{y:.2f} %", error_y=_bars(d, spans, QUIET, thickness=1, width=2))


def _band(path: Sequence[tuple[float, ...]], name: str, *, shown: bool = True, **line: Any) -> list[Figure]:
    """A level over time with its 95 % band; path: (epoch seconds, level, low, high) in spans."""
    x = [ms(p[0]) for p in path]
    y, low, high = ([round(100 * max(p[i], 0.0), 4) for p in path] for i in (1, 2, 3))
    common: Figure = {"legendgroup": name, "hoverinfo": "skip", "hover": ""}
    return [trace([*x, *x[::-1]], [*high, *low[::-1]], f"{name}, 95 %", QUIET, width=0, showlegend=False, fill="toself",
                  fillcolor="rgba(128, 128, 128, 0.18)", **common),
            trace(x, y, name, MEASUREMENT, showlegend=shown, **line, **common)]
