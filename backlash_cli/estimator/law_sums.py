"""Window sums for the regression of the control law, compiled by numba (imported lazily by identify)."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ..record import FloatArray, IntArray

COLUMNS = ("output", "proportional", "integral", "setpoint", "derivative")
WIDTH = len(COLUMNS)
LANES = 8  # filter times side by side: the processor works on eight of them at a time
# Places of the lanes, in LANES: what each filter holds, then this row's terms and the window's first, then sums.
FIRST, SECOND, INTEGRAL, DECAY, BASE, TOTAL, CROSS = (LANES * x for x in (0, 1, 2, 3, 4, 9, 14))
PLACES = CROSS + LANES * (WIDTH * (WIDTH + 1) // 2)


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def _terms(a: Any, first: Any, second: Any, integral: Any, y: Any, r: Any, interval: float, unseen: float) -> Any:
    """Go on by one row: both filters and the integral, then the terms that depend on the filter time."""
    first = a * first + (1.0 - a) * y
    smooth = a * second + (1.0 - a) * first
    integral = integral + interval * (r - smooth)
    return first, smooth, integral, -smooth, integral - unseen * (r - smooth), (second - smooth) / interval


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def _take(S: FloatArray, u: float, r: float, y: float, interval: float, unseen: float, begins: bool,
          settled: bool) -> None:
    """Go on by one row: filters, integral, and, where they have settled, the sums of the terms less the window's first.

    One loop for all, so that the compiler does it for all lanes at once.
    """
    counts = 1.0 if settled else 0.0
    for j in range(LANES):
        S[FIRST + j], S[SECOND + j], S[INTEGRAL + j], p, i, d = _terms(
            S[DECAY + j], S[FIRST + j], S[SECOND + j], S[INTEGRAL + j], y, r, interval, unseen)
        if begins:
            S[BASE + j], S[BASE + LANES + j], S[BASE + 2 * LANES + j] = u, p, i
            S[BASE + 3 * LANES + j], S[BASE + 4 * LANES + j] = r, d
        v, w = counts * (u - S[BASE + j]), counts * (r - S[BASE + 3 * LANES + j])
        p, i = counts * (p - S[BASE + LANES + j]), counts * (i - S[BASE + 2 * LANES + j])
        d = counts * (d - S[BASE + 4 * LANES + j])
        S[TOTAL + j] += v
        S[TOTAL + LANES + j] += p
        S[TOTAL + 2 * LANES + j] += i
        S[TOTAL + 3 * LANES + j] += w
        S[TOTAL + 4 * LANES + j] += d
        S[CROSS + j] += v * v
        S[CROSS + LANES + j] += p * v
        S[CROSS + 2 * LANES + j] += p * p
        S[CROSS + 3 * LANES + j] += i * v
        S[CROSS + 4 * LANES + j] += i * p
        S[CROSS + 5 * LANES + j] += i * i
        S[CROSS + 6 * LANES + j] += w * v
        S[CROSS + 7 * LANES + j] += w * p
        S[CROSS + 8 * LANES + j] += w * i
        S[CROSS + 9 * LANES + j] += w * w
        S[CROSS + 10 * LANES + j] += d * v
        S[CROSS + 11 * LANES + j] += d * p
        S[CROSS + 12 * LANES + j] += d * i
        S[CROSS + 13 * LANES + j] += d * w
        S[CROSS + 14 * LANES + j] += d * d


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def _take_four(S: FloatArray, signals: FloatArray, k: int, late: int, interval: float, unseen: float) -> None:
    """The same for four rows from k on, within a window: fetching and storing the sums takes longer than adding."""
    u, w = S[BASE], S[BASE + 3 * LANES]
    v0, v1, v2, v3 = signals[2, k] - u, signals[2, k + 1] - u, signals[2, k + 2] - u, signals[2, k + 3] - u
    r0, r1, r2, r3 = signals[0, late], signals[0, late + 1], signals[0, late + 2], signals[0, late + 3]
    y0, y1, y2, y3 = signals[1, late], signals[1, late + 1], signals[1, late + 2], signals[1, late + 3]
    w0, w1, w2, w3 = r0 - w, r1 - w, r2 - w, r3 - w
    for j in range(LANES):
        a, x, z, q = S[DECAY + j], S[FIRST + j], S[SECOND + j], S[INTEGRAL + j]
        x, z, q, p0, i0, d0 = _terms(a, x, z, q, y0, r0, interval, unseen)
        x, z, q, p1, i1, d1 = _terms(a, x, z, q, y1, r1, interval, unseen)
        x, z, q, p2, i2, d2 = _terms(a, x, z, q, y2, r2, interval, unseen)
        x, z, q, p3, i3, d3 = _terms(a, x, z, q, y3, r3, interval, unseen)
        S[FIRST + j], S[SECOND + j], S[INTEGRAL + j] = x, z, q
        p, i, d = S[BASE + LANES + j], S[BASE + 2 * LANES + j], S[BASE + 4 * LANES + j]
        p0, p1, p2, p3 = p0 - p, p1 - p, p2 - p, p3 - p
        i0, i1, i2, i3 = i0 - i, i1 - i, i2 - i, i3 - i
        d0, d1, d2, d3 = d0 - d, d1 - d, d2 - d, d3 - d
        S[TOTAL + j] += v0 + v1 + v2 + v3
        S[TOTAL + LANES + j] += p0 + p1 + p2 + p3
        S[TOTAL + 2 * LANES + j] += i0 + i1 + i2 + i3
        S[TOTAL + 3 * LANES + j] += w0 + w1 + w2 + w3
        S[TOTAL + 4 * LANES + j] += d0 + d1 + d2 + d3
        S[CROSS + j] += v0 * v0 + v1 * v1 + v2 * v2 + v3 * v3
        S[CROSS + LANES + j] += p0 * v0 + p1 * v1 + p2 * v2 + p3 * v3
        S[CROSS + 2 * LANES + j] += p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3
        S[CROSS + 3 * LANES + j] += i0 * v0 + i1 * v1 + i2 * v2 + i3 * v3
        S[CROSS + 4 * LANES + j] += i0 * p0 + i1 * p1 + i2 * p2 + i3 * p3
        S[CROSS + 5 * LANES + j] += i0 * i0 + i1 * i1 + i2 * i2 + i3 * i3
        S[CROSS + 6 * LANES + j] += w0 * v0 + w1 * v1 + w2 * v2 + w3 * v3
        S[CROSS + 7 * LANES + j] += w0 * p0 + w1 * p1 + w2 * p2 + w3 * p3
        S[CROSS + 8 * LANES + j] += w0 * i0 + w1 * i1 + w2 * i2 + w3 * i3
        S[CROSS + 9 * LANES + j] += w0 * w0 + w1 * w1 + w2 * w2 + w3 * w3
        S[CROSS + 10 * LANES + j] += d0 * v0 + d1 * v1 + d2 * v2 + d3 * v3
        S[CROSS + 11 * LANES + j] += d0 * p0 + d1 * p1 + d2 * p2 + d3 * p3
        S[CROSS + 12 * LANES + j] += d0 * i0 + d1 * i1 + d2 * i2 + d3 * i3
        S[CROSS + 13 * LANES + j] += d0 * w0 + d1 * w1 + d2 * w2 + d3 * w3
        S[CROSS + 14 * LANES + j] += d0 * d0 + d1 * d1 + d2 * d2 + d3 * d3


@numba.njit(cache=True, nogil=True)
def window_sums(signals: FloatArray, index: IntArray, interval: float, filter_times: FloatArray, shift: int,
                phase: float, window: int, settle: int) -> FloatArray:
    """Return centred sums of products of the control law's terms, one matrix per filter time and window.

    signals: (3, rows) setpoint, measurement, output; index: (rows,) grid number of each row, a jump is a gap.
    interval: seconds between rows. filter_times: at most LANES Tf [s] of the measurement filter (3). shift: rows by
    which the output answers late. phase: share of the newest error that the integral has not yet taken in (0 for a
    controller that runs at the logged rate, 1/2 for one much faster). window: rows per window. settle: rows left out
    after a gap, in which the filter settles (about 5 Tf). Returns (filter times, windows, 5, 5) sums in the order of
    COLUMNS. Windows never span a gap, and the filter starts anew after one.
    Terms of eq. (2): -yf, integral of (ysp - yf), ysp, -dyf/dt.
    """
    rows, lanes = len(index), len(filter_times)
    S = np.zeros(PLACES)
    for j in range(lanes):
        S[DECAY + j] = np.exp(-interval / filter_times[j]) if filter_times[j] > 0.0 else 0.0
    sums = np.empty((lanes, rows // max(window // 2, 1) + 1, WIDTH, WIDTH))
    done = n = since = 0
    k: Any = np.int64(0)  # a plain 0 would be compiled for itself
    while k <= rows:
        new = k == rows or k == 0 or index[k] != index[k - 1] + 1
        if (new or n == window) and n > 0:
            if 2 * n >= window and done < sums.shape[1]:
                for lane in range(lanes):
                    c = CROSS + lane
                    for i in range(WIDTH):
                        for j in range(i + 1):
                            v = S[c] - S[TOTAL + i * LANES + lane] * S[TOTAL + j * LANES + lane] / n
                            sums[lane, done, i, j] = sums[lane, done, j, i] = v
                            c += LANES
                done += 1
            for j in range(TOTAL, PLACES):
                S[j] = 0.0
            n = 0
        if k == rows:
            break
        last = k + 3
        if not new and 0 < n <= window - 4 and last < rows and index[last] == index[k] + 3:
            _take_four(S, signals, k, k - shift, interval, phase * interval)
            k, n, since = k + 4, n + 4, since + 4
            continue
        if new:
            since = 0
            for j in range(LANES):
                S[FIRST + j] = S[SECOND + j] = signals[1, k]
                S[INTEGRAL + j] = 0.0
        else:
            since += 1
        late = k - shift if since >= shift else k
        settled = since >= settle
        _take(S, signals[2, k], signals[0, late], signals[1, late], interval, phase * interval, settled and n == 0,
              settled)
        n += settled
        k += 1
    return sums[:, :done]
