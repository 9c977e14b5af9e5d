"""Tests of a valve in manual, on the plant simulator that shares nothing with the model (strange_plant)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from backlash_cli.estimator.criteria import weigh
from backlash_cli.estimator.predictor import Recording
from backlash_cli.kernels import play
from backlash_cli.model.manual_test import Answer, manual_test
from backlash_cli.record import FloatArray, Note
from backlash_cli.results import Confirmation
from tests.benchmarks.strange_plant import KARNOPP, control_loop

PERCENT = np.linspace(0, 100, 1001)
HOLD, STEP, LEAD = 120, 3.0, 300  # samples of 1 s, %, samples


def moves(pattern: str, step: float = STEP, hold: int = HOLD) -> FloatArray:
    """OP [%] in manual: u up by a step, d down, 0 stays."""
    return np.repeat(step * np.cumsum([0, *({"u": 1, "d": -1, "0": 0}[c] for c in pattern)]), hold).astype(float)


@dataclass
class Plant:
    """Three lags behind the valve, load at its input, white noise; all in %, samples of 1 s."""

    d: float = 0.0
    gain: float = 1.0
    integ: float = 0.0
    noise: float = 0.05
    load: FloatArray | float = 0.0
    friction: tuple[float, float] = (0.0, 0.0)
    lags: tuple[float, ...] = (12.0, 5.0, 2.0)
    flow: FloatArray = field(default_factory=lambda: PERCENT)
    seed: int = 0

    def recording(self, hand: FloatArray) -> Recording:
        """OP stands at 50 % for LEAD samples, then moves as `hand` says."""
        op = 50.0 + np.append(np.zeros(LEAD), hand)
        zero, n = np.zeros(len(op)), len(op)
        noise = self.noise * np.random.default_rng(self.seed).normal(size=n)
        wall = (KARNOPP, self.friction[0], self.friction[1], self.friction[0], self.friction[1])
        _, pv, _, _, _ = control_loop(
            1.0, 0, zero + 50.0, zero + self.load, zero, noise, zero, op, np.array([0.5, 20, 0, 0, 0, 0, 1.0]),
            np.zeros(5), np.array(self.lags), 4, self.integ, self.gain, 0.0, self.flow, PERCENT, np.zeros(2),
            np.array([self.d, 0.0, 0.0, 0.4]), np.array([1e3, 1.0]), np.array(wall) * any(self.friction), 50.0,
            np.array([0.0, 100.0]))
        return Recording(op, pv, np.arange(n) >= LEAD)


def look(plant: Plant, pattern: str = "uudduudd", K: float | None = 0.5, **how: float) -> Confirmation:
    found = manual_test([plant.recording(moves(pattern, **how))], 1.0, K)
    assert isinstance(found, Confirmation), found
    return found


def wander(n: int, seed: int, size: float = 0.02) -> FloatArray:
    return size * np.cumsum(np.random.default_rng(seed).normal(size=n))


SAMPLES = LEAD + 9 * HOLD
LOADS = {"none": 0.0, "wanders": wander(SAMPLES, 3), "swings": 0.5 * np.sin(np.arange(SAMPLES) / 70.0),
         "jumps": np.where(np.arange(SAMPLES) > 800, 1.5, 0.0)}


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("d", [0.8, 2.0, 3.5])
def test_the_size_is_found_under_any_load(d, load):
    found = look(Plant(d, load=LOADS[load]))
    assert found.d == pytest.approx(d / 100, rel=0.15)
    assert found.ci95[0] <= d / 100 <= found.ci95[1]
    assert weigh(found).clear


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("seed", range(3))
def test_a_healthy_valve_is_cleared_and_never_called(load, seed):
    found = look(Plant(load=LOADS[load], seed=seed))
    assert not weigh(found).some
    assert found.limit_of_detection is not None and found.limit_of_detection <= 0.02


@pytest.mark.parametrize(("plant", "K"), [
    (Plant(2.0, gain=-1.5), -0.4), (Plant(2.0, gain=-1.5), None), (Plant(2.0, gain=0.0, integ=0.004, lags=(3.0,)), 1.0),
    (Plant(2.0, gain=0.0, integ=-0.004, lags=(3.0,)), -1.0), (Plant(2.0, noise=0.0), 0.5)])
def test_sign_level_and_a_pv_without_noise(plant, K):
    found = look(plant, K=K)
    assert weigh(found).clear and found.d == pytest.approx(0.02, rel=0.12)


@pytest.mark.parametrize("integ", [0.004, -0.004])
def test_a_healthy_level_is_not_called(integ):
    for seed in range(4):
        found = look(Plant(gain=0.0, integ=integ, lags=(3.0,), seed=seed, load=wander(SAMPLES, seed)), K=100.0 * integ)
        assert not weigh(found).some


def test_each_test_of_a_level_may_drift_in_its_own_way():
    parts = [Plant(gain=0.0, integ=0.004, lags=(3.0,), seed=i, load=load).recording(moves("udu"))
             for i, load in enumerate((0.0, 2.0, -3.0))]
    found = manual_test(parts, 1.0, 0.5)
    assert isinstance(found, Confirmation) and not weigh(found).some


def test_a_curved_valve_is_no_dead_band():
    curved = PERCENT**1.8 / 50.0**0.8 / 1.8
    for seed in range(4):
        assert not weigh(look(Plant(flow=curved, seed=seed), step=6.0)).some
    assert weigh(look(Plant(3.0, flow=curved), step=6.0)).clear


def test_ramps_tell_as_much_as_steps():
    ramps = np.interp(np.arange(1200), np.arange(0, 1201, 150), [0, 0, 6, 6, 0, 0, 6, 0, 0])
    found = manual_test([Plant(2.0).recording(ramps)], 1.0, 0.5)
    assert isinstance(found, Confirmation) and weigh(found).clear and found.d == pytest.approx(0.02, rel=0.12)


def test_several_tests_count_together():
    parts = [Plant(1.5, noise=0.4, seed=i).recording(moves("uuddu")) for i in range(4)]
    one, all_of_them = (manual_test(some, 1.0, 0.5) for some in (parts[:1], parts))
    assert isinstance(one, Confirmation) and isinstance(all_of_them, Confirmation)
    assert all_of_them.details["evidence"] > 2.0 * float(one.details["evidence"])
    assert weigh(all_of_them).clear and all_of_them.d == pytest.approx(0.015, rel=0.2)


@pytest.mark.parametrize("seed", range(2))
def test_many_steps_under_a_load_that_wanders_are_not_blurred(seed):
    hand = moves("uudd" * 36, step=2.0, hold=20)
    for d in (0.0, 2.0):
        plant = Plant(d, seed=seed, lags=(6.0, 3.0, 2.0), load=wander(LEAD + len(hand), seed))
        found = manual_test([plant.recording(hand)], 1.0, 0.5)
        assert isinstance(found, Confirmation) and weigh(found).clear == (d > 0.0)
        if d:
            assert found.d == pytest.approx(d / 100, rel=0.15)
        else:
            assert found.details["evidence"] < 0.0 and found.limit_of_detection <= 0.02


@pytest.mark.parametrize(("pattern", "code"), [("uuudd", "few_reversals"), ("uuudduu", None)])
def test_one_turn_is_no_proof_however_clear(pattern, code):
    found = look(Plant(2.0), pattern)
    assert float(found.details["evidence"]) > 30.0
    assert [note.code for note in weigh(found).against] == ([code] if code else [])


def test_a_load_that_jumps_when_op_turns_once_is_no_proof():
    hand = moves("uudduu")
    load = np.where(np.arange(LEAD + len(hand)) >= LEAD + 3 * HOLD, 2.0, 0.0)  # all of the first step back
    found = manual_test([Plant(load=load).recording(hand)], 1.0, 0.5)
    assert isinstance(found, Confirmation) and not weigh(found).clear


def test_much_noise_hides_it_and_nothing_is_cleared():
    found = look(Plant(1.0, noise=6.0), "uudd")
    assert not weigh(found).clear and found.limit_of_detection is None


def test_pv_that_does_not_answer_says_how_much_at_least():
    stuck, moving = (manual_test([Plant(d).recording(moves("udud", step=2.0))], 1.0, 0.5, 30.0) for d in (5.0, 1.0))
    assert isinstance(stuck, Note) and stuck.code == "manual_no_answer"
    assert stuck.values["at_least"] == pytest.approx(0.02)
    assert isinstance(moving, Confirmation)


@pytest.mark.parametrize(("change", "code"), [("short", "manual_short"), ("still", "manual_still"),
                                              ("dead", "manual_constant")])
def test_why_nothing_could_be_told(change, code):
    test = Plant(2.0).recording(moves("uudd", step=0.1 if change == "still" else STEP))
    if change == "short":
        test = Recording(test.output[: LEAD + 20], test.measurement[: LEAD + 20], test.usable[: LEAD + 20])
    if change == "dead":
        test = Recording(test.output, np.full(len(test.output), 50.0), test.usable)
    found = manual_test([test], 1.0, 0.5)
    assert isinstance(found, Note) and found.code == code


def test_what_lies_before_tells_where_the_stem_stood():
    """Without it the stem may stand anywhere in its gap; both ways find the size."""
    whole = Plant(2.0).recording(np.append(-moves("u"), moves("uuddu")))
    known = Recording(whole.output, whole.measurement, np.arange(len(whole.output)) >= LEAD + 2 * HOLD)
    cut = Recording(*(a[LEAD + 2 * HOLD :] for a in (known.output, known.measurement, known.usable)))
    for test in (known, cut):
        found = manual_test([test], 1.0, 0.5)
        assert isinstance(found, Confirmation) and found.d == pytest.approx(0.02, rel=0.1)


def test_a_sticking_valve_looks_like_play():
    found = look(Plant(friction=(1.2, 0.6)), "uuudduuddd")
    assert float(found.details["evidence"]) > 6.0


@pytest.mark.parametrize("answer", [Answer(10.0), Answer(10.0, 6.0, 5.0), Answer(20.0, integrating=True)])
def test_answers_are_those_of_their_differential_equations(answer):
    """Against small Euler steps. A step at 1 s acts from there on."""
    fine, h = 1000, 1.0
    u = np.append(np.zeros(5), np.ones(60))
    x = np.zeros(3)
    expected = []
    line = np.repeat(u, fine)
    for k in range(len(line)):
        if k % fine == 0:
            expected.append(x[2] if answer.integrating else x[1] if answer.second else x[0])
        wanted = line[k - int(answer.delay * fine)] if k >= answer.delay * fine else 0.0
        x += np.array([(wanted - x[0]) / answer.lag, (x[0] - x[1]) / max(answer.second, 1e-9) if answer.second else 0.0,
                       x[0] / answer.lag]) * h / fine
    tolerance = 0.05 if answer.second or answer.integrating else 1e-3  # the second stage holds its input for a sample
    np.testing.assert_allclose(answer.of(u, h), expected, atol=tolerance)


def test_at_no_dead_band_the_stem_is_op():
    u = wander(200, 1)
    np.testing.assert_array_equal(play(u, 0.0, u[0] + 3.0), u)


SMALL_STEPS = "duduuduuddd"  # of 1.8 %, over 5.4 % in all


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_gap_too_wide_to_be_missed_is_refuted_by_each_small_answer(seed):
    """Of a gap as wide as OP moves little evidence would come; but PV could not answer each step, as it does here."""
    load = wander(LEAD + 12 * HOLD, seed, 0.2)
    limit = look(Plant(seed=seed, load=load, noise=0.1), SMALL_STEPS, step=1.8).limit_of_detection
    assert limit is not None and limit < 0.02
    for d in (2.5, 3.5, 4.5):  # and where there is one, no limit lies below it
        limit = look(Plant(d, seed=seed, load=load, noise=0.1), SMALL_STEPS, step=1.8).limit_of_detection
        assert limit is None or limit > d / 100
