"""Loops driven by their load: who moves OP, what is known ahead, and a gap that the load shows."""

from __future__ import annotations

import numpy as np
import pytest

from backlash_cli.effects.process import delayed_lag
from backlash_cli.model import compare, explain
from backlash_cli.model.noise import Noise, known_load, whitener
from backlash_cli.model.problem import horizon, moved_from_outside, trust
from tests.benchmarks.driven_loops import draw


def test_share_moved_from_outside_is_that_of_the_setpoint_and_of_the_hand() -> None:
    random = np.random.default_rng(0)
    n = 4000
    everywhere, never = np.ones(n, dtype=bool), np.zeros(n, dtype=bool)
    setpoint = np.repeat(random.uniform(0.4, 0.6, 20), n // 20)
    answer = delayed_lag(setpoint, 1.0, 30.0, 0.0)
    load = delayed_lag(random.standard_normal(n), 1.0, 20.0, 0.0)
    load *= answer.std() / load.std()
    still = np.full(n, 0.5)
    assert moved_from_outside(answer, setpoint, never, everywhere, 1.0) > 0.97
    assert moved_from_outside(load, still, never, everywhere, 1.0) == pytest.approx(0.0, abs=1e-9)
    assert moved_from_outside(answer + load, setpoint, never, everywhere, 1.0) == pytest.approx(0.5, abs=0.1)
    assert moved_from_outside(load, still, everywhere, everywhere, 1.0) > 0.97
    assert (trust(0.0), trust(0.5), trust(1.0)) == (0.0, 0.5, 1.0)


def test_horizon_is_half_of_ti_or_when_pv_has_moved() -> None:
    random = np.random.default_rng(1)
    noise = 0.001 * random.standard_normal(5000)
    walk = np.cumsum(0.001 * random.standard_normal(5000))
    assert horizon(walk, 0.001, 1.0, 40.0) == 20
    # the walk moves by 0.001 sqrt(m), the noise adds 0.001 sqrt(2): 2 sqrt(2) times 0.001 needs m = 6
    assert horizon(walk + noise, 0.001, 1.0, None) == pytest.approx(6, abs=1)


@pytest.mark.parametrize("slow", [40.0, 8.0])
@pytest.mark.parametrize("ahead", [1, 2, 7])
def test_known_load_is_the_filter_run_on_without_measurements(slow: float, ahead: int) -> None:
    random = np.random.default_rng(2)
    n, h, noise = 60, 1.0, Noise(3.0, slow, 8.0)
    used = random.random(n) < 0.9
    error = random.standard_normal(n)
    got = known_load(error, used, h, noise, ahead)
    for k in (5, 20, 59):
        # what comes later than `ahead` samples before is hidden: the filter runs on by itself
        seen = used.copy()
        seen[max(k - ahead + 1, 0) : k] = False
        white = whitener(noise, seen, h)
        innovation = white.columns(np.where(seen, error, 0.0))[k]
        if seen[k]:
            assert error[k] - got[k] == pytest.approx(innovation / white.weight[k], abs=1e-6)


def test_friction_is_found_at_a_fixed_setpoint_and_none_in_a_healthy_valve() -> None:
    for sticks in (True, False):
        case = draw(102, "coloured", friction=sticks)
        found = explain(case.record)
        names = {e.effect for e in found.effects}
        assert [n.code for n in found.warnings] == ["load_driven"]
        assert bool(names & {"backlash", "stiction"}) == sticks
        if sticks:
            assert found.effects[0].parameters["d"].value == pytest.approx(case.d, rel=0.08)
            assert found.rmse_holdout < found.baseline.rmse_holdout
            kept = compare(case.record, found.model)
            assert kept.fitness.rmse_holdout < kept.baseline.rmse_holdout
