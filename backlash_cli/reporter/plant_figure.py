"""The plant in one picture: its loops ranked, the dead band of each with its interval, limit and last weeks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .figures import EVIDENCE, MEASUREMENT, OUTPUT, QUIET, Figure, ms
from .safe import picture

COLOURS = {"bad": EVIDENCE, "warn": OUTPUT, "good": "#2a9d5c", "quiet": QUIET}  # by mark
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
        spans = [(x, x) if row.size is None or row.interval is None else (100 * row.interval[0], 100 * row.interval[1])
                 for x, (_, row) in zip(at, own, strict=True)]
        colour = COLOURS[own[0][1].mark]
        data.append({
            "type": "scatter", "mode": "markers+text", "name": picture(f"{group} ({len(own)})"), "x": at,
            "y": [k for k, _ in own], "text": [row.words for _, row in own], "textposition": "middle right",
            "cliponaxis": False, "showlegend": any(at), "hoverinfo": "text",
            "hovertext": [picture(f"{row.loop}: {row.hover}", 200) for _, row in own],
            "marker": {"color": colour, "size": 10, "opacity": [float(x > 0) for x in at],
                       "symbol": ["triangle-left-open" if row.size is None else "circle" for _, row in own]},
            "error_x": {"type": "data", "symmetric": False, "visible": any(row.size is not None for _, row in own),
                        "color": colour, "thickness": 2,
                        "array": [max(high - x, 0.0) for x, (_, high) in zip(at, spans, strict=True)],
                        "arrayminus": [max(x - low, 0.0) for x, (low, _) in zip(at, spans, strict=True)]},
        })
    ticks = [(k, 100 * row.tick) for k, row in enumerate(rows) if row.tick is not None]
    if ticks:
        data.append({"type": "scatter", "mode": "markers", "name": tick, "x": [x for _, x in ticks],
                     "y": [k for k, _ in ticks], "hovertemplate": f"{tick} %{{x:.2f}} %<extra></extra>",
                     "marker": {"symbol": "line-ns-open", "size": 16, "color": QUIET, "line": {"width": 3}}})
    axis = {"tickvals": [*range(len(rows))], "ticktext": [picture(row.loop, 16) for row in rows], "fixedrange": True,
            "range": [len(rows) - 0.4, -0.6], "zeroline": False}
    layout: Figure = {"xaxis": {"title": {"text": "dead band [% of output span]"}, "rangemode": "tozero"},
                      "yaxis": axis, "hovermode": "closest", "height": 130 + 26 * len(rows)}
    if any(row.last for row in rows):
        data += _last_weeks(rows)
        layout["xaxis"]["domain"] = [0.0, 0.6]
        layout["xaxis2"] = {"type": "date", "domain": [0.66, 1.0], "showgrid": False, "showticklabels": False}
    return {"data": data, "layout": layout}


def _last_weeks(rows: Sequence[PlantRow]) -> list[Figure]:
    """A small line per loop within its row, as high as its size over its limit; the limit dotted across it."""
    x: list[int | None] = []
    y: list[float | None] = []
    x_limit: list[int | None] = []
    y_limit: list[float | None] = []
    first, last = (edge(t for row in rows for t, _ in row.last) for edge in (min, max))
    for k, row in enumerate(rows):
        if not row.last:
            continue
        top = 1.2 * max(row.tick or 0.0, *(size for _, size in row.last))
        x += [*(ms(t) for t, _ in row.last), None]
        y += [*(round(k + 0.42 - 0.84 * size / top, 3) for _, size in row.last), None]
        if row.tick is not None:
            x_limit += [ms(first), ms(last), None]
            y_limit += [*[round(k + 0.42 - 0.84 * row.tick / top, 3)] * 2, None]
    line: Figure = {"type": "scatter", "mode": "lines", "xaxis": "x2", "hoverinfo": "skip", "showlegend": False}
    return [line | {"x": x_limit, "y": y_limit, "line": {"color": QUIET, "width": 1, "dash": "dot"}},
            line | {"x": x, "y": y, "line": {"color": MEASUREMENT, "width": 1.6}}]
