"""Repairs that nobody entered: nights after which the dead band is suddenly and lastingly smaller.

Only drops are looked for: wear makes a dead band grow slowly, and nothing but a repair makes it fall at once. The
statistic compares the medians of the nights before and after a cut, in units of the night-to-night noise; its
threshold keeps false alarms at about 1 in 100 histories (tests/benchmarks/trend_benchmark.py measures it). Nights that
only say "below the limit of detection" count as a drop where nearly all nights after the cut say so: single ones among
sizes are nights that missed it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray

WINDOW = 7  # nights on either side: a week before against a week after
LEAST = 4  # nights needed on either side: two bad nights must not make a repair
SMALLEST_SHARE = 0.25  # a repair takes away at least a quarter of the dead band ...
SMALLEST = 0.005  # ... and at least 0.5 % of the output span
QUIETEST = 0.03  # relative noise of a night is never taken as smaller than this
SURE = 4.0  # standard errors that a drop must have; from the benchmark
SILENT = 0.8  # share of nights below detection that makes silence


def drops(d: FloatArray, bound: NDArray[np.bool_] | None = None) -> list[int]:
    """Return the positions k where d (nights,), in time order, drops between night k-1 and night k.

    bound: (nights,) True where d is only an upper bound. The strongest drop is taken first, then the nights on both
    sides are searched again.
    """
    bounds = np.zeros(len(d), bool) if bound is None else bound
    return sorted(_search(np.log(np.maximum(d, 1e-6)), bounds, 0, len(d)))


def _search(y: FloatArray, bound: NDArray[np.bool_], first: int, last: int) -> list[int]:
    n = last - first
    part, silent = y[first:last], bound[first:last]
    sizes = part[~silent]
    if n < 2 * LEAST or len(sizes) < LEAST:
        return []
    noise = max(float(np.median(np.abs(np.diff(sizes)))) / 0.6745 / np.sqrt(2.0), QUIETEST)
    cuts = np.arange(LEAST, n - LEAST + 1)
    wear = _wear(np.exp(sizes))
    score = np.array([drop_score(part, silent, int(k), noise, wear) for k in cuts])
    if score.max() <= SURE:
        return []
    best = _place(part, silent, int(cuts[np.argmax(score)]))
    return [first + best, *_search(y, bound, first, first + best), *_search(y, bound, first + best, last)]


def _wear(d: FloatArray) -> float:
    """Return the growth per night, from nights a window apart; a single drop touches few of these pairs."""
    return max(float(np.median(d[WINDOW:] - d[:-WINDOW])) / WINDOW, 0.0) if len(d) > WINDOW else 0.0


def drop_score(y: FloatArray, bound: NDArray[np.bool_], k: int, noise: float, wear: float = 0.0) -> float:
    """Return the drop of the median at position k in standard errors, 0 where it is too small to be a repair.

    y: (nights,) logarithm of the dead band. wear: growth per night, that the median after the cut would show without a
    repair. The variance of a median of m normal values is about pi/2 / m.
    """
    before = y[:k][~bound[:k]][-WINDOW:]
    after = _after(y[k:], bound[k:])
    if len(before) < LEAST or len(after) < LEAST:
        return 0.0
    high, low = float(np.median(before)), float(np.median(after))
    if np.exp(high) - np.exp(low) < SMALLEST or np.exp(low - high) > 1.0 - SMALLEST_SHARE:
        return 0.0
    expected = np.log(np.exp(high) + 0.5 * wear * (len(before) + len(after)))
    return float((expected - low) / (noise * np.sqrt(0.5 * np.pi * (1.0 / len(before) + 1.0 / len(after)))))


def _after(y: FloatArray, bound: NDArray[np.bool_]) -> FloatArray:
    """Return the values that stand for the nights after a cut: sizes, or bounds where nearly all nights are silent."""
    if bound[:WINDOW].mean() >= SILENT:
        return y[:WINDOW][bound[:WINDOW]]
    return y[~bound][:WINDOW]


def _place(y: FloatArray, bound: NDArray[np.bool_], k: int) -> int:
    """Return the cut near k with the sharpest step: the largest difference of the medians of a few nights on either
    side, less their scatter, so that the cut falls between the nights and not among them."""
    near = range(max(k - WINDOW, 1), min(k + WINDOW, len(y) - 1) + 1)

    def sharpness(cut: int) -> float:
        before, after = y[:cut][~bound[:cut]][-LEAST:], _after(y[cut:], bound[cut:])[:LEAST]
        if not len(before) or not len(after):
            return -np.inf
        high, low = np.median(before), np.median(after)
        return float(high - low - np.abs(before - high).mean() - np.abs(after - low).mean())

    return max(near, key=lambda cut: (sharpness(cut), -abs(cut - k)))
