from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.check import check_loop
from backlash_cli.estimator.quality import data_quality, fast_noise, rounding_step, stored_as
from backlash_cli.estimator.survey import Survey
from backlash_cli.record import Note, Record, SampleState, record_from_arrays

from .closed_loop import Loop, exception_reporting, load_steps, run

RECORD = run(Loop(), 6000, load=load_steps(6000, 0.1))
PV = RECORD.measurement
INDEX = np.arange(len(PV))


def interpolated(values: np.ndarray, deviation: float) -> np.ndarray:
    stored = [0]
    for k in range(1, len(values)):
        if abs(values[k] - values[stored[-1]]) > deviation:
            stored += [k - 1, k]
    stored = sorted({*stored, len(values) - 1})
    return np.interp(np.arange(len(values)), stored, values[stored])


def test_a_logged_signal_is_a_row_of_samples() -> None:
    storage = stored_as(INDEX, PV)
    assert (storage.kind, storage.share, storage.step) == ("samples", 0.0, 0.0)
    assert storage.noise == pytest.approx(0.001, rel=0.1)


@pytest.mark.parametrize("deviation", [0.002, 0.005, 0.01])
def test_exception_reporting_is_seen_with_its_deviation(deviation: float) -> None:
    storage = stored_as(INDEX, exception_reporting(PV, deviation))
    assert storage.kind == "held"
    assert storage.deviation == pytest.approx(deviation, rel=0.1)


@pytest.mark.parametrize("deviation", [0.005, 0.01])
@pytest.mark.parametrize("digits", [15, 5])
def test_interpolation_between_stored_values_is_seen(deviation: float, digits: int) -> None:
    storage = stored_as(INDEX, np.round(interpolated(PV, deviation), digits))
    assert storage.kind == "linear" and storage.share > 0.3


def test_a_slower_scan_is_seen() -> None:
    storage = stored_as(INDEX, np.repeat(PV[::10], 10))
    assert storage.kind == "held" and storage.run == pytest.approx(10, rel=0.02)


@pytest.mark.parametrize("every", [2, 3, 30])
def test_a_slower_scan_is_seen_in_rounded_values(every) -> None:
    storage = stored_as(INDEX, np.round(np.repeat(PV[::every], every), 3)[: len(INDEX)])
    assert storage.kind == "held" and storage.deviation == 0.0 and storage.run == pytest.approx(every, rel=0.3)


@pytest.mark.parametrize("step", [0.001, 0.0005, 0.005])
def test_rounding_is_no_compression(step: float) -> None:
    storage = stored_as(INDEX, np.round(PV / step) * step)
    assert storage.kind == "samples"
    assert storage.step == pytest.approx(step, rel=1e-6)


def test_a_noise_free_signal_is_not_taken_for_an_interpolated_one() -> None:
    smooth = run(Loop(noise=0.0), 6000, load=load_steps(6000, 0.1)).measurement
    for digits in (15, 5, 4, 3):
        assert stored_as(INDEX, np.round(smooth, digits)).kind == "samples"


def test_no_rounding_step_in_scattered_numbers() -> None:
    assert rounding_step(np.random.default_rng(0).normal(size=300)) == 0.0
    assert rounding_step(np.array([1.0])) == 0.0


@pytest.mark.parametrize("count", [4095, 4096, 40_000])
def test_a_lattice_is_found_in_any_number_of_values(count: int) -> None:
    values = np.cumsum(np.random.default_rng(1).normal(size=count)) / 1000.0
    assert rounding_step(values) == 0.0
    assert rounding_step(np.round(values, 3)) == pytest.approx(1e-3, rel=1e-9)


def test_noise_of_a_slow_signal() -> None:
    rng = np.random.default_rng(0)
    values = np.sin(INDEX / 300.0) + 0.01 * rng.normal(size=len(INDEX))
    assert fast_noise(INDEX, values) == pytest.approx(0.01, rel=0.05)


def codes(record: Record, Ti: float | None = 20.0) -> dict[str, str]:
    return {note.code: str(note.values["effect"]) for note in data_quality(record, Ti).notes}


def test_a_good_record_has_nothing_to_say() -> None:
    assert codes(RECORD) == {}


def test_every_finding_has_its_code_and_effect() -> None:
    assert RECORD.output is not None
    op = RECORD.output
    assert codes(RECORD, 4.0) == {"sampling_coarse": "info"}
    assert codes(RECORD, 1.5) == {"sampling_too_coarse": "info"}
    assert codes(replace(RECORD, measurement=exception_reporting(PV, 0.0025))) == {"compressed_held": "limits"}
    assert codes(replace(RECORD, measurement=exception_reporting(PV, 0.02))) == {"compressed_held": "blocks"}
    assert codes(replace(RECORD, measurement=interpolated(PV, 0.003))) == {"compressed_linear": "limits"}
    assert codes(replace(RECORD, measurement=interpolated(PV, 0.01))) == {"compressed_linear": "blocks"}
    assert codes(replace(RECORD, measurement=np.repeat(PV[::5], 5))) == {"scanned_slowly": "limits"}
    assert codes(replace(RECORD, measurement=np.repeat(PV[::15], 15))) == {"scanned_slowly": "blocks"}
    assert codes(replace(RECORD, output=np.round(op, 3))) == {"output_rounded": "info"}
    assert codes(replace(RECORD, output=exception_reporting(op, 0.01))) == {"output_compressed": "info"}
    assert codes(replace(RECORD, output=None)) == {"no_output": "info"}
    assert codes(replace(RECORD, output=0.5 + 0.1 * (op - 0.5))) == {"little_motion": "info"}
    assert codes(replace(RECORD, output=np.full(len(op), 0.3))) == {"output_constant": "blocks"}
    assert codes(replace(RECORD, measurement=np.full(len(op), 0.3))) == {"measurement_constant": "blocks"}
    assert codes(replace(RECORD, setpoint=0.5 + 0.001 * np.sin(INDEX))) == {"setpoint_moves": "info"}


