"""The shape of an oscillation: period, regularity, mean half period, and how well simple shapes fit it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from ..record import FloatArray

POINTS = 64  # of a half period after stretching to common length
LEAST_HALF_PERIODS = 6


@dataclass(frozen=True)
class Wave:
    """One signal's oscillation: height, the autocorrelation one period on; sustained, the same five periods on (1: the
    same for ever, 0: forgotten); half_period, (POINTS,) median shape between zero crossings, mean 1."""

    height: float
    sustained: float
    half_period: FloatArray


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
    after = below[0] + np.flatnonzero(r[below[0] :] > 0.0) if len(below) else below
    if not len(after):
        return 0.0, 0.0
    end = after[0] + np.flatnonzero(r[after[0] :] < 0.0)
    k = int(after[0] + np.argmax(r[after[0] : end[0] if len(end) else len(r)]))
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
    shapes = np.interp(begin + grid * lasts, np.arange(len(flat)), flat)
    mean = shapes.mean(1, keepdims=True)
    shapes /= np.where(mean == 0.0, 1.0, mean)
    far, near = round(5.0 * period), max(round(period / 8.0), 2)  # the period is not known to the sample
    sustained = height**5
    if far + near < len(values) // 2:
        n, flat = len(values), values - values.mean()
        sustained = max(float(flat[:-k] @ flat[k:]) * n / (n - k) for k in range(far - near, far + near + 1))
        sustained /= float(flat @ flat)
    return Wave(height, sustained, np.median(shapes, axis=0))


def crossings(flat: FloatArray, period: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Zero crossings [samples] of a detrended signal, smoothed over a sixteenth of the period, and whether it rises."""
    smooth = moving_mean(flat, round(period / 16.0))
    sign = smooth >= 0.0
    at = np.flatnonzero(sign[1:] != sign[:-1])
    return at + smooth[at] / (smooth[at] - smooth[at + 1]), sign[at + 1]


def misfits(shape: FloatArray) -> list[float]:
    """Sums of squares that the best half sine, the best constant and the best triangle leave of a half period.

    The triangle may have its peak anywhere (He et al. 2007).
    """
    grid, peaks = (np.arange(len(shape)) + 0.5) / len(shape), np.linspace(0.1, 0.9, 33)[:, None]
    left = []
    for bases in (np.sin(np.pi * grid)[None], np.ones((1, len(shape))),
                  np.minimum(grid / peaks, (1.0 - grid) / (1.0 - peaks))):
        along = (bases @ shape) / np.sum(bases * bases, axis=1)
        left.append(float(np.sum((shape - bases * along[:, None]) ** 2, axis=1).min()))
    return left
