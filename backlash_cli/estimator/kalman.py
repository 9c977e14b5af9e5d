"""Gains and variances of the Kalman filter that whitens the rows of the dead-band test; the model is in `whitening`.

All in double precision. The covariance settles after some rows and stays so until the next load step.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from .lanes import fma

DIFFUSE = 1e6  # variance of the unknown state where a stretch begins
WEIGHTS = 5  # of a row: what its innovation adds to the prediction of the next state (four), 1 / deviation
TOGETHER = 128  # rows that are looked over at a time


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _go_on(begin: int, end: int, S: NDArray[Any], W: NDArray[Any], use: NDArray[Any], scale: Any) -> None:
    """Give the rows from begin to end what the row before has; rows that are not in `use` get no weight."""
    for i in range(WEIGHTS - 1):
        w, weights = W[i, begin - 1], W[i, begin:end]
        for k in range(len(weights)):
            weights[k] = w
    s, variances, scales, used = S[begin - 1], S[begin:end], W[WEIGHTS - 1, begin:end], use[begin:end]
    for k in range(len(variances)):
        variances[k] = s
        scales[k] = scale if used[k] else np.float32(0.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _quiet_until(k: int, shock: NDArray[Any], first: NDArray[Any]) -> int:
    """Return the next row from k on with a load step or the start of a stretch; many are looked at together."""
    n = len(shock)
    while k + TOGETHER <= n:
        loud = False
        shocks, starts = shock[k : k + TOGETHER], first[k : k + TOGETHER]
        for i in range(TOGETHER):
            loud |= (shocks[i] != 0.0) | starts[i]
        if loud:
            break
        k += TOGETHER
    while k < n and shock[k] == 0.0 and not first[k]:
        k += 1
    return k


@numba.njit(cache=True, nogil=True, error_model="numpy")
def gains(a: float, ratio: float, phi: float, shock: NDArray[Any], first: NDArray[Any], use: NDArray[Any],
          G: NDArray[Any], S: NDArray[Any], W: NDArray[Any]) -> Any:
    """Write Kalman gains G (rows, 4; or no rows where they are not wanted) and variances S (rows,) of the innovations.

    `first` (rows,) marks the start of stretches. The covariance (ten numbers, it is symmetric) goes through one
    equation of the model after the other.

    Also writes the weights W (WEIGHTS, rows) that `innovations` needs, the last of them 0 for rows not in `use`, and
    returns the number of rows in use and the sum of ln S over them.
    """
    b = 1.0 - a
    aa, bb, ab, g0, g1 = a * a, b * b, 2.0 * a * b, a, a * a
    p00 = p01 = p02 = p03 = p11 = p12 = p13 = p22 = p23 = p33 = 0.0
    logs, product, rows = 0.0, 1.0, 0
    scale, before = np.float32(0.0), 0.0
    n = len(shock)
    settled = 0
    k: Any = np.int64(0)  # a plain 0 would be compiled for itself
    while k < n:
        if settled >= 3:
            end = _quiet_until(k, shock, first)
            _go_on(k, end, S, W, use, scale)
            if len(G):
                for row in range(k, end):
                    for i in range(4):
                        G[row, i] = G[k - 1, i]
            used: Any = np.count_nonzero(use[k:end])
            rows += used
            logs += used * np.log(S[k - 1])
            settled, k = 0, end
            continue
        if first[k]:
            p00 = p11 = p22 = 1.01 * DIFFUSE
            p01 = p02 = p12 = DIFFUSE
            p03 = p13 = p23 = p33 = 0.0
            settled = 0
        # s = phi s
        p03 *= phi
        p13 *= phi
        p23 *= phi
        p33 *= phi * phi
        # w = w + s
        p22 += fma(2.0, p23, p33)
        p02 += p03
        p12 += p13
        p23 += p33
        # z1 = (1 - a) z1 + a w
        p00 = fma(bb, p00, fma(ab, p02, aa * p22))
        p01 = fma(b, p01, a * p12)
        p02 = fma(b, p02, a * p22)
        p03 = fma(b, p03, a * p23)
        # z2 = (1 - a) z2 + a z1
        p11 = fma(bb, p11, fma(ab, p01, aa * p00))
        p01 = fma(b, p01, a * p00)
        p12 = fma(b, p12, a * p02)
        p13 = fma(b, p13, a * p03)
        # the increment of the load reaches all four, a load step the first three
        step = ratio + shock[k]
        p00 += step * g0 * g0
        p01 += step * g0 * g1
        p02 += step * g0
        p03 += ratio * g0
        p11 += step * g1 * g1
        p12 += step * g1
        p13 += ratio * g1
        p22 += step
        p23 += ratio
        p33 += ratio
        s = p11 + 1.0
        inverse = 1.0 / s
        h0, h1, h2, h3 = p01 * inverse, p11 * inverse, p12 * inverse, p13 * inverse
        p00 = fma(-p01, h0, p00)
        p02 = fma(-p01, h2, p02)
        p03 = fma(-p01, h3, p03)
        p22 = fma(-p12, h2, p22)
        p23 = fma(-p12, h3, p23)
        p33 = fma(-p13, h3, p33)
        p01, p11, p12, p13 = h0, h1, h2, h3
        still = k > 0 and shock[k] == 0.0 and abs(s - S[k - 1]) < 1e-4 * s
        settled = settled + 1 if still and abs(h2 - before) < 1e-4 * abs(h2) + 1e-12 else 0
        S[k], before = s, h2
        if len(G):
            G[k, 0], G[k, 1], G[k, 2], G[k, 3] = h0, h1, h2, h3
        # gains of the prediction, so that nothing but one sum lies between one innovation and the next
        k3 = phi * h3
        k2 = h2 + k3
        k0 = b * h0 + a * k2
        W[0, k], W[1, k], W[2, k], W[3, k] = k0, b * h1 + a * k0, k2 + phi * k3, k3
        scale = np.float32(np.sqrt(inverse))
        W[4, k] = scale if use[k] else np.float32(0.0)
        if use[k]:
            rows += 1
            product *= s
            if product > 1e200:
                logs += np.log(product)
                product = 1.0
        k += 1
    return rows, logs + np.log(product)
