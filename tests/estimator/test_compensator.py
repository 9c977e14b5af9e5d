"""The rule for the compensator gain."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backlash_cli.estimator.compensator import gain_share, recommend
from backlash_cli.results import Cluster, Confirmation


def cluster(d, low):
    return Cluster(d, (low, 2 * d - low), 0.1, 8, 1.0)


def test_pi_loop_gets_four_fifths_of_the_lower_end():
    found = recommend(cluster(0.05, 0.04), None, derivative=False, output_noise=0.0)
    assert found.gain == pytest.approx(0.032)
    assert found.scheme == "error-sign (9)"


def test_derivative_action_halves_the_gain():
    assert recommend(cluster(0.05, 0.04), None, derivative=True, output_noise=0.0).gain == pytest.approx(0.02)


@pytest.mark.parametrize(("noise", "share"), [(0.0, 0.8), (0.04, 0.8), (0.1, 0.5), (0.15, 0.25), (0.17, 0.0)])
def test_share_falls_with_the_noise_on_the_output(noise, share):
    assert gain_share(0.05, derivative=False, output_noise=noise * 0.05)[0] == pytest.approx(share)


def test_the_test_of_pv_against_op_comes_before_the_cluster():
    confirmation = Confirmation(0.03, (0.025, 0.036), 0.3, 40.0)
    found = recommend(cluster(0.05, 0.04), confirmation, derivative=False, output_noise=0.0)
    assert found.gain == pytest.approx(0.02)


def test_nothing_is_recommended_without_a_dead_band_that_is_surely_there():
    assert recommend(None, None, derivative=False, output_noise=0.0) is None
    assert recommend(cluster(0.05, 0.04), None, derivative=False, output_noise=0.0, oscillating=True) is None
    assert recommend(cluster(0.02, 0.0), None, derivative=False, output_noise=0.0) is None
    assert recommend(cluster(0.02, 0.015), None, derivative=False, output_noise=0.01) is None


@given(st.floats(0.002, 0.2), st.floats(0.0, 0.1), st.booleans())
def test_gain_and_noise_stay_inside_the_gap(d, noise, derivative):
    share, why = gain_share(d, derivative=derivative, output_noise=noise)
    assert share == 0.0 or share * d + 5.0 * noise <= d * (1.0 + 1e-9)
    assert why


@given(st.floats(0.002, 0.2), st.floats(0.0, 0.05), st.floats(0.0, 0.05))
def test_more_noise_never_gives_a_larger_gain(d, noise, more):
    quiet, noisy = (gain_share(d, derivative=False, output_noise=n)[0] for n in (noise, noise + more))
    assert noisy <= quiet
