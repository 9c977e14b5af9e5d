"""The paper's numbers beside ours, as text for a terminal and as JSON."""

from __future__ import annotations

import io
import textwrap
from typing import Any

from rich.console import Console
from rich.table import Table

from ..results.paper import PaperReport, PaperRow

WIDTH = 120


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
    out = io.StringIO()
    console = Console(file=out, width=WIDTH, force_terminal=colour, color_system="standard" if colour else None,
                      highlight=False, markup=False, emoji=False)
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    table.add_column("Number", overflow="fold")
    for name in ("Paper", "Ours", "Difference"):
        table.add_column(name, justify="right", no_wrap=True)
    for name in ("Unit", "Agrees"):
        table.add_column(name, no_wrap=True)
    reasons: list[str] = []
    for row in report.rows:
        p = row.published
        note = ""
        if p.why:
            if p.why not in reasons:
                reasons.append(p.why)
            note = f" [{reasons.index(p.why) + 1}]"
        table.add_row(p.quantity, number(p.value, p.unit), number(row.ours, p.unit), difference(row), unit_of(row),
                      ("yes" if row.agrees else "no") + note, style="" if row.agrees else "yellow")
    console.print("T. Haegglund, J. Process Control 17 (2007) 489-499: the paper's numbers and ours\n")
    console.print(table)
    agreeing = sum(row.agrees for row in report.rows)
    console.print(f"\n{agreeing} of {len(report.rows)} numbers agree within their tolerance. Where they do not:")
    for k, why in enumerate(reasons, 1):
        console.print(textwrap.fill(why, WIDTH - 2, initial_indent=f"[{k}] ", subsequent_indent="    "))
    console.print("\nSingle estimates [% of span]:")
    for key, (theirs, ours) in report.lists.items():
        console.print(f"  Fig. {key[3:]}  paper {theirs}   ours {ours}")
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def to_document(report: PaperReport) -> dict[str, Any]:
    """Return the rows as plain values for JSON."""
    return {
        "paper": "T. Haegglund, J. Process Control 17 (2007) 489-499",
        "agree": sum(row.agrees for row in report.rows),
        "rows": [
            {"key": row.published.key, "figure": row.published.figure, "quantity": row.published.quantity,
             "unit": row.published.unit, "paper": row.published.value, "ours": row.ours,
             "difference": row.difference, "tolerance": row.published.tolerance, "agrees": row.agrees,
             "why": row.published.why or None}
            for row in report.rows
        ],
        "estimates": {key: {"paper": theirs, "ours": ours} for key, (theirs, ours) in report.lists.items()},
    }
