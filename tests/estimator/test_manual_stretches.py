"""Which stretches in manual are a test of the valve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.estimator.confirm import MOST_TESTS, manual_stretches
from backlash_cli.record import Record, SampleState, record_from_arrays

HOLD = 100


def record(*tests: tuple[int, list[float]], samples: int = 12_000) -> Record:
    """A record with OP at 0.5 and PV a number of its own at each sample; tests: where they begin and OP in them."""
    output, state = np.full(samples, 0.5), np.zeros(samples, dtype=np.uint8)
    for begin, levels in tests:
        part = slice(begin, begin + len(levels) * HOLD)
        output[part], state[part] = np.repeat(levels, HOLD), SampleState.MANUAL
    found = record_from_arrays(0.5, np.linspace(0.4, 0.6, samples), output, interval=1.0)
    return replace(found, state=state)


def test_tests_are_found_with_what_lies_before_them():
    whole = record((3000, [0.5, 0.53, 0.5, 0.53]), (6000, [0.5, 0.48, 0.5]))
    found = manual_stretches(whole)
    assert [int(np.argmax(r.usable)) for r in found] == [4 * HOLD, 3 * HOLD]
    assert [int(np.count_nonzero(r.usable)) for r in found] == [4 * HOLD, 3 * HOLD]
    np.testing.assert_allclose(found[0].output, 100.0 * whole.output[3000 - 4 * HOLD : 3400])
    np.testing.assert_allclose(found[0].measurement[found[0].usable], 100.0 * whole.measurement[3000:3400])


@pytest.mark.parametrize("levels", [[0.5, 0.5, 0.5], [0.3, 0.5, 0.9], [0.8, 0.4, 0.0], [0.5, 0.502, 0.5],
                                    [0.0, 0.0, 0.3], [1.0, 0.6, 1.0]])
def test_op_that_stands_or_moves_one_way_is_no_test(levels):
    assert manual_stretches(record((3000, levels))) == []


def test_a_valve_at_its_limit_ends_a_test():
    (found,) = manual_stretches(record((3000, [0.5, 0.53, 0.5, 0.53, 0.0, 0.5])))
    assert int(np.count_nonzero(found.usable)) == 4 * HOLD


def test_a_short_hole_does_not_cut_a_test_and_a_long_one_does():
    whole = record((3000, [0.5, 0.53, 0.5, 0.53, 0.5, 0.53]))
    measured, state = whole.measurement.copy(), whole.state.copy()
    measured[3210:3220], state[3210:3220] = np.nan, SampleState.MISSING
    (found,) = manual_stretches(replace(whole, measurement=measured, state=state))
    assert int(np.count_nonzero(found.usable)) == 6 * HOLD - 10 and np.isfinite(found.measurement).all()
    kept = np.append(np.arange(3250), np.arange(3290, len(whole)))  # no samples at all in between
    apart = Record(whole.loop, 0.0, 1.0, *(a[kept] for a in (whole.index, whole.setpoint, whole.measurement,
                                                            whole.output, whole.state)))
    found = manual_stretches(apart)
    assert [int(np.count_nonzero(r.usable)) for r in found] == [250, 310]
    assert int(np.argmax(found[1].usable)) == 0  # what lies before the hole does not tell where the stem stood


def test_without_output_there_is_no_test():
    assert manual_stretches(replace(record((3000, [0.5, 0.53, 0.5])), output=None)) == []


def test_the_last_tests_of_many_count():
    whole = record(*((k * 500, [0.5, 0.53, 0.5]) for k in range(1, 20)))
    whole = replace(whole, measurement=np.linspace(0.0, 1.0, len(whole)))
    found = manual_stretches(whole)
    assert len(found) == MOST_TESTS
    assert found[-1].measurement[-1] == pytest.approx(100.0 * whole.measurement[19 * 500 + 3 * HOLD - 1])


def test_a_test_without_any_measurement_is_none():
    whole = record((3000, [0.5, 0.53, 0.5, 0.53]), (6000, [0.5, 0.48, 0.5]))
    pv = whole.measurement.copy()
    pv[3000:3400] = np.nan
    (found,) = manual_stretches(replace(whole, measurement=pv))
    assert np.count_nonzero(found.usable) == 3 * HOLD
