"""The wear of one loop over the nights, as a plain plotly dict: sizes, fitted lines, limit and repairs."""

from __future__ import annotations

from collections.abc import Sequence

from ..results import Verdict
from ..results.history import HalfPeriod, Night, Wear
from .figures import EVIDENCE, MEASUREMENT, OUTPUT, QUIET, SETPOINT, Figure, ms
from .safe import picture


def wear_figure(nights: Sequence[Night], wear: Wear) -> Figure:
    """Return dead band over time in % of the output span, with the lines between repairs and the limit."""
    first, last = min(n.time for n in nights), max(n.time for n in nights)
    lines = [
        _sizes([n for n in nights if n.measured and n.verdict is not Verdict.SUSPECTED], "night", "circle"),
        _sizes([n for n in nights if n.measured and n.verdict is Verdict.SUSPECTED], "suspected", "circle-open"),
        _bounds([n for n in nights if n.below_detection]),
        *_fits(wear),
    ]
    lines += _ahead(wear)
    last = max([last, *(p[0] for p in wear.forecast)])
    limit = 100 * wear.limit.value
    lines.append({"type": "scatter", "mode": "lines", "name": f"limit {limit:.2g} %", "x": [ms(first), ms(last)],
                  "y": [limit, limit], "line": {"color": OUTPUT, "dash": "dash", "width": 2}, "hoverinfo": "name"})
    shapes, words = _repairs(wear)
    layout = {"xaxis": {"type": "date"}, "yaxis": {"title": {"text": "dead band [% of output span]"},
              "rangemode": "tozero"}, "hovermode": "closest", "height": 420, "shapes": shapes, "annotations": words,
              "margin": {"t": 60}}
    return {"data": [line for line in lines if line["x"]], "layout": layout}


def half_period_figure(half_periods: Sequence[HalfPeriod]) -> Figure:
    """Return the accepted estimates of the half periods over time, in % of the output span."""
    used = [p for p in half_periods if p.accepted]
    groups = []
    for joined, name, symbol in ((False, "half period", "circle"), (True, "across the cut of two nights", "diamond")):
        part = [p for p in used if p.joined is joined]
        groups.append({
            "type": "scatter", "mode": "markers", "name": f"{name} ({len(part)})", "x": [ms(p.start) for p in part],
            "y": [round(100 * p.d, 4) for p in part], "text": [f"{p.dt_s:.4g} s long" for p in part],
            "hovertemplate": "%{y:.2f} % (%{text})", "marker": {"color": EVIDENCE, "symbol": symbol, "size": 6},
        })
    layout = {"xaxis": {"type": "date"}, "yaxis": {"title": {"text": "estimate [% of output span]"},
              "rangemode": "tozero"}, "hovermode": "closest", "height": 320}
    return {"data": [g for g in groups if g["x"]], "layout": layout}


def _sizes(nights: Sequence[Night], name: str, symbol: str) -> Figure:
    d = [100 * n.d for n in nights if n.d is not None]
    spans = [n.ci95 or (n.d, n.d) for n in nights if n.d is not None]
    return {
        "type": "scatter", "mode": "markers", "name": f"{name} ({len(nights)})", "x": [ms(n.time) for n in nights],
        "y": [round(v, 4) for v in d],
        "error_y": {"type": "data", "symmetric": False, "thickness": 1, "width": 2, "color": QUIET,
                    "array": [round(max(100 * (hi or 0) - v, 0), 4) for v, (_, hi) in zip(d, spans, strict=True)],
                    "arrayminus": [round(max(v - 100 * (lo or 0), 0), 4) for v, (lo, _) in zip(d, spans, strict=True)]},
        "hovertemplate": "%{x|%Y-%m-%d}: %{y:.2f} %", "marker": {"color": EVIDENCE, "symbol": symbol, "size": 7},
    }


def _bounds(nights: Sequence[Night]) -> Figure:
    return {
        "type": "scatter", "mode": "markers", "name": f"below detection ({len(nights)})",
        "x": [ms(n.time) for n in nights], "y": [round(100 * (n.limit_of_detection or 0.0), 4) for n in nights],
        "hovertemplate": "%{x|%Y-%m-%d}: below %{y:.2f} %",
        "marker": {"color": SETPOINT, "symbol": "triangle-down-open", "size": 8},
    }


def _fits(wear: Wear) -> list[Figure]:
    """The level between repairs with its 95 % band."""
    out: list[Figure] = []
    for number, path in enumerate(s.path for s in wear.segments if s.path):
        out += _band(path, "wear", number == 0)
    return out


def _ahead(wear: Wear) -> list[Figure]:
    """What comes if it goes on, to the limit or as far as the figure goes."""
    return _band(wear.forecast, "if it goes on", True, dash="dot") if wear.forecast else []


def _band(path: Sequence[tuple[float, float, float, float]], name: str, shown: bool, **line: str) -> list[Figure]:
    x = [ms(p[0]) for p in path]
    y, low, high = ([round(100 * max(p[i], 0.0), 4) for p in path] for i in (1, 2, 3))
    common = {"type": "scatter", "mode": "lines", "legendgroup": name, "hoverinfo": "skip"}
    return [
        {**common, "name": f"{name}, 95 %", "showlegend": False, "x": [*x, *x[::-1]], "y": [*high, *low[::-1]],
         "fill": "toself", "fillcolor": "rgba(128, 128, 128, 0.18)", "line": {"width": 0}},
        {**common, "name": name, "showlegend": shown, "x": x, "y": y,
         "line": {"color": MEASUREMENT, "width": 2 if line else 3, **line}},
    ]


def _repairs(wear: Wear) -> tuple[list[Figure], list[Figure]]:
    shapes, words = [], []
    for repair in wear.repairs:
        x = ms(repair.time)
        shapes.append({"type": "line", "xref": "x", "yref": "paper", "x0": x, "x1": x, "y0": 0, "y1": 1,
                       "line": {"color": QUIET, "width": 2, "dash": "dashdot"}})
        note = "repair found" if repair.found else f"repair: {repair.note}" if repair.note else "repair"
        words.append({"xref": "x", "yref": "paper", "x": x, "y": 1.0, "text": picture(note, 30), "showarrow": False,
                      "xanchor": "left", "yanchor": "top", "xshift": 4})
    return shapes, words
