"""Where the stem stood when a record began: the closed form against play from other starts, and pooled recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli import read
from backlash_cli.estimator.confirm import widened
from backlash_cli.estimator.evidence import weigh
from backlash_cli.estimator.stem import placed_at, weigh_with_stem
from backlash_cli.kernels import play
from backlash_cli.record import LoopSettings, Record
from backlash_cli.results import Verdict
from backlash_cli.scan import scan
from tests.estimator.closed_loop import Loop, rows_of, run
from tests.shared_data import shared_data


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.002, 0.1), st.floats(-1.0, 1.0))
def test_another_start_is_the_middle_held_between_what_op_has_shown(seed: int, d: float, place: float) -> None:
    u = 0.5 + np.cumsum(np.random.default_rng(seed).normal(0.0, 0.01, 60))
    low, high = np.minimum.accumulate(u), np.maximum.accumulate(u)
    shift = placed_at(place, d, np.full(60, u[0]), low, high)
    np.testing.assert_allclose(play(u, d, u[0]) + shift, play(u, d, u[0] + place * 0.5 * d), atol=1e-12)


def recordings(seed: int, d: float, count: int = 6) -> Record:
    """Parts of 1500 s of one long record, an hour of it missing after each: the stem stands anywhere as each begins."""
    rng = np.random.default_rng(seed)
    samples = count * 2400
    setpoint = 0.5 + np.repeat(rng.normal(0.0, 0.012, samples // 600), 600)
    load = np.cumsum(rng.normal(0.0, 1e-4, samples))
    record = run(Loop(dead_band=d, K=0.4), samples, load=load - np.linspace(0.0, load[-1], samples), setpoint=setpoint,
                 seed=seed)
    keep = np.concatenate([np.arange(k * 2400 + 700, k * 2400 + 2200) for k in range(count)])
    assert record.output is not None
    return replace(record, settings=LoopSettings(K=0.4, Ti=20.0, Kp=1.0), index=keep, setpoint=record.setpoint[keep],
                   measurement=record.measurement[keep], output=record.output[keep], state=record.state[keep])


def test_pooled_recordings_that_hardly_cross_the_gap_give_its_size() -> None:
    middle, placed = [], []
    for seed in range(5):
        rows = rows_of(recordings(seed, 0.03))
        found = weigh(rows)
        middle.append(found.d / 0.03 - 1.0)
        better = weigh_with_stem(rows, found)
        assert better.gain > found.gain
        placed.append(better.d / 0.03 - 1.0)
    assert abs(np.median(placed)) < 0.07 < np.median(np.abs(middle))
    assert np.max(np.abs(placed)) < 0.2


def test_a_record_that_began_in_the_middle_and_a_healthy_valve_change_nothing() -> None:
    load = np.repeat(np.random.default_rng(5).normal(0.0, 0.03, 6), 1000)
    for d in (0.0, 0.03):
        record = replace(run(Loop(dead_band=d), 6000, load=load), settings=LoopSettings(K=0.6, Ti=20.0, Kp=1.0))
        rows = rows_of(record)
        found = weigh(rows)
        assert weigh_with_stem(rows, found).d == pytest.approx(found.d, rel=0.05)


def test_the_real_valve_pooled_has_the_size_seen_by_eye() -> None:
    files = sorted(shared_data("plant").glob("2411FIC20102_*.csv"))
    (record,) = read(files).records
    report = scan(record)
    assert report.verdict is Verdict.BACKLASH and report.cluster is not None
    assert 0.015 <= report.cluster.d <= 0.021


def test_a_gap_covered_late_has_a_wider_interval() -> None:
    narrow, wide = (widened(0.02, (0.0195, 0.0205), 0, False, loose=share) for share in (0.0, 0.5))
    assert wide[0] < narrow[0] < 0.0195 < 0.0205 < narrow[1] < wide[1]
    assert wide[1] - 0.02 == pytest.approx(0.02 - wide[0])
