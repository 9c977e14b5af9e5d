"""An effect acts at its own stage: one hidden at each, linear and not, is recovered where it is and in its size."""

from __future__ import annotations

import math

import numpy as np
import pytest

from backlash_cli.effects import Effect, Parameter, Stage
from backlash_cli.effects.registry import load_effect
from backlash_cli.model import compare, explain
from backlash_cli.model.fit import Solver
from backlash_cli.model.noise import Noise
from backlash_cli.model.pipeline import Part, Shape, acting, predict
from backlash_cli.model.problem import problem_from_record
from backlash_cli.record import FloatArray, LoopSettings, Record, record_from_arrays

from .loops import gap, process, steps

SAMPLES, H, GAIN, LAG = 1000, 2.0, 1.2, 20.0


def no_memory(p: FloatArray, interval: float, first: float) -> FloatArray:
    return np.empty(0)


def clock(p: FloatArray, interval: float, first: float) -> FloatArray:
    return np.array([0.0, interval])


def bent(state: FloatArray, value: float, p: FloatArray) -> float:
    return value + p[0] * value * value


def pumped(state: FloatArray, value: float, p: FloatArray) -> float:
    """A load that dies away: not linear in its time constant."""
    now = state[0] * state[1]
    state[0] += 1.0
    return value if math.isinf(p[0]) else value + 0.1 * math.exp(-now / p[0])


def own(name: str, stage: Stage) -> Effect:
    """A user's effect of a few lines, without any help for the fit."""
    if stage == Stage.LOAD:
        q = Parameter("fade", "s", "time after which the load has gone", math.inf, 1.0, math.inf, (100.0, 500.0))
        return Effect(name, stage, "A load that fades.", "test", (q,), clock, pumped)
    q = Parameter("bend", "1", "how much it is bent", 0.0, -0.9, 0.9, (-0.3, 0.3))
    return Effect(name, stage, "Bent.", "test", (q,), no_memory, bent)


def record(pv: FloatArray, u: FloatArray, noise: float = 0.0005) -> Record:
    pv = pv + noise * np.random.default_rng(3).standard_normal(len(pv))
    return record_from_arrays(0.5, pv, u, interval=H, loop="TIC1", settings=LoopSettings(Ti=LAG))


def played(stage: Stage) -> tuple[FloatArray, FloatArray, float]:
    """PV and OP of a loop with the user's effect at one stage, computed by hand, and the true parameter."""
    u, t = steps(SAMPLES), H * np.arange(SAMPLES)
    if stage == Stage.LOAD:
        # a step of the loop's dead time lies before the load
        return process(u + 0.1 * np.exp(-t / 300.0), H, GAIN, LAG, -0.1), u, 300.0
    if stage == Stage.SENSOR:
        true = process(u, H, GAIN, LAG, -0.1)
        return true - 0.4 * true**2, u, -0.4
    return process(u - 0.4 * u**2, H, GAIN, LAG, 0.1), u, -0.4


@pytest.mark.parametrize("stage", list(Stage))
def test_a_users_effect_is_recovered_at_every_stage(stage: Stage) -> None:
    pv, u, true = played(stage)
    found = explain(record(pv, u), add=[own("own", stage)])
    (effect,) = found.effects
    (p,) = effect.parameters.values()
    assert p.value == pytest.approx(true, rel=0.1)
    assert isinstance(p.ci95, tuple) and p.ci95[0] < true < p.ci95[1]  # type: ignore[operator]
    assert found.rmse_holdout < 1.1 * 0.0005
    assert found.baseline.rmse_holdout > 1.1 * found.rmse_holdout


def test_hysteresis_of_the_sensor_is_found_and_told_from_play_of_the_valve() -> None:
    u = steps(SAMPLES, low=0.4, high=0.6)
    true = process(u, H, GAIN, LAG, -0.1)
    found = explain(record(gap(true, 0.02), u))
    assert [e.effect for e in found.effects] == ["sensor_hysteresis"]
    assert found.effects[0].parameters["w"].value == pytest.approx(0.02, rel=0.1)
    assert found.effects[0].confidence == "stand_in"
    # the other way round: play in the valve is not called hysteresis of the sensor
    worn = explain(record(process(gap(u, 0.03), H, GAIN, LAG, -0.1), u))
    assert [e.effect for e in worn.effects] == ["backlash"] and worn.effects[0].confidence == "clear"


def test_a_root_that_was_never_taken_is_told_from_the_curve_of_a_valve() -> None:
    u = steps(SAMPLES, low=0.12, high=0.5)
    found = explain(record(np.sqrt(process(u, H, 1.2, LAG, -0.1)), u))
    assert [(e.effect, e.confidence) for e in found.effects] == [("sensor_curve", "stand_in")]
    curved = explain(record(process(np.sqrt(u), H, GAIN, LAG, -0.1), u))
    assert [(e.effect, e.confidence) for e in curved.effects] == [("valve_characteristic", "clear")]


def test_a_gain_that_grows_with_time_is_found() -> None:
    u = steps(SAMPLES)
    grown = u + 0.5 * np.arange(SAMPLES) / SAMPLES * (u - 0.5)
    found = explain(record(process(grown, H, GAIN, LAG, -0.1), u))
    assert found.missing_effect == "gain_drift"
    growth = found.effects[0].parameters["growth"].value
    assert growth == pytest.approx(0.5 / (SAMPLES * H / 3600.0), rel=0.05)


def test_linear_numbers_behind_a_bent_sensor_are_those_of_a_plain_search() -> None:
    pv, u, _ = played(Stage.SENSOR)
    problem = problem_from_record(record(pv, u, noise=0.0))
    shape = Shape(LAG, 0.0, (Part(own("own", Stage.SENSOR), {"bend": -0.4}),))
    noise = Noise(1e-3, 100.0, 20.0)
    c, rss, _ = Solver(problem, noise).solve(shape)
    assert c[:2] == pytest.approx([GAIN, -0.1], rel=1e-3)
    assert predict(problem, shape, c) == pytest.approx(pv, abs=1e-5)
    assert rss < 1e-6


def test_a_model_with_an_effect_at_the_sensor_holds_on_another_day() -> None:
    u = steps(SAMPLES, seed=1, low=0.4, high=0.6)
    model = explain(record(gap(process(u, H, GAIN, LAG, -0.1), 0.02), u), add=["sensor_hysteresis"]).model
    v = steps(SAMPLES, seed=2, low=0.4, high=0.6)
    there = compare(record(gap(process(v, H, GAIN, LAG, -0.1), 0.02), v), model)
    assert there.fitness.rmse_holdout < 1.3 * 0.0005 < 0.5 * there.baseline.rmse_holdout


def test_effects_of_the_tool_have_a_stage_that_the_pipeline_knows() -> None:
    names = ("sensor_hysteresis", "load_step", "backlash")
    parts = sensor, load, valve = [Part(load_effect(name), {}) for name in names]
    assert load.is_linear
    assert [acting(parts, *stages) for stages in ((Stage.SENSOR,), (Stage.LOAD,), (Stage.VALVE, Stage.PROCESS))] == [
        [sensor], [], [valve]]
