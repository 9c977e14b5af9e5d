"""The paper's numbers beside ours: all numbers first, then each figure drawn anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from .figures import GREEN, QUIET, Figure, axis, digits, trace, written
from .json_report import fields_of
from .report import Report

if TYPE_CHECKING:
    from ..simulator.paper import PaperFigure, PaperRow

COLOURS = ("#2878c8", "#d1345b", GREEN, "#c77700", "#7a5bc7")
GAP = 0.1  # of the height, between panels
SOURCE = "J. Process Control 17 (2007) 489-499"


def paper(rows: Sequence[PaperRow], figures: Sequence[PaperFigure], lists: Mapping[str, tuple[str, str]]) -> Report:
    """Return the table paper, ours, difference, agrees; why some rows differ; the figures; and single estimates, the
    paper's and ours by the key of a figure."""
    agreeing = sum(row.agrees for row in rows)
    content = {"rows": rows, "lists": lists, "source": SOURCE, "agreeing": agreeing,
               "reasons": list(dict.fromkeys(row.why for row in rows if row.why))}

    def document() -> dict[str, Any]:
        told = [{**fields_of(row, "value", "certified", "certified_tolerance"), "paper": row.value,
                 "difference": row.difference, "agrees": row.agrees, "why": row.why or None} for row in rows]
        return {"paper": f"T. Haegglund, {SOURCE}", "agree": agreeing, "rows": told,
                "estimates": {key: {"paper": theirs, "ours": ours} for key, (theirs, ours) in lists.items()}}

    return Report("paper", "Haegglund (2007), recomputed", content, document,
                  lambda: {"figures": [(figure, _plot(figure)) for figure in figures]},
                  f"T. Haegglund, Automatic on-line estimation of backlash in control loops, {SOURCE}", width=120)


def _plot(figure: PaperFigure) -> Figure:
    n = len(figure.panels)
    height = (1.0 - GAP * (n - 1)) / n
    layout: Figure = {"height": 190 * n + 160, "annotations": []}
    data: list[Figure] = []
    for k, panel in enumerate(figure.panels):
        mark = str(k + 1) if k else ""
        top = 1.0 - k * (height + GAP)
        known, colours = {one["name"] for one in data}, iter(COLOURS * len(panel.lines))
        for line in panel.lines:
            data.append(trace(digits(line.x), digits(line.y), line.name, QUIET if line.quiet else next(colours),
                mode="markers" if len(line.x) == 1 else "lines", width=1.2 if line.quiet else 1.6, dash=line.dash,
                size=10, symbol="diamond", hover="", showlegend=line.name not in known, legendgroup=line.name,
                xaxis=f"x{mark}", yaxis=f"y{mark}"))
        shown: Figure = {"range": list(panel.square)} if panel.square else {}
        layout[f"xaxis{mark}"] = axis(panel.x_label, anchor=f"y{mark}", **shown)
        layout[f"yaxis{mark}"] = axis(panel.y_label, anchor=f"x{mark}", domain=[max(top - height, 0.0), top], **shown)
        if k > 0 and not figure.panels[0].x_label and panel.x_label.startswith("time"):
            layout[f"xaxis{mark}"]["matches"] = "x"
        if panel.square:
            layout[f"yaxis{mark}"]["scaleanchor"] = f"x{mark}"
            layout["height"] = 620
        layout["annotations"] += [written(text, x, y, xref=f"x{mark}", yref=f"y{mark}", yshift=12)
                                  for x, y, text in panel.marks]
    return {"data": data, "layout": layout}