@pytest.mark.parametrize(
    ("state", "code"),
    [
        (SampleState.MANUAL, "manual"),
        (SampleState.SATURATED, "saturated"),
        (SampleState.MISSING, "missing_samples"),
        (SampleState.FROZEN, "frozen"),
        (SampleState.IMPLAUSIBLE, "spikes"),
        (SampleState.FILLED, "filled"),
    ],
)
def test_shares_of_what_cannot_be_used(state: SampleState, code: str) -> None:
    states = RECORD.state.copy()
    states[1000:1600] = state
    (note,) = data_quality(replace(RECORD, state=states), 20.0).notes
    assert note.code == code and note.values["share"] == pytest.approx(0.1)
    states[1000:4600] = state
    half = codes(replace(RECORD, state=states))
    filled = state == SampleState.FILLED
    assert ("little_usable" in half) == (not filled) and ("interpolated" in half) == filled


def test_gaps_are_counted_with_the_longest() -> None:
    keep = np.r_[0:1000, 1300:2000, 2100:6000]
    record = replace(
        RECORD,
        index=INDEX[keep],
        setpoint=RECORD.setpoint[keep],
        measurement=PV[keep],
        output=None,
        state=RECORD.state[keep],
    )
    quality = data_quality(record, 20.0)
    assert (quality.gaps, quality.longest_gap) == (2, 300.0)
    assert quality.missing_share == pytest.approx(400 / 6000)
    (note,) = (note for note in quality.notes if note.code == "gaps")
    assert note.message.startswith("2 gaps in time, the longest 5 min;")


def test_nothing_usable_blocks() -> None:
    dead = replace(RECORD, state=np.full(len(PV), SampleState.MANUAL, dtype=np.uint8))
    assert codes(dead) == {"no_usable_data": "blocks"}
    assert data_quality(dead, 20.0).notes[0].values["effect"] == "blocks"
    empty = data_quality(record_from_arrays([], [], interval=1.0))
    assert empty.samples == 0 and empty.notes[0].values["effect"] == "blocks"


LONG = run(Loop(), 30_000, load=load_steps(30_000, 0.1))


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(1, 29_999), max_size=6, unique=True))
def test_the_cut_into_blocks_does_not_matter(cuts: list[int]) -> None:
    whole = data_quality(LONG, 20.0)
    survey = Survey()
    for first, last in pairwise([0, *sorted(cuts), len(LONG)]):
        survey.update(LONG.slice(first, last))
    assert data_quality(survey.kept, 20.0, survey) == whole


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.2, 0.3, 0.5])
def test_what_rounding_leaves_in_means_is_that_of_many_draws(noise: float) -> None:
    """The mean of many rounded values around each of many levels, against the level itself."""
    rng = np.random.default_rng(3)
    levels = np.linspace(0.0, 10.0, 401)
    left = np.rint(levels[:, None] + noise * rng.normal(size=(401, 4000))).mean(axis=1) - levels
    slow = np.rint(np.repeat(levels, 50) + noise * rng.normal(size=401 * 50))
    found = stored_as(np.arange(len(slow)), slow).error
    first = 2.0 * abs(np.mean(left * np.exp(-2j * np.pi * levels)))  # harmonic of the error over a step
    if noise in (0.0, 0.5):
        assert found == pytest.approx(first, abs=0.01)
    else:  # a MAD of values that are rounded so coarsely sees less noise than there is
        assert first - 0.02 <= found <= 1.0 / np.pi


def test_what_an_exception_deviation_leaves_in_means_is_that_of_a_signal_that_swings() -> None:
    swing = 0.5 + 0.1 * np.sin(np.arange(20000) / 300.0)
    stored = exception_reporting(swing, 0.01)
    left = (stored - swing).reshape(-1, 50).mean(axis=1)
    found = stored_as(np.arange(len(stored)), stored).error
    assert float(np.std(left)) < found < 2.5 * float(np.std(left))


def test_how_pv_was_stored_is_seen_without_a_setpoint_too() -> None:
    record = replace(RECORD, measurement=np.round(PV, 2), setpoint=np.full(len(PV), np.nan))
    assert data_quality(record).pv.step == pytest.approx(0.01)


def test_what_forbids_a_verdict_goes_before_what_limits_it() -> None:
    cascade = Note("cascade", "OP is the setpoint of FIC102", {"effect": "limits"})
    flat = replace(RECORD, output=np.full(len(PV), 0.4), notes=(cascade,))
    judged = check_loop(flat).judged
    assert judged.code == "blocks" and "OP" in judged.message and "FIC102" not in judged.message
    assert check_loop(replace(RECORD, notes=(cascade,))).judged.code == "limits"
