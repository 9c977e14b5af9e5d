"""What a history holds, in lines for the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from ..results.history import Night, Repair, Run, day_of
from .safe import terminal


def loops_text(nights: Mapping[str, Sequence[Night]], repairs: Mapping[str, Sequence[Repair]], runs: int) -> str:
    """Return one line per loop: nights, span, verdicts, last size, repairs."""
    rows = [("Loop", "Nights", "First", "Last", "Last size", "Repairs", "Verdicts")]
    for name, found in nights.items():
        sized = [n.d for n in found if n.d is not None]
        verdicts = Counter(str(n.verdict) for n in found).most_common()
        marked = ", ".join(r.date.isoformat() for r in repairs.get(name, ()))
        rows.append((terminal(name, 30), str(len(found)), found[0].date.isoformat(), found[-1].date.isoformat(),
                     f"{100 * sized[-1]:.2f} %" if sized else "-", marked or "-",
                     ", ".join(f"{n} {word}" for word, n in verdicts)))
    loops = f"{len(nights)} loop{'s' * (len(nights) != 1)}, {runs} run{'s' * (runs != 1)}"
    return columns(rows) + f"\n{loops}. Sizes in % of the output span.\n"


def runs_text(runs: Sequence[Run]) -> str:
    """Return one line per run that added to the history, in the order of their data."""
    rows = [("Data from", "to", "Loops", "Failures", "Inputs")]
    for run in runs:
        inputs = ", ".join(run.inputs[:3]) + (f" and {len(run.inputs) - 3} more" if len(run.inputs) > 3 else "")
        rows.append((day_of(run.first).isoformat(), day_of(run.last).isoformat(), str(run.loops),
                     str(len(run.failures)), terminal(inputs, 80)))
    return columns(rows)


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Return rows of text in aligned columns."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows)
    return "\n".join(lines) + "\n"
