"""What a model leaves: nothing but noise and load after the right effect, and something after a wrong one."""

from __future__ import annotations

import numpy as np
import pytest

from backlash_cli.effects.registry import load_effect
from backlash_cli.model import explain, holdout
from backlash_cli.model.adequacy import left_by
from backlash_cli.model.candidates import Judge, candidate, recorders
from backlash_cli.model.holdout import only_reports, recorded_floor
from backlash_cli.model.intervals import unseen_travel
from backlash_cli.model.problem import problem_from_record
from backlash_cli.model.search import baseline
from backlash_cli.record import FloatArray, LoopSettings, Record, record_from_arrays

from .loops import gap, loop, process, steps


def record(u: FloatArray, stem: FloatArray, noise: float = 0.001, load: FloatArray | None = None) -> Record:
    push = np.zeros_like(u) if load is None else load
    pv = process(stem + push, 2.0, 1.2, 20.0, -0.1) + noise * np.random.default_rng(5).standard_normal(len(u))
    return record_from_arrays(0.5, pv, u, interval=2.0, loop="TIC1", settings=LoopSettings(Ti=20.0))


def test_noise_and_a_wandering_load_alone_go_with_nothing() -> None:
    alarms = 0
    for seed in range(12):
        problem = problem_from_record(loop(noise=0.001, load=0.01, seed=seed))
        fitted = baseline(problem)
        alarms += bool(left_by(problem, fitted).goes_with)
    # four groups at a chance of 1e-5 each
    assert alarms == 0


def test_what_is_missing_shows_in_what_it_goes_with_until_it_is_there() -> None:
    problem = problem_from_record(loop(d=0.03))
    plain = baseline(problem)
    before = left_by(problem, plain)
    assert before.goes_with[0].startswith("the direction of travel") and not before.adequate([])
    right = candidate(Judge(problem, 20.0), plain, load_effect("backlash"))
    assert right is not None
    after = left_by(problem, right)
    assert after.goes_with == () and after.adequate([])
    assert right.rmse == pytest.approx(problem.floor, rel=0.15)


def test_a_stand_in_is_called_one_and_a_right_effect_clear() -> None:
    u = steps(1500)
    # the gain of the process goes with time, and only a curved valve is offered
    grown = u + 0.8 * np.linspace(0.0, 1.0, u.size) * (u - 0.5)
    found = explain(record(u, grown), add=["valve_characteristic"])
    assert found.adequate is False and found.effects[0].confidence == "stand_in"
    assert found.rest is not None and found.rest.goes_with[0].startswith("time")
    right = explain(record(u, gap(u, 0.03)))
    assert right.adequate and [e.confidence for e in right.effects] == ["clear"]


def test_a_stop_beside_one_load_step_is_no_string_of_load_steps() -> None:
    u = steps(1500, low=0.35, high=0.75)
    load = np.where(np.arange(u.size) >= 700, -0.06, 0.0)
    found = explain(record(u, np.minimum(u, 0.65), load=load))
    values = {e.effect: e.parameters for e in found.effects}
    assert set(values) == {"saturation", "load_step"}
    assert values["saturation"]["high"].value == pytest.approx(0.65, abs=0.01)
    assert values["load_step"]["sizes"].value == pytest.approx((-0.06,), rel=0.15)
    assert values["load_step"]["times"].value == pytest.approx((1400.0,), abs=20.0)


def test_a_gap_may_be_wider_where_op_turned_between_the_stored_samples() -> None:
    random = np.random.default_rng(4)
    # a controller five times as fast as the historian, whose output carries the noise of the measurement
    fine = np.repeat(steps(800, hold=40), 5) + 0.004 * random.standard_normal(4000)
    stem, u = gap(fine, 0.03), fine[::5]
    pv = process(stem, 0.4, 1.2, 20.0, -0.1)[::5] + 0.001 * random.standard_normal(800)
    there = record_from_arrays(0.5, pv, u, interval=2.0, loop="TIC1", settings=LoopSettings(Ti=20.0))
    d = next(e for e in explain(there).effects if e.effect == "backlash").parameters["d"]
    assert isinstance(d.value, float) and isinstance(d.ci95, tuple)
    low, high = d.ci95
    assert d.value < 0.03 and low < 0.03 < high  # type: ignore[operator]
    problem, backlash = problem_from_record(there), load_effect("backlash")
    # by hand: a top of 5 over neighbours of 3 and 4 would be cut off by 1 if every second sample were stored
    peaks = np.tile([0.3, 0.4, 0.5, 0.4, 0.2, 0.1, 0.2], 30)
    by_hand = unseen_travel(problem_with(problem, peaks), backlash, backlash.parameters[0], 0.05)
    assert by_hand == pytest.approx(1.5 * 0.1)


def problem_with(problem, output):  # type: ignore[no-untyped-def]
    from dataclasses import replace

    return replace(problem, output=output)


def test_repeated_values_are_an_exception_test_or_rounding_with_their_own_floor() -> None:
    u = steps(1500)
    pv = process(u, 2.0, 1.2, 20.0, -0.1) + 0.001 * np.random.default_rng(1).standard_normal(u.size)
    held, last = pv.copy(), np.inf
    for k, value in enumerate(pv):
        last = value if abs(value - last) > 0.02 else last
        held[k] = last
    rounded = np.rint(pv / 0.01) * 0.01
    for values, name, step in ((held, "exception_compression", 0.02), (rounded, "quantization", 0.01)):
        there = record_from_arrays(0.5, values, u, interval=2.0, loop="TIC1", settings=LoopSettings(Ti=20.0))
        problem = problem_from_record(there)
        base = baseline(problem)
        (part,) = recorders(problem, base, [load_effect("quantization"), load_effect("exception_compression")])
        assert part.effect.name == name and next(iter(part.values.values())) == pytest.approx(step, rel=0.05)
        assert only_reports(problem, (part,)) is (name == "exception_compression")
        assert 0.0005 < recorded_floor(problem, (part,), base) < 0.01


def test_a_load_that_passes_in_one_block_makes_no_model_surely_worse() -> None:
    unseen = np.random.default_rng(4).standard_normal(1200)
    passed = unseen + np.repeat([5.0, 0.0], [100, 1100])
    usual, one, all_over = (holdout.Tested(None, 1.0, 1.0, e)  # type: ignore[arg-type]
                            for e in (unseen, passed, 1.3 * unseen))
    assert not one.surely_worse(usual) and not usual.surely_worse(one) and not one.surely_worse(one)
    assert all_over.surely_worse(usual)
