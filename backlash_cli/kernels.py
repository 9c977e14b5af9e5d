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


@numba.njit(cache=True)
def gap_means(u: NDArray[Any], widths: NDArray[Any], size: int, count: int) -> NDArray[Any]:
    """Means over `count` blocks of `size` samples of what the stem lags behind OP, for each dead band in `widths`.

    u: (samples,) controller output; widths: (widths,) dead bands in its units; returns (widths, blocks) of
    play(u) - u. The stem begins in the middle of its gap.
    """
    out = np.empty((len(widths), count))
    for j in range(len(widths)):
        half, x = 0.5 * widths[j], u[0]
        for b in range(count):
            total = 0.0
            for i in range(b * size, (b + 1) * size):
                v = u[i]
                if x < v - half:
                    x = v - half
                elif x > v + half:
                    x = v + half
                total += x - v
            out[j, b] = total / size
    return out


@numba.njit(cache=True)
def forgetting_gap_means(u: NDArray[Any], widths: NDArray[Any], rates: NDArray[Any], size: int,
                         count: int) -> NDArray[Any]:
    """The same for gaps that forget: -clip(u - slow mean of u, half a width), `rates` (widths,) per sample.

    Like a dead band in shape, but it depends on how fast OP moves, which no gap does: what explains PV as well as
    this one does is no valve.
    """
    out = np.empty((len(widths), count))
    for j in range(len(widths)):
        half, mean = 0.5 * widths[j], u[0]
        for b in range(count):
            total = 0.0
            for i in range(b * size, (b + 1) * size):
                mean += rates[j] * (u[i] - mean)
                total -= min(max(u[i] - mean, -half), half)
            out[j, b] = total / size
    return out


@numba.njit(cache=True)
def gap_crossings(u: NDArray[Any], width: float) -> int:
    """How often the stem behind a dead band of `width` began to move the other way: OP crossed the whole gap."""
    half, x, way, crossings = 0.5 * width, u[0], 0, 0
    for i in range(len(u)):
        v = u[i]
        now = 0
        if x < v - half:
            x, now = v - half, 1
        elif x > v + half:
            x, now = v + half, -1
        if now != 0:
            crossings += 1 if way == -now else 0
            way = now
    return crossings
