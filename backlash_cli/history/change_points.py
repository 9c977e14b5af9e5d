"""Repairs that nobody entered: nights after which the dead band is suddenly and lastingly smaller.

Only drops are looked for: wear makes a dead band grow slowly, and nothing but a repair makes it fall at once. The
statistic compares the medians of the nights before and after a cut, in units of the night-to-night noise; its
threshold keeps false alarms at about 1 in 100 histories (tests/benchmarks/trend_benchmark.py measures it).
"""

from __future__ import annotations

import numpy as np

from ..record import FloatArray

WINDOW = 7  # nights on either side: a week before against a week after
LEAST = 4  # nights needed on either side: two bad nights must not make a repair
SMALLEST_SHARE = 0.25  # a repair takes away at least a quarter of the dead band ...
SMALLEST = 0.005  # ... and at least 0.5 % of the output span
QUIETEST = 0.03  # relative noise of a night is never taken as smaller than this
SURE = 4.0  # standard errors that a drop must have; from the benchmark


def drops(d: FloatArray) -> list[int]:
    """Return the positions k where d (nights,), in time order, drops between night k-1 and night k.

    The strongest drop is taken first, then the nights on both sides are searched again.
    """
    return sorted(_search(np.log(np.maximum(d, 1e-6)), 0, len(d)))


def _search(y: FloatArray, first: int, last: int) -> list[int]:
    n = last - first
    if n < 2 * LEAST:
        return []
    part = y[first:last]
    noise = max(float(np.median(np.abs(np.diff(part)))) / 0.6745 / np.sqrt(2.0), QUIETEST)
    cuts = np.arange(LEAST, n - LEAST + 1)
    score = np.array([drop_score(part, int(k), noise) for k in cuts])
    if score.max() <= SURE:
        return []
    best = _place(part, int(cuts[np.argmax(score)]))
    return [first + best, *_search(y, first, first + best), *_search(y, first + best, last)]


def drop_score(y: FloatArray, k: int, noise: float) -> float:
    """Return the drop of the median at position k in standard errors, 0 where it is too small to be a repair.

    y: (nights,) logarithm of the dead band. The variance of a median of m normal values is about pi/2 / m.
    """
    before, after = y[max(0, k - WINDOW) : k], y[k : k + WINDOW]
    high, low = float(np.median(before)), float(np.median(after))
    if np.exp(high) - np.exp(low) < SMALLEST or np.exp(low - high) > 1.0 - SMALLEST_SHARE:
        return 0.0
    return (high - low) / (noise * np.sqrt(0.5 * np.pi * (1.0 / len(before) + 1.0 / len(after))))


def _place(y: FloatArray, k: int) -> int:
    """Return the cut near k that leaves the least scatter about the medians of both sides."""
    first, last = max(0, k - WINDOW), min(len(y), k + WINDOW)
    near = range(max(first + 1, k - LEAST), min(last, k + LEAST + 1))

    def scatter(cut: int) -> float:
        before, after = y[first:cut], y[cut:last]
        return float(np.abs(before - np.median(before)).sum() + np.abs(after - np.median(after)).sum())

    return min(near, key=lambda cut: (scatter(cut), abs(cut - k)))
