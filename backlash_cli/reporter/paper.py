"""The paper's numbers beside ours as text, plain values and a page with each figure drawn anew."""

from __future__ import annotations

from typing import Any

from ..results.paper import Line, PaperFigure, PaperReport
from .console import screen
from .figures import GREEN, QUIET, Figure, axis, digits, trace, written
from .json_report import json_text
from .page import page

WIDTH = 120
COLOURS = ("#2878c8", "#d1345b", GREEN, "#c77700", "#7a5bc7")
GAP = 0.1  # of the height, between panels
_SOURCE = "J. Process Control 17 (2007) 489-499"


def to_text(report: PaperReport, *, colour: bool = False) -> str:
    """Return the table paper, ours, difference, agrees; below it why some rows differ."""
    return screen("paper.txt", colour=colour, width=WIDTH, **_content(report),
                  reasons=list(dict.fromkeys(row.why for row in report.rows if row.why)))


def paper_page(report: PaperReport) -> str:
    """Return the page: all numbers first, then figure by figure."""
    return page("paper.html", "Haegglund (2007), recomputed", **_content(report),
                subtitle=f"T. Haegglund, Automatic on-line estimation of backlash in control loops, {_SOURCE}",
                figures=[(figure, plot(figure)) for figure in report.figures])


def _content(report: PaperReport) -> dict[str, Any]:
    return {"report": report, "source": _SOURCE, "agreeing": sum(row.agrees for row in report.rows)}


def to_json(report: PaperReport) -> str:
    """Return the rows as JSON text."""
    rows = [{**{n: getattr(row, n) for n in ("key", "figure", "quantity", "unit")},
             "paper": row.value, "ours": row.ours, "difference": row.difference,
             "tolerance": row.tolerance, "agrees": row.agrees, "why": row.why or None}
            for row in report.rows]
    return json_text({
        "paper": f"T. Haegglund, {_SOURCE}", "agree": sum(row.agrees for row in report.rows), "rows": rows,
        "estimates": {key: {"paper": theirs, "ours": ours} for key, (theirs, ours) in report.lists.items()}})


def plot(figure: PaperFigure) -> Figure:
    """Return a figure with its panels below each other."""
    n = len(figure.panels)
    height = (1.0 - GAP * (n - 1)) / n
    data: list[Figure] = []
    layout: Figure = {"height": 190 * n + 160, "annotations": [], "hovermode": "closest"}
    shown: set[str] = set()
    for k, panel in enumerate(figure.panels):
        mark = "" if k == 0 else str(k + 1)
        top = 1.0 - k * (height + GAP)
        colours = iter(COLOURS * len(panel.lines))
        for line in panel.lines:
            data.append(_line(line, QUIET if line.quiet else next(colours), mark, first=line.name not in shown))
            shown.add(line.name)
        for letter, label, limits, more in (
                ("x", panel.x_label, panel.x_limits, {"anchor": f"y{mark}"}),
                ("y", panel.y_label, panel.y_limits, {"anchor": f"x{mark}", "domain": [max(top - height, 0.0), top]})):
            layout[f"{letter}axis{mark}"] = axis(label, **({"range": list(limits)} if limits else {}), **more)
        if k > 0 and not figure.panels[0].x_label and panel.x_label.startswith("time"):
            layout[f"xaxis{mark}"]["matches"] = "x"
        if panel.equal_scales:
            layout[f"yaxis{mark}"]["scaleanchor"] = f"x{mark}"
            layout["height"] = 620
        layout["annotations"] += [written(text, x, y, xref=f"x{mark}", yref=f"y{mark}", yshift=12)
                                  for x, y, text in panel.marks]
    return {"data": data, "layout": layout}


def _line(line: Line, colour: str, mark: str, *, first: bool) -> Figure:
    return trace(digits(line.x), digits(line.y), line.name, colour, mode="markers" if len(line.x) == 1 else "lines",
                 width=1.2 if line.quiet else 1.6, dash=line.dash, size=10, symbol="diamond", hover="",
                 showlegend=first, legendgroup=line.name, xaxis=f"x{mark}", yaxis=f"y{mark}")
