"""The compiled core against independent computations: scipy, the joint normal density, brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar, nnls

from backlash_cli.estimator import whitening as core
from backlash_cli.estimator.kalman import DIFFUSE, WEIGHTS, gains
from backlash_cli.estimator.likelihood import T_FREEDOM, pair, several, t_scale
from backlash_cli.estimator.load_steps import step_information, step_scores
from backlash_cli.estimator.step_response import DIP, nonnegative, response_base


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000))
def test_nonnegative_least_squares_agrees_with_scipy(seed: int):
    rng = np.random.default_rng(seed)
    M, y = rng.normal(size=(30, 6)), rng.normal(size=30)
    x = np.empty(6)
    nonnegative(M.T @ M, M.T @ y, x)
    np.testing.assert_allclose(x, nnls(M, y)[0], atol=1e-8)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.floats(0, 3), min_size=6, max_size=6))
def test_the_base_keeps_every_step_response_above_its_bound(v: list[float]):
    response = np.cumsum(response_base(6) @ np.array(v))
    assert np.all(response >= -DIP * response[-1] - 1e-12)


def room(n: int):
    """Room for gains, variances, columns in the filter, whitened columns and residuals of n rows."""
    return (np.empty((n, 4)), np.empty(n), np.zeros((core.CHUNK, core.LANES), np.float32),
            np.empty((core.LANES, n), np.float32), np.empty((2, n), np.float32))


def whitened(y, a, ratio, phi, shock, first):
    """Innovations of y over their deviation, gains and variances."""
    n = len(y)
    G, S, T, E, _ = room(n)
    W, f = np.empty((WEIGHTS, n), np.float32), np.empty((n, 2), np.float32)
    rows, logs = gains(a, ratio, phi, shock, first, np.ones(n, dtype=bool), G, S, W)
    assert rows == n
    assert logs == pytest.approx(np.sum(np.log(S)))
    core.innovations(y, np.empty((0, n)), np.zeros(n), np.zeros(n), a, phi, first, W, f, T, E)
    return E[0].astype(float), G, S


def transition(a: float, phi: float):
    """Matrix (4, 4) that takes the state (z1, z2, w, s) one row on, from the equations of the model in turn."""
    z1, z2, w, s = np.eye(4)
    s = phi * s
    w = w + s
    z1 = z1 + a * (w - z1)
    z2 = z2 + a * (z1 - z2)
    return np.array([z1, z2, w, s])


def brute_force(y, a, ratio, phi, shock):
    """Log-density of y from the full covariance matrix of all rows."""
    n = len(y)
    effect = np.zeros((n, 3 + 2 * n))  # of the initial state, of each increment, of each load step
    state = np.zeros((4, 3 + 2 * n))
    state[:3, :3] = np.eye(3)
    for k in range(n):
        z1, z2, w, s = state
        s = phi * s
        s[3 + k] += 1.0
        w = w + s
        w[3 + n + k] += 1.0
        z1 = z1 + a * (w - z1)
        z2 = z2 + a * (z1 - z2)
        state = np.array([z1, z2, w, s])
        effect[k] = z2
    initial = DIFFUSE * (np.ones((3, 3)) + 0.01 * np.eye(3))
    variance = np.zeros((3 + 2 * n, 3 + 2 * n))
    variance[:3, :3] = initial
    variance[3:, 3:] = np.diag([*([ratio] * n), *shock])
    cov = effect @ variance @ effect.T + np.eye(n)
    _, logdet = np.linalg.slogdet(cov)
    return -0.5 * (logdet + y @ np.linalg.solve(cov, y))


def test_whitened_rows_have_the_density_of_the_model():
    rng = np.random.default_rng(3)
    n, a, ratio, phi = 14, 0.4, 0.3, 0.5
    shock = np.zeros(n)
    shock[6] = 25.0
    y = rng.normal(size=n)
    first = np.arange(n) == 0
    e, _, S = whitened(y, a, ratio, phi, shock, first)
    assert -0.5 * (np.sum(e**2) + np.sum(np.log(S))) == pytest.approx(brute_force(y, a, ratio, phi, shock), abs=1e-4)


def test_a_load_step_is_found_where_it_is_and_as_large_as_it_is():
    rng = np.random.default_rng(0)
    n, at, size, a = 300, 170, 12.0, 0.3
    load = np.where(np.arange(n) >= at, size, 0.0)
    z1 = z2 = 0.0
    y = np.empty(n)
    for k in range(n):
        z1 += a * (load[k] - z1)
        z2 += a * (z1 - z2)
        y[k] = z2 + rng.normal()
    first = np.arange(n) == 0
    e, G, S = whitened(y, a, 1e-4, 0.1, np.zeros(n), first)
    least, information = np.full(n, np.inf), step_information(G, S, a, 0.1, first)
    step_scores(2.0 * e, 2.0, np.sqrt(S), G, a, 0.1, first, least)
    k = int(np.argmax(least / information))
    assert abs(k - at) <= 1
    assert np.sqrt(least[k]) / information[k] == pytest.approx(size, rel=0.25)


def test_the_score_of_a_load_step_is_standard_normal_without_one_and_the_least_counts():
    rng, n, a = np.random.default_rng(0), 4000, 0.3
    first = np.arange(n) == 0
    _, G, S = whitened(np.zeros(n), a, 0.1, 0.1, np.zeros(n), first)
    information = step_information(G, S, a, 0.1, first)
    least = np.full(n, np.inf)
    step_scores(rng.normal(size=n), 1.0, np.sqrt(S), G, a, 0.1, first, least)  # innovations of a load without steps
    assert np.mean(least[20:-20] / information[20:-20]) == pytest.approx(1.0, abs=0.15)
    once = least.copy()
    step_scores(rng.normal(size=n), 1.0, np.sqrt(S), G, a, 0.1, first, least)
    assert np.all(least <= once)
    assert np.mean(least[20:-20] / information[20:-20]) == pytest.approx(0.36, abs=0.1)  # of two, 1 - 2 / pi


def test_regression_recovers_a_process_from_its_input():
    rng = np.random.default_rng(1)
    n, a = 1500, 0.35
    x = np.cumsum(rng.normal(size=n)) * 0.2
    z1 = z2 = x[0]
    f = np.empty(n)
    for k in range(n):
        z1 += a * (x[k] - z1)
        z2 += a * (z1 - z2)
        f[k] = z2
    y = np.zeros(n)
    y[2:] = 1.5 * f[:-2]
    y += 0.05 * rng.normal(size=n)
    first = np.arange(n) == 0
    p = np.array([np.log(-1.0 / np.log(1.0 - a)), np.log(1e-5), np.log(0.1 / 0.9)])
    ll, noise, b, _ = pair(p, x, np.roll(x, 5), True, y, np.empty((0, n)), first, np.arange(n) >= 20, 1e-6, np.zeros(n),
                        *room(n))
    assert ll[0] > ll[1]
    # the scale of a Student t with 6 degrees of freedom fitted to normal noise is 0.86 of its deviation
    assert np.sqrt(noise[0]) == pytest.approx(0.86 * 0.05, rel=0.1)
    assert b[0].sum() == pytest.approx(1.5, rel=0.03)
    assert core.LAGS[int(np.argmax(b[0]))] == 2


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10_000), st.integers(1, 5), st.floats(-1.0, 3.0), st.floats(-14.0, 6.0), st.floats(-4.0, 6.0))
def test_many_positions_at_once_are_what_they_are_in_pairs(seed, positions, lag, ratio, smooth):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(60, 400))
    x = np.cumsum(rng.normal(size=(positions, n)), axis=1)
    y = x[0] + rng.normal(size=n)
    first = np.isin(np.arange(n), [0, n // 2])
    use = ~np.isin(np.arange(n), [*range(12), *range(n // 2, n // 2 + 12)])
    shock = np.where(np.arange(n) == n // 3, 40.0, 0.0)
    line = rng.normal(size=(int(rng.integers(0, 3)), n))
    p = np.array([lag, ratio, smooth])
    which = rng.permutation(positions)
    at_once = several(p, x, which, y, line, first, use, 1e-6, shock, *room(n))
    pairs = [pair(p, x[k], x[k], False, y, line, first, use, 1e-6, shock, *room(n))[0][0] for k in which]
    np.testing.assert_allclose(at_once, pairs, rtol=1e-4, atol=0.02)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10_000), st.floats(0.05, 0.9), st.floats(-12.0, 6.0), st.floats(0.02, 0.98))
def test_single_precision_loses_nothing_that_counts(seed, a, ratio, phi):
    """The same filter in double precision, one row after the other."""
    rng = np.random.default_rng(seed)
    n = 500
    y = np.cumsum(rng.normal(size=n)) + rng.normal(size=n)
    first = np.isin(np.arange(n), [0, 300])
    shock = np.where(np.arange(n) % 170 == 90, 30.0, 0.0)
    e, G, S = whitened(y, a, np.exp(ratio), phi, shock, first)
    F, z, exact = transition(a, phi), np.zeros(4), np.empty(n)
    for k in range(n):
        z = np.zeros(4) if first[k] else F @ z
        exact[k] = (y[k] - z[1]) / np.sqrt(S[k])
        z = z + G[k] * (y[k] - z[1])
    np.testing.assert_allclose(e, exact, atol=1e-3 * np.std(exact))


@pytest.mark.parametrize("outliers", [0, 3, 40])
def test_the_scale_of_the_residuals_is_the_most_likely_one(outliers: int):
    rng = np.random.default_rng(outliers)
    r = (0.02 * rng.normal(size=700)).astype(np.float32)
    r[:outliers] *= 30.0
    s2, logs = t_scale(r, len(r))

    def loss(ln_s2: float) -> float:
        return 0.5 * (T_FREEDOM + 1.0) * np.sum(np.log1p(r**2 / (T_FREEDOM * np.exp(ln_s2)))) + 0.5 * len(r) * ln_s2

    best = minimize_scalar(loss, bracket=(-12.0, -4.0)).fun
    assert 0.5 * (T_FREEDOM + 1.0) * logs + 0.5 * len(r) * np.log(s2) == pytest.approx(best, abs=0.02)
