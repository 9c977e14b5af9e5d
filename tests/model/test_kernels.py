"""The fast ways of a fit give what the plain ways give."""

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli import kernels
from backlash_cli.effects.registry import load_effect
from backlash_cli.model.fit import Solver, curvature, free_numbers, get, put
from backlash_cli.model.noise import Noise, downhill, fit_noise, whitener
from backlash_cli.model.pipeline import Part, Shape, predict, regressors
from backlash_cli.model.problem import problem_from_record

from .loops import loop

STEP = Part(load_effect("load_step"), {"times": (400.0, 900.0), "sizes": (0.0, 0.0)})
GAP = Part(load_effect("backlash"), {"d": 0.02, "position": 0.3})
LAG = Part(load_effect("second_lag"), {"tau2": 7.0})
LATE = Part(load_effect("dead_time"), {"theta": 5.0})


@pytest.fixture(scope="module")
def problem():
    """Return a loop with a hole of OP and PV."""
    record = loop(d=0.03, load=0.01)
    output = record.output.copy()
    output[300:320] = np.nan
    found = problem_from_record(replace(record, output=output))
    assert found.holes == 1
    return found


@pytest.mark.parametrize("parts", [(), (GAP,), (STEP,), (GAP, LAG, STEP), (LATE, STEP)])
@pytest.mark.parametrize("delay", [0.0, 3.3])
def test_predicted_pv_is_regressors_times_coefficients(problem, parts, delay):
    shape = Shape(21.0, delay)
    for part in parts:
        shape = shape.with_part(part)
    X = regressors(problem, shape)
    c = np.random.default_rng(1).normal(size=X.shape[1])
    np.testing.assert_allclose(predict(problem, shape, c), X @ c, atol=1e-11)


def test_innovations_of_the_filter_are_what_whitening_gives(problem):
    random = np.random.default_rng(2)
    used = random.random(problem.samples) > 0.2
    error = np.where(used, random.standard_normal(problem.samples), 0.0)
    for noise in (Noise(1.0, 60.0, 20.0), Noise(0.01, 10.0, 5.0), Noise(30.0, 200.0, 1.0)):
        white = whitener(noise, used, 2.0)
        innovations, log_det = kernels.kalman(error, used, *noise.at_rest(2.0), np.empty((0, 2)), np.empty(0))
        np.testing.assert_allclose(innovations, white.columns(error), atol=1e-10)
        assert log_det == pytest.approx(white.log_det, rel=1e-12)


def test_the_noise_found_is_no_worse_than_any_near_it(problem):
    random = np.random.default_rng(3)
    n, h = 3000, 2.0
    load = np.zeros(n)
    for k in range(1, n):
        load[k] = 0.98 * load[k - 1] + random.standard_normal()
    error, used = load + random.standard_normal(n), np.ones(n, dtype=bool)
    found = fit_noise(error, used, h, Noise(1.0, 30.0, 10.0))

    def cost(noise: Noise) -> float:
        white = whitener(noise, used, h)
        return white.deviance(float(np.sum(white.columns(error) ** 2)))

    for factor in (0.7, 1.4):
        assert cost(found) < cost(Noise(factor * found.ratio, found.slow, found.fast)) + 0.1
        assert cost(found) < cost(Noise(found.ratio, factor * found.slow, found.fast)) + 0.1


def full_slopes(solver, shape, rest, free):
    """Change of the whitened rest per unit of each searched number, the linear numbers solved anew each time."""
    numbers, columns = get(shape, free), []
    for j, f in enumerate(free):
        step = f.step if numbers[j] + f.step <= f.high else -f.step
        moved = numbers.copy()
        moved[j] += step
        columns.append((solver.rest(put(shape, free, moved))[2] - rest) / step)
    return np.column_stack(columns)


@pytest.mark.parametrize("parts", [(), (GAP,), (LAG, STEP)])
def test_one_column_per_number_points_where_full_slopes_point(problem, parts):
    shape = Shape(30.0, 0.0)
    for part in parts:
        shape = shape.with_part(part)
    solver = Solver(problem, Noise(0.5, 60.0, 20.0))
    free = free_numbers(problem, shape)
    _, _, rest = solver.rest(shape)
    J = full_slopes(solver, shape, rest, free)
    A, g = curvature(solver, shape)
    # the gradient is exact up to the finite steps; the curvature leaves out terms of second order
    np.testing.assert_allclose(g, J.T @ rest, rtol=0.05, atol=0.02 * np.max(np.abs(J.T @ rest)))
    assert np.all(np.linalg.eigvalsh(A) > -1e-9 * np.max(np.diag(A)))
    assert np.all(np.diag(A) < 1.5 * np.diag(J.T @ J)) and np.all(np.diag(A) > 0.3 * np.diag(J.T @ J))


def test_the_optimiser_comes_to_the_end_of_a_curved_valley():
    """Rosenbrock's function as two errors, 10 (y - x^2) and 1 - x: the least is at (1, 1)."""

    def errors(x):
        return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0], 1e-3])

    def local(x):
        J = np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0], [0.0, 0.0]])
        return J.T @ J, J.T @ errors(x)

    ends = np.full(2, 10.0)
    found = downhill(np.array([-1.2, 1.0]), lambda x: float(np.sum(errors(x) ** 2)), local, -ends, ends, 3, 200, 1e-9)
    np.testing.assert_allclose(found, [1.0, 1.0], atol=1e-3)


def test_downhill_stays_where_the_slope_cannot_be_computed():
    at = np.array([0.5, 2.0])
    found = downhill(at, lambda x: 7.0, lambda x: (np.full((2, 2), np.nan), np.ones(2)), at - 9, at + 9, 3, 20, 1e-9)
    assert found.tolist() == at.tolist()
