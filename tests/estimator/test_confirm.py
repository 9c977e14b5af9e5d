"""PV against OP through a dead band: cuts, sizes, and each kind of trouble a record can have."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.estimator.confirm import (
    LEAST_NOISE,
    MOST_ADDED,
    MOST_ROWS,
    ConfirmationScanner,
    confirm,
    with_least_noise,
)
from backlash_cli.estimator.decimate import STRETCH, WHOLE, WIDTHS, BlockMeans
from backlash_cli.kernels import play
from backlash_cli.record import LoopSettings, Note, Record, SampleState
from backlash_cli.results import Confirmation, Verdict
from backlash_cli.scan import scan
from tests.benchmarks.random_loops import CONTROLS, draw
from tests.estimator.closed_loop import Loop, run

SETTINGS = LoopSettings(K=0.6, Ti=20.0, Kp=1.0)
STEPS = np.repeat(np.random.default_rng(5).normal(0.0, 0.04, 20), 300)


def loop(d: float, **changes: object) -> Record:
    return replace(run(replace(Loop(dead_band=d), **changes), 6000, load=STEPS), settings=SETTINGS)


@pytest.fixture(scope="module")
def worn() -> Record:
    return loop(0.03)


@pytest.fixture(scope="module")
def healthy() -> Record:
    return loop(0.0)


def test_block_means_are_those_of_play_at_full_rate():
    rng = np.random.default_rng(2)
    u = np.cumsum(rng.normal(0.0, 0.004, 700))
    blocks = BlockMeans(7, 3000)
    blocks.update(np.arange(700), np.full(700, 0.5), 2.0 * u, u, np.zeros(700, np.uint8))
    at, means = blocks.rows()
    assert len(at) == 100
    np.testing.assert_allclose(means[:, 0], 2.0 * u.reshape(-1, 7).mean(1), atol=1e-12)
    for j in (0, 5, len(WIDTHS) - 1):
        expected = play(u, float(WIDTHS[j]), u[0]).reshape(-1, 7).mean(1)
        np.testing.assert_allclose(means[:, 2 + j], expected, atol=1e-12)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.integers(1, 12), st.floats(0.5, 1.0))
def test_block_means_with_missing_samples_are_those_of_a_plain_loop(seed: int, size: int, share: float):
    """Up to thousands of blocks, many of them short of samples; short holes bridged, block by block."""
    rng = np.random.default_rng(seed)
    n = 3000 * size
    there = np.flatnonzero(rng.random(n) < share)
    u = np.cumsum(rng.normal(0.0, 0.004, n))
    blocks, few = BlockMeans(size, 10**6), BlockMeans(size, 500)
    for part in np.array_split(there, 3):
        for one in (blocks, few):
            one.update(part, np.full(len(part), 0.5), 2.0 * u[part], u[part], np.zeros(len(part), np.uint8))
    at, means = blocks.rows()
    full: dict[int, float] = {}
    for number, members in groupby(there.tolist(), key=lambda k: k // size):
        values = [u[k] for k in members]
        if len(values) >= 0.7 * size:
            full[number] = float(np.mean(values))
    known = np.array(sorted(full))
    bridged = {k for a, b in pairwise(known.tolist()) if b - a <= 3 for k in range(a, b)} | set(known.tolist())
    np.testing.assert_array_equal(at, sorted(bridged))
    np.testing.assert_allclose(means[:, 1], np.interp(at, known, [full[k] for k in known]), atol=1e-12)
    np.testing.assert_allclose(means[:, 0], 2.0 * means[:, 1], atol=1e-12)
    some, of_some = few.rows()
    np.testing.assert_array_equal(of_some, means[np.isin(at, some)])
    travel = np.bincount(at // STRETCH, np.abs(np.diff(means[:, 1], prepend=means[0, 1])))
    count = np.bincount(at // STRETCH)
    pairs = [k for k in range(len(count) - 1)
             if count[k] >= WHOLE * STRETCH and count[k + 1] and STRETCH < count[k] + count[k + 1] <= 500]
    kept = np.unique(some // STRETCH)
    assert len(some) <= 500
    if pairs:
        assert travel[kept].sum() == pytest.approx(max(travel[k] + travel[k + 1] for k in pairs))
        assert np.all(np.diff(kept) == 1)
    else:
        left = np.setdiff1d(np.unique(at // STRETCH), kept)
        assert not len(left) or travel[left].max() <= travel[kept].min()


def test_any_cut_of_the_record_gives_the_same_answer(worn: Record):
    whole = confirm(worn)
    scanner = ConfirmationScanner(worn.settings, worn.interval)
    edges = [0, 1, 17, 1234, 1235, 4001, len(worn)]
    for low, high in pairwise(edges):
        scanner.update(worn.slice(low, high))
    assert scanner.finish() == whole


def test_the_size_is_found_with_op_and_without(worn: Record):
    for record in (worn, replace(worn, output=None)):
        found = confirm(record)
        assert isinstance(found, Confirmation)
        assert found.d == pytest.approx(0.03, rel=0.12)
        assert found.ci95[0] <= 0.03 <= found.ci95[1]
        assert found.details["evidence"] > 30


def test_verdicts_on_a_worn_and_a_healthy_valve(worn: Record, healthy: Record):
    assert scan(worn).verdict is Verdict.BACKLASH
    report = scan(healthy)
    assert report.verdict is Verdict.NO_BACKLASH
    assert any(note.code == "limit_of_detection" for note in report.reasons)


def test_periodic_and_wandering_loads_do_not_look_like_a_dead_band():
    loops = [draw(seed, kind, 0.0) for kind in CONTROLS for seed in (11, 12, 13)]
    called = [loop.kind for loop in loops if scan(loop.record).verdict is Verdict.BACKLASH]
    assert len(called) <= 1, called  # square loads still fool it now and then; the benchmark has the rates


def test_a_negative_process_gain_changes_nothing(worn: Record):
    mirrored = replace(worn, setpoint=1 - worn.setpoint, measurement=1 - worn.measurement,
                       settings=replace(SETTINGS, K=-0.6))
    assert confirm(mirrored).d == pytest.approx(confirm(worn).d, rel=1e-6)  # type: ignore[union-attr]


def test_manual_stretches_and_gaps_are_left_out(worn: Record):
    state = worn.state.copy()
    state[1000:1400] = SampleState.MANUAL
    keep = np.r_[0:3000, 3300:6000]
    record = replace(worn, state=state, index=worn.index)
    holed = replace(record, index=record.index[keep], setpoint=record.setpoint[keep], state=record.state[keep],
                    measurement=record.measurement[keep], output=record.output[keep])
    found = confirm(holed)
    assert isinstance(found, Confirmation)
    assert found.d == pytest.approx(0.03, rel=0.2)


def test_of_a_long_record_the_rows_with_the_most_motion_are_kept_in_one_piece():
    rng = np.random.default_rng(3)
    n, size, most = 20_000, 4, 1500
    u = np.cumsum(rng.normal(0.0, 1e-4, n))
    busy = slice(8_000, 10_000)
    u[busy] += 0.02 * np.sin(np.arange(2_000) / 20.0)
    at, means = {}, {}
    for cuts in ([0, n], [0, 777, 9_001, 9_002, 15_000, n]):
        blocks = BlockMeans(size, most)
        for low, high in pairwise(cuts):
            k = np.arange(low, high)
            blocks.update(k, np.full(len(k), 0.5), u[k], u[k], np.zeros(len(k), np.uint8))
        at[len(cuts)], means[len(cuts)] = blocks.rows()
        assert blocks._kept.stored <= 3 * most + 2 * STRETCH
    np.testing.assert_array_equal(at[2], at[6])
    np.testing.assert_allclose(means[2], means[6], atol=1e-12)
    assert len(at[2]) == most and set(range(2_000, 2_500)) <= set(at[2].tolist())
    assert np.all(np.diff(at[2]) == 1)


def test_refusals_say_why(worn: Record):
    short = confirm(worn.slice(0, 400))
    assert isinstance(short, Note)
    assert short.code == "short_record"
    assert short.message == "the record holds 6.67 min that can be used; 12.5 min are needed"
    still = confirm(replace(worn, output=np.full(len(worn), 0.5)))
    assert isinstance(still, Note)
    assert still.code == "output_still"


def test_stretches_too_short_for_the_filter_to_settle_are_no_record(worn: Record):
    """Every 60 samples a hole of 15 blocks: enough rows in all, but none of them counts."""
    keep = np.flatnonzero(np.arange(len(worn)) % 135 < 55)
    found = confirm(replace(worn, index=worn.index[keep], setpoint=worn.setpoint[keep], state=worn.state[keep],
                            measurement=worn.measurement[keep], output=worn.output[keep]))  # type: ignore[index]
    assert isinstance(found, Note)
    assert found.code == "short_record"
    assert found.values["usable_s"] < found.values["needed_s"] == 750.0


def test_memory_is_bounded_by_the_decimated_length(worn: Record):
    scanner = ConfirmationScanner(worn.settings, 1.0)
    scanner.update(worn)
    _, means = scanner._blocks.rows()
    assert len(means) == min(len(worn) // scanner.size, MOST_ROWS)


def test_a_record_without_noise_gets_a_little_and_others_none():
    rng = np.random.default_rng(4)
    first = np.zeros(800, dtype=bool)
    first[[0, 400]] = True
    smooth = 0.01 * np.sin(np.arange(800) / 15.0)
    added = with_least_noise(smooth, first) - smooth
    assert np.std(added) == pytest.approx(LEAST_NOISE * np.std(smooth), rel=0.1)
    assert np.std(with_least_noise(100.0 * smooth, first) - 100.0 * smooth) <= 1.1 * MOST_ADDED
    noisy = smooth + rng.normal(0.0, 0.0006, 800)
    np.testing.assert_array_equal(with_least_noise(noisy, first), noisy)


# Robustness: the verdict stays, or becomes one that says why it cannot be sure; never a confident wrong one.
def stays(worn: Record, healthy: Record, *, size_within: float = 0.25, because: str = "") -> None:
    """because: the reason that may take the verdict back; without one it must stay."""
    report = scan(worn)
    assert report.cluster is not None
    assert report.cluster.d == pytest.approx(0.03, rel=size_within)
    if because:
        assert report.verdict in (Verdict.SUSPECTED, Verdict.CANNOT_TELL)
        assert because in [note.code for note in report.reasons]
    else:
        assert report.verdict is Verdict.BACKLASH
    report = scan(healthy)
    assert report.verdict is Verdict.NO_BACKLASH
    if because:
        assert because in [note.code for note in report.reasons]
        assert report.confidence < 0.9


@pytest.mark.parametrize("change", [{"Kp": 2.0}, {"Kp": 0.5}, {"Ti": 26.0}, {"Ti": 15.4}])
def test_wrong_settings(worn: Record, healthy: Record, change: dict[str, float]):
    wrong = replace(SETTINGS, **change)
    stays(replace(worn, settings=wrong), replace(healthy, settings=wrong))


def test_no_noise_at_all():
    stays(loop(0.03, noise=0.0), loop(0.0, noise=0.0))


@pytest.mark.parametrize("d", [0.02, 0.04])
def test_dead_bands_without_noise_under_steps_of_another_kind(d: float):
    steps = np.repeat(np.random.default_rng(6).normal(0.0, 0.03, 30), 200)
    record = replace(run(Loop(dead_band=d, noise=0.0), 6000, load=steps), settings=SETTINGS)
    report = scan(record)
    assert report.verdict is Verdict.BACKLASH
    assert report.cluster is not None and report.cluster.d == pytest.approx(d, rel=0.2)


@pytest.mark.parametrize("step", [4, 5, 7, 10])
def test_coarse_sampling(worn: Record, healthy: Record, step: int):
    def thinned(r: Record) -> Record:
        pick = slice(None, None, step)
        n = len(r.index[pick])
        return replace(r, interval=float(step), index=np.arange(n), setpoint=r.setpoint[pick], state=r.state[pick],
                       measurement=r.measurement[pick], output=r.output[pick])

    stays(thinned(worn), thinned(healthy))


def test_output_recorded_to_a_tenth_of_a_percent(worn: Record, healthy: Record):
    def rounded(r: Record) -> Record:
        return replace(r, output=np.round(r.output, 3))

    stays(rounded(worn), rounded(healthy))


def test_pv_stored_by_exception(worn: Record, healthy: Record):
    def compressed(r: Record) -> Record:
        held = r.measurement.copy()
        for k in range(1, len(held)):
            if abs(held[k] - held[k - 1]) < 0.002:
                held[k] = held[k - 1]
        return replace(r, measurement=held)

    stays(compressed(worn), compressed(healthy), because="compressed_held")
