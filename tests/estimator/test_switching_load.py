"""A load that switches to and fro: its wave, and the dead band beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.estimator.evidence import weigh
from backlash_cli.estimator.square_wave import Wave, fourier_sums, opposed_wave, square
from backlash_cli.estimator.switching_load import switching_load, with_switching_load
from backlash_cli.record import LoopSettings, Record, record_from_arrays
from backlash_cli.results import Confirmation, Verdict
from backlash_cli.scan import scan

from .closed_loop import Loop, rows_of, run

TIME = np.arange(9000)
SQUARE = 0.03 * np.sign(np.sin(2 * np.pi * (TIME + 0.5) / 430.0))
GIVEN = LoopSettings(K=Loop.K, Ti=Loop.Ti)


def simulated(load: np.ndarray, dead_band: float = 0.0, seed: int = 0) -> Record:
    return replace(run(Loop(dead_band=dead_band), 9000, load=load, seed=seed), settings=GIVEN)


@pytest.mark.parametrize(("half", "phase"), [(7.3, 0.0), (20.0, 3.4), (11.1, -25.7)])
def test_the_means_of_a_square_wave_are_exact(half: float, phase: float) -> None:
    rows, fine = np.arange(-40, 40), 2000
    time = (np.arange(80 * fine) + 0.5) / fine - 40.0
    wave = np.where(np.mod(time - phase, 2 * half) < half, 1.0, -1.0)
    np.testing.assert_allclose(square(rows.astype(float), half, phase), wave.reshape(80, fine).mean(1), atol=2e-3)


@pytest.mark.parametrize("rows", [1, 2, 99, 100, 2000])
def test_sums_over_a_square_of_rows_are_those_over_each(rows: int) -> None:
    rng = np.random.default_rng(rows)
    x, frequencies = rng.normal(size=rows), np.array([0.0, 1e-4, 0.013, 0.2, 0.49])
    plain = [np.sum(x * np.exp(-2j * np.pi * f * np.arange(rows))) for f in frequencies]
    np.testing.assert_allclose(fourier_sums(x, frequencies), plain, atol=1e-10)


def test_the_wave_that_op_opposes_is_found() -> None:
    rows = np.arange(1200)
    load = square(rows - 599.5, 31.7, 4.0)
    found = opposed_wave(-0.02 * load, np.gradient(load), rows)
    assert found is not None
    assert found.half == pytest.approx(31.7, rel=1e-3)
    assert found.amplitude == pytest.approx(0.02, rel=0.03)
    assert found.phase == pytest.approx(4.0, abs=0.5)


def test_a_record_in_pieces_shows_no_wave() -> None:
    rows = np.concatenate([np.arange(k, k + 250) for k in range(0, 4000, 1000)])
    load = square(rows - 1999.5, 31.7, 4.0)
    assert opposed_wave(-0.02 * load, np.gradient(load), rows) is None


@pytest.mark.parametrize("output", [
    np.sin(np.arange(1200) / 20.0), np.random.default_rng(0).normal(size=1200).cumsum(), np.arange(30.0) % 2,
])
def test_no_wave_where_there_is_none(output: np.ndarray) -> None:
    assert opposed_wave(output, np.gradient(output), np.arange(len(output))) is None


@pytest.mark.parametrize("seed", range(2))
def test_a_dead_band_is_sized_beside_a_square_load(seed: int) -> None:
    record = simulated(SQUARE, 0.04, seed)
    rows = rows_of(record)
    load = switching_load(rows)
    assert load is not None
    found = with_switching_load(rows, weigh(rows), load)
    assert found.half_period > 0
    assert found.d == pytest.approx(0.04, rel=0.15)
    report = scan(record)
    assert report.verdict is Verdict.BACKLASH
    assert "switching_load" in [reason.code for reason in report.reasons]
    assert report.confirmation is not None
    assert report.confirmation.details["load_half_period_s"] == pytest.approx(215.0, rel=0.01)
    assert report.confirmation.ci95[0] < 0.04 < report.confirmation.ci95[1]


@pytest.mark.parametrize("seed", range(2))
def test_a_healthy_loop_under_a_square_load_is_not_called(seed: int) -> None:
    record = simulated(SQUARE, seed=seed)
    rows = rows_of(record)
    load = switching_load(rows)
    assert load is not None
    found = with_switching_load(rows, weigh(rows), load)
    assert found.half_period > 0
    assert found.gain < 8.0
    assert scan(record).verdict is Verdict.NO_BACKLASH


def test_single_steps_leave_the_plain_test_as_it_is() -> None:
    steps = np.repeat(np.random.default_rng(1).normal(0, 0.04, 12), 750)
    rows = rows_of(simulated(steps))
    plain = weigh(rows)
    assert with_switching_load(rows, plain, Wave(0.04, 37.5, 0.0)) is plain


def test_the_confirmation_says_nothing_of_a_load_that_it_did_not_find() -> None:
    quiet = record_from_arrays(0.5, 0.5 + 0.01 * np.sin(TIME / 300.0), 0.5 + 0.01 * np.cos(TIME / 300.0), interval=1.0,
                               settings=LoopSettings(K=0.5, Ti=20.0))
    report = scan(quiet)
    assert not isinstance(report.confirmation, Confirmation) or not report.confirmation.details["load_half_period_s"]
