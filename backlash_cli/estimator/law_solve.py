"""The weighted least squares of the control law on window sums, compiled by numba: a fit of three numbers must not cost
more than the sums it rests on."""

from __future__ import annotations

import numba
import numpy as np

from ..record import FloatArray, IntArray

ILL_CONDITIONED = 1e9  # ratio of the largest to the smallest eigenvalue from which the terms cannot be told apart
TURNS = 4  # of reweighting
FEWEST_WINDOWS = 6  # of which some may lose their weight


@numba.njit(cache=True, nogil=True)
def condition(matrix: FloatArray) -> float:
    """Ratio of the largest to the smallest size of the eigenvalues of a small symmetric matrix (Jacobi rotations)."""
    n = len(matrix)
    a = np.empty((n, n))
    for p in range(n):
        for q in range(n):
            a[p, q] = matrix[p, q]
    for _ in range(30):
        rest = 0.0
        for p in range(n):
            for q in range(p):
                rest = max(rest, abs(a[p, q]))
                if a[p, q] == 0.0:
                    continue
                angle = 0.5 * np.arctan2(2.0 * a[p, q], a[q, q] - a[p, p])
                c, s = np.cos(angle), np.sin(angle)
                for k in range(n):
                    x, y = a[k, p], a[k, q]
                    a[k, p], a[k, q] = c * x - s * y, s * x + c * y
                for k in range(n):
                    x, y = a[p, k], a[q, k]
                    a[p, k], a[q, k] = c * x - s * y, s * x + c * y
        if rest <= 1e-15 * n:
            break
    low, high = np.inf, 0.0
    for k in range(n):
        low, high = min(low, abs(a[k, k])), max(high, abs(a[k, k]))
    return high / low if low > 0.0 else np.inf


@numba.njit(cache=True, nogil=True)
def solve(a: FloatArray, x: FloatArray) -> None:
    """Solve a few linear equations by elimination with row exchange; x holds the right side, then the solution (nan
    where there is none), and the matrix a is used up."""
    n = len(x)
    for p in range(n):
        best = p
        for k in range(p + 1, n):
            best = k if abs(a[k, p]) > abs(a[best, p]) else best
        if a[best, p] == 0.0:
            for k in range(n):
                x[k] = np.nan
            return
        for j in range(n):
            a[p, j], a[best, j] = a[best, j], a[p, j]
        x[p], x[best] = x[best], x[p]
        for k in range(p + 1, n):
            share = a[k, p] / a[p, p]
            for j in range(p, n):
                a[k, j] -= share * a[p, j]
            x[k] -= share * x[p]
    for p in range(n - 1, -1, -1):
        for j in range(p + 1, n):
            x[p] -= a[p, j] * x[j]
        x[p] /= a[p, p]


@numba.njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _weighed(weights: FloatArray, values: FloatArray) -> float:
    found = 0.0
    for w in range(len(weights)):
        found += weights[w] * values[w]
    return found


@numba.njit(cache=True, nogil=True)
def _normal(columns: FloatArray, weights: FloatArray, gram: FloatArray, right: FloatArray) -> float:
    """Write the weighted sums of `columns`: products of the terms with each other and with the output; return that of
    the output with itself."""
    n, c = len(right), 1
    for i in range(n):
        right[i] = _weighed(weights, columns[c])
        c += 1
        for j in range(i + 1):
            gram[i, j] = gram[j, i] = _weighed(weights, columns[c])
            c += 1
    return _weighed(weights, columns[0])


@numba.njit(cache=True, nogil=True)
def _add(left: FloatArray, factor: float, column: FloatArray) -> None:
    for w in range(len(left)):
        left[w] += factor * column[w]


@numba.njit(cache=True, nogil=True)
def _left(columns: FloatArray, values: FloatArray, left: FloatArray) -> None:
    """Write what is left in each window: the output's square less what the terms make of it."""
    for w in range(len(left)):
        left[w] = columns[0, w]
    c = 1
    for i in range(len(values)):
        _add(left, -2.0 * values[i], columns[c])
        c += 1
        for j in range(i + 1):
            _add(left, (1.0 if i == j else 2.0) * values[i] * values[j], columns[c])
            c += 1
    for w in range(len(left)):
        left[w] = max(left[w], 1e-12 * columns[0, w])


@numba.njit(cache=True, nogil=True)
def weighted_fit(sums: FloatArray, terms: IntArray) -> tuple[bool, FloatArray, FloatArray, FloatArray, float]:
    """Fit the output by some terms, each window with a weight of its own.

    sums: (windows, 5, 5) of products, output first. Returns whether the terms can be told apart, their coefficients,
    what is left in each window, its weight, and the share of the output that is left. A window in which something else
    moved the output leaves much more than the others and loses its weight (Cauchy weights on the window residuals).
    """
    windows, n = len(sums), len(terms)
    columns = np.empty((1 + n + n * (n + 1) // 2, windows))  # the sums that matter, of all windows in a row
    for w in range(windows):
        columns[0, w], c = sums[w, 0, 0], 1
        for i in range(n):
            columns[c, w] = sums[w, terms[i], 0]
            c += 1
            for j in range(i + 1):
                columns[c, w] = sums[w, terms[i], terms[j]]
                c += 1
    scale, gram, right = np.ones(n), np.zeros((n, n)), np.zeros(n)
    weights, left, values = np.ones(windows), np.zeros(windows), np.zeros(n)
    for turn in range(TURNS):
        _normal(columns, weights, gram, right)
        if turn == 0:
            for i in range(n):
                scale[i] = np.sqrt(max(gram[i, i], 1e-300))
        for i in range(n):
            right[i] /= scale[i]
            for j in range(n):
                gram[i, j] /= scale[i] * scale[j]
        if turn == 0 and not condition(gram) <= ILL_CONDITIONED:
            return False, values, left, weights, 1.0
        solve(gram, right)
        for i in range(n):
            values[i] = right[i] / scale[i]
        _left(columns, values, left)
        if windows < FEWEST_WINDOWS:
            break
        ordered = np.sort(left)
        middle = 0.5 * (ordered[(windows - 1) // 2] + ordered[windows // 2])
        for w in range(windows):
            weights[w] = 2.0 / (1.0 + left[w] / middle)
    return True, values, left, weights, _weighed(weights, left) / _weighed(weights, columns[0])


@numba.njit(cache=True, nogil=True)
def standard_errors(left: FloatArray, other: FloatArray) -> float:
    """By how many standard errors the first leaves less than the other, window by window, in logarithms."""
    n = len(left)
    mean = square = 0.0
    for w in range(n):
        mean += np.log(other[w] / left[w]) / n
    for w in range(n):
        square += (np.log(other[w] / left[w]) - mean) ** 2 / n
    error = np.sqrt(square) / np.sqrt(max(n - 1, 1))
    if error > 0.0:
        return mean / error
    return np.inf * mean if mean != 0.0 else 0.0
