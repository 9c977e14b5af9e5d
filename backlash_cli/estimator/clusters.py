"""Where estimates gather: the densest group, its robust centre, spread and interval."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import bdtr

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
    lows = np.searchsorted(values, values * (1 - CLOSE))
    highs = np.searchsorted(values, values * (1 + CLOSE), side="right")
    most = int(np.argmax(highs - lows))
    members = values[lows[most] : highs[most]]
    q1, centre, q3 = np.quantile(members, [0.25, 0.5, 0.75]).tolist()
    return Cluster(centre, median_interval(members), (q3 - q1) / centre, len(members),
                   len(members) / len(values))


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
    # the smallest rank with P(X <= rank) >= (1 - level) / 2, X binomial (n, 1/2)
    rank = int(np.searchsorted(bdtr(np.arange(n // 2 + 1), n, 0.5), (1 - level) / 2))
    low = max(rank - 1, 0)
    return float(values[low]), float(values[n - 1 - low])
