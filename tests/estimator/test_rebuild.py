"""The controller output rebuilt from SP, PV, K and Ti, against the one that the controller gave."""

from __future__ import annotations

import numpy as np
import pytest

from backlash_cli.estimator.rebuild import at_once, rebuilt_output
from backlash_cli.half_periods import double_lag
from backlash_cli.record import Record
from tests.benchmarks.random_loops import draw


def rebuilt(record: Record) -> np.ndarray:
    return rebuilt_output(record, record.settings, record.usable)


@pytest.mark.parametrize("kind", ["fastsp", "coloured", "steps"])
def test_the_output_of_a_digital_controller_is_rebuilt_but_for_a_constant(kind: str) -> None:
    for seed in (41000, 41001, 41003):  # Ti of 3 to 8 samples: a delay of one of them would show
        record = draw(seed, kind, 0.02).record
        assert record.output is not None
        off = (rebuilt(record) - record.output)[100:]
        assert np.std(off) < 0.001 * np.std(record.output)


def test_the_filter_acts_at_once_and_keeps_its_gain() -> None:
    lag = double_lag(3.0, 1.0)
    quick = at_once(lag)
    values = np.random.default_rng(0).normal(size=50)
    late, _ = lag.run(np.append(values, 0.0), lag.settled(0.0))
    soon, _ = quick.run(values, quick.settled(0.0))
    np.testing.assert_allclose(soon, late[1:], atol=1e-12)
    held, _ = quick.run(np.full(5, 0.7), quick.settled(0.7))
    np.testing.assert_allclose(held, 0.7, atol=1e-12)
    nothing = double_lag(0.0, 1.0)
    assert at_once(nothing) is nothing
