"""Load steps found in what the whitening filter leaves over.

Harvey and Koopman, Diagnostic checking of unobserved-components models, JBES 10 (1992) 377-389.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(cache=True, nogil=True, error_model="numpy")
def step_information(G: NDArray[Any], S: NDArray[Any], a: float, phi: float, first: NDArray[Any]) -> NDArray[Any]:
    """How well a load step at each row would be known (rows,): one over its variance, whatever the residuals.

    The information matrix N of the state goes backward through the equations of the model (see `kalman.gains`);
    it changes only where the filter is not settled.
    """
    n = len(S)
    b = 1.0 - a
    g0, g1 = a, a * a
    out = np.zeros(n)
    n00 = n01 = n02 = n03 = n11 = n12 = n13 = n22 = n23 = n33 = 0.0
    steady = 0
    for k in range(n - 1, -1, -1):
        same = k < n - 1 and S[k] == S[k + 1]
        if not (same and steady > 60):
            # N = F' N F: z2 = (1 - a) z2 + a z1 first, then z1, w and s
            n00 += 2.0 * a * n01 + a * a * n11
            n02 += a * n12
            n03 += a * n13
            n01 = b * (n01 + a * n11)
            n11 *= b * b
            n12 *= b
            n13 *= b
            n22 += 2.0 * a * n02 + a * a * n00
            n12 += a * n01
            n23 += a * n03
            n02 = b * (n02 + a * n00)
            n00 *= b * b
            n01 *= b
            n03 *= b
            n33 = phi * phi * (n33 + 2.0 * n23 + n22)
            n03 = phi * (n03 + n02)
            n13 = phi * (n13 + n12)
            n23 = phi * (n23 + n22)
            # N = (I - G h')' N (I - G h') + h h' / S: only what has to do with z2 changes
            v0 = n00 * G[k, 0] + n01 * G[k, 1] + n02 * G[k, 2] + n03 * G[k, 3]
            v1 = n01 * G[k, 0] + n11 * G[k, 1] + n12 * G[k, 2] + n13 * G[k, 3]
            v2 = n02 * G[k, 0] + n12 * G[k, 1] + n22 * G[k, 2] + n23 * G[k, 3]
            v3 = n03 * G[k, 0] + n13 * G[k, 1] + n23 * G[k, 2] + n33 * G[k, 3]
            n11 += G[k, 0] * v0 + G[k, 1] * v1 + G[k, 2] * v2 + G[k, 3] * v3 - 2.0 * v1 + 1.0 / S[k]
            n01 -= v0
            n12 -= v2
            n13 -= v3
            steady = steady + 1 if same else 0
        out[k] = (g0 * g0 * n00 + g1 * g1 * n11 + n22 + 2.0 * (g0 * g1 * n01 + g0 * n02 + g1 * n12))
        if first[k]:
            n00 = n01 = n02 = n03 = n11 = n12 = n13 = n22 = n23 = n33 = 0.0
            steady = 0
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def step_scores(e: NDArray[Any], deviation: float, roots: NDArray[Any], G: NDArray[Any], a: float, phi: float,
                first: NDArray[Any], least: NDArray[Any]) -> None:
    """Bring `least` (rows,) down to the square of the score of a load step at each row, where that is smaller.

    A backward disturbance smoother over innovations e (rows,), which have this `deviation`; roots (rows,): square
    roots of their variances S. The score over the square root of the information (`step_information`) is standard
    normal where the load did not step, over the information it is the most likely step [noise deviations].
    """
    b, share = 1.0 - a, 1.0 / deviation
    r0 = r1 = r2 = r3 = 0.0
    for k in range(len(e) - 1, -1, -1):
        # r = F' r, the equations of the model backward
        r0 += a * r1
        r1 *= b
        r2 += a * r0
        r0 *= b
        r3 = phi * (r3 + r2)
        r1 += share * e[k] / roots[k] - (G[k, 0] * r0 + G[k, 1] * r1 + G[k, 2] * r2 + G[k, 3] * r3)
        score = a * r0 + a * a * r1 + r2
        least[k] = min(least[k], score * score)
        if first[k]:
            r0 = r1 = r2 = r3 = 0.0
