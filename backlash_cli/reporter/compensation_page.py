"""Advice on a compensator as a page: the loop before and after, and what every gain would do."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..record import FloatArray
from ..results.compensation import CompensationStudy, Glimpse
from .compensation_text import ADVICE, COLUMNS, assumptions, cells, headline
from .page import Cell, Section, Table, page
from .safe import shorten

BEFORE, AFTER, QUIET, SPEED, LIMIT = "#c77700", "#2878c8", "#8d99a5", "#d1345b", "#2a9d5c"


def compensation_page(study: CompensationStudy) -> str:
    """Return the page of one study."""
    name = shorten(study.loop, 80)
    sentence = headline(study)
    sections = [
        Section("Advice", text=[sentence[0].upper() + sentence[1:], ADVICE]),
        Section("What was simulated", text=assumptions(study),
                note="Load steps up and down at the process input, noise as in the record, the same for every gain."),
    ]
    if study.before is not None:
        sections.append(Section(
            "Before and after" if study.after is not None else "The loop as it is", figure=trends(study),
            text=["Two load steps. The valve follows the output only after it has crossed the dead band; the "
                  "compensator makes the output jump through the band when the error changes its sign."],
        ))
    sections.append(Section("Every gain", figure=gains(study), table=table(study), text=[
        "A larger gain lowers the error until it comes near the dead band; then the valve's travel grows. Errors and "
        "travel are relative to the loop without compensator."]))
    notes = [*study.refusals, *study.warnings]
    if notes:
        sections.append(Section("What speaks against it", table=Table(
            ["Code", "What"], [[n.code, n.message] for n in notes])))
    return page(f"Backlash compensation: {name}", sections,
                subtitle="Simulated; nothing was written to the control system")


def table(study: CompensationStudy) -> Table:
    """Return the table of gains."""
    rows = []
    for trial in study.trials:
        mark = "good" if trial.gain == study.recommended else "bad" if trial.limit_cycle else ""
        texts = [text.removesuffix(" <-") for text in cells(study, trial)]
        rows.append([Cell(trial.gain, text=texts[0], mark=mark), *texts[1:]])
    return Table(COLUMNS, rows)


def trends(study: CompensationStudy) -> dict[str, Any]:
    """Return measurement, output and valve position before and after, as a plotly figure."""
    assert study.before is not None
    data = [_line(study.before, "setpoint", "setpoint", "", QUIET, "dot")]
    runs = [(study.before, "without", BEFORE)]
    if study.after is not None:
        runs.append((study.after, f"gain {100 * study.after.gain:.2f} %", AFTER))
    for run, name, colour in runs:
        data.append(_line(run, "measurement", f"PV, {name}", "", colour))
        data.append(_line(run, "output", f"OP, {name}", "2", colour))
        data.append(_line(run, "valve", f"valve, {name}", "3", colour))
    return {"data": data, "layout": {
        "height": 620, "hovermode": "x", "xaxis": {"title": {"text": "time [s]"}, "anchor": "y3"},
        "yaxis": {"title": {"text": "PV, deviation [%]"}, "domain": [0.7, 1.0]},
        "yaxis2": {"title": {"text": "OP, change [%]"}, "domain": [0.36, 0.64]},
        "yaxis3": {"title": {"text": "valve, change [%]"}, "domain": [0.0, 0.3]},
    }}


def gains(study: CompensationStudy) -> dict[str, Any]:
    """Return mean error, peak and travel over the gain, relative to no compensator, as a plotly figure."""
    base, x = study.base, [100.0 * t.gain for t in study.trials]
    data: list[dict[str, Any]] = []
    shown = (("mean error", "iae", AFTER), ("peak error", "peak", QUIET), ("valve travel", "travel", SPEED))
    for name, key, colour in shown:
        first = getattr(base, key)
        y = [getattr(t, key) / first if first > 0 else None for t in study.trials]
        data.append({"type": "scatter", "mode": "lines+markers", "name": name, "x": x, "y": y,
                     "line": {"color": colour}, "hovertemplate": "%{y:.2f}"})
    line: dict[str, Any] = {"type": "line", "yref": "paper", "y0": 0, "y1": 1}
    shapes = [line | {"x0": 100 * study.d, "x1": 100 * study.d, "line": {"color": QUIET, "dash": "dot"}}]
    word: dict[str, Any] = {"y": 1.0, "yref": "paper", "showarrow": False}
    texts = [word | {"x": 100 * study.d, "text": "dead band", "xanchor": "left"}]
    if study.recommended is not None:
        at = 100 * study.recommended
        shapes.append(line | {"x0": at, "x1": at, "line": {"color": LIMIT}})
        texts.append(word | {"x": at, "text": "advice", "xanchor": "right"})
    top = min(max(3.0, 1.1 * max((t.iae / base.iae for t in study.trials), default=1.0)), 6.0)
    return {"data": data, "layout": {
        "xaxis": {"title": {"text": "compensator gain [% of output span]"}}, "shapes": shapes, "annotations": texts,
        "yaxis": {"title": {"text": "relative to no compensator"}, "range": [0, top]}, "height": 380,
    }}


def _line(run: Glimpse, key: str, name: str, axis: str, colour: str, dash: str = "solid") -> dict[str, Any]:
    values: FloatArray = getattr(run, key)
    return {"type": "scatter", "mode": "lines", "name": name, "x": np.round(run.time, 3).tolist(),
            "y": np.round(100.0 * values, 4).tolist(), "yaxis": f"y{axis}", "hovertemplate": "%{y:.2f}",
            "line": {"color": colour, "width": 1.4, "dash": dash}}
