"""The paper's numbers beside ours as text, plain values and a page with each figure drawn anew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..record import FloatArray
from ..results.paper import Line, PaperFigure, PaperReport, PaperRow
from .console import Screen
from .figures import QUIET
from .page import Cell, Section, Table, page

WIDTH = 120
COLOURS = ("#2878c8", "#d1345b", "#2a9d5c", "#c77700", "#7a5bc7")
GAP = 0.1  # of the height, between panels
_SOURCE = "J. Process Control 17 (2007) 489-499"


def number(value: float, unit: str, signed: bool = False) -> str:
    """Return a value of a row in words a reader of the paper knows.

    >>> number(1.0, "yes/no"), number(7.7081, "s"), number(-0.2, "%", signed=True)
    ('yes', '7.71', '-0.20')
    """
    if unit == "yes/no":
        return "yes" if value else "no"
    digits = 0 if unit == "count" and value == int(value) else 2
    return f"{round(value, digits) + 0.0:{'+' if signed else ''}.{digits}f}"  # + 0.0: no minus sign before zero


def difference(row: PaperRow) -> str:
    """Return ours minus the paper's, empty where the answer is yes or no."""
    return "" if row.published.unit == "yes/no" else number(row.difference, row.published.unit, signed=True)


def unit_of(row: PaperRow) -> str:
    """Return the unit as printed."""
    return "" if row.published.unit in ("yes/no", "count") else row.published.unit


def to_text(report: PaperReport, *, colour: bool = False) -> str:
    """Return the table paper, ours, difference, agrees; below it why some rows differ."""
    screen = Screen(colour=colour, width=WIDTH)
    reasons = list(dict.fromkeys(row.published.why for row in report.rows if row.published.why))
    rows = []
    for row in report.rows:
        p = row.published
        note = f" [{reasons.index(p.why) + 1}]" if p.why else ""
        rows.append([p.quantity, number(p.value, p.unit), number(row.ours, p.unit), difference(row), unit_of(row),
                     ("yes" if row.agrees else "no") + note])
    screen.say(f"T. Haegglund, {_SOURCE}: the paper's numbers and ours")
    screen.say()
    screen.table(("Number", ">Paper", ">Ours", ">Difference", "Unit", "Agrees"), rows,
                 styles=[["" if row.agrees else "yellow"] * 6 for row in report.rows])
    agreeing = sum(row.agrees for row in report.rows)
    screen.say(f"\n{agreeing} of {len(report.rows)} numbers agree within their tolerance. Where they do not:")
    for k, why in enumerate(reasons, 1):
        screen.say(f"[{k}] {why}")
    screen.say("\nSingle estimates [% of span]:")
    for key, (theirs, ours) in report.lists.items():
        screen.say(f"Fig. {key[3:]}  paper {theirs}   ours {ours}", indent=2)
    return screen.text()


def to_document(report: PaperReport) -> dict[str, Any]:
    """Return the rows as plain values for JSON."""
    rows = [{**{n: getattr(row.published, n) for n in ("key", "figure", "quantity", "unit")},
             "paper": row.published.value, "ours": row.ours, "difference": row.difference,
             "tolerance": row.published.tolerance, "agrees": row.agrees, "why": row.published.why or None}
            for row in report.rows]
    return {"paper": f"T. Haegglund, {_SOURCE}", "agree": sum(row.agrees for row in report.rows), "rows": rows,
            "estimates": {key: {"paper": theirs, "ours": ours} for key, (theirs, ours) in report.lists.items()}}


def paper_page(report: PaperReport) -> str:
    """Return the page: all numbers first, then figure by figure."""
    agreeing = sum(row.agrees for row in report.rows)
    overview = Section(
        "All numbers", text=[f"{agreeing} of {len(report.rows)} numbers agree within their tolerance. Rows that do not "
                             "agree say why; the figures below show the simulations behind the numbers."],
        table=numbers(report.rows, with_reason=True), anchor="numbers",
    )
    return page("Haegglund (2007), recomputed", [overview, *(section(figure, report) for figure in report.figures)],
                subtitle=f"T. Haegglund, Automatic on-line estimation of backlash in control loops, {_SOURCE}")


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
    return Table(columns, [_row(row)[: len(columns)] for row in rows])


def _row(row: PaperRow) -> list[object]:
    p = row.published
    return [p.quantity, unit_of(row), Cell(p.value, text=number(p.value, p.unit)),
            Cell(row.ours, text=number(row.ours, p.unit)), Cell(row.difference, text=difference(row) or "–"),
            p.tolerance or "–", Cell("yes" if row.agrees else "no", mark="good" if row.agrees else "warn"),
            "" if row.agrees else p.why]


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
        if k > 0 and not figure.panels[0].x_label and panel.x_label.startswith("time"):
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
