"""A load that swings with one period: its sine and cosine, to be told from what OP does."""

from __future__ import annotations

import numpy as np

from ..record import FloatArray, IntArray

SHARE = 0.75  # of PV's variance in one line: swings with and without dead band have 95 %, square loads 60 %
FEWEST_PERIODS = 6
FEWEST_ROWS = 8  # per period


def periodic_load(y: FloatArray, at: IntArray) -> FloatArray:
    """Return sine and cosine (2, rows) of the one period that dominates y (rows,), or nothing (0, rows).

    at (rows,): block numbers; holes are bridged by the mean. The frequency is refined by least squares within the
    width of the line.
    """
    none = np.empty((0, len(y)))
    span = int(at[-1] - at[0]) + 1
    if len(y) < 0.8 * span:
        return none
    even = np.zeros(span)
    even[at - at[0]] = y - y.mean()
    power = np.abs(np.fft.rfft(even * np.hanning(span))) ** 2
    low, high = FEWEST_PERIODS, span // FEWEST_ROWS
    if high <= low:
        return none
    top = low + int(np.argmax(power[low:high]))
    if power[max(top - 2, 1) : top + 3].sum() < SHARE * power[1:].sum():
        return none
    centred = y - y.mean()

    def shapes(frequency: float) -> FloatArray:
        phase = 2.0 * np.pi * frequency / span * at
        return np.stack([np.sin(phase), np.cos(phase)])

    def left(frequency: float) -> float:
        columns = shapes(frequency)
        fit = np.linalg.lstsq(columns.T, centred, rcond=None)[0] @ columns
        return float(np.sum((centred - fit) ** 2))

    grid = top + np.linspace(-1.0, 1.0, 41)
    return shapes(float(grid[int(np.argmin([left(f) for f in grid]))]))
