"""The robust line against SciPy, against closed forms, and against simulation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import theilslopes

from backlash_cli.history.robust_line import kendall_variance, robust_line


def line(t, y, weight=None, low=None):
    y = np.asarray(y, float)
    return robust_line(np.asarray(t, float), y if low is None else np.asarray(low, float), y,
                       np.ones(len(y)) if weight is None else np.asarray(weight, float))


@given(st.integers(5, 80), st.integers(0, 10**6))
def test_with_equal_weights_it_is_theil_sen_as_in_scipy(n, seed):
    rng = np.random.default_rng(seed)
    t, y = np.sort(rng.uniform(0, 60, n)), rng.normal(size=n)
    slope, _, low, high = theilslopes(y, t)
    found = line(t, y)
    assert found.slope == pytest.approx(slope)
    slopes = np.sort([(y[j] - y[i]) / (t[j] - t[i]) for i in range(n) for j in range(i + 1, n)])
    # SciPy rounds the ranks of both ends, so that they may differ by a few places among n (n - 1) / 2 slopes
    for mine, theirs in zip(found.slope_ci, (low, high), strict=True):
        assert abs(int(np.searchsorted(slopes, mine)) - int(np.searchsorted(slopes, theirs))) <= 2


def test_the_variance_is_kendalls_with_equal_weights_and_counted_with_others():
    assert kendall_variance(np.arange(9.0), np.ones(9)) == pytest.approx(9 * 8 * 23 / 18)
    rng = np.random.default_rng(0)
    t, w = np.arange(12.0), rng.uniform(0.1, 1, 12)
    a = np.triu(np.outer(w, w), 1)
    y = rng.normal(size=(20000, 12))
    s = (a * np.sign(y[:, None, :] - y[:, :, None])).sum(axis=(1, 2))
    assert s.var() == pytest.approx(kendall_variance(t, w), rel=0.05)


@given(st.floats(-1, 1), st.floats(-1, 1), st.integers(5, 30))
def test_an_exact_line_is_returned_exactly(a, b, n):
    found = line(np.arange(n), a + b * np.arange(n))
    assert found.slope == pytest.approx(b, abs=1e-12) and found.at(3.0) == pytest.approx(a + 3 * b, abs=1e-9)


def test_a_quarter_of_outliers_does_not_bend_it():
    rng = np.random.default_rng(3)
    y = 0.01 + 0.0005 * np.arange(60) + 0.001 * rng.normal(size=60)
    y[rng.permutation(60)[:15]] = 0.10
    assert line(np.arange(60), y).slope == pytest.approx(0.0005, rel=0.25)


def test_a_light_point_pulls_less():
    y = np.arange(9.0)
    y[8] = 30.0
    heavy, light = line(np.arange(9), y), line(np.arange(9), y, weight=[1] * 8 + [0.01])
    assert light.slope_ci[1] <= heavy.slope_ci[1] and light.slope == 1.0


def test_bounds_pull_only_where_the_order_is_certain():
    t, d = np.arange(30.0), 0.002 + 0.001 * np.arange(30.0)
    low, high = d.copy(), d.copy()
    low[:14], high[:14] = 0.0, 0.016  # below detection: truth is 0.002 .. 0.015
    without = line(t[14:], d[14:])
    found = line(t, high, low=low)
    assert without.slope == pytest.approx(found.slope, rel=0.02) == 0.001
    naive = line(t, high)
    assert naive.slope < 0.0009


def test_too_few_points_have_no_interval():
    assert line([0.0, 1.0, 2.0, 3.0], [1.0, 2.0, 3.0, 4.0]).slope_ci is None
    assert line([0.0], [1.0]).slope == 0.0


def test_a_line_that_may_be_level_reaches_no_limit():
    rng = np.random.default_rng(1)
    assert line(np.arange(20), rng.normal(size=20)).reaches(5.0) is None
    value, early, late = line(np.arange(20), np.arange(20) + 0.5 * rng.normal(size=20)).reaches(40.0)
    assert early < value < late and value == pytest.approx(40.0, abs=4)
    past = line(np.arange(20), np.arange(20) + 0.5 * rng.normal(size=20)).reaches(5.0)
    assert past[1] < past[0] < past[2] and past[0] == pytest.approx(5.0, abs=1)


def test_both_intervals_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(5)
    t = np.arange(40.0)
    hits = np.zeros(3)
    for _ in range(400):
        d = (0.01 + 0.0005 * t) * (1 + 0.08 * rng.standard_t(4, 40))
        found = line(t, d)
        _, early, late = found.reaches(0.03)
        low, high = found.interval_at(39.0)
        hits += [found.slope_ci[0] <= 0.0005 <= found.slope_ci[1], early <= 40.0 <= late,
                 low <= 0.01 + 0.0005 * 39 <= high]
    assert np.all(hits / 400 > 0.90), hits / 400
