"""Compiled loops over the rows of the dead-band test: positions from where a stretch begins, and between two widths."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(cache=True, nogil=True, error_model="numpy")
def from_start(x: NDArray[Any], use: NDArray[Any], first: NDArray[Any]) -> NDArray[Any]:
    """Return the rows at the places `use` (rows,) of x (columns, all rows), counted from where their stretch begins.

    first (rows,): True where one does, so at the first row.
    """
    out = np.empty((len(x), len(use)))
    for c in range(len(x)):
        values, row, begin = x[c], out[c], 0.0
        for k in range(len(use)):
            value = values[use[k]]
            if first[k]:
                begin = value
            row[k] = value - begin
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def joined(before: NDArray[Any], below: NDArray[Any], above: NDArray[Any], after: NDArray[Any],
           widths: tuple[float, float, float, float], d: float) -> NDArray[Any]:
    """Return where straight lines over the width meet at a width d between the second and the third of `widths`.

    before, below, above, after (rows,): values at the four widths. See `profile.between`.
    """
    lower, low, high, higher = widths
    out = np.empty(len(below))
    for k in range(len(out)):
        rise = (below[k] - before[k]) / (low - lower)
        slope = (above[k] - below[k]) / (high - low)
        fall = (after[k] - above[k]) / (higher - high) if higher > high else slope
        chord = below[k] + slope * (d - low)
        left, right = below[k] + rise * (d - low), above[k] - fall * (high - d)
        over, under = max(min(left, right), chord), min(max(left, right), chord)
        out[k] = over if rise > fall else under
    return out
