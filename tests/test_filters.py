"""The sampled filters against the state-space discretisation and the closed-form step response."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from backlash_cli.filters import double_lag


@given(T=st.floats(0.05, 500), h=st.floats(0.01, 60))
def test_coefficients_equal_the_exact_discretisation_of_the_state_space(T, h):
    A, B = np.array([[-1 / T, 0], [1 / T, -1 / T]]), np.array([[1 / T], [0]])
    discrete = signal.cont2discrete((A, B, np.array([[0, 1.0]]), np.zeros((1, 1))), h)
    numerator, denominator = signal.ss2tf(*discrete[:4])
    ours = double_lag(T, h)
    np.testing.assert_allclose(ours.denominator, denominator, atol=1e-12)
    np.testing.assert_allclose(ours.numerator, numerator[0], atol=1e-9)


def test_step_response_is_the_closed_form_at_every_sample():
    T, h = 3.0, 0.7
    stage = double_lag(T, h)
    out, _ = stage.run(np.ones(50), stage.settled(0.0))
    t = h * np.arange(50)
    np.testing.assert_allclose(out, 1 - (1 + t / T) * np.exp(-t / T), atol=1e-12)


def test_settled_filter_stays_at_rest():
    stage = double_lag(2.0, 1.0)
    out, _ = stage.run(np.full(20, 0.37), stage.settled(0.37))
    np.testing.assert_allclose(out, 0.37, rtol=1e-13)


def test_time_constant_zero_is_the_identity():
    values = np.random.default_rng(0).normal(size=9)
    stage = double_lag(0.0, 1.0)
    np.testing.assert_array_equal(stage.run(values, stage.settled(0.0))[0], values)


@pytest.mark.parametrize("T, h", [(1.0, 0.0), (-1.0, 1.0)])
def test_impossible_times_are_refused(T, h):
    with pytest.raises(ValueError):
        double_lag(T, h)


def test_runs_like_the_library_filter_from_any_state():
    rng = np.random.default_rng(2)
    stage, values, state = double_lag(4.0, 1.0), rng.normal(size=200), rng.normal(size=2)
    expected, after = signal.lfilter(stage.numerator, stage.denominator, values, zi=state)
    out, new = stage.run(values, state)
    np.testing.assert_allclose(out, expected, rtol=1e-12)
    np.testing.assert_allclose(new, after, rtol=1e-12)
