"""The local trend against closed forms and brute force, and wear of four kinds that is followed as it is told."""

from functools import cache

import numpy as np
import pytest
from statsmodels.tsa.statespace.structural import UnobservedComponents

from backlash_cli.history.local_trend import LINE, Fit, Nights, Way, _quantiles, find_shocks, fit
from backlash_cli.history.trend import wear
from backlash_cli.results import Verdict
from backlash_cli.results.history import Limit
from tests.benchmarks import wear as benchmark
from tests.benchmarks.wear import BENDING, KINDS, judged, made, repairs, scored

sixty_nights = cache(benchmark.sixty_nights)  # several tests look at the same ones


def measured(days, size, error):
    return Nights(days, size, error, *np.zeros((2, len(days)), bool))


def nights(n=30, seed=0, error=0.001):
    rng = np.random.default_rng(seed)
    days = np.sort(rng.choice(60, n, replace=False)).astype(float)
    return measured(days, 0.02 + 0.0003 * days + error * rng.normal(size=n), np.full(n, error))


def least_squares(found, columns):
    """Coefficients and their covariance of a weighted fit of the sizes."""
    x = np.column_stack(columns) / found.error[:, None]
    cov = np.linalg.inv(x.T @ x)
    return cov @ x.T @ (found.size / found.error), cov


def test_a_straight_line_is_that_of_weighted_least_squares():
    found = nights()
    found = measured(found.days, found.size, found.error * np.random.default_rng(1).uniform(0.5, 2.0, len(found)))
    (level, slope), cov = least_squares(found, [np.ones(len(found)), found.days])
    line = Fit(found, LINE)
    mean, error = line.foreseen(found.days, 30.0)
    np.testing.assert_allclose(mean[:-1], level + slope * found.days, rtol=2e-4)
    assert mean[-1] == pytest.approx(slope, rel=2e-3)
    assert error[-1] ** 2 / line.scale == pytest.approx(cov[1, 1], rel=5e-3)


def test_a_bending_trend_has_the_covariance_of_an_integrated_random_walk():
    """In closed form, Rasmussen and Williams, equation 6.28, on top of a line of unknown level and growth."""
    found, way = nights(), Way(1, 8.0)
    t = found.days - found.days[0]
    q = found.error[0] ** 2 / (8.0**4 * np.median(np.diff(found.days)) ** 3)
    low = np.minimum(t[:, None], t)
    wander = q * (low**2 * np.maximum(t[:, None], t) / 2 - low**3 / 6)
    line = (3 * np.median(found.size)) ** 2 * (1 + t[:, None] * t / t[-1] ** 2)
    columns = found.unknowns(way, found.days)
    np.testing.assert_allclose(columns @ columns.T - line, wander, rtol=0.02, atol=2e-3 * wander.max())


def test_level_and_evidence_are_those_of_the_kalman_smoother_of_statsmodels():
    """Its random walk with a deterministic trend, started from the same spread of level and slope."""
    days, rng = np.arange(40.0), np.random.default_rng(3)
    found = measured(days, 0.02 + 0.0003 * days + 0.001 * rng.normal(size=40), np.full(40, 0.001))
    gain, far = 0.001**2 / 4.0**2, 9 * np.median(found.size) ** 2
    model = UnobservedComponents(found.size - np.median(found.size), "lldtrend")
    model.ssm.loglikelihood_burn = 0
    model.ssm.initialize_known(np.zeros(2), np.diag([far, far / 39.0**2]))
    known = model.smooth([0.001**2, gain])
    mine = Fit(found, Way(0, 4.0))
    mean, error = mine.foreseen(np.arange(50.0), 30.0)
    np.testing.assert_allclose(mean[:40], np.median(found.size) + known.smoothed_state[0], rtol=1e-9)
    np.testing.assert_allclose(error[:40] ** 2 / mine.scale, known.smoothed_state_cov[0, 0], rtol=1e-7)
    ahead = known.get_forecast(10)
    np.testing.assert_allclose(mean[40:50], np.median(found.size) + ahead.predicted_mean, rtol=1e-9)
    np.testing.assert_allclose(error[40:50] ** 2 / mine.scale, ahead.var_pred_mean - 0.001**2, rtol=1e-7)
    # both with the noise as it is: the scale integrated out puts a Student distribution in place of the normal one
    off = known.standardized_forecasts_error[0]
    student = -0.5 * (30.0 + 40) * np.log1p((off**2).sum() / 30.0)
    normal = -0.5 * (off**2).sum() - 20 * np.log(2 * np.pi)
    assert mine.evidence == pytest.approx(known.llf - normal + student, rel=1e-9)


