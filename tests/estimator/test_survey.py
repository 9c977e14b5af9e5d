"""The survey of a record against counting by hand, for clean and doubtful samples and any cut into blocks."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.estimator.survey import LEVELS, ROWS, SLOTS, SLOWER, STATES, Survey
from backlash_cli.record import Record, SampleState


def surveyed(record: Record, cuts: list[int]) -> Survey:
    survey = Survey(record.interval)
    for first, last in pairwise([0, *sorted(min(cut, len(record)) for cut in cuts), len(record)]):
        survey.update(record.slice(first, last))
    return survey


def made(seed: int, n: int, doubtful: float) -> Record:
    """Samples of which a share, in stretches, is doubtful: other states, holes, numbers that are none."""
    rng = np.random.default_rng(seed)
    odd = np.repeat(rng.random(n // 100 + 1) < doubtful, 100)[:n]
    state = np.where(odd, rng.choice(len(SampleState), n), rng.random(n) < 0.05).astype(np.uint8)
    index = 5 + np.cumsum(np.where(odd, rng.choice([1, 2, 9], n), 1))
    sp = 0.01 * np.cumsum(rng.random(n) < 0.01)
    pv, op = rng.normal(-0.2, 1.0, n), rng.normal(0.0, 1.0, n)
    for values in (sp, pv, op):
        values[odd & (rng.random(n) < 0.1)] = np.nan
    return Record("a", 0.0, 2.0, index.astype(np.int64), sp, pv, op, state)


def counted(record: Record) -> dict[str, int]:
    """What the survey counts, by hand."""
    r, y, u = record.setpoint, record.measurement, record.output
    use = record.state <= SampleState.FILLED
    known = r[use & np.isfinite(r)]
    mine = use & np.isfinite(r) & np.isfinite(y) & np.isfinite(u)
    steps = np.diff(record.index)
    return {"first": record.index[0], "last": record.index[-1], "gaps": np.sum(steps > 2),
            "longest": max(steps.max(initial=0), 0) if (steps > 1).any() else 0, "moves": np.sum(np.diff(known) != 0),
            "used": np.sum(mine), "used_filled": np.sum(mine & (record.state == SampleState.FILLED)),
            "with_setpoint": np.sum(np.isfinite(r)), "with_output": np.sum(np.isfinite(u))}


def means(index: np.ndarray, rows: np.ndarray) -> dict[int, np.ndarray]:
    """Means over the groups of SLOWER rows that are complete."""
    groups: dict[int, list[np.ndarray]] = {}
    for at, row in zip(index.tolist(), rows, strict=True):
        groups.setdefault(at // SLOWER, []).append(row)
    return {at: np.mean(group, axis=0) for at, group in groups.items() if len(group) == SLOWER}


@given(st.integers(0, 10_000), st.integers(1, 3500), st.sampled_from([0.0, 0.05, 1.0]),
       st.lists(st.integers(0, 3500), max_size=4))
@settings(max_examples=40, deadline=None)
def test_counts_ranges_and_pictures_are_those_of_the_samples(seed, n, doubtful, cuts):
    record = made(seed, n, doubtful)
    survey = surveyed(record, cuts)
    assert {name: getattr(survey, name) for name in counted(record)} == counted(record)
    np.testing.assert_array_equal(survey.states, np.bincount(record.state, minlength=STATES))
    use = record.usable
    for column, values in enumerate((record.setpoint, record.measurement, record.output)):
        there = values[use & np.isfinite(values)]
        assert survey.spread(column) == pytest.approx(np.ptp(there) if len(there) else 0.0)
    signals = np.column_stack([record.setpoint, record.measurement, record.output])
    mine = use & np.isfinite(signals).all(1)
    index, rows = survey.rows(0)
    np.testing.assert_array_equal(index, record.index[mine])
    np.testing.assert_array_equal(rows.T, signals[mine])
    expected = dict(zip(index.tolist(), rows.T, strict=True))
    for level in range(1, LEVELS):
        expected = means(np.array(list(expected)), np.array(list(expected.values())).reshape(-1, 3))
        index, rows = survey.rows(level)
        assert index.tolist() == list(expected)
        np.testing.assert_allclose(rows.T, np.array(list(expected.values())).reshape(-1, 3), atol=1e-12)


def test_of_a_long_record_an_even_choice_of_stretches_is_kept_wherever_it_is_cut():
    record = made(1, 40 * ROWS, 0.0)
    whole, cut = surveyed(record, []), surveyed(record, [1000, 1001, 20_000])
    index, rows = whole.rows(0)
    assert np.unique(index // ROWS).tolist() == list(range(0, 41, 4)) and len(np.unique(index // ROWS)) <= SLOTS
    for level in range(LEVELS):
        np.testing.assert_array_equal(whole.rows(level)[1], cut.rows(level)[1])
    np.testing.assert_array_equal(rows[1], record.measurement[np.isin(record.index, index)])


def test_a_record_without_output_has_samples_and_no_rows():
    survey = Survey(1.0)
    record = replace(made(2, 3000, 0.0), output=None)
    survey.update(record)
    index, measured, at, outputs = survey.measured()
    np.testing.assert_array_equal(measured, record.measurement[record.state == SampleState.GOOD])
    assert len(at) == len(outputs) == len(survey.rows(0)[0]) == 0 and len(index) == len(measured)
