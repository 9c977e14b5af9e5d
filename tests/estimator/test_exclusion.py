"""Which dead bands a record excludes: the signs, the chance, and the limit that follows."""

import numpy as np
import pytest

from backlash_cli.estimator.exclusion import CONSTANT, HIDDEN, LIMITS, SHORT_OF, WEIGHTS, chance_hidden, excluded, signs
from backlash_cli.estimator.gap_test import GapTest

WIDTHS = np.array([0.5, 1.0, 2.0, 4.0, 8.0])


def gap(free, share, deviation, tied) -> GapTest:
    free, *full = (np.broadcast_to(np.asarray(v, float), WIDTHS.shape) for v in (free, share, deviation, tied))
    return GapTest(WIDTHS, np.zeros(5), *full, np.zeros(5, bool), np.zeros(5), np.ones(5), free)


def test_the_signs_are_those_that_are_written_down():
    one = gap([90, 80, 4, 2, 1], [1, 1, 0.2, 0.1, 0.3], 0.1, [50, 40, -3, -6, -9])
    two = gap([70, 60, 6, 0, 0], [1, 1, 0.5, 0.0, 0.1], 0.2, [20, 20, -1, -2, -3])
    found = signs([(one, 2.0), (two, 4.0)], length=200.0, span=6.0)[LIMITS.index(2.0)]
    # widths of 1.7 to 5 count: 2 and 4; nets 4 - 1 and 6 - 2, shortfall 6 and 1.5 deviations, tied -3 and -1
    expected = [np.log1p(3.5), np.log1p(3.75), -np.log1p(2.0), *np.log([200.0, 3.0, 2.0, 0.15]), 3.75]
    assert found == pytest.approx(expected)


def test_the_chance_is_the_logistic_of_weighted_signs():
    row = np.array([[0.5, 1.0, -2.0, 5.0, 1.0, 0.7, -1.5]])
    score = sum(w * x for w, x in zip(WEIGHTS, row[0], strict=True)) + CONSTANT
    assert chance_hidden(row)[0] == pytest.approx(1.0 / (1.0 + np.exp(-score)))


def test_a_trace_of_small_gaps_leaves_larger_ones_excluded():
    """What is known well to be no answer is excluded, though something below it gains a lot."""
    small = gap([90, 70, 0.1, 0.1, 0.1], [1, 0.9, 0.0, 0.0, 0.0], 0.05, [80, 60, -40, -60, -80])
    limit = excluded([(small, 1.0)] * 4, 300.0, 6.0)
    assert limit is not None and 1.1 < limit <= 2.8
    clean = gap(0.1, 0.0, 0.2, -40.0)
    assert excluded([(clean, 2.0)] * 4, 3000.0, 6.0) == LIMITS[0]


def test_nothing_is_excluded_where_nothing_is_known():
    """Whatever the calibration says of such records: the share itself must be short of full."""
    vague = gap(0.1, 0.5, 0.8, -0.5)
    found = signs([(vague, 1.0)] * 4, 300.0, 12.0)[LIMITS.index(5.6)]
    assert chance_hidden(found[None, :-1])[0] < HIDDEN and found[-1] < SHORT_OF
    assert excluded([(vague, 1.0)] * 4, 300.0, 12.0) is None


def test_where_an_imitation_gains_a_lot_nothing_is_excluded():
    clean = gap(0.1, 0.0, 0.2, -40.0)
    assert excluded([(clean, 2.0)] * 3 + [(clean, 50.0)], 3000.0, 6.0) is not None
    assert excluded([(clean, 2.0)] * 3 + [(clean, 70.0)], 3000.0, 6.0) is None


def test_a_longer_record_excludes_more():
    signs_of = [signs([(gap(0.5, 0.1, 0.2, -3.0), 1.0)] * 3, length, 12.0) for length in (30.0, 300.0, 3000.0)]
    rows = [found[LIMITS.index(1.5), :-1] for found in signs_of]
    assert np.all(np.diff(chance_hidden(np.array(rows))) < 0.0)
