"""The densest group of estimates and the interval of its median."""

import numpy as np
import pytest
from scipy.stats import binom

from backlash_cli.estimator.reading import densest, median_interval


@pytest.mark.parametrize("n", [1, 2, 5, 9, 30, 101, 999, 1001, 5000])
@pytest.mark.parametrize("level", [0.95, 0.8])
def test_ranks_of_the_interval_are_quantiles_of_the_binomial_distribution(n, level):
    rank = max(int(binom.ppf((1 - level) / 2, n, 0.5)) - 1, 0)
    assert median_interval(np.arange(float(n)), level) == (rank, n - 1 - rank)


def test_interval_of_the_median_holds_it_as_often_as_it_says():
    rng = np.random.default_rng(4)
    held = 0
    for _ in range(2000):
        low, high = median_interval(np.sort(rng.exponential(size=25)))
        held += low <= np.log(2) <= high
    assert 0.95 <= held / 2000 <= 0.985


def test_the_larger_of_two_groups_is_taken_and_its_share_said():
    d = np.array([0.01] * 3 + [0.030, 0.031, 0.029, 0.0305, 0.028] + [0.2])
    found = densest(d)
    assert found is not None
    assert (found.n, found.d) == (5, 0.030)
    assert found.share == pytest.approx(5 / 9)
    assert found.ci95[0] <= found.d <= found.ci95[1]


def test_nothing_positive_is_no_group():
    assert densest(np.array([-0.1, 0.0])) is None
