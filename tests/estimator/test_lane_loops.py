"""Loops written for vector registers against plain NumPy in double precision, and what lies beside their arrays."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.estimator import vector_code
from backlash_cli.estimator.lane_loops import HIGHEST_TERM, columns_of, grow, sums_of_products, whiten_rows
from backlash_cli.estimator.vector_code import LANES

GUARD = np.float32(-7.0)


@numba.njit
def whitened(T, W, low, begin, end, a, phi, Z):
    whiten_rows(T, W, low, begin, end, a, phi, Z)


@numba.njit
def turned(T, rows, E, low):
    columns_of(T, rows, E, low)


@numba.njit
def grown(r, begin, end, q, side):
    grow(r, begin, end, q, side)


def plainly_whitened(T, W, begin, end, a, phi, Z):
    """The same in double precision, in the words of the model; the load is what w and s make together."""
    T, (z1, z2, load, s) = T.astype(float), Z.astype(float).reshape(4, LANES)
    for k in range(begin, end):
        e = T[k] - z2
        T[k] = e * W[4, k]
        z2 = (1 - a) * z2 + a * ((1 - a) * z1 + a * load) + W[1, k] * e
        z1 = (1 - a) * z1 + a * load + W[0, k] * e
        load, s = load + phi * phi * s + W[2, k] * e, phi * s + W[3, k] * e
    return T, np.concatenate([z1, z2, load, s])


def drawn(seed: int, rows: int):
    rng = np.random.default_rng(seed)
    T = rng.normal(size=(rows, LANES)).astype(np.float32)
    W = np.abs(0.2 * rng.normal(size=(5, rows + 3))).astype(np.float32)
    return T, W, rng.normal(size=4 * LANES).astype(np.float32)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000), st.integers(0, 140), st.integers(0, 3))
def test_rows_are_whitened_as_in_double_precision(seed: int, rows: int, low: int):
    T, W, Z = drawn(seed, rows)
    begin = rows // 3
    expected, state = plainly_whitened(T, W[:, low:], begin, rows, 0.3, 0.6, Z)
    whitened(T, W, low, begin, rows, np.float32(0.3), np.float32(0.6), Z)
    np.testing.assert_allclose(T, expected, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(Z, state, rtol=1e-4, atol=1e-4)


def test_a_processor_without_merged_products_gives_the_same_but_for_rounding(monkeypatch):
    T, W, Z = drawn(3, 100)
    expected, _ = plainly_whitened(T, W, 0, 100, 0.3, 0.6, Z)
    monkeypatch.setattr(vector_code, "HAS_FMA", False)
    parted = numba.njit(whitened.py_func)
    parted(T, W, 0, 0, 100, np.float32(0.3), np.float32(0.6), Z)
    np.testing.assert_allclose(T, expected, rtol=1e-4, atol=1e-4)
    assert "llvm.fma" not in next(iter(parted.inspect_llvm().values()))


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000), st.integers(0, 100))
def test_sums_of_products_are_those_of_double_precision(seed: int, n: int):
    E = np.random.default_rng(seed).normal(size=(6, n)).astype(np.float32)
    columns, out = (4, 0, 3), np.full(6, np.nan)
    sums_of_products(E, columns, out)
    exact = E.astype(float) @ E.astype(float).T
    expected = [exact[columns[i], columns[k]] for i in range(3) for k in range(i + 1)]
    np.testing.assert_allclose(out, expected, atol=1e-6 * max(n, 1))


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000), st.integers(0, 80), st.integers(0, 5), st.integers(0, 5))
def test_columns_are_turned_and_nothing_beside_them_is_touched(seed: int, rows: int, low: int, spare: int):
    T = np.random.default_rng(seed).normal(size=(rows, LANES)).astype(np.float32)
    E = np.full((LANES, low + rows + spare), GUARD)
    turned(T, rows, E, low)
    whole = rows - rows % LANES
    np.testing.assert_array_equal(E[:, low : low + whole], T[:whole].T)
    assert np.all(E[:, :low] == GUARD)
    assert np.all(E[:, low + whole :] == GUARD)


@pytest.mark.parametrize("begin", [0, 2 * LANES])
def test_factors_are_multiplied_lane_by_lane_and_bounded(begin: int):
    r = np.random.default_rng(1).normal(size=6 * LANES).astype(np.float32)
    r[begin + 3] = 1e8
    side = np.linspace(1.0, 2.0, LANES)
    expected = side * np.prod(1.0 + np.minimum(0.7 * r[begin : 5 * LANES].astype(float).reshape(-1, LANES) ** 2,
                                               HIGHEST_TERM), axis=0)
    grown(r, begin, 5 * LANES, np.float32(0.7), side)
    np.testing.assert_allclose(side, expected, rtol=1e-5)
