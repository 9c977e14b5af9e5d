"""Load steps that no dead band explains."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from .likelihood import pair, shape_of
from .load_steps import step_information, step_scores
from .whitening import WARM_UP

BESIDE = 2  # rows on either side beyond which a load step must stand out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_load_steps(p: NDArray[Any], x: NDArray[Any], some: NDArray[Any], limit: float, y: NDArray[Any],
                   line: NDArray[Any], first: NDArray[Any], use: NDArray[Any], ridge: float, shock: NDArray[Any],
                   G: NDArray[Any], S: NDArray[Any], T: NDArray[Any], E: NDArray[Any], R: NDArray[Any]) -> bool:
    """Add to `shock` (rows,) the variance of load steps; True where there are any.

    A load step must stand out by `limit` deviations with every one of the valve positions x[i] (rows,), i in `some`,
    and more than its neighbours; its size is the smallest of them. The others as in `likelihood.pair`.
    """
    n = len(y)
    a, _, phi = shape_of(p)
    least, roots, information = np.empty(n), np.empty(n), np.empty(0)
    for k in range(n):
        least[k] = np.inf
    for i in range(0, len(some), 2):
        two = min(2, len(some) - i)
        noise = pair(p, x[some[i]], x[some[i + two - 1]], two == 2, y, line, first, use, ridge, shock, G, S, T, E, R)[1]
        if i == 0:
            information = step_information(G, S, a, phi, first)
            for k in range(n):
                roots[k] = np.sqrt(S[k])
        for c in range(two):
            step_scores(R[c], np.sqrt(noise[c]), roots, G, a, phi, first, least)
    for k in range(n):
        known = k >= WARM_UP - 4 and information[k] > 1e-30
        least[k] = least[k] / information[k] if known else 0.0
    found = False
    for k in range(n):
        if least[k] > limit * limit:
            highest = True
            for other in range(max(k - BESIDE, 0), min(k + BESIDE + 1, n)):
                highest &= least[k] >= least[other]
            if highest:
                shock[k] += least[k] / information[k]
                found = True
    return found
