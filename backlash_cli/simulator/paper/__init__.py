"""Haegglund (2007) recomputed: every number and figure, ours beside the paper's.

T. Haegglund, Automatic on-line estimation of backlash in control loops, J. Process Control 17 (2007) 489-499.
"""

from __future__ import annotations

from ...results.paper import PaperReport, PaperRow
from . import estimates, simulated
from .estimates import Estimator
from .published import ESTIMATES, PUBLISHED

__all__ = ["reproduce"]

ORDER = ("fig3", "scaling", "fig4", "fig5", "fig6", "fig7", "fig8", "fig9", "fig10", "kp", "fig12", "fig13", "fig14",
         "fig15", "fig17", "fig18", "fig19")


def reproduce(estimator: Estimator) -> PaperReport:
    """Recompute the paper; `estimator` returns the published estimates of a record, refused ones included."""
    values: dict[str, float] = {}
    figures = []
    for part in (simulated.integrating_process(), simulated.stable_process()):
        values |= part[0]
        figures += part[1]
    more, drawn, lists = estimates.numbers(estimator)
    values |= more
    figures = sorted([*figures, *drawn], key=lambda f: ORDER.index(f.key))
    rows = tuple(PaperRow(p, values[p.key]) for p in PUBLISHED)
    return PaperReport(rows, tuple(figures), {key: (ESTIMATES[key], ours) for key, ours in lists.items()})
