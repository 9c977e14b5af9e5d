"""The shape of an oscillation: period, regularity, mean half period, and how well simple shapes fit it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate

from ..record import FloatArray

GRID = (np.arange(64) + 0.5) / 64  # of a half period after stretching to common length
LEAST_HALF_PERIODS = 6


def autocorrelation(values: FloatArray, lags: int) -> FloatArray:
    """Correlation of `values` now with those 0, 1 ... lags - 1 samples later, unbiased, over their variance."""
    n, flat = len(values), values - values.mean()
    power = float(flat @ flat)
    raw = correlate(flat, flat, method="fft")[n - 1 : n - 1 + lags]
    return np.asarray(raw / power * (n / (n - np.arange(lags)))) if power > 0 else np.zeros(lags)


def detrended(values: FloatArray, period: float) -> FloatArray:
    """Values less their mean over one period around each, so that only the oscillation and faster parts stay."""
    return values - moving_mean(values, round(period))


def moving_mean(values: FloatArray, width: int) -> FloatArray:
    """Centred mean over `width` samples, over fewer at the ends."""
    width = max(width, 1)
    total = np.concatenate([[0.0], np.cumsum(values)])
    at = np.arange(len(values))
    low, high = np.maximum(at - width // 2, 0), np.minimum(at + width - width // 2, len(values))
    return np.asarray((total[high] - total[low]) / (high - low))


def find_period(values: FloatArray) -> tuple[float, float]:
    """Return the period [samples] and the height of the autocorrelation there; (0, 0) where nothing repeats.

    The first maximum after the first minimum below zero, refined by a parabola (Miao and Seborg, Control Engineering
    Practice 7 (1999) 91, use the same maxima).
    """
    r = autocorrelation(values, max(len(values) // 3, 2))
    at = [*(np.flatnonzero(np.diff(r >= 0.0)) + 1).tolist(), len(r), len(r), len(r)]  # down, up and down again
    k = at[1] + int(np.argmax(r[at[1] : at[2]])) if at[1] < at[2] else len(r)
    if k + 1 >= len(r):
        return 0.0, 0.0
    bend = r[k - 1] - 2.0 * r[k] + r[k + 1]
    return k + (0.5 * (r[k - 1] - r[k + 1]) / bend if bend < 0 else 0.0), float(r[k])


def regularity(values: FloatArray, crossings: int = 11) -> float:
    """Return mean / (3 sd) of the intervals between the first zero crossings of the autocorrelation; above 1: regular.

    Source: Thornhill, Huang and Zhang, J. Process Control 13 (2003) 91. 0 with fewer than eight crossings.
    """
    r = autocorrelation(values, len(values) // 2)
    at = np.flatnonzero(np.sign(r[1:]) != np.sign(r[:-1]))[:crossings]
    if len(at) < 8:
        return 0.0
    length = np.diff(at)
    spread = float(np.std(length, ddof=1))
    return float(np.mean(length) / (3.0 * spread)) if spread > 0 else np.inf


def sustained(values: FloatArray, period: float, height: float) -> float:
    """Autocorrelation five periods on (1: the same for ever, 0: forgotten); height: the same one period on."""
    far, near = round(5.0 * period), max(round(period / 8.0), 2)  # the period is not known to the sample
    if far + near >= len(values) // 2:
        return height**5
    return float(autocorrelation(values, far + near + 1)[far - near :].max())


def mean_half_period(values: FloatArray, period: float) -> FloatArray | None:
    """Return the median shape (64,) between zero crossings of a signal that oscillates with `period`, each of mean 1;
    None with fewer than six half periods."""
    flat = detrended(values, period)
    shapes = stretched(flat, crossings(flat, period)[0], (0.25 * period, 0.8 * period), GRID)
    if len(shapes) < LEAST_HALF_PERIODS:
        return None
    mean = shapes.mean(1, keepdims=True)
    return np.asarray(np.median(shapes / np.where(mean == 0.0, 1.0, mean), axis=0))


def stretched(values: FloatArray, marks: FloatArray, lengths: tuple[float, float], grid: FloatArray) -> FloatArray:
    """Values between two marks (pieces, grid), of all pieces of a length between `lengths`, at the same `grid` 0..1."""
    length = np.diff(marks)
    typical = (length > lengths[0]) & (length < lengths[1])
    time = marks[:-1][typical, None] + grid * length[typical, None]
    return np.asarray(np.interp(time, np.arange(len(values)), values))


def crossings(flat: FloatArray, period: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Zero crossings [samples] of a detrended signal, smoothed over a sixteenth of the period, and whether it rises."""
    smooth = moving_mean(flat, round(period / 16.0))
    sign = smooth >= 0.0
    at = np.flatnonzero(sign[1:] != sign[:-1])
    return at + smooth[at] / (smooth[at] - smooth[at + 1]), sign[at + 1]


def misfits(shape: FloatArray) -> list[float]:
    """Sums of squares that the best half sine, the best constant and the best triangle leave of a half period (64,).

    The triangle may have its peak anywhere (He et al. 2007).
    """
    peaks, left = np.linspace(0.1, 0.9, 33)[:, None], []
    for bases in (np.sin(np.pi * GRID)[None], np.ones((1, len(GRID))),
                  np.minimum(GRID / peaks, (1.0 - GRID) / (1.0 - peaks))):
        along = (bases @ shape) / np.sum(bases * bases, axis=1)
        left.append(float(np.sum((shape - bases * along[:, None]) ** 2, axis=1).min()))
    return left
