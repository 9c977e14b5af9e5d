"""Which dead bands a record excludes: the signs, the chance, and the limit that follows."""

import numpy as np
import pytest

from backlash_cli.estimator.gap_test import GapTest
from backlash_cli.estimator.width_profile import CONSTANT, HIDDEN, LIMITS, WEIGHTS, chance_hidden, excluded, signs

WIDTHS = np.array([0.5, 1.0, 2.0, 4.0, 8.0])


def gap(gain, share, deviation) -> GapTest:
    gain, share, deviation = (np.broadcast_to(np.asarray(v, float), WIDTHS.shape) for v in (gain, share, deviation))
    return GapTest(WIDTHS, gain, share, deviation, np.zeros(5), np.zeros(5, bool), np.zeros(5), np.ones(5), np.zeros(5))


def test_the_signs_are_those_that_are_written_down():
    one = gap([90, 80, 4, 2, 1], [1, 1, 0.2, 0.1, 0.3], 0.1)
    two = gap([70, 66, 6, 0, 0], [1, 1, 0.6, 0.0, 0.1], 0.2)
    found = signs([one, two], -3.0, length=200.0, moved=6.0)[LIMITS.index(2.0)]
    # gains of 2 % and more: 5, 1, 0.5 in the mean; the first length is 10 above the mean at 0.5 %; 2 % is a width
    expected = [np.log1p(5.0), np.log1p(10.0), -np.log1p(3.0), *np.log([200.0, 3.0]), 0.5 * (50.0 + 12.5)]
    assert found == pytest.approx(expected)


def test_the_chance_is_the_logistic_of_weighted_signs():
    row = np.array([[0.5, 1.0, -2.0, 5.0, 1.0]])
    score = sum(w * x for w, x in zip(WEIGHTS, row[0], strict=True)) + CONSTANT
    assert chance_hidden(row)[0] == pytest.approx(1.0 / (1.0 + np.exp(-score)))


def test_a_trace_of_small_gaps_leaves_larger_ones_excluded():
    """What is known well to be no answer is excluded, though something below it gains a lot."""
    small = gap([9, 7, 0.1, 0.1, 0.1], [1, 0.9, 0.0, 0.0, 0.0], 0.05)
    limit = excluded([small] * 4, -4.0, 3000.0, 12.0)
    assert limit is not None and 0.8 < limit <= 2.8
    assert excluded([gap(0.1, 0.0, 0.2)] * 4, -4.0, 3000.0, 6.0) == LIMITS[0]


def test_nothing_is_excluded_that_would_not_have_shown():
    """Whatever the calibration says of such records: a gap that is there must bring two nats."""
    for deviation, limit in ((0.4, LIMITS[0]), (0.6, None)):
        vague = [gap(0.1, 0.0, deviation)] * 4
        assert chance_hidden(signs(vague, -4.0, 3000.0, 6.0)[:1, :-1])[0] < HIDDEN
        assert excluded(vague, -4.0, 3000.0, 6.0) == limit


def test_op_must_have_moved_twice_as_far_as_the_dead_band_that_it_excludes():
    """What OP hardly crossed is not excluded, however well PV is explained without it."""
    clean = [gap(0.1, 0.0, 0.2)] * 4
    assert excluded(clean, -4.0, 30000.0, 1.7) == LIMITS[0] == 0.8
    assert excluded(clean, -4.0, 30000.0, 1.5) is None


def test_a_longer_record_excludes_more():
    signs_of = [signs([gap(0.5, 0.1, 0.2)] * 3, 0.0, length, 12.0) for length in (30.0, 300.0, 3000.0)]
    rows = [found[LIMITS.index(1.5), :-1] for found in signs_of]
    assert np.all(np.diff(chance_hidden(np.array(rows))) < 0.0)
