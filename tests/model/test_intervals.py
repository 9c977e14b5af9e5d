"""The intervals of a model's numbers hold the truth, and rounded values do not mislead the fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.effects import EFFECTS
from backlash_cli.model.fit import Fit, fit
from backlash_cli.model.holdout import expected, limits, through_rounding
from backlash_cli.model.intervals import MODEL_ERROR, fitted_effects, half_widths, process_parameters
from backlash_cli.model.noise import Noise
from backlash_cli.model.pipeline import Part, Shape
from backlash_cli.model.problem import Problem, problem_from_record
from backlash_cli.record import LoopSettings, Record

from .loops import loop

BY_NAME = {effect.name: effect for effect in EFFECTS}


def true_fit(record: Record, d: float) -> tuple[Problem, Fit]:
    problem = problem_from_record(record)
    shape = Shape(18.0, 0.0, (Part(BY_NAME["backlash"], {"d": 1.1 * d, "position": 0.0}),))
    return problem, fit(problem, shape, Noise(1.0, 60.0, 20.0))


def test_a_normal_quantity_between_limits_has_the_mean_of_a_brute_force_integral() -> None:
    random = np.random.default_rng(0)
    mean, low = random.normal(0.0, 1.0, 6), random.normal(0.0, 1.0, 6)
    high = low + random.uniform(0.1, 2.0, 6)
    for m, a, b, found in zip(mean, low, high, expected(mean, 0.7, low, high), strict=True):
        x = np.linspace(a, b, 20001)
        p = np.exp(-0.5 * ((x - m) / 0.7) ** 2)
        assert found == pytest.approx(float(np.sum(x * p) / np.sum(p)), abs=1e-4)
    # so far out that nothing is left of the normal curve: the nearer limit
    assert expected(np.array([0.0, 0.0]), 0.01, np.array([1.0, -2.0]), np.array([2.0, -1.0])).tolist() == [1.0, -1.0]


def test_the_dead_band_of_a_coarse_record_is_nearer_the_truth_after_allowing_for_rounding() -> None:
    d, step = 0.03, 0.02
    recorder = (Part(BY_NAME["quantization"], {"step": step, "hold": 0.0}),)
    before, after = [], []
    for seed in range(8):
        record = loop(d=d, noise=0.0005, seed=seed, samples=1200)
        problem, plain = true_fit(replace(record, measurement=np.round(record.measurement / step) * step), d)
        assert limits(problem, recorder)[2].any() and not limits(problem, ())[2].any()
        found = through_rounding(problem, recorder, plain)
        before.append(abs(float(plain.shape.parts[0].values["d"]) / d - 1.0))  # type: ignore[arg-type]
        after.append(abs(float(found.shape.parts[0].values["d"]) / d - 1.0))  # type: ignore[arg-type]
        assert through_rounding(problem, (), plain) is plain
    assert np.mean(after) < 0.8 * np.mean(before)
    assert np.mean(after) < 0.05


def test_intervals_hold_the_truth_about_as_often_as_they_promise() -> None:
    held = []
    for seed in range(12):
        problem, found = true_fit(loop(d=0.03, noise=0.002, load=0.01, seed=seed, samples=1000), 0.03)
        (effect,) = fitted_effects(problem, found)
        process = process_parameters(problem, found)
        for number, true in ((effect.parameters["d"], 0.03), (process["tau"], 20.0), (process["Kp"], 1.2)):
            low, high = number.ci95  # type: ignore[misc]
            assert high - low >= 1.9 * MODEL_ERROR * true
            held.append(bool(low <= true <= high))  # type: ignore[operator]
    assert np.mean(held) > 0.85


def test_a_rest_that_is_not_white_widens_the_intervals() -> None:
    off = []
    for seed in range(12):
        problem, found = true_fit(loop(d=0.03, noise=0.001, load=0.02, seed=seed), 0.03)
        # the load is taken for white noise: the truth is that its error lasts
        blind = replace(found, noise=Noise(1e-3, 60.0, 20.0))
        wide, right = (half_widths(problem, f)[-1, "lag", 0] for f in (blind, found))
        off.append(abs(found.shape.lag - 20.0) / wide)
        assert wide > 0.5 * right
    assert np.mean(np.array(off) < 1.0) > 0.8


def test_the_clock_is_not_blamed_for_the_process() -> None:
    record = loop(noise=0.001)
    wave = 0.01 * np.sin(2.0 * np.pi * record.time / 150.0)
    problem = problem_from_record(replace(record, measurement=record.measurement + wave))
    part = Part(BY_NAME["external_oscillation"], {"period": 150.1, "amplitude": 0.0, "phase": 0.0})
    found = fit(problem, Shape(20.0, 0.0, (part,)), Noise(1.0, 60.0, 20.0))
    (effect,) = fitted_effects(problem, found)
    low, high = effect.parameters["period"].ci95  # type: ignore[misc]
    assert 149.9 < low < 150.0 < high < 150.1  # type: ignore[operator]


def test_a_measured_column_moves_on_between_its_samples() -> None:
    random = np.random.default_rng(4)
    fine, h, tau = 10, 2.0, 20.0
    column = np.convolve(random.standard_normal(1500 * fine + 400), np.ones(400) / 20.0, mode="valid")[: 1500 * fine]
    pv, a = np.zeros(1500 * fine), np.exp(-h / fine / tau)
    for k in range(1, pv.size):
        pv[k] = a * pv[k - 1] + (1 - a) * 0.02 * column[k - 1]
    record = loop(noise=0.0005)
    more = replace(record, measurement=record.measurement + 1.2 * pv[::fine], disturbances={"DV1": column[::fine]})
    problem = problem_from_record(more)
    part = Part(BY_NAME["measured_disturbance"], {"gain": 0.0}, "DV1")
    found = fit(problem, Shape(18.0, 0.0, (part,)), Noise(1.0, 60.0, 20.0))
    (effect,) = fitted_effects(problem, found)
    assert effect.parameters["gain"].value == pytest.approx(0.02, rel=0.005)
    assert found.shape.lag == pytest.approx(tau, rel=0.005)


def test_the_period_of_a_swing_is_found_from_the_neighbouring_line_of_the_spectrum() -> None:
    record = loop(noise=0.001, samples=6000, h=0.5)
    wave = 0.02 * np.sin(2.0 * np.pi * record.time / 10.53)
    problem = problem_from_record(replace(record, measurement=record.measurement + wave))
    for start in (10.526, 10.534):
        part = Part(BY_NAME["external_oscillation"], {"period": start, "amplitude": 0.0, "phase": 0.0})
        found = fit(problem, Shape(20.0, 0.0, (part,)), Noise(1.0, 60.0, 20.0))
        (effect,) = fitted_effects(problem, found)
        low, high = effect.parameters["period"].ci95  # type: ignore[misc]
        assert low < 10.53 < high and high - low < 0.002  # type: ignore[operator]


def test_a_dead_time_beside_that_of_the_settings_leaves_it_and_is_known_to_a_fifth_of_it() -> None:
    problem = problem_from_record(loop(noise=0.001, delay=6, settings=LoopSettings(Ti=20.0, theta=4.0)))
    part = Part(BY_NAME["dead_time"], {"theta": 5.0})
    found = fit(problem, Shape(18.0, 4.5, (part,)), Noise(1.0, 60.0, 20.0))
    theta = fitted_effects(problem, found)[0].parameters["theta"]
    assert found.shape.delay == 4.0 and theta.value == pytest.approx(8.0, abs=0.2)
    low, high = theta.ci95  # type: ignore[misc]
    assert 0.8 <= 0.5 * (high - low) < 1.6  # type: ignore[operator]
    given = process_parameters(problem, found)["theta"]
    assert given.value == 4.0 and given.ci95[0] <= 3.2 and given.ci95[1] >= 4.8  # type: ignore[index, operator]
