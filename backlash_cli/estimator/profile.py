"""The likelihood over the width of the dead band: positions between tried widths, its top, and its interval."""

from __future__ import annotations

import numpy as np

from ..record import FloatArray
from .row_loops import joined

DROP = 3.0  # nats from the top to the ends of the likelihood interval


def between(x: FloatArray, widths: FloatArray, d: float) -> FloatArray:
    """Valve position (rows,) for a width d between two of `widths`.

    x (1 + widths, rows): OP, and OP through each dead band of `widths` (ascending).

    At any moment the position behind a gap is a chain of straight lines over the width: half a width above OP or
    below, or half a width from where OP turned last, with bends at the widths that OP just crosses. The lines through
    the neighbours on either side meet at such a bend; the chord would cut it off and pull the fit to the grid.
    """
    i = int(np.clip(np.searchsorted(widths, d), 1, len(widths) - 1))
    last = min(i + 1, len(widths) - 1)  # the wider neighbour, or the chord goes on where there is none
    at = (float(widths[i - 2]) if i > 1 else 0.0, float(widths[i - 1]), float(widths[i]), float(widths[last]))
    bent: FloatArray = joined(x[i - 1], x[i], x[i + 1], x[1 + last], at, d)
    return bent


def peak(d: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Return place and height of the top of `values` over the widths d (ascending), the place by a parabola."""
    i = int(np.argmax(values))
    if 0 < i < len(d) - 1:
        a, b = d[i - 1] - d[i], d[i + 1] - d[i]
        slope_a, slope_b = (values[i - 1] - values[i]) / a, (values[i + 1] - values[i]) / b
        bend = (slope_a - slope_b) / (a - b)
        if bend < 0:
            return float(d[i] + np.clip(-0.5 * (slope_a - bend * a) / bend, a, b)), float(values[i])
    return float(d[i]), float(values[i])


def likelihood_interval(d: FloatArray, values: FloatArray, top: float) -> tuple[float, float]:
    """Return where the log-likelihood `values` (widths,) over d (widths,), ascending, fall DROP below the top."""
    level = top - DROP
    inside = np.flatnonzero(values > level)
    first, last = int(inside[0]), int(inside[-1])

    def crossing(a: int, b: int) -> float:
        return float(d[a] + (level - values[a]) / (values[b] - values[a]) * (d[b] - d[a]))

    low = crossing(first - 1, first) if first > 0 else 0.0
    high = crossing(last + 1, last) if last < len(d) - 1 else float(d[-1]) * 1.22
    return low, high
