"""The controller output rebuilt from SP, PV, K and Ti, against the one that the controller gave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.estimator.control_law import output_made, rebuilt_output
from backlash_cli.record import LoopSettings, Record, record_from_arrays
from tests.benchmarks.random_loops import draw
from tests.benchmarks.strange_plant import swinging_door


def rebuilt(record: Record) -> np.ndarray:
    return rebuilt_output(record, record.settings, record.usable)


@pytest.mark.parametrize("kind", ["fastsp", "coloured", "steps"])
def test_the_output_of_a_digital_controller_is_rebuilt_but_for_a_constant(kind: str) -> None:
    for seed in (41000, 41001, 41003):  # Ti of 3 to 8 samples: a delay of one of them would show
        record = draw(seed, kind, 0.02).record
        assert record.output is not None
        off = (rebuilt(record) - record.output)[100:]
        assert np.std(off) < 0.001 * np.std(record.output)


@pytest.mark.parametrize("Tf", [0.0, 3.0])
def test_the_law_sample_by_sample_gives_the_same(Tf: float) -> None:
    """The filter (3) has taken in each sample when the controller answers to it, and rests at the first one."""
    rng = np.random.default_rng(0)
    y, ysp = 0.5 + 0.1 * np.cumsum(rng.normal(size=50)) / 7.0, np.where(np.arange(50) < 20, 0.5, 0.6)
    K, Ti, Td = 0.8, 9.0, 2.0
    settings = LoopSettings(K=K, Ti=Ti, Td=Td, Tf=Tf)
    found = rebuilt_output(record_from_arrays(ysp, y, None, interval=1.0), settings, np.ones(50, bool))
    a, x1, x2, before, integral = (np.exp(-1.0 / Tf) if Tf else 0.0), y[0], y[0], y[0], 0.0
    for k in range(50):
        # 1/(1 + s T)^2 for PV held over one second, from rest: exact answer of both lags
        ramp = (1.0 / Tf) * a * (x1 - y[k]) if Tf else 0.0
        x1, x2 = y[k] + a * (x1 - y[k]), y[k] + a * (x2 - y[k]) + ramp
        integral += ysp[k] - x2
        assert found[k] == pytest.approx(K * (integral / Ti - x2 - Td * (x2 - before)), abs=1e-12)
        before = x2


def compressed(record: Record, size: float) -> Record:
    """OP as it reads after a swinging door: few values, held."""
    assert record.output is not None
    kept = swinging_door(record.output, size)
    return replace(record, output=record.output[np.maximum.accumulate(np.where(kept, np.arange(len(kept)), 0))])


@pytest.mark.parametrize("kind", ["coloured", "steps"])
def test_between_few_records_the_output_is_completed_by_the_law(kind: str) -> None:
    record = draw(41000, kind, 0.02).record
    few = compressed(record, 0.01)
    assert record.output is not None and few.output is not None
    assert np.mean(np.diff(few.output) != 0) < 0.2
    found, origin = output_made(few, record.settings)
    assert origin == "completed"
    own = np.flatnonzero(np.diff(few.output, prepend=np.nan) != 0)
    np.testing.assert_allclose(found[own], record.output[own], atol=1e-12)  # the records themselves stand
    held, made = (np.std(values - record.output) for values in (few.output, found))
    assert made < 0.05 * held


def test_the_weight_of_the_setpoint_in_the_law_is_found() -> None:
    record = draw(41000, "fastsp", 0.02).record
    assert record.output is not None and record.settings.K is not None
    with_kicks = replace(record, output=record.output + 0.7 * record.settings.K * record.setpoint)
    found, origin = output_made(compressed(with_kicks, 0.01), record.settings)
    assert origin == "completed"
    assert with_kicks.output is not None
    assert np.std(found - with_kicks.output) < 0.2 * np.std(compressed(with_kicks, 0.01).output - with_kicks.output)


def test_an_output_that_is_recorded_often_stays_as_it_is() -> None:
    record = draw(41000, "coloured", 0.02).record
    found, origin = output_made(record, record.settings)
    assert origin == "recorded" and found is record.output


def test_where_the_law_does_not_lead_from_record_to_record_nothing_is_completed() -> None:
    record = draw(41000, "coloured", 0.02).record
    few = compressed(record, 0.01)
    wrong = replace(record.settings, K=-record.settings.K)  # type: ignore[operator]
    assert output_made(few, wrong)[1] == "recorded"
    assert few.output is not None
    steps = 0.5 + 0.1 * np.round(np.sin(np.arange(len(record)) / 300.0), 1)  # somebody else moves the valve
    assert output_made(replace(few, output=steps), record.settings)[1] == "recorded"


def test_without_records_of_the_output_all_of_it_is_rebuilt() -> None:
    record = draw(41000, "coloured", 0.02).record
    found, origin = output_made(replace(record, output=None), record.settings)
    assert origin == "rebuilt"
    np.testing.assert_array_equal(found, rebuilt(record))
