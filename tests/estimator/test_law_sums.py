"""Window sums and the fit on them against plain numpy, one row and one window after the other."""

import numpy as np
import pytest

from backlash_cli.estimator.law_solve import condition, solve, standard_errors, weighted_fit
from backlash_cli.estimator.law_sums import WIDTH, window_sums

TIMES = (0.0, 0.4, 2.0)


def by_hand(signals: np.ndarray, index: np.ndarray, h: float, Tf: float, shift: int, phase: float, window: int,
            settle: int) -> np.ndarray:
    """The terms of each window as a matrix, and its centred products."""
    a, parts, rows = np.exp(-h / Tf) if Tf else 0.0, [], []
    for k in range(len(index)):
        if k == 0 or index[k] != index[k - 1] + 1:
            parts, rows, since, integral = [*parts, rows], [], 0, 0.0
            first = second = signals[1, k]
        else:
            since += 1
        late = k - shift if since >= shift else k
        before = second
        first = a * first + (1 - a) * signals[1, late]
        second = a * second + (1 - a) * first
        error = signals[0, late] - second
        integral += h * error
        if since >= settle:
            rows.append([signals[2, k], -second, integral - phase * h * error, signals[0, late],
                         -(second - before) / h])
            if len(rows) == window:
                parts, rows = [*parts, rows], []
    windows = [np.array(part) for part in (*parts, rows) if 2 * len(part) >= window]
    return np.array([(x - x.mean(0)).T @ (x - x.mean(0)) for x in windows])


@pytest.mark.parametrize(("shift", "phase", "window", "settle"), [(0, 0.0, 20, 3), (1, 0.25, 37, 0), (2, 0.5, 41, 10)])
def test_sums_are_those_of_the_rows_one_by_one(shift, phase, window, settle):
    rng = np.random.default_rng(window)
    index = np.cumsum(rng.choice([1, 4], size=700, p=[0.99, 0.01])).astype(np.int64)
    signals = np.cumsum(rng.normal(size=(3, 700)), axis=1)
    found = window_sums(signals, index, 0.5, np.array(TIMES), shift, phase, window, settle)
    for sums, Tf in zip(found, TIMES, strict=True):
        expected = by_hand(signals, index, 0.5, Tf, shift, phase, window, settle)
        assert sums.shape == expected.shape and len(sums) > 8
        np.testing.assert_allclose(sums, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    found = right.copy()
    solve(matrix.copy(), found)
    return found


def products(rng: np.random.Generator, windows: int, size: float = 0.1) -> np.ndarray:
    """Sums of products of five terms, the output made of the others and noise."""
    x = rng.normal(size=(windows, 30, WIDTH))
    x[:, :, 0] = x[:, :, 1:] @ [0.8, 0.03, 0.2, 0.0] + size * rng.normal(size=(windows, 30))
    return np.einsum("wki,wkj->wij", x, x)


@pytest.mark.parametrize("windows", [1, 5, 40])
def test_the_fit_is_least_squares_with_weights_that_follow_from_what_is_left(windows):
    sums = products(np.random.default_rng(windows), windows)
    terms = np.array([1, 2, 3])
    apart, values, left, weights, unexplained = weighted_fit(sums, terms)
    assert apart
    if windows < 6:
        expected = np.linalg.solve(sums.sum(0)[1:4, 1:4], sums.sum(0)[1:4, 0])
        np.testing.assert_allclose(values, expected, rtol=1e-9)
        assert unexplained == pytest.approx(left.sum() / sums[:, 0, 0].sum())
        return
    np.testing.assert_allclose(values, [0.8, 0.03, 0.2], atol=0.02)
    np.testing.assert_allclose(weights, 2.0 / (1.0 + left / np.median(left)), rtol=1e-9)
    rest = [s[0, 0] - 2 * s[0, 1:4] @ values + values @ s[1:4, 1:4] @ values for s in sums]
    np.testing.assert_allclose(left, rest, rtol=1e-9)
    assert unexplained == pytest.approx(weights @ left / (weights @ sums[:, 0, 0]))


def test_a_window_that_something_else_moved_loses_its_weight():
    rng = np.random.default_rng(5)
    sums = products(rng, 40)
    sums[7] = products(rng, 1, 30.0)[0]
    _, values, _, weights, _ = weighted_fit(sums, np.array([1, 2, 3]))
    assert weights[7] < 0.01 * np.median(weights)
    np.testing.assert_allclose(values, [0.8, 0.03, 0.2], atol=0.02)


def test_terms_that_cannot_be_told_apart_are_refused():
    sums = products(np.random.default_rng(6), 20)
    sums[:, :, 3], sums[:, 3, :] = sums[:, :, 2], sums[:, 2, :]
    sums[:, 3, 3] = sums[:, 2, 2]
    assert not weighted_fit(sums, np.array([1, 2, 3]))[0]
    sums[:, :, 3] = sums[:, 3, :] = 0.0  # a setpoint that stands still
    assert not weighted_fit(sums, np.array([1, 2, 3]))[0] and weighted_fit(sums, np.array([1, 2]))[0]


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_condition_and_solution_are_those_of_the_library(n):
    rng = np.random.default_rng(n)
    for _ in range(20):
        x = rng.normal(size=(n + 2, n)) * 10.0 ** rng.uniform(-3, 3, n)
        matrix, right = x.T @ x, rng.normal(size=n)
        np.testing.assert_allclose(solved(matrix, right), np.linalg.solve(matrix, right), rtol=1e-6)
        scale = np.sqrt(np.diag(matrix))
        scaled = matrix / np.outer(scale, scale)
        np.testing.assert_allclose(condition(scaled), np.linalg.cond(scaled), rtol=1e-6)
    assert np.isnan(solved(np.zeros((n, n)), right)).all()


def test_standard_errors_are_those_of_a_paired_difference():
    rng = np.random.default_rng(0)
    a, b = rng.uniform(1, 2, 30), rng.uniform(1, 3, 30)
    difference = np.log(b / a)
    assert standard_errors(a, b) == pytest.approx(difference.mean() / (difference.std() / np.sqrt(29)))
    assert standard_errors(a, a) == 0.0
    assert standard_errors(a[:1], b[:1]) == np.inf * np.sign(difference[0])
