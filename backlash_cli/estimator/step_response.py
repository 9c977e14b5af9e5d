"""Regression on a step response that may start the wrong way only a little, as a process can and a controller cannot.

In closed loop OP is a noise-free function of past PV. Without this bound a regression finds the inverse of the
controller instead of the process.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

DIP = 0.15  # an inverse response may reach this share of the final value


@numba.njit(cache=True, nogil=True, error_model="numpy")
def solve_free(A: NDArray[Any], c: NDArray[Any], free: NDArray[Any], z: NDArray[Any], work: NDArray[Any]) -> None:
    """Solve A z = c for the free entries, z = 0 elsewhere; work: (n, n + 1). Elimination of a positive matrix."""
    n = len(c)
    for i in range(n):
        for j in range(n):
            work[i, j] = A[i, j] if free[i] and free[j] else (1.0 if i == j else 0.0)
        work[i, n] = c[i] if free[i] else 0.0
    for i in range(n):
        for k in range(i + 1, n):
            if work[k, i] != 0.0:
                f = work[k, i] / work[i, i]
                for j in range(i, n + 1):
                    work[k, j] -= f * work[i, j]
    for i in range(n - 1, -1, -1):
        v = work[i, n]
        for j in range(i + 1, n):
            v -= work[i, j] * z[j]
        z[i] = v / work[i, i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _most_wanted(A: NDArray[Any], c: NDArray[Any], x: NDArray[Any], free: NDArray[Any], tiny: float) -> int:
    """Which of the entries that are not free would lower x'Ax/2 - c'x most if it grew; -1 for none."""
    best, most = -1, tiny
    for i in range(len(c)):
        w = c[i]
        for j in range(len(c)):
            w -= A[i, j] * x[j]
        w /= np.sqrt(A[i, i])
        if free[i] == 0.0 and w > most:
            best, most = i, w
    return best


@numba.njit(cache=True, nogil=True, error_model="numpy")
def nonnegative(A: NDArray[Any], c: NDArray[Any], x: NDArray[Any]) -> None:
    """Minimise x'Ax/2 - c'x over x >= 0 into x (Lawson and Hanson 1974, chapter 23, active set).

    First all entries are free, and those that come out below 0 are left out; mostly that is the solution already.
    A plain elimination instead of a library call: six unknowns, and a tenth of the time to compile.
    """
    n = len(c)
    free = np.ones(n)
    z = np.zeros(n)
    work = np.zeros((n, n + 1))
    tiny = 1e-300
    for i in range(n):
        tiny = max(tiny, 1e-9 * abs(c[i]))
    for _ in range(n):
        solve_free(A, c, free, x, work)
        below = False
        for i in range(n):
            if free[i] > 0.0 and x[i] < 0.0:
                free[i], below = 0.0, True
        if not below:
            if _most_wanted(A, c, x, free, tiny) < 0:
                return
            break
    free[:] = 0.0
    x[:] = 0.0
    for _ in range(3 * n):
        best = _most_wanted(A, c, x, free, tiny)
        if best < 0:
            break
        free[best] = 1.0
        for _ in range(n):
            solve_free(A, c, free, z, work)
            step, stop = 1.0, -1
            for i in range(n):
                if free[i] > 0.0 and z[i] <= 0.0:
                    t = x[i] / (x[i] - z[i] + 1e-300)
                    if t < step:
                        step, stop = t, i
            for i in range(n):
                if free[i] > 0.0:
                    x[i] += step * (z[i] - x[i])
            if stop < 0:
                break
            for i in range(n):
                if free[i] > 0.0 and (i == stop or x[i] <= 1e-14):
                    free[i] = 0.0
                    x[i] = 0.0


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
