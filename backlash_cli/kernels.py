"""Loops over samples that NumPy cannot vectorise, compiled by numba on first use (imported lazily, cached on disk)."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(cache=True)
def play(u: NDArray[Any], d: float, start: float) -> NDArray[Any]:
    """Valve position behind a dead band d, started at position `start`: stays while u moves inside the band.

    u: (samples,) controller output; returns (samples,). At d = 0 the output is u bit for bit.
    Source: Haegglund (2007), Fig. 2; the play operator of Krasnosel'skii and Pokrovskii (1989).
    """
    out = np.empty_like(u)
    x = start
    half = 0.5 * d
    for k in range(len(u)):
        v = u[k]
        if d == 0.0:
            x = v
        elif v - half > x:
            x = v - half
        elif v + half < x:
            x = v + half
        out[k] = x
    return out
