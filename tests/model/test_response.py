"""The linear response and the whitening against brute force."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.effects.process import delayed_lag, lag_transposed
from backlash_cli.model.noise import Noise, fit_noise, whitener
from backlash_cli.model.pipeline import MOST_KEPT, kept

from .loops import process, steps


def test_lag_without_delay_is_the_plain_recursion() -> None:
    u = steps(400)
    assert delayed_lag(u, 2.0, 20.0, 0.0) == pytest.approx(process(u, 2.0, 1.0, 20.0, 0.0), abs=1e-12)


@given(st.floats(0.0, 30.0), st.floats(3.0, 50.0))
@settings(max_examples=25, deadline=None)
def test_fractional_delay_agrees_with_a_fine_grid(delay: float, lag: float) -> None:
    h, fine = 2.0, 100
    u = steps(60, hold=9)
    held = np.repeat(u, fine)
    late = np.concatenate([np.full(round(delay / h * fine), u[0]), held])[: len(held)]
    expected = process(late, h / fine, 1.0, lag, 0.0)[::fine]
    assert delayed_lag(u, h, lag, round(delay / h * fine) * h / fine) == pytest.approx(expected, abs=1e-9)


def dense_covariance(noise: Noise, h: float, samples: int) -> np.ndarray:
    """Covariance of the error of the noise model, from its definition."""
    a1, a2 = np.exp(-h / noise.slow), np.exp(-h / noise.fast)
    F = np.array([[a1, 0.0], [(1 - a2), a2]])
    P = np.zeros((2, 2))
    for _ in range(20000):
        P = F @ P @ F.T + np.diag([1.0, 0.0])
    P *= noise.ratio**2 / P[1, 1]
    auto = []
    M = P.copy()
    for _ in range(samples):
        auto.append(M[1, 1])
        M = F @ M
    lags = np.abs(np.subtract.outer(np.arange(samples), np.arange(samples)))
    return np.array(auto)[lags] + np.eye(samples)


def test_whitening_is_the_exact_likelihood_with_holes() -> None:
    noise, h, n = Noise(3.0, 30.0, 8.0), 2.0, 160
    used = np.ones(n, dtype=bool)
    used[40:55] = used[90] = False
    error = np.random.default_rng(1).standard_normal(n)
    white = whitener(noise, used, h)
    C = dense_covariance(noise, h, n)[np.ix_(used, used)]
    z = white.columns(error)
    assert float(z @ z) == pytest.approx(float(error[used] @ np.linalg.solve(C, error[used])), rel=1e-9)
    assert white.log_det == pytest.approx(np.linalg.slogdet(C)[1], rel=1e-9)
    assert white.columns(np.column_stack([error] * 5))[:, 4] == pytest.approx(z)


def test_adjoints_turn_the_inner_product_around() -> None:
    random = np.random.default_rng(2)
    n = 200
    used = random.random(n) < 0.9
    white = whitener(Noise(2.0, 20.0, 5.0), used, 1.0)
    x, z = random.standard_normal((2, n))
    assert white.columns(x) @ z == pytest.approx(x @ white.transposed(z))
    u = np.concatenate([[0.0], random.standard_normal(n - 1)])
    assert delayed_lag(u, 1.0, 9.0, 0.0) @ z == pytest.approx(u @ lag_transposed(z, 1.0, 9.0))


def test_noise_is_found_again() -> None:
    random = np.random.default_rng(4)
    n, h = 6000, 1.0
    a1, a2 = np.exp(-h / 60.0), np.exp(-h / 15.0)
    load = np.zeros((n, 2))
    for k in range(1, n):
        load[k, 0] = a1 * load[k - 1, 0] + random.standard_normal()
        load[k, 1] = a2 * load[k - 1, 1] + (1 - a2) * load[k - 1, 0]
    error = 3.0 * load[:, 1] / load[:, 1].std() + random.standard_normal(n)
    found = fit_noise(error, np.ones(n, dtype=bool), h, Noise(1.0, 30.0, 10.0))
    assert found.ratio == pytest.approx(3.0, rel=0.25)
    assert found.slow * found.fast == pytest.approx(60.0 * 15.0, rel=0.5)


def test_the_last_columns_that_were_made_are_kept_and_older_ones_are_not() -> None:
    problem, made = SimpleNamespace(others={}), []
    for number in range(2 * MOST_KEPT):
        kept(problem, number, lambda number=number: made.append(number))
        assert [*problem.others] == [*range(max(number + 1 - MOST_KEPT, 0), number + 1)]
    kept(problem, 2 * MOST_KEPT - 1, lambda: made.append(-1))
    assert made == [*range(2 * MOST_KEPT)]
