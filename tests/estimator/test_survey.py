"""The survey of a record against counting by hand, for clean and doubtful samples and any cut into blocks."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.estimator.survey import LEVELS, MOST, ROWS, SLOTS, SLOWER, STATES, Survey, measured, rows
from backlash_cli.record import Record, SampleState


def surveyed(record: Record, cuts: list[int], most: int = MOST) -> Survey:
    survey = Survey(most)
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
    r = record.setpoint
    use = record.state <= SampleState.FILLED
    known = r[use & np.isfinite(r)]
    steps = np.diff(record.index)
    return {"first": record.index[0], "last": record.index[-1], "gaps": np.sum(steps > 2),
            "longest": steps.max(initial=1), "moves": np.sum(np.diff(known) != 0),
            "used": np.sum(use), "samples": len(record), "with_setpoint": np.sum(np.isfinite(r))}


def means(index: np.ndarray, values: np.ndarray) -> dict[int, np.ndarray]:
    """Means over the groups of SLOWER rows that are complete."""
    groups: dict[int, list[np.ndarray]] = {}
    for at, row in zip(index.tolist(), values, strict=True):
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
    for k, values in enumerate((record.measurement, record.output)):
        there = values[record.usable & np.isfinite(values)]
        assert not len(there) or (survey.lowest[k], survey.highest[k]) == (there.min(), there.max())
    signals = np.column_stack([record.setpoint, record.measurement, record.output])
    mine = record.usable & np.isfinite(signals).all(1)
    index, values = rows(survey.kept, 0)
    np.testing.assert_array_equal(index, record.index[mine])
    np.testing.assert_array_equal(values.T, signals[mine])
    expected = dict(zip(index.tolist(), values.T, strict=True))
    for level in range(1, LEVELS):
        expected = means(np.array(list(expected)), np.array(list(expected.values())).reshape(-1, 3))
        index, values = rows(survey.kept, level)
        assert index.tolist() == list(expected)
        np.testing.assert_allclose(values.T, np.array(list(expected.values())).reshape(-1, 3), atol=1e-12)


@given(st.lists(st.integers(0, 3000), max_size=6), st.integers(1, 3500))
@settings(max_examples=30, deadline=None)
def test_the_last_samples_are_kept_wherever_the_record_is_cut(cuts, most):
    record = made(3, 3000, 0.05)
    kept = surveyed(record, cuts, most).kept
    for name in ("index", "setpoint", "measurement", "output", "state"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(record, name)[-most:])


def test_of_a_long_record_an_even_choice_of_stretches_is_looked_at():
    record = made(1, 40 * ROWS, 0.0)
    index, values = rows(record, 0)
    assert np.unique(index // ROWS).tolist() == list(range(0, 41, 4)) and len(np.unique(index // ROWS)) <= SLOTS
    np.testing.assert_array_equal(values[1], record.measurement[np.isin(record.index, index)])
    assert np.unique(measured(record)[0] // ROWS).tolist() == list(range(0, 41, 8))


def test_a_record_without_output_has_samples_and_no_rows():
    record = replace(made(2, 3000, 0.0), output=None)
    index, values, at, outputs = measured(record)
    np.testing.assert_array_equal(values, record.measurement[record.state == SampleState.GOOD])
    assert len(at) == len(outputs) == len(rows(record, 0)[0]) == 0 and len(index) == len(values)
