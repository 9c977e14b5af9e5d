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
    low, high, q1, centre, q3 = _fullest(values)
    members = values[low:high]
    return Cluster(centre, median_interval(members), (q3 - q1) / centre, len(members),
                   len(members) / len(values))


@numba.njit(cache=True, nogil=True)
def _quantile(ordered: FloatArray, q: float) -> float:
    """Quantile of values in order, straight between neighbours, as numpy gives it."""
    at = q * (len(ordered) - 1)
    low = int(at)
    return float(ordered[low] + (at - low) * (ordered[min(low + 1, len(ordered) - 1)] - ordered[low]))


@numba.njit(cache=True, nogil=True)
def _fullest(values: FloatArray) -> tuple[int, int, float, float, float]:
    """First and one after the last of the values, in order, that lie close to the one with the most neighbours; and
    the three quartiles of these."""
    low = high = first = last = 0
    for value in values:
        while values[low] < value * (1 - CLOSE):
            low += 1
        while high < len(values) and values[high] <= value * (1 + CLOSE):
            high += 1
        if high - low > last - first:
            first, last = low, high
    members = values[first:last]
    return first, last, _quantile(members, 0.25), _quantile(members, 0.5), _quantile(members, 0.75)


def gathered(d: FloatArray, first: Cluster | None = None) -> tuple[Cluster, ...]:
    """Return all groups of at least SEVERAL estimates and a quarter of them each, the largest first.

    Each is the densest of what the groups before it left. Neighbours whose intervals touch are one group. first: the
    densest of all, where that is known already.
    """
    found: list[Cluster] = []
    left = d[d > 0]
    total = len(left)
    while len(left) >= SEVERAL:
        group = first if first is not None and not found else densest(left)
        if group is None or group.n < max(SEVERAL, A_QUARTER * total):
            break
        if all(group.ci95[0] > c.ci95[1] or group.ci95[1] < c.ci95[0] for c in found):
            found.append(replace(group, share=group.n / total))
        left = left[np.abs(left / group.d - 1.0) > CLOSE]
    return tuple(found)


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
