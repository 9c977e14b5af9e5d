"""A load that swings with one period: its sine and cosine, to be told from what OP does."""

from __future__ import annotations

import numpy as np

from ..record import FloatArray, IntArray
from .square_wave import THIRD

SHARE = 0.75  # of PV's variance in one line: swings with and without dead band have 95 %, square loads 60 %
FEWEST_PERIODS = 6
FEWEST_ROWS = 8  # per period
WHOLE = 0.8  # of the rows that a record without large holes has
TOGETHER = 8  # rows added up in a record in pieces, where periods of 32 rows (8 Ti) and more are looked for
STEPS = 41  # frequencies tried within two bins
NEARLY = 0.8  # of SHARE at the first guess of the frequency, before it is refined


def periodic_load(y: FloatArray, at: IntArray) -> FloatArray:
    """Return sine and cosine (2, rows) of the one period that dominates y (rows,), or nothing (0, rows).

    at (rows,): block numbers; holes are bridged by the mean. The frequency is refined by least squares within the
    width of the line. In a record in pieces the line is as sharp as the whole record is long, and its share is that
    of the sine and cosine that fit all pieces; what has a third harmonic is a square wave rather.
    """
    span = int(at[-1] - at[0]) + 1
    centred = y - y.mean()
    found = _of_whole(centred, at, span) if len(y) >= WHOLE * span else _of_pieces(centred, at, span)
    return np.empty((0, len(y))) if found is None else _shapes(found, at)


def _shapes(frequency: float, at: IntArray) -> FloatArray:
    """Sine and cosine (2, rows); frequency: periods a row."""
    phase = 2.0 * np.pi * frequency * at
    return np.stack([np.sin(phase), np.cos(phase)])


def _left(frequency: float, y: FloatArray, at: IntArray) -> float:
    """Sum of squares that the best sine leaves of y."""
    columns = _shapes(frequency, at)
    return float(y @ y - (y @ columns.T) @ np.linalg.solve(columns @ columns.T, columns @ y))


def _refined(frequency: float, bin_width: float, y: FloatArray, at: IntArray) -> float:
    """The frequency within a bin's width at which the best sine explains most of y, of a grid of STEPS.

    The waves are turned on from one frequency to the next, which takes a tenth of the time of making each.
    """
    grid = frequency + bin_width * np.linspace(-1.0, 1.0, STEPS)
    wave, turn = (np.exp(2j * np.pi * f * at) for f in (grid[0], 2.0 * bin_width / (STEPS - 1)))
    values, explained = y.astype(complex), np.empty(STEPS)
    for i in range(STEPS):
        of_y, squares = values @ wave, wave @ wave
        coscos, sinsin, cossin = 0.5 * (len(y) + squares.real), 0.5 * (len(y) - squares.real), 0.5 * squares.imag
        explained[i] = (sinsin * of_y.real**2 - 2.0 * cossin * of_y.real * of_y.imag + coscos * of_y.imag**2) / (
            coscos * sinsin - cossin**2)
        wave = wave * turn
    return float(grid[int(np.argmax(explained))])


def _of_whole(y: FloatArray, at: IntArray, span: int) -> float | None:
    even = np.zeros(span)
    even[at - at[0]] = y
    power = np.abs(np.fft.rfft(even * np.hanning(span))) ** 2
    low, high = FEWEST_PERIODS, span // FEWEST_ROWS
    if high <= low:
        return None
    top = low + int(np.argmax(power[low:high]))
    if power[max(top - 2, 1) : top + 3].sum() < SHARE * power[1:].sum():
        return None
    return _refined(top / span, 1.0 / span, y, at)


def _of_pieces(y: FloatArray, at: IntArray, span: int) -> float | None:
    sums = np.bincount((at - at[0]) // TOGETHER, y)
    fine = 1 << (2 * len(sums) - 1).bit_length()
    bin_width = 1.0 / (fine * TOGETHER)
    low, high = int(FEWEST_PERIODS / (span * bin_width)), fine // 4
    if high <= low:
        return None
    power = np.abs(np.fft.rfft(sums, fine)) ** 2
    top = low + int(np.argmax(power[low:high]))
    most = float(y @ y)
    if 2.0 * power[top] < NEARLY * SHARE * len(y) * most:
        return None
    frequency = _refined(top * bin_width, bin_width, y, at)
    explained, third = most - _left(frequency, y, at), most - _left(3.0 * frequency, y, at)
    return frequency if explained > SHARE * most and third < THIRD**2 * explained else None
