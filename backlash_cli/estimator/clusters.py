"""Where estimates gather: the densest group, its robust centre, spread and interval."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from statistics import NormalDist

import numba
import numpy as np

from ..record import FloatArray
from ..results import Cluster

CLOSE = 0.35  # estimates within +-35 % of the centre belong together
SEVERAL = 4  # fewest estimates of a group beside another
A_QUARTER = 0.25


def densest(d: FloatArray) -> Cluster | None:
    """Return the largest group of similar positive estimates d (estimates,), None when there are none.

    Similar means within +-35 % of the group's median. The interval is that of the median from order statistics
    (binomial, distribution free), widened to the extremes for small groups.
    """
    values = np.sort(d[d > 0])
    if not len(values):
        return None
    low, high = _fullest(values)
    members = values[low:high]
    q1, centre, q3 = (_quantile(members, q) for q in (0.25, 0.5, 0.75))
    return Cluster(centre, median_interval(members), (q3 - q1) / centre, len(members),
                   len(members) / len(values))


@numba.njit(cache=True, nogil=True)
def _fullest(values: FloatArray) -> tuple[int, int]:
    """First and one after the last of the values, in order, that lie close to the one with the most neighbours."""
    low = high = first = last = 0
    for value in values:
        while values[low] < value * (1 - CLOSE):
            low += 1
        while high < len(values) and values[high] <= value * (1 + CLOSE):
            high += 1
        if high - low > last - first:
            first, last = low, high
    return first, last


def gathered(d: FloatArray) -> tuple[Cluster, ...]:
    """Return all groups of at least SEVERAL estimates and a quarter of them each, the largest first.

    Each is the densest of what the groups before it left. Neighbours whose intervals touch are one group.
    """
    found: list[Cluster] = []
    left = np.sort(d[d > 0])
    total = len(left)
    while len(left) >= SEVERAL:
        group = densest(left)
        if group is None or group.n < max(SEVERAL, A_QUARTER * total):
            break
        if all(group.ci95[0] > c.ci95[1] or group.ci95[1] < c.ci95[0] for c in found):
            found.append(replace(group, share=group.n / total))
        left = left[np.abs(left / group.d - 1.0) > CLOSE]
    return tuple(found)


def _quantile(ordered: FloatArray, q: float) -> float:
    """Quantile of values in order, straight between neighbours: what numpy gives, in a tenth of the time."""
    at = q * (len(ordered) - 1)
    low = int(at)
    return float(ordered[low] + (at - low) * (ordered[min(low + 1, len(ordered) - 1)] - ordered[low]))


def median_interval(values: FloatArray, level: float = 0.95) -> tuple[float, float]:
    """Return the distribution-free interval of the median of sorted `values` (David and Nagaraja, section 7.1)."""
    n = len(values)
    rank = _binomial_quantile(n, (1 - level) / 2)
    low = max(rank - 1, 0)
    return float(values[low]), float(values[n - 1 - low])


@lru_cache
def _binomial_quantile(n: int, probability: float) -> int:
    """Return the smallest k with P(X <= k) >= probability, X binomial (n, 1/2); normal beyond n = 1000."""
    if n > 1000:
        return max(math.ceil(n / 2 + NormalDist().inv_cdf(probability) * math.sqrt(n) / 2 - 0.5), 0)
    below, term = 0, 1  # in units of 2^-n, exact
    for k in range(n + 1):
        below += term
        if below >= probability * 2**n:
            return k
        term = term * (n - k) // (k + 1)
    return n