def test_shocks_are_told_as_by_fits_with_a_step_or_without_the_night():
    found = nights()
    steps, apart = Fit(found, LINE).shocks()
    n, ones = len(found), np.ones(len(found))
    for k in (5, 12, 20):
        for shape, mine in (((np.arange(n) >= k) * 1.0, steps), ((np.arange(n) == k) * 1.0, apart)):
            value, cov = least_squares(found, [ones, found.days, shape])
            assert mine[k] == pytest.approx(abs(value[2]) / np.sqrt(cov[2, 2]), rel=5e-3)


def test_quantiles_of_ways_that_disagree_are_those_of_their_mixture():
    from scipy.stats import norm

    mean, error, weight = np.array([[0.0], [3.0]]), np.array([[1.0], [0.5]]), np.array([0.3, 0.7])
    for share, point in zip((0.5, 0.025, 0.975), _quantiles(mean, error, weight)[:, 0], strict=True):
        assert 0.3 * norm.cdf(point) + 0.7 * norm.cdf(point, 3.0, 0.5) == pytest.approx(share, abs=1e-9)


@pytest.mark.parametrize("rate", [-4.0, -2.0, 1.0, 2.5])
def test_a_curve_that_goes_on_is_foreseen(rate):
    """Without noise: the level 20 days on, and the growth of the last month, of an exponential between the ways."""
    days = np.arange(60.0)
    curve = 0.01 + 0.03 * np.expm1(rate * np.arange(80.0) / 59) / np.expm1(rate)
    trend = fit(measured(days, curve[:60], np.full(60, 2e-4)))
    assert trend.slope[0] == pytest.approx((curve[59] - curve[29]) / 30, rel=0.03)
    assert trend.at(79.0)[0] == pytest.approx(curve[79], rel=0.03)


def test_a_bad_night_and_a_step_are_told_apart():
    found = nights(40, error=0.0005)
    size = found.size.copy()
    size[12] *= 1.8
    size[25:] += 0.006
    shocks = find_shocks(measured(found.days, size, found.error))
    assert np.flatnonzero(shocks.apart).tolist() == [12] and np.flatnonzero(shocks.steps).tolist() == [25]
    trend = fit(shocks)
    assert trend.level[39] == pytest.approx(0.026 + 0.0003 * found.days[-1], rel=0.02)
    assert trend.level[12] == pytest.approx(0.02 + 0.0003 * found.days[12], rel=0.02)


@pytest.mark.parametrize("limit", [0.025, 0.04])
def test_the_date_of_an_exact_line_is_exact(limit):
    days = np.arange(40.0)
    trend = fit(measured(days, 0.02 + 0.0003 * days, np.full(40, 1e-4)))
    value, early, late = trend.reaches(limit)
    assert value == pytest.approx((limit - 0.02) / 0.0003, abs=0.1) and early < value < late


def test_the_sixty_nights_that_grow_ever_faster():
    for seed in range(3):
        history, found = sixty_nights("exponential", seed)
        score = scored(history, found)
        assert abs(score.level) < 0.05 and abs(score.slope) < 0.15 and score.date_hit
        assert found.model == "local" and found.held_out.straight_line_error > 3 * found.held_out.local_error
        assert found.held_out.straight_line_bias > 0.003


@pytest.mark.parametrize("kind", BENDING)
def test_sixty_nights_are_followed_however_they_bend(kind):
    for seed in range(2):
        score = scored(*sixty_nights(kind, seed))
        assert abs(score.level) < 0.05 and abs(score.slope) < 0.15


def test_the_interval_of_wear_that_sets_in_late_holds_the_truth():
    scores = [scored(*sixty_nights(kind, seed)) for kind in ("kinked", "begun half way", "begun late")
              for seed in range(4)]
    assert sum(s.level_hit for s in scores) >= 11 and not sum(s.repairs for s in scores)


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
    found, false = repairs(10)
    assert found >= 0.75 and false <= 0.1


def test_missed_nights_in_a_row_are_no_repair_and_a_long_silence_is():
    history = made("linear", 1)
    sized = [n for n in history.nights if n.d is not None][:40]
    silent = [n.__class__("X", n.start, n.end, Verdict.NO_BACKLASH, 0.8, limit_of_detection=0.4 * n.d) for n in sized]
    few = [*sized[:20], *silent[20:23], *sized[23:]]
    assert not wear("X", few, (), Limit(0.05, "a", "test")).repairs
    long = [*sized[:20], *silent[20:]]
    (repair,) = wear("X", long, (), Limit(0.05, "a", "test")).repairs
    assert repair.found and sized[19].time < repair.time <= silent[20].time
