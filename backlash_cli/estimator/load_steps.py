"""Load steps found in what the whitening filter leaves over.

Harvey and Koopman, Diagnostic checking of unobserved-components models, JBES 10 (1992) 377-389.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from .whitening import transition


@numba.njit(cache=True)
def load_steps(e: NDArray[Any], G: NDArray[Any], S: NDArray[Any], a: float, phi: float, first: NDArray[Any]) -> Any:
    """Statistic and size of a load step at each row, from innovations e (rows,) in units of their deviation.

    A backward disturbance smoother: t (rows,) is standard normal where the load did not step, size (rows,) is the
    most likely step in units of the noise deviation.
    """
    n = len(e)
    F = transition(a, phi)
    g = np.zeros(4)
    g[0], g[1], g[2] = a, a * a, 1.0
    r = np.zeros(4)
    back = np.zeros(4)
    N = np.zeros((4, 4))
    L = np.zeros((4, 4))
    T = np.zeros((4, 4))
    t = np.zeros(n)
    size = np.zeros(n)
    steady = 0
    for k in range(n - 1, -1, -1):
        for i in range(4):
            v = 0.0
            for j in range(4):
                v += F[j, i] * r[j]
            back[i] = v
        along = 0.0
        for j in range(4):
            along += G[k, j] * back[j]
            r[j] = back[j]
        r[1] += e[k] / np.sqrt(S[k]) - along
        same = k < n - 1 and S[k] == S[k + 1]
        if not (same and steady > 60):
            for i in range(4):
                v = 0.0
                for j in range(4):
                    L[i, j] = F[i, j]
                    v += F[i, j] * G[k, j]
                L[i, 1] -= v
            for i in range(4):
                for j in range(4):
                    v = 0.0
                    for m in range(4):
                        v += N[i, m] * L[m, j]
                    T[i, j] = v
            for i in range(4):
                for j in range(4):
                    v = 0.0
                    for m in range(4):
                        v += L[m, i] * T[m, j]
                    N[i, j] = v
            N[1, 1] += 1.0 / S[k]
            steady = steady + 1 if same else 0
        v = w = 0.0
        for i in range(4):
            v += g[i] * r[i]
            for j in range(4):
                w += g[i] * N[i, j] * g[j]
        if w > 1e-30:
            t[k] = v / np.sqrt(w)
            size[k] = v / w
        if first[k]:
            for i in range(4):
                r[i] = 0.0
                for j in range(4):
                    N[i, j] = 0.0
            steady = 0
    return t, size
