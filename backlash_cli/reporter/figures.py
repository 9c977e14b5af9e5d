"""Interactive figures of one loop, as plain plotly dicts in engineering units: the evidence behind a verdict."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..record import IntArray, Record
from ..results import Confirmation, Estimate, LoopReport
from .safe import picture

POINTS = 1600  # per line: lowest and highest of each of 800 columns; a page of twelve loops stays below 3 MB
CLOSE_LOOK = 8  # half periods in the close look

SETPOINT, MEASUREMENT, OUTPUT, EVIDENCE, QUIET = "#7a8793", "#2878c8", "#c77700", "#d1345b", "#8d99a5"
Figure = dict[str, Any]


def trend(record: Record, report: LoopReport, window: slice | None = None, points: int = POINTS) -> Figure:
    """SP, PV and OP over time, with the half periods that carry the verdict drawn over the measurement.

    Long records are thinned to smallest and largest of each piece, so that no peak is lost: `points` per line.
    """
    part = record if window is None else record.slice(window.start, window.stop)
    s = record.settings
    pv, sp = part.measurement, part.setpoint
    lines = [
        _line(part, sp, s.pv_range, "SP", SETPOINT, points, width=1.2, dash="dot"),
        _line(part, pv, s.pv_range, "PV", MEASUREMENT, points),
    ]
    marked = np.where(_inside(part, report), pv, np.nan)
    if np.isfinite(marked).any():
        lines.append(_line(part, marked, s.pv_range, "PV in the half periods used", EVIDENCE, points, width=3))
    layout: Figure = {"xaxis": {"type": "date"}, "yaxis": {"title": {"text": "SP, PV"}}, "hovermode": "x"}
    if part.output is not None:
        lines.append(_line(part, part.output, s.op_range, "OP", OUTPUT, points) | {"yaxis": "y2"})
        layout |= {
            "yaxis": {"title": {"text": "SP, PV"}, "domain": [0.42, 1.0]},
            "yaxis2": {"title": {"text": "OP"}, "domain": [0.0, 0.36]},
            "xaxis": {"type": "date", "anchor": "y2"},
            "height": 480,
        }
    return {"data": lines, "layout": layout}


def plane(record: Record, window: slice, points: int = POINTS) -> Figure:
    """PV against OP: without dead band a line or a cloud, with dead band a leaning box with flat sides."""
    assert record.output is not None
    s = record.settings
    every = slice(None, None, max(1, len(record) // points))
    near = slice(window.start, window.stop, max(1, (window.stop - window.start) // points))

    def path_of(part: slice) -> Figure:
        assert record.output is not None
        return {"x": units(record.output[part], s.op_range), "y": units(record.measurement[part], s.pv_range)}

    cloud = {"type": "scatter", "mode": "markers", "name": "whole record", "marker": {"size": 3, "color": QUIET}}
    path = {"type": "scatter", "mode": "lines", "name": "close look", "line": {"color": EVIDENCE, "width": 1.5}}
    layout = {"xaxis": {"title": {"text": "OP"}}, "yaxis": {"title": {"text": "PV"}}, "hovermode": "closest",
              "height": 420}
    return {"data": [cloud | path_of(every), path | path_of(near)], "layout": layout}


def estimates(report: LoopReport) -> Figure:
    """Every estimate over time in % of the output span: used ones, refused ones with the reason, and the cluster."""
    groups: list[Figure] = []
    for accepted, name, colour, symbol in (
        (False, "refused", QUIET, "x-thin-open"),
        (True, "used", EVIDENCE, "circle"),
    ):
        chosen = _latest([e for e in report.estimates if e.accepted is accepted])
        groups.append({
            "type": "scatter", "mode": "markers", "name": f"{name} ({len(chosen)})",
            "x": [_ms(e.start) for e in chosen], "y": [round(100 * e.d, 4) for e in chosen],
            "text": [picture(f"{e.why}, {e.dt_s:.4g} s") for e in chosen], "hovertemplate": "%{y:.2f} % (%{text})",
            "marker": {"color": colour, "symbol": symbol, "size": 8},
        })
    used = [100 * e.d for e in report.estimates if e.accepted and math.isfinite(e.d)]
    shapes: list[Figure] = []
    top = max(used, default=0.0)
    if report.cluster is not None:
        low, high = (100 * x for x in report.cluster.ci95)
        size = 100 * report.cluster.d
        base: Figure = {"xref": "paper", "x0": 0, "x1": 1}
        band = {"type": "rect", "y0": low, "y1": high, "fillcolor": EVIDENCE, "opacity": 0.15, "line": {"width": 0}}
        shapes = [
            base | band,
            base | {"type": "line", "y0": size, "y1": size, "line": {"color": EVIDENCE, "width": 1.5}},
        ]
        top = max(top, high)
    axis: Figure = {"title": {"text": "dead band [% of OP span]"}}
    if top > 0:
        axis["range"] = [0, 1.25 * top]
    layout = {"xaxis": {"type": "date"}, "yaxis": axis, "shapes": shapes, "hovermode": "closest"}
    return {"data": groups, "layout": layout}


def profile(confirmation: Confirmation) -> Figure:
    """Evidence for each size of dead band, from the test of PV against OP through a dead band of that size."""
    x = [round(100 * d, 4) for d, _ in confirmation.profile]
    y = [evidence for _, evidence in confirmation.profile]
    line = {"type": "scatter", "mode": "lines", "x": x, "y": y, "line": {"color": MEASUREMENT}, "showlegend": False}
    layout = {
        "xaxis": {"title": {"text": "dead band tried [% of OP span]"}},
        "yaxis": {"title": {"text": "evidence"}},
    }
    return {"data": [line], "layout": layout}


def close_look(record: Record, report: LoopReport) -> slice:
    """The samples around the most ordinary of the half periods used: a window of about eight of them."""
    used = [e for e in report.estimates if e.accepted and math.isfinite(e.d)]
    if not used:
        return slice(0, min(len(record), POINTS))
    middle = sorted(used, key=lambda e: e.d)[len(used) // 2]
    reach = CLOSE_LOOK / 2 * middle.dt_s
    center = 0.5 * (middle.start + middle.end)
    first, last = np.searchsorted(record.time, [center - reach, center + reach])
    return slice(int(first), max(int(last), int(first) + 1))


def _latest(found: list[Estimate]) -> list[Estimate]:
    """The estimates to draw: finite ones, and of very many the latest."""
    return [e for e in found if math.isfinite(e.d)][-POINTS:]


def _inside(record: Record, report: LoopReport) -> NDArray[np.bool_]:
    """(samples,) True within a half period that was used."""
    used = [e for e in report.estimates if e.accepted]
    change = np.zeros(len(record) + 1, dtype=np.int64)
    time = record.time
    np.add.at(change, np.searchsorted(time, [e.start for e in used]), 1)
    np.add.at(change, np.searchsorted(time, [e.end for e in used]), -1)
    return np.cumsum(change[:-1]) > 0


def _line(
    record: Record, values: NDArray[np.float64], span: tuple[float, float], name: str, colour: str, points: int,
    width: float = 1.5, dash: str = "solid",
) -> Figure:
    chosen, gaps = thin(record.index, values, points)
    x: list[int | None] = (record.time[chosen] * 1000).astype(np.int64).tolist()
    y: list[float | None] = units(values[chosen], span)
    for position in reversed(gaps):
        x.insert(position, x[position])
        y.insert(position, None)
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": x, "y": y,
        "line": {"color": colour, "width": width, "dash": dash}, "hovertemplate": "%{y}",
    }


def thin(index: IntArray, values: NDArray[np.float64], points: int = POINTS) -> tuple[IntArray, list[int]]:
    """Return which samples to draw, at most `points`, and before which of them the line breaks at a gap.

    index: (samples,) grid numbers, values: (samples,). Of each piece the smallest and the largest value stay.
    """
    n = len(values)
    chosen = np.arange(n)
    if n > points:
        width = -(-n // (points // 2))
        padded = np.full(-(-n // width) * width, np.nan)
        padded[:n] = values
        pieces = padded.reshape(-1, width)
        known = np.isfinite(pieces)
        low = np.where(known, pieces, np.inf).argmin(axis=1)
        high = np.where(known, pieces, -np.inf).argmax(axis=1)
        both = np.sort(np.stack([low, high], axis=1), axis=1) + width * np.arange(len(pieces))[:, None]
        chosen = np.unique(np.minimum(both.ravel(), n - 1))
    piece = np.concatenate([[0], np.cumsum(np.diff(index) > 1)])[chosen] if n else chosen
    return chosen, (np.flatnonzero(np.diff(piece)) + 1).tolist()


def units(values: NDArray[np.float64], span: tuple[float, float], digits: int = 4) -> list[float | None]:
    """Normalised values in engineering units, with the digits of the span that a plot can show; None: not known."""
    low, high = span
    places = max(0, digits - math.floor(math.log10(abs(high - low) or 1.0)))
    return [v if math.isfinite(v) else None for v in np.round(low + (high - low) * values, places).tolist()]


def _ms(epoch: float) -> int:
    return round(1000 * epoch)
