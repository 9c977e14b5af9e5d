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


@numba.njit(cache=True)
def stick_slip(u: NDArray[Any], S: float, J: float, start: float, restick: bool) -> NDArray[Any]:
    """Stem position behind stick band S and slip jump J, started at rest at position `start`.

    u: (samples,) controller output; returns (samples,). The same as `effects.stiction.step`, with its state in
    registers. Source: Kano et al. (2004); with `restick` He et al. (2007).
    """
    out = np.empty_like(u)
    hold = 0.5 * (S + J)
    behind = 0.5 * (S - J)
    stem = start
    sliding = 0.0
    last = u[0]
    for k in range(len(u)):
        v = u[k]
        if restick or (v - last) * sliding <= 0.0:
            sliding = 0.0
        if sliding == 0.0:
            if v - stem > hold:
                sliding = 1.0
            elif stem - v > hold:
                sliding = -1.0
        if sliding != 0.0:
            stem = v - behind * sliding
        last = v
        out[k] = stem
    return out
