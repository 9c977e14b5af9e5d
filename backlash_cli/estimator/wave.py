"""The shape of an oscillation: period, regularity, mean half period, and how well simple shapes fit it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from ..record import FloatArray

POINTS = 64  # of a half period after stretching to common length
LEAST_HALF_PERIODS = 6


@dataclass(frozen=True)
class Wave:
    """One signal's oscillation: period [samples] and height, the autocorrelation one period on.

    sustained: autocorrelation five periods on (1: the same for ever, 0: forgotten). half_period: (POINTS,) median
    shape between zero crossings, mean 1. n: half periods in it.
    """

    period: float
    height: float
    sustained: float
    half_period: FloatArray
    n: int


def autocorrelation(values: FloatArray, other: FloatArray | None = None, lags: int | None = None) -> FloatArray:
    """Correlation of `values` now with `other` 0, 1 ... samples later, unbiased, divided by the standard deviations.

    lags: how many of them, all n unless it is given; few take less time.
    """
    n = len(values)
    lags = n if lags is None else min(lags, n)
    size = next_fast_len(n + lags, real=True)
    a = values - values.mean()
    b = a if other is None else other - other.mean()
    spectrum = np.fft.rfft(a, size)
    raw = np.fft.irfft(np.conj(spectrum) * (spectrum if other is None else np.fft.rfft(b, size)), size)[:lags]
    norm = float(np.sqrt(np.sum(a * a) * np.sum(b * b)))
    return np.asarray(raw / norm * (n / (n - np.arange(lags)))) if norm > 0 else np.zeros(lags)


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
    r = autocorrelation(values, lags=max(len(values) // 3, 2))
    below = np.flatnonzero(r < 0.0)
    if not len(below):
        return 0.0, 0.0
    after = int(below[0]) + np.flatnonzero(r[below[0] :] > 0.0)
    if not len(after):
        return 0.0, 0.0
    end = after[0] + np.flatnonzero(r[after[0] :] < 0.0)
    stop = int(end[0]) if len(end) else len(r)
    k = int(after[0] + np.argmax(r[after[0] : stop]))
    if k + 1 >= len(r):
        return 0.0, 0.0
    bend = r[k - 1] - 2.0 * r[k] + r[k + 1]
    return k + (0.5 * (r[k - 1] - r[k + 1]) / bend if bend < 0 else 0.0), float(r[k])


def regularity(values: FloatArray, crossings: int = 11) -> float:
    """Return mean / (3 sd) of the intervals between the first zero crossings of the autocorrelation; above 1: regular.

    Source: Thornhill, Huang and Zhang, J. Process Control 13 (2003) 91. 0 with fewer than eight crossings.
    """
    r = autocorrelation(values, lags=len(values) // 2)
    at = np.flatnonzero(np.sign(r[1:]) != np.sign(r[:-1]))[:crossings]
    if len(at) < 8:
        return 0.0
    length = np.diff(at)
    spread = float(np.std(length, ddof=1))
    return float(np.mean(length) / (3.0 * spread)) if spread > 0 else np.inf


def wave(values: FloatArray, period: float, height: float) -> Wave | None:
    """Return the mean half period of a signal that oscillates with `period`; None with fewer than six half periods."""
    flat = detrended(values, period)
    crossing = crossings(flat, period)[0]
    length = np.diff(crossing)
    typical = (length > 0.25 * period) & (length < 0.8 * period)
    if typical.sum() < LEAST_HALF_PERIODS:
        return None
    grid = (np.arange(POINTS) + 0.5) / POINTS
    begin, lasts = crossing[:-1][typical, None], length[typical, None]
    shapes = between(flat, begin + grid * lasts)
    mean = shapes.mean(1, keepdims=True)
    shapes /= np.where(mean == 0.0, 1.0, mean)
    far, near = round(5.0 * period), max(round(period / 8.0), 2)  # the period is not known to the sample
    sustained = height**5
    if far + near < len(values) // 2:
        n, flat = len(values), values - values.mean()
        sustained = max(float(flat[:-k] @ flat[k:]) * n / (n - k) for k in range(far - near, far + near + 1))
        sustained /= float(flat @ flat)
    return Wave(period, height, sustained, np.median(shapes, axis=0), int(typical.sum()))


def between(values: FloatArray, at: FloatArray) -> FloatArray:
    """Values at positions between the samples [samples], on straight lines; those of the ends beyond them."""
    return np.asarray(np.interp(at, np.arange(len(values)), values))


def crossings(flat: FloatArray, period: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Zero crossings [samples] of a detrended signal, smoothed over a sixteenth of the period, and whether it rises."""
    smooth = moving_mean(flat, round(period / 16.0))
    sign = smooth >= 0.0
    at = np.flatnonzero(sign[1:] != sign[:-1])
    return at + smooth[at] / (smooth[at] - smooth[at + 1]), sign[at + 1]


def sine_misfit(shape: FloatArray) -> float:
    """Sum of squares that the best half sine leaves of a half period."""
    grid = (np.arange(len(shape)) + 0.5) / len(shape)
    base = np.sin(np.pi * grid)
    return float(np.sum((shape - base * (shape @ base) / (base @ base)) ** 2))


def square_misfit(shape: FloatArray) -> float:
    """Sum of squares that the best constant leaves of a half period."""
    return float(np.sum((shape - shape.mean()) ** 2))


def triangle_misfit(shape: FloatArray) -> float:
    """Sum of squares that the best triangle, peak anywhere, leaves of a half period (He et al. 2007)."""
    bases, squares = _triangles(len(shape))
    along = (bases @ shape) / squares
    return float(np.sum((shape - bases * along[:, None]) ** 2, axis=1).min())


@cache
def _triangles(points: int) -> tuple[FloatArray, FloatArray]:
    """Triangles with different peaks, (peaks, points), and the sum of squares of each."""
    grid, peaks = (np.arange(points) + 0.5) / points, np.linspace(0.1, 0.9, 33)[:, None]
    bases = np.minimum(grid / peaks, (1.0 - grid) / (1.0 - peaks))
    return bases, np.sum(bases * bases, axis=1)
