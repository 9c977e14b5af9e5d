"""What is asked of every signal is answered as NumPy answers it."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from backlash_cli.loaders.scaling import normalised
from backlash_cli.loaders.signal_kernel import ENDLESS, UNKNOWN, holds, stands_still, stays_outside

ANY = arrays.arrays(np.float64, st.integers(1, 1200), elements=st.floats(-1e300, 1e300) | st.sampled_from(
    [0.0, -0.0, np.nan, -np.nan, np.inf, -np.inf, 5e-324, 50.0]), fill=st.just(50.0))


@given(ANY, st.sampled_from([(0.0, 1.0), (0.0, 100.0), (-40.0, 260.0), (1e-3, 2e-3)]))
@settings(max_examples=200, deadline=None)
def test_a_signal_is_scaled_and_looked_at_in_one_go(values, span):
    with np.errstate(all="ignore"):
        expected = (values - span[0]) * (1.0 / (span[1] - span[0]))
    found = normalised(values, span)
    np.testing.assert_array_equal(found.values.view(np.int64), expected.view(np.int64))
    assert found.complete == np.isfinite(expected).all()
    if found.complete:
        assert (found.low, found.high) == (expected.min(), expected.max())


@given(ANY)
@settings(max_examples=100, deadline=None)
def test_what_a_signal_holds(values):
    assert holds(values) == ENDLESS * np.isinf(values).any() + UNKNOWN * np.isnan(values).any()


@given(st.lists(st.integers(0, 2), max_size=60))
@settings(max_examples=300, deadline=None)
def test_a_run_of_nine_repeats_is_always_seen(numbers):
    values = np.array(numbers, np.float64)
    five = any(len(set(numbers[k : k + 6])) == 1 for k in range(0, len(numbers) - 5, 5))
    assert stands_still(values) == five
    assert stands_still(np.append(values, [7.0] * 10)) and stands_still(np.append(values[::-1], [7.0] * 10)[::-1])


@given(st.lists(st.sampled_from([0.0, 0.5, 0.5, 1.0, np.nan, -np.inf]), max_size=60),
       st.sampled_from([0, 500, 511, 1023]), st.integers(1, 4))
@settings(max_examples=300, deadline=None)
def test_where_a_signal_stays_at_its_limits(numbers, before, least):
    values = np.concatenate([np.full(before, 0.5), np.array(numbers, np.float64)])
    expected = np.zeros(len(values), bool)
    for first in range(len(values) - least + 1):
        some = values[first : first + least]
        expected[first : first + least] |= ((some <= 0.1) | (some >= 0.9)).all()
    found = stays_outside(values, 0.1, 0.9, least)
    assert (found is None) == (not expected.any())
    assert found is None or found.tolist() == expected.tolist()
