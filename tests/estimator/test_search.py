"""The search for the numbers of the noise, and for load steps: against scipy, differences and a plain computation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from backlash_cli.estimator.best_models import (
    PER_STEP,
    STARTS,
    Models,
    around,
    best_of_two,
    final_models,
    first_models,
)
from backlash_cli.estimator.fitter import ASIDE, STEP_LIMIT, Fitter
from backlash_cli.estimator.likelihood import HIGHEST, LOWEST, STEPS, T_FREEDOM
from backlash_cli.estimator.load_steps import step_information, step_scores
from backlash_cli.estimator.profile import peak
from backlash_cli.estimator.rows import Rows
from backlash_cli.estimator.search import FLAT, FURTHEST, bounded_step, normal_equations
from backlash_cli.estimator.whitening import LAGS
from backlash_cli.record import LoopSettings

from .closed_loop import Loop, rows_of, run

STEP_AT = 4000
TIME = np.arange(8000)
SMOOTH = 0.03 * np.sin(TIME / 160.0) + 0.02 * np.sin(TIME / 71.0 + 1.0)
STEPPED = SMOOTH + np.where(TIME < STEP_AT, 0.0, 0.06)


def loop_rows(d: float, load: np.ndarray = SMOOTH, seed: int = 0) -> Rows:
    given = LoopSettings(K=0.6, Ti=20.0, Kp=1.0)
    return rows_of(replace(run(Loop(dead_band=d), 8000, load=load, seed=seed), settings=given))


@pytest.fixture(scope="module")
def worn() -> Rows:
    return loop_rows(0.02)


def from_start(fit: Fitter, number: int) -> np.ndarray:
    share, *rest = STARTS[number]
    found = np.full((2, 4), -np.inf)
    found[:, :3] = np.log(fit.r.lag * share), *rest
    return found


@pytest.mark.parametrize("which", [0, 1])
def test_the_search_goes_as_high_as_another_from_the_same_start(worn: Rows, which: int) -> None:
    fit, j = Fitter(worn), 12
    found = from_start(fit, 2)
    fit.ascend(found, which, j, 0.2)
    x = worn.x[[0, j]]
    other = minimize(lambda p: -fit.ll(p, x)[which], from_start(fit, 2)[0, :3], method="Nelder-Mead",
                     bounds=list(zip(LOWEST, HIGHEST, strict=True)), options={"maxfev": 400})
    assert found[which, 3] > -other.fun - 1.0


def test_what_is_found_is_the_likelihood_there_for_both(worn: Rows) -> None:
    fit = Fitter(worn)
    found = from_start(fit, 2)
    start = fit.ll(found[0, :3], worn.x, [0, 12])
    fit.ascend(found, 1, 12, 0.2)
    assert np.all(found[:, 3] >= start)
    for c, j in enumerate((0, 12)):
        assert fit.ll(found[c, :3], worn.x, [j])[0] == pytest.approx(found[c, 3], abs=0.02)


def test_a_second_search_from_the_top_stays_there_and_is_short(worn: Rows) -> None:
    fit = Fitter(worn)
    found = from_start(fit, 2)
    fit.ascend(found, 1, 12, 0.2)
    before = found.copy()
    fit.ascend(found, 1, 12, 0.2)
    assert before[1, 3] <= found[1, 3] < before[1, 3] + 0.5


def test_gradient_and_curvature_are_those_of_the_likelihood() -> None:
    rng = np.random.default_rng(3)
    n = 20_000
    J = rng.normal(size=(3, n))
    r = rng.standard_t(T_FREEDOM, n) * 0.3
    none = np.zeros(len(LAGS))  # of the response: no prior

    def level(p: np.ndarray) -> float:
        e = r + p @ J
        s2 = np.mean(e * e)
        for _ in range(60):  # the most likely scale, by its own equation
            s2 = np.mean((T_FREEDOM + 1.0) * e * e / (T_FREEDOM + e * e / s2))
        return float(-0.5 * ((T_FREEDOM + 1.0) * np.sum(np.log1p(e * e / (T_FREEDOM * s2))) + n * np.log(s2)))

    s2 = 0.09
    for _ in range(60):
        s2 = np.mean((T_FREEDOM + 1.0) * r * r / (T_FREEDOM + r * r / s2))
    H, g = np.empty((3, 3)), np.empty(3)
    normal_equations(np.r_[r, none], float(s2), np.c_[J, np.tile(none, (3, 1))], H, g)
    h = 1e-4
    eye = h * np.eye(3)
    np.testing.assert_allclose(g, [(level(e) - level(-e)) / (2 * h) for e in eye], rtol=1e-3, atol=0.05 * np.sqrt(n))
    bend = [[(level(a + b) - level(a - b) - level(b - a) + level(-a - b)) / (4 * h * h) for a in eye] for b in eye]
    # the expected curvature is above the true one: the weights of Student's t are taken as given
    np.testing.assert_allclose(np.diag(H) * (T_FREEDOM + 1.0) / (T_FREEDOM + 3.0), -np.diag(bend), rtol=0.35)
    assert np.abs(H - np.diag(np.diag(H))).max() < 0.05 * H[0, 0]


def test_the_prior_of_the_response_counts_as_normal_residuals() -> None:
    rng = np.random.default_rng(4)
    r, J, s2 = rng.normal(size=50 + len(LAGS)), rng.normal(size=(3, 50 + len(LAGS))), 1.3
    without, behind = r.copy(), J.copy()
    without[50:] = behind[:, 50:] = 0.0
    (H, g), (H0, g0) = (np.empty((3, 3)), np.empty(3)), (np.empty((3, 3)), np.empty(3))
    normal_equations(r, s2, J, H, g)
    normal_equations(without, s2, behind, H0, g0)
    np.testing.assert_allclose(g - g0, -J[:, 50:] @ r[50:] / s2)
    np.testing.assert_allclose(H - H0, J[:, 50:] @ J[:, 50:].T / s2)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10_000))
def test_a_step_stays_within_bounds_and_promises_no_loss(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(5, 3)) * rng.choice([1e-3, 1.0, 30.0], 3)
    H, g, d = A.T @ A, rng.normal(size=3) * 30.0, np.empty(3)
    p = np.array([rng.choice([low, high, rng.uniform(low, high)]) for low, high in zip(LOWEST, HIGHEST, strict=True)])
    gain = bounded_step(p, H, g, 0.0, d)
    assert np.all(p + d >= np.array(LOWEST) - 1e-9) and np.all(p + d <= np.array(HIGHEST) + 1e-9)
    assert np.all(np.abs(d) <= np.array(FURTHEST) + 1e-9)
    inside = np.all((p + d > np.array(LOWEST) + 1e-6) & (p + d < np.array(HIGHEST) - 1e-6))
    if inside and np.all(np.abs(d) < np.array(FURTHEST) - 1e-6):
        free = np.linalg.solve(H + np.diag(FLAT / np.array(STEPS) ** 2), g)
        np.testing.assert_allclose(d, free, rtol=1e-6, atol=1e-9)
        assert gain >= -1e-9


def test_load_steps_are_those_that_stand_out_with_every_width() -> None:
    rows = loop_rows(0.02, STEPPED)
    fit, p, j = Fitter(rows), np.array([0.6, -6.0, -2.0]), 12
    assert fit.add_load_steps(p, j)
    a, phi = 1.0 - np.exp(-1.0 / np.exp(p[0])), 1.0 / (1.0 + np.exp(-p[2]))
    plain = Fitter(rows)
    statistics, sizes = [], []
    for i in (0, j - ASIDE, j, j + ASIDE):
        noise = plain.pair(p, rows.x[i])[1][0]
        information = step_information(plain.G, plain.S, a, phi, rows.first)
        scores = np.full(len(rows.y), np.inf)
        step_scores(plain.R[0], np.sqrt(noise), np.sqrt(plain.S), plain.G, a, phi, rows.first, scores)
        statistics.append(np.sqrt(scores / information))
        sizes.append(scores / information**2)
    least = np.min(statistics, axis=0)
    top = [least[k] == least[max(k - 2, 0) : k + 3].max() for k in range(len(least))]
    hit = (least > STEP_LIMIT) & top & (np.arange(len(least)) >= 8)
    np.testing.assert_array_equal(fit.shock > 0, hit)
    np.testing.assert_allclose(fit.shock[hit], np.min(sizes, axis=0)[hit], rtol=1e-3)
    assert np.abs(np.flatnonzero(hit) - STEP_AT / 5).min() <= 1


def test_a_quiet_load_has_no_steps(worn: Rows) -> None:
    fit = Fitter(worn)
    m = first_models(fit)
    steps = np.count_nonzero(fit.shock)
    assert steps <= 2
    before = fit.shock.copy()
    assert not fit.add_load_steps(m.best[1, :3], m.j) or steps == 2
    assert np.all(fit.shock >= before)


def test_the_width_at_the_end_is_the_best_of_those_tried(worn: Rows) -> None:
    fit = Fitter(worn)
    m, some, levels = final_models(fit, first_models(fit))
    assert m.j == some[int(np.argmax(levels))]
    assert worn.widths[m.j - 1] == pytest.approx(0.02, rel=0.25)
    assert set(around(worn, m.j, (-1, 0, 1))) <= set(some)
    assert m.gain > 10.0


def test_the_better_of_two_beginnings_is_kept_with_its_load_steps() -> None:
    rows = loop_rows(0.02, STEPPED)
    one, two = Fitter(rows), Fitter(rows)
    first, best = first_models(one), best_of_two(two)

    def worth(m: Models, fit: Fitter) -> float:
        return float(m.best[:, 3].max()) - PER_STEP * np.count_nonzero(fit.shock)

    assert worth(best, two) >= worth(first, one)
    for c, j in enumerate((0, best.j)):
        assert two.ll(best.best[c, :3], rows.x, [j])[0] == pytest.approx(best.best[c, 3], abs=0.05)


def test_the_top_of_a_parabola_over_uneven_widths() -> None:
    d = np.array([0.01, 0.012, 0.017, 0.03])
    assert peak(d, -((d - 0.0141) ** 2))[0] == pytest.approx(0.0141)
    assert peak(d, d) == (0.03, 0.03)
