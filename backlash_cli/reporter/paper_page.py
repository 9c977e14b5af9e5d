"""The paper as a page: each figure drawn anew beside its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..record import FloatArray
from ..results.paper import Line, PaperFigure, PaperReport, PaperRow
from .page import Cell, Section, Table, page
from .paper_text import difference, number, unit_of

COLOURS = ("#2878c8", "#d1345b", "#2a9d5c", "#c77700", "#7a5bc7")
QUIET = "#8d99a5"
GAP = 0.1  # of the height, between panels


def paper_page(report: PaperReport) -> str:
    """Return the page: all numbers first, then figure by figure."""
    agreeing = sum(row.agrees for row in report.rows)
    overview = Section(
        "All numbers", text=[f"{agreeing} of {len(report.rows)} numbers agree within their tolerance. Rows that do not "
                             "agree say why; the figures below show the simulations behind the numbers."],
        table=numbers(report.rows, with_reason=True), anchor="numbers",
    )
    figures = [section(figure, report) for figure in report.figures]
    return page("Haegglund (2007), recomputed", [overview, *figures],
                subtitle="T. Haegglund, Automatic on-line estimation of backlash in control loops, J. Process Control "
                "17 (2007) 489-499")


def section(figure: PaperFigure, report: PaperReport) -> Section:
    """Return one figure with the rows that belong to it."""
    rows = [row for row in report.rows if row.published.figure == figure.key]
    text = [figure.text] if figure.text else []
    if figure.key in report.lists:
        theirs, ours = report.lists[figure.key]
        text.append(f"Single estimates [%]: paper {theirs}; ours {ours}.")
    reasons = dict.fromkeys(row.published.why for row in rows if not row.agrees and row.published.why)
    return Section(figure.title, text=text, table=numbers(rows) if rows else None, figure=plot(figure),
                   note=" ".join(f"Why not: {why}." for why in reasons), anchor=figure.key)


def numbers(rows: Sequence[PaperRow], *, with_reason: bool = False) -> Table:
    """Return the table paper, ours, difference, agrees."""
    columns = ["Number", "Unit", "Paper", "Ours", "Difference", "Tolerance", "Agrees", *["Why not"] * with_reason]
    return Table(columns, [_row(row, with_reason) for row in rows])


def _row(row: PaperRow, with_reason: bool) -> list[object]:
    p = row.published
    cells: list[object] = [
        p.quantity, unit_of(row), Cell(p.value, text=number(p.value, p.unit)),
        Cell(row.ours, text=number(row.ours, p.unit)), Cell(row.difference, text=difference(row) or "–"),
        p.tolerance or "–", Cell("yes" if row.agrees else "no", mark="good" if row.agrees else "warn"),
    ]
    return [*cells, "" if row.agrees else p.why] if with_reason else cells


def plot(figure: PaperFigure) -> dict[str, Any]:
    """Return a plotly figure with its panels below each other."""
    n = len(figure.panels)
    height = (1.0 - GAP * (n - 1)) / n
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"height": 190 * n + 160, "annotations": [], "hovermode": "closest"}
    shown: set[str] = set()
    for k, panel in enumerate(figure.panels):
        mark = "" if k == 0 else str(k + 1)
        top = 1.0 - k * (height + GAP)
        coloured = [line for line in panel.lines if not line.quiet]
        data += [_line(line, 0 if line.quiet else coloured.index(line), mark, shown) for line in panel.lines]
        layout[f"xaxis{mark}"] = _axis(panel.x_label, panel.x_limits) | {"anchor": f"y{mark}"}
        layout[f"yaxis{mark}"] = _axis(panel.y_label, panel.y_limits) | {"domain": [max(top - height, 0.0), top],
                                                                       "anchor": f"x{mark}"}
        if _shares_x(figure, k):
            layout[f"xaxis{mark}"]["matches"] = "x"
        if panel.equal_scales:
            layout[f"yaxis{mark}"]["scaleanchor"] = f"x{mark}"
            layout["height"] = 620
        layout["annotations"] += [
            {"x": m.x, "y": m.y, "text": m.text, "xref": f"x{mark}", "yref": f"y{mark}", "showarrow": False,
             "yshift": 12}
            for m in panel.marks
        ]
    return {"data": data, "layout": layout}


def _shares_x(figure: PaperFigure, k: int) -> bool:
    return k > 0 and not figure.panels[0].x_label and figure.panels[k].x_label.startswith("time")


def _axis(label: str, limits: tuple[float, float] | None) -> dict[str, Any]:
    axis: dict[str, Any] = {"title": {"text": label}}
    return axis | {"range": list(limits)} if limits else axis


def _line(line: Line, place: int, mark: str, shown: set[str]) -> dict[str, Any]:
    first = line.name not in shown
    shown.add(line.name)
    single = len(line.x) == 1
    return {
        "type": "scatter", "mode": "markers" if single else "lines", "name": line.name, "legendgroup": line.name,
        "showlegend": first, "x": _digits(line.x), "y": _digits(line.y), "xaxis": f"x{mark}", "yaxis": f"y{mark}",
        "line": {"color": QUIET if line.quiet else COLOURS[place % len(COLOURS)], "dash": line.dash,
                 "width": 1.2 if line.quiet else 1.6},
        **({"marker": {"size": 10, "symbol": "diamond", "color": COLOURS[place % len(COLOURS)]}} if single else {}),
    }


def _digits(values: FloatArray) -> list[float]:
    """Five digits of the range: what a plot can show, and a page a third of the size."""
    reach = float(np.max(np.abs(values))) or 1.0
    return np.round(values, max(0, 5 - int(np.floor(np.log10(reach))))).tolist()
