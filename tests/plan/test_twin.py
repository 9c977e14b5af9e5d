"""The loop on the desk is the loop of the record: process, dead band, upset, and what is done to it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from backlash_cli.plan import twin as twins
from backlash_cli.plan.twin import HOLE, UNLIKE, Move, Test, answer, behind, longest_stretch, response, twins_of
from backlash_cli.record import LoopSettings, record_from_arrays
from backlash_cli.simulator import Controller, Process, Scenario, Signal, simulate, use

Test.__test__ = False  # not one of pytest's


def loop(d=0.0, process=None, seed=1, duration=14_400.0):
    """A loop with a known process, a wandering load and little noise."""
    process = process or Process(gain=1.3, lags=(60.0,), dead_time=6.0)
    load = use("random_load", sd=0.01, time_constant=300.0)
    return simulate(Scenario(Controller(0.6, 60.0, b=1.0), process, duration, 2.0,
                             (use("backlash", d=d), load, use("measurement_noise", density=1e-7)), Signal(0.5),
                             output=0.4, seed=seed))


@pytest.mark.parametrize("process", [
    Process(gain=-1.7, lags=(40.0, 15.0), dead_time=10.0), Process(gain=0.02, lags=(8.0,), integrating=True)])
def test_the_answer_of_a_process_is_that_of_an_exact_solution(process):
    t = np.arange(400.0)
    values = np.where(t < 50, 0.0, 0.1) - np.where(t < 200, 0.0, 0.15)
    denominator = [1.0, 0.0] if process.integrating else [1.0]
    for lag in process.lags:
        denominator = np.polymul(denominator, [lag, 1.0])
    late = int(process.dead_time)
    held = np.concatenate([np.zeros(late), values[: len(values) - late]])
    exact = signal.lsim(([process.gain], denominator), held, t, interp=False)[1]
    assert np.ptp(exact) > 0.1
    assert np.max(np.abs(response(process, values, 1.0) - exact)) < 1e-9 * np.ptp(exact)


def test_the_process_is_read_from_the_record_and_its_upset_is_what_the_process_leaves():
    record = loop(d=0.02)
    twin = twins_of(record, [0.02])[0]
    assert twin.source == "fitted"
    assert twin.process.static_gain == pytest.approx(1.3, rel=0.25)
    assert sum(twin.process.lags) == pytest.approx(60.0, rel=0.5)
    assert twin.output == pytest.approx(float(record.output.mean()))
    # PV is put together again by process and upset
    stem = use("backlash", d=0.02).effect.apply(record.output, np.array([0.02, 0.0]), 2.0)
    again = response(twin.process, stem - twin.output, 2.0) + twin.upset
    difference = again - record.measurement
    assert np.ptp(difference[100:]) < 1e-9


def test_a_derivative_part_whose_filter_is_not_given_gets_the_usual_one():
    record = loop()
    record = replace(record, settings=replace(record.settings, Td=8.0, Tf=0.0))
    assert twins_of(record, [0.0])[0].controller.filter_time == pytest.approx(1.6)


def test_a_loop_that_does_not_answer_gets_a_process_that_its_tuning_would_suit():
    random = np.random.default_rng(0)
    record = record_from_arrays(0.5, 0.5 + 0.01 * random.normal(size=3000), 0.4 + 0.01 * random.normal(size=3000),
                                interval=2.0, settings=LoopSettings(K=-0.5, Ti=40.0))
    twin = twins_of(record, [0.02])[0]
    assert twin.source.startswith("assumed") and twin.process.gain * -0.5 > 0 and twin.process.lags == (40.0,)


def test_a_level_that_is_not_seen_fills_as_fast_as_its_tuning_says():
    """Of an integrator tuned by lambda K = 1/(rate x), Ti = 4 x with any x."""
    random, rate, x = np.random.default_rng(0), -4e-4, 300.0
    K, Ti = 1.0 / (rate * x), 4.0 * x
    record = record_from_arrays(0.5, 0.5 + 0.001 * random.normal(size=600), 0.4 + 0.001 * random.normal(size=600),
                                interval=2.0, settings=LoopSettings(K=K, Ti=Ti))
    process = twins_of(record, [0.02])[0].process
    assert process.gain / process.lags[0] == pytest.approx(rate)


@pytest.mark.parametrize("times", [0.01, 0.5, 100.0])
def test_a_fit_answers_within_reason_of_what_the_tuning_suits(times, monkeypatch):
    record = loop()
    monkeypatch.setattr(twins, "model_of", lambda *_, **__: (Process(gain=times, lags=(60.0,)), ()))
    process = twins_of(record, [0.02])[0].process
    assert answer(process, 60.0) == pytest.approx(np.clip(times, 1.0 / UNLIKE, UNLIKE) * (1.0 - np.exp(-1.0)))


def test_an_integrator_without_lag_is_played():
    twin = replace(twins_of(loop(), [0.0])[0], process=Process(gain=0.02, integrating=True))
    later, _, _ = twin.play(Test("manual_test", 200.0, 0.03, (1.0, 0.0, -1.0, 0.0)), 1, around=300.0)
    assert np.ptp(later.measurement[later.state == 3]) > 0.05


def test_what_is_played_again_moves_like_the_record_and_is_the_same_for_the_same_seed():
    record = loop()
    twin = twins_of(record, [0.0])[0]
    later, _, _ = twin.play(Test("wait", 14_400.0), 3)
    again, _, _ = twin.play(Test("wait", 14_400.0), 3)
    other, _, _ = twin.play(Test("wait", 14_400.0), 4)
    np.testing.assert_array_equal(later.measurement, again.measurement)
    assert np.any(later.measurement != other.measurement)
    assert len(later) == 7200
    for name in ("measurement", "output"):
        assert getattr(later, name).std() == pytest.approx(getattr(record, name).std(), rel=0.6)


def test_a_test_in_manual_moves_op_in_its_steps_and_is_marked():
    twin = twins_of(loop(), [0.0])[0]
    test = Test("manual_test", 200.0, 0.03, (1.0, 2.0, 1.0, 0.0))
    later, _, _ = twin.play(test, 1, around=300.0)
    by_hand = later.output[later.state == 3]
    assert len(by_hand) == 400
    assert np.diff(by_hand[[0, 100, 200, 300]]) == pytest.approx([0.03, -0.03, -0.03])
    steps, _, _ = twin.play(Test("setpoint_steps", 200.0, 0.05, (1.0, 0.0)), 1, around=300.0)
    assert np.ptp(steps.setpoint) == pytest.approx(0.05) and not np.any(steps.state == 3)


def test_later_samples_stand_behind_a_hole_and_a_long_hole_ends_a_stretch():
    record = loop(duration=3600.0)
    both = behind(record, record.slice(0, 500))
    assert len(both) == len(record) + 500 and np.all(np.diff(both.index) >= 1)
    assert np.max(np.diff(both.index)) > HOLE
    assert len(longest_stretch(both)) == len(record)


def test_a_course_holds_each_level_and_nothing_before_and_after():
    test = Test("setpoint_steps", 10.0, 0.02, (1.0, -1.0))
    moves = test.course(np.array([-1.0, 0.0, 9.9, 10.0, 19.9, 20.0]))
    np.testing.assert_allclose(moves, [0, 0.02, 0.02, -0.02, -0.02, 0])
    assert test.duration == 20.0


def test_a_limit_in_units_is_a_share_of_the_span():
    assert Move(45.0, of_span=False).share((0.0, 900.0)) == pytest.approx(0.05)
    assert Move(5.0, of_span=False).share((100.0, 0.0)) == pytest.approx(0.05)
    assert Move(0.05).share((0.0, 900.0)) == 0.05
