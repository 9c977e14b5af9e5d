"""The published equations against hand-computed and brute-force numbers."""

import numpy as np
import pytest

from backlash_cli.estimator.haegglund import WHY, dead_band, estimate, gate, mean_error, output_change
from backlash_cli.half_periods import Segments
from backlash_cli.record import LoopSettings


def test_estimate_is_output_travel_minus_the_part_that_moves_the_process():
    rng = np.random.default_rng(3)
    dy, dt = rng.uniform(0.001, 0.05, 50), rng.uniform(1, 500, 50)
    K, Ti, Kp = 0.6, 28.0, 1.3
    travel = output_change(dy, dt, K, Ti)
    np.testing.assert_allclose(travel, K / Ti * dy * dt)
    np.testing.assert_allclose(dead_band(dy, dt, K, Ti, Kp), travel - dy / Kp)


@pytest.mark.parametrize("Kp, error", [(1.0, 0.22), (3.4, -0.17)])
def test_default_process_gain_costs_at_most_what_the_paper_says(Kp, error):
    """Section 4: with K Kp = 0.5 at dt = 5 Ti the default Kp = 1.5 errs by less than about 20 %."""
    K = 0.5
    one, dt, Ti = np.array([1.0]), np.array([5.0]), 1.0
    ratio = dead_band(one, dt, K, Ti, 1.5) / dead_band(one, dt, K, Ti, Kp) - 1
    assert ratio[0] == pytest.approx(error, abs=0.01)


def test_mean_error_of_an_empty_half_period_is_zero():
    assert (mean_error(0.0, 0.0), mean_error(4.0, 2.0)) == (0.0, 2.0)


def test_gates_at_their_edges():
    duration, e_max = np.array([9.99, 10.0, 10.0, 10.0, 10.0]), np.array([0.01, 0.0199, 0.02, 0.01, 0.01])
    complete, d = np.array([True, True, True, False, True]), np.array([1.0, 1.0, 1.0, 1.0, 0.0])
    found = gate(duration, np.full(5, 0.01), e_max, complete, d, 2.0)
    assert [WHY[code] for code in found] == ["too_short", "ok", "shape", "incomplete", "not_positive"]


def test_the_estimates_are_the_rule_half_period_by_half_period():
    rng = np.random.default_rng(7)
    n, h, K, Ti, Kp = 400, 0.5, -0.1, 4.0, 1.3
    begin = np.cumsum(rng.uniform(0.0, 100.0, n))
    end, area = begin + rng.choice([0.0, 30.0, 60.0, 100.0], n), rng.uniform(0.0, 2.0, n)
    e_max, complete = rng.uniform(0.0, 0.2, n), rng.random(n) < 0.9
    s = Segments(begin, end, area, e_max, np.ones(n, np.int64), np.zeros(n), complete)
    found = estimate(s, h, LoopSettings(K=K, Ti=Ti, Kp=Kp))
    for k in range(n):
        dt = (end[k] - begin[k]) * h
        dy = area[k] * h / dt if dt else 0.0
        d = (abs(K) * dt / Ti - 1.0 / Kp) * dy
        np.testing.assert_allclose([found.begin[k], found.dt_s[k], found.dy[k], found.d[k]],
                                   [begin[k] * h, dt, dy, d], rtol=1e-12, atol=1e-15)
        why = ("incomplete" if not complete[k] else "too_short" if dt < 5 * Ti else "shape" if e_max[k] >= 2 * dy
               else "ok" if d > 0.0 else "not_positive")
        assert found[k].why == why
    assert len(set(found.why)) == 5


def test_an_exact_dead_band_transit_gives_d_back():
    """The error rests at e0 while the integral walks the output across d; then the valve moves the process by dy."""
    K, Ti, Kp, d, e0 = 0.6, 28.0, 1.3, 0.03, 0.004
    duration = (d + e0 / Kp) * Ti / (K * e0)
    s = Segments(np.array([0.0]), np.array([duration]), np.array([e0 * duration]), np.array([e0]),
                 np.array([1]), np.array([0.0]), np.array([True]))
    found = estimate(s, 1.0, LoopSettings(K=K, Ti=Ti, Kp=Kp))
    assert found.d[0] == pytest.approx(d, rel=1e-12) and found[0].why == "ok"
