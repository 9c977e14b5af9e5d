"""Regression on a step response that may start the wrong way only a little: what a process can be, and a controller not.

In closed loop OP is a noise-free function of past PV. Without this bound a regression finds the inverse of the
controller instead of the process.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

DIP = 0.15  # an inverse response may reach this share of the final value


@numba.njit(cache=True)
def nonnegative(A: NDArray[Any], c: NDArray[Any]) -> NDArray[Any]:
    """Minimise v'Av/2 - c'v over v >= 0 (Lawson and Hanson 1974, active set)."""
    n = len(c)
    x = np.zeros(n)
    free = np.zeros(n, np.bool_)
    for _ in range(3 * n):
        w = c - A @ x
        best, most = -1, 1e-9 * np.max(np.abs(c)) + 1e-300
        for i in range(n):
            if not free[i] and w[i] / np.sqrt(A[i, i]) > most:
                best, most = i, w[i] / np.sqrt(A[i, i])
        if best < 0:
            break
        free[best] = True
        while True:
            idx = np.flatnonzero(free)
            m = len(idx)
            B = np.empty((m, m))
            r = np.empty(m)
            for i in range(m):
                r[i] = c[idx[i]]
                for j in range(m):
                    B[i, j] = A[idx[i], idx[j]]
            z = np.linalg.solve(B, r)
            step, stop = 1.0, -1
            for i in range(m):
                if z[i] <= 0.0:
                    t = x[idx[i]] / (x[idx[i]] - z[i] + 1e-300)
                    if t < step:
                        step, stop = t, i
            for i in range(m):
                x[idx[i]] += step * (z[i] - x[idx[i]])
            if stop < 0:
                break
            x[idx[stop]] = 0.0
            for i in range(m):
                if x[idx[i]] <= 1e-14:
                    free[idx[i]] = False
                    x[idx[i]] = 0.0
            if step == 0.0 and idx[stop] == best:
                break
    return x


@numba.njit(cache=True)
def response_base(n: int) -> NDArray[Any]:
    """Matrix M, b = M v: v >= 0 keeps every step response sum(b_0..b_i) above -DIP times its final value."""
    M = np.zeros((n, n))
    for i in range(n):
        if i < n - 1:
            M[i, i] += 1.0
            M[i, n - 1] -= DIP
        else:
            M[i, n - 1] += 1.0
        if i > 0:
            M[i, i - 1] -= 1.0
            M[i, n - 1] += DIP
    return M
