"""Samples that must not be used are found, and only those."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.loaders import read
from backlash_cli.record import runs
from backlash_cli.samples import frozen, is_copy, judged, pasted, saturated, short_holes


@settings(max_examples=100, deadline=None)
@given(st.lists(st.booleans(), max_size=60))
def test_runs_cover_exactly_the_flags(flags):
    array = np.array(flags, bool)
    starts, ends = runs(array)
    rebuilt = np.zeros(len(array), bool)
    for start, end in zip(starts, ends, strict=True):
        rebuilt[start:end] = True
    assert np.array_equal(rebuilt, array)


def test_short_holes_are_bridged_on_a_line():
    values = np.array([1.0, np.nan, np.nan, 4.0, np.nan, np.nan, np.nan, 8.0, np.nan])
    out, filled = short_holes(values, np.arange(9), 2)
    assert np.array_equal(filled, [False, True, True, False, False, False, False, False, False])
    assert np.allclose(out[:4], [1, 2, 3, 4]) and np.isnan(out[4:7]).all() and np.isnan(out[8])


def test_no_hole_is_bridged_across_a_gap():
    values = np.array([1.0, np.nan, 3.0])
    _, filled = short_holes(values, np.array([0, 1, 500]), 5)
    assert not filled.any()


def test_saturation_needs_several_samples():
    u = np.full(100, 0.5)
    u[10] = 1.0
    assert not saturated(u).any()
    u[20:25] = 0.9999
    u[40:44] = -0.01
    flags = saturated(u)
    assert flags is not None and np.array_equal(np.flatnonzero(flags), [*range(20, 25), *range(40, 44)])


def test_an_output_that_stands_at_a_limit_inside_its_range():
    rng = np.random.default_rng(3)
    wanted, off = 0.5 + 0.05 * np.sin(np.arange(2000) / 40.0), np.abs(0.02 * rng.standard_normal(2000))
    output = np.minimum(wanted, 0.51)  # the controller's upper limit
    assert np.array_equal(saturated(output, off), output == 0.51) and not saturated(output).any()
    assert not saturated(output, np.where(output == 0.51, 0.0, off)).any()  # at rest: no error moves the output
    assert not saturated(np.round(wanted, 2), off).any()  # a swing of few recorded levels
    assert not saturated(np.full(2000, 0.5), off).any() and not saturated(wanted[:0], off[:0]).any()
    assert not saturated(output, np.full(2000, np.nan)).any()


def test_spikes_beyond_the_span():
    y = np.full(50, 0.4)
    assert not judged(np.arange(50), None, y, None, None, None, 0)[2]["wild"].any()
    y[3], y[9], y[12] = 1e308, -np.inf, 1.4
    assert np.flatnonzero(judged(np.arange(50), None, y, None, None, None, 0)[2]["wild"]).tolist() == [3, 9]


@pytest.mark.parametrize("seed", range(5))
def test_frozen_stretch_of_a_noisy_signal(seed):
    rng = np.random.default_rng(seed)
    y = (0.5 + 0.01 * rng.standard_normal(5000)).round(4)
    assert not frozen(y).any()
    y[2000:2100] = y[2000]
    flags = frozen(y)
    assert flags is not None and flags[2000:2100].all() and flags.sum() <= 102


@pytest.mark.parametrize("seed", range(5))
def test_a_coarse_signal_is_not_frozen(seed):
    rng = np.random.default_rng(seed)
    slow = 0.5 + 0.02 * np.sin(np.arange(8000) / 400) + 0.002 * rng.standard_normal(8000)
    assert not frozen(np.round(slow, 2)).any()


def test_a_valve_that_sticks_in_a_quiet_loop_is_not_frozen():
    ramp = np.concatenate([np.full(200, k * 0.01) + 0 for k in range(20)])
    smooth = np.interp(np.arange(4000), [0, 900, 1100, 2000, 2300, 4000], [0.4, 0.4, 0.5, 0.5, 0.45, 0.4])
    assert not frozen(smooth).any()
    assert not frozen(ramp).any()


def test_constant_signal_is_frozen():
    flags = frozen(np.full(4500, 0.45))
    assert flags is not None and flags.all()
    assert (
        frozen(np.concatenate([np.full(3000, 0.45), 0.45 + 0.01 * np.random.default_rng(0).standard_normal(3000)]))
        is not None
    )


DRIFT, FAST = np.random.default_rng(5).normal(0.0, [[0.02], [0.2]], (2, 4000))
NOISE = 50.0 + np.cumsum(DRIFT) + FAST


@pytest.mark.parametrize("values", [np.tile(NOISE[:2000], 2), np.tile(NOISE[:700], 6), np.tile(np.round(NOISE, 2), 3)])
def test_a_measurement_pasted_again_is_told_where_it_comes_again(values):
    lag = {4000: 2000, 4200: 700, 12_000: 4000}[len(values)]
    assert np.array_equal(np.flatnonzero(pasted(values)), np.arange(lag, len(values)))


@pytest.mark.parametrize("values", [
    NOISE, np.round(NOISE), np.full(4000, 7.0), np.sin(2 * np.pi * np.arange(4000) / 100),  # a cycle repeats itself
    np.append(NOISE, NOISE[:500]), np.full(4000, np.nan), NOISE[:100]])
def test_other_measurements_are_no_repetition(values):
    assert pasted(values) is None


@pytest.mark.parametrize("samples", range(12))
def test_a_few_samples_are_no_copy(samples):
    assert not is_copy(np.full(samples, 3.0), np.arange(samples, dtype=float))


def test_what_was_pasted_counts_once(tmp_path):
    rows = "".join(f"{np.datetime64('2026-03-17T00:00:00') + k},50,{NOISE[k % 2000]:.3f},{40 + k % 97}\n"
                   for k in range(4000))
    (tmp_path / "plant.csv").write_text("time,A.SP,A.PV,A.OP\n" + rows)
    (record,) = read(tmp_path / "plant.csv")
    assert np.array_equal(np.flatnonzero(record.usable), np.arange(2000))
    assert any(note.code == "repeated" and "2000 of 4000" in note.message for note in record.notes)
