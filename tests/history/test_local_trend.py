"""The local trend against closed forms and brute force, and wear of four kinds that is followed as it is told."""

import numpy as np
import pytest

from backlash_cli.history.local_trend import (
    LINE,
    Nights,
    Shocks,
    Way,
    _apart,
    _steps,
    evidence,
    find_shocks,
    fit,
    smoothed,
)
from backlash_cli.history.trend import wear
from backlash_cli.results import Verdict
from backlash_cli.results.history import Limit
from tests.benchmarks.wear import KINDS, judged, made, repairs, scored, sixty_nights


def nights(n=30, seed=0, error=0.001):
    rng = np.random.default_rng(seed)
    days = np.sort(rng.choice(60, n, replace=False)).astype(float)
    return Nights(days, 0.02 + 0.0003 * days + error * rng.normal(size=n), np.full(n, error))


def least_squares(found, columns):
    """Coefficients and their covariance of a weighted fit of the sizes."""
    x = np.column_stack(columns) / found.error[:, None]
    cov = np.linalg.inv(x.T @ x)
    return cov @ x.T @ (found.size / found.error), cov


def test_a_straight_line_is_that_of_weighted_least_squares():
    found = nights()
    found = Nights(found.days, found.size, found.error * np.random.default_rng(1).uniform(0.5, 2.0, len(found)))
    (level, slope), cov = least_squares(found, [np.ones(len(found)), found.days])
    result = smoothed(found, LINE, Shocks())
    np.testing.assert_allclose(result.smoothed_state[0], level + slope * found.days, rtol=2e-4)
    np.testing.assert_allclose(result.smoothed_state[1], slope, rtol=2e-3)
    np.testing.assert_allclose(result.smoothed_state_cov[1, 1], cov[1, 1], rtol=5e-3)


def test_a_bending_trend_is_the_mean_of_a_gaussian_process():
    """An integrated random walk about a line: its covariance is known, the smoother must give the same mean."""
    found, way = nights(), Way(1, 8.0)
    t, n = found.days - found.days[0], len(found)
    step = np.median(np.diff(found.days))
    q = found.error[0] ** 2 / (8.0**4 * step**3)
    low = np.minimum(t[:, None], t)
    wander = q * (low**2 * np.maximum(t[:, None], t) / 2 - low**3 / 6)
    usual, span = np.median(found.size), t[-1]
    prior = (3 * usual) ** 2 * (1 + t[:, None] * t / span**2) + wander
    mean = usual + prior @ np.linalg.solve(prior + np.diag(found.error**2), found.size - usual)
    np.testing.assert_allclose(smoothed(found, way, Shocks()).smoothed_state[0], mean, rtol=1e-6)
    whole = prior + np.diag(found.error**2)
    z = found.size - usual
    total = 30.0 + z @ np.linalg.solve(whole, z)
    expected = -0.5 * np.linalg.slogdet(whole)[1] - 0.5 * (30.0 + n) * np.log(total / 30.0)
    assert evidence(smoothed(found, way, Shocks()))[0] == pytest.approx(expected, rel=1e-6)


def test_shocks_are_told_as_by_fits_with_a_step_or_without_the_night():
    found = nights()
    result = smoothed(found, LINE, Shocks())
    n, ones = len(found), np.ones(len(found))
    for k in (5, 12, 20):
        for shape, mine in (((np.arange(n) >= k) * 1.0, _steps(result)), ((np.arange(n) == k) * 1.0, _apart(result))):
            value, cov = least_squares(found, [ones, found.days, shape])
            assert mine[k] == pytest.approx(abs(value[2]) / np.sqrt(cov[2, 2]), rel=5e-3)


def test_a_bad_night_and_a_step_are_told_apart():
    found = nights(40, error=0.0005)
    size = found.size.copy()
    size[12] *= 1.8
    size[25:] += 0.006
    shocks = find_shocks(Nights(found.days, size, found.error))
    assert shocks.apart == (12,) and shocks.steps == (25,)
    trend = fit(Nights(found.days, size, found.error), shocks)
    assert trend.level[-1] == pytest.approx(0.026 + 0.0003 * found.days[-1], rel=0.02)
    assert trend.level[12] == pytest.approx(0.02 + 0.0003 * found.days[12], rel=0.02)


@pytest.mark.parametrize("limit", [0.025, 0.04])
def test_the_date_of_an_exact_line_is_exact(limit):
    days = np.arange(40.0)
    trend = fit(Nights(days, 0.02 + 0.0003 * days, np.full(40, 1e-4)), Shocks())
    value, early, late = trend.reaches(limit)
    assert value == pytest.approx((limit - 0.02) / 0.0003, abs=0.1) and early < value < late


def test_the_sixty_nights_that_grow_ever_faster():
    for seed in range(3):
        history, found = sixty_nights(seed)
        score = scored(history, found)
        assert abs(score.level) < 0.05 and abs(score.slope) < 0.15 and score.date_hit
        assert found.model == "local" and found.held_out.line > 3 * found.held_out.local and found.held_out.bias > 0.003


@pytest.mark.parametrize("kind", KINDS)
def test_wear_of_every_kind_is_followed(kind):
    """A few of the 200 histories of the benchmark; its whole table is in docs/reading-the-report.md."""
    scores = judged(kind, 12)
    assert np.median(np.abs([s.level for s in scores])) < 0.05
    assert sum(s.level_hit for s in scores) >= 10
    assert np.nanmean([s.date_hit for s in scores]) >= 0.7
    assert sum(s.repairs > 0 for s in scores) <= 1
    if kind in ("linear", "accelerating"):
        assert sum(s.model == {"linear": "line", "accelerating": "local"}[kind] for s in scores) >= 10


def test_repairs_are_found_among_missed_nights_and_few_that_are_none():
    found, false = repairs(16)
    assert found >= 0.75 and false <= 0.1


def test_missed_nights_in_a_row_are_no_repair_and_a_long_silence_is():
    history = made("linear", 1)
    sized = [n for n in history.nights if n.measured][:40]
    silent = [n.__class__("X", n.start, n.end, Verdict.NO_BACKLASH, 0.8, limit_of_detection=0.4 * n.d) for n in sized]
    few = [*sized[:20], *silent[20:23], *sized[23:]]
    assert not wear("X", few, (), Limit(0.05, "a", "test")).repairs
    long = [*sized[:20], *silent[20:]]
    (repair,) = wear("X", long, (), Limit(0.05, "a", "test")).repairs
    assert repair.found and sized[19].time < repair.time <= silent[20].time
