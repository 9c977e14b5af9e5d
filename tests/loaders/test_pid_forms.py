"""Controller settings of every form mean the same controller: checked on the frequency response."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backlash_cli.errors import MetadataError
from backlash_cli.settings.pid_forms import (
    Tuning,
    per_second,
    seconds,
    series_to_ideal,
    to_ideal,
)

OMEGA = np.logspace(-3, 2, 40)
S = 1j * OMEGA
gains = st.floats(0.05, 50).flatmap(lambda k: st.sampled_from([k, -k]))
times = st.floats(0.5, 500)


def ideal(t: Tuning) -> np.ndarray:
    assert t.K is not None and t.Ti is not None
    return t.K * (1 + 1 / (S * t.Ti) + S * t.Td)


@given(gains, times, times)
def test_series_has_the_response_of_its_factors(k, ti, td):
    np.testing.assert_allclose(ideal(series_to_ideal(k, ti, td)), k * (1 + 1 / (S * ti)) * (1 + S * td), rtol=1e-9)


@given(gains, times, times)
def test_parallel_has_the_response_of_its_sum(k, ki, kd):
    sign = np.sign(k)
    want = k + sign * ki / S + sign * kd * S
    found = to_ideal({"K": k, "Ki": sign * ki, "Kd": sign * kd, "form": "parallel"})
    np.testing.assert_allclose(ideal(found), want, rtol=1e-9)


def test_textbook_values():
    # Astrom and Hagglund, Advanced PID Control, eqs 3.6 and 3.7: K' = 2, Ti' = 8, Td' = 2
    assert series_to_ideal(2.0, 8.0, 2.0) == Tuning(2.5, 10.0, 1.6)
    assert to_ideal({"K": 2, "Ti": 8, "Td": 2, "form": "series"}) == Tuning(2.5, 10.0, 1.6)
    assert to_ideal({"K": 2, "Ti": 8, "form": "series"}) == Tuning(2.0, 8.0, 0.0)
    assert to_ideal({"K": 2.0, "Ki": 0.1, "Kd": 3.0, "form": "parallel"}) == Tuning(2.0, 20.0, 1.5)
    assert to_ideal({"PB": 50, "reset": "2 /min", "Td": "0.1 min"}) == Tuning(2.0, 30.0, 6.0)
    assert to_ideal({"PB": "200 %", "Ti": "0.5 min"}) == Tuning(0.5, 30.0, 0.0)


def test_independent_times_of_the_parallel_form():
    # u = K e + 1/Ti int e + Td de/dt
    assert to_ideal({"K": 2.0, "Ti": 10.0, "Td": 3.0, "form": "parallel"}) == Tuning(2.0, 20.0, 1.5)
    assert to_ideal({"K": -2.0, "Ti": 10.0, "Td": 3.0, "form": "parallel"}) == Tuning(-2.0, 20.0, 1.5)


def test_reverse_action_keeps_its_times_positive():
    assert to_ideal({"K": -0.5, "Ti": 20}) == Tuning(-0.5, 20.0, 0.0)
    assert to_ideal({"K": -2.0, "Ki": -0.1}) == Tuning(-2.0, 20.0, 0.0)
    assert to_ideal({"PB": -50.0, "Ti": 20}) == Tuning(-2.0, 20.0, 0.0)
    with pytest.raises(MetadataError, match="same sign"):
        to_ideal({"K": -2.0, "Ki": 0.1})


@pytest.mark.parametrize(
    ("text", "value"),
    [("28", 28), (28, 28), ("28 s", 28), ("28sec", 28), ("0,5 min", 30), ("0.5 Minutes", 30),
     ("0.01 h", 36), ("500 ms", 0.5),
     ("2 /min", 30), ("2 repeats/min", 30), ("2 rep per minute", 30), ("4 rpm", 15), ("0.1 /s", 10), ("1e1 s", 10)],
)  # fmt: skip
def test_times_with_units(text, value):
    assert seconds(text, "Ti") == pytest.approx(value)


def test_rates_with_units():
    assert per_second("3 /min", "Ki") == pytest.approx(0.05)
    assert per_second(0.05, "Ki") == 0.05
    assert per_second("36 /h", "Ki") == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("values", "words"),
    [({"K": 1, "Ti": 0}, "Ti must be positive"), ({"K": 1, "Ti": -3}, "Ti must be positive"),
     ({"K": 1, "Ti": float("nan")}, "Ti must be a number"), ({"K": 1, "Ti": "n/a"}, "Ti must be a number"),
     ({"K": 1, "Ti": "3 lightyears"}, "unknown time unit"), ({"K": 1, "Ti": float("inf")}, "must be a number"),
     ({"K": 0, "Ti": 3}, "K must not be zero"), ({"K": True, "Ti": 3}, "K must be a number"),
     ({"K": 1, "PB": 100}, "both K and PB"), ({"PB": 0}, "PB must not be zero"),
     ({"K": 1, "Ti": 3, "Ki": 3}, "both Ti and Ki"), ({"K": 1, "reset": 2}, "needs its unit"),
     ({"Ki": 2}, "need the gain"), ({"K": 1, "Ti": 3, "form": "seris"}, "form"),
      ({"K": 1, "Ti": [3]}, "must be a number"),
     ({"K": 1, "Ti": 3, "Td": -1}, "must not be negative"), ({"K": 1, "reset": "0 /min"}, "zero repeats"),
     ({"K": 1, "Ki": "3 /fortnight"}, "unknown time unit"), ({"K": 10**400}, "must be a number")],
)  # fmt: skip
def test_wrong_settings_name_the_key(values, words):
    with pytest.raises(MetadataError, match=words):
        to_ideal(values)
