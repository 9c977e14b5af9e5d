"""Window sums for the regression of the control law, compiled by numba (imported lazily by identify)."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

COLUMNS = ("output", "proportional", "integral", "setpoint", "derivative")


@numba.njit(cache=True)
def window_sums(
    signals: NDArray[Any],
    index: NDArray[Any],
    interval: float,
    filter_time: float,
    shift: int,
    phase: float,
    window: int,
    settle: int,
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return centred sums of products of the control law's terms, one matrix per window.

    signals: (rows, 3) setpoint, measurement, output; index: (rows,) grid number of each row, a jump is a gap.
    interval: seconds between rows. filter_time: Tf [s] of the measurement filter (3). shift: rows by which the
    output answers late. phase: share of the newest error that the integral has not yet taken in (0 for a
    controller that runs at the logged rate, 1/2 for one much faster). window: rows per window.
    settle: rows left out after a gap, in which the filter settles (about 5 Tf).
    Returns (windows, 5, 5) sums in the order of COLUMNS and (windows,) the rows in each. Windows never span a
    gap, and the filter starts anew after one.
    Terms of eq. (2): -yf, integral of (ysp - yf), ysp, -dyf/dt.
    """
    rows = len(index)
    a = np.exp(-interval / filter_time) if filter_time > 0.0 else 0.0
    width = 5
    sums = np.empty((rows // max(window // 2, 1) + 1, width, width))
    counts = np.empty(len(sums), dtype=np.int64)
    done = 0
    total = np.zeros(width)
    cross = np.zeros((width, width))
    base = np.zeros(width)
    row = np.zeros(width)
    n = 0
    first = 0.0
    second = 0.0
    integral = 0.0
    since = 0
    for k in range(rows + 1):
        new = k == rows or k == 0 or index[k] != index[k - 1] + 1
        if (new or n == window) and n > 0:
            if 2 * n >= window and done < len(sums):
                for i in range(width):
                    for j in range(i + 1):
                        v = cross[i, j] - total[i] * total[j] / n
                        sums[done, i, j] = v
                        sums[done, j, i] = v
                counts[done] = n
                done += 1
            total[:] = 0.0
            cross[:] = 0.0
            n = 0
        if k == rows:
            break
        if new:
            since = 0
            first = signals[k, 1]
            second = signals[k, 1]
            integral = 0.0
        else:
            since += 1
        late = k - shift if since >= shift else k
        before = second
        first = a * first + (1.0 - a) * signals[late, 1]
        second = a * second + (1.0 - a) * first
        error = signals[late, 0] - second
        integral += interval * error
        if since < settle:
            continue
        row[0] = signals[k, 2]
        row[1] = -second
        row[2] = integral - phase * interval * error
        row[3] = signals[late, 0]
        row[4] = -(second - before) / interval
        if n == 0:
            base[:] = row
        for i in range(width):
            v = row[i] - base[i]
            total[i] += v
            for j in range(i + 1):
                cross[i, j] += v * (row[j] - base[j])
        n += 1
    return sums[:done], counts[:done]
