"""The simulator of strange plants: it shares nothing with the package, and its laws are what they are said to be."""

import ast
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import signal

from tests.benchmarks import strange_plant, strangers
from tests.benchmarks.strange_plant import KARNOPP, LUGRE, control_loop, gain_margin, reversals, swinging_door

PERCENT = np.linspace(0, 100, 1001)


def driven(op, gaps=(0.0, 0.0, 0.0, 0.0), friction=(0.0, 0.0, 0.0, 0.0, 0.0), gain=1.0):
    """PV, stem and crossings of a loop in manual whose OP is given; steps of 0.2 s."""
    zero = np.zeros(len(op))
    _, pv, _, stem, crossings = control_loop(
        0.2, 0, zero + 50.0, zero, zero, zero, zero, np.asarray(op, dtype=float), np.array([0.5, 20, 0, 0, 0, 0, 1.0]),
        np.zeros(5), np.array([5.0, 2.0]), 5, 0.0, gain, 0.0, PERCENT, PERCENT, np.zeros(2), np.array(gaps),
        np.array([1e3, 1.0]), np.array(friction), 50.0, np.array([0.0, 100.0]))
    return pv, stem, crossings


@pytest.mark.parametrize("module", [strangers, strange_plant])
def test_nothing_of_the_package_is_imported_outside_the_scoring(module):
    tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
    guilty = {
        getattr(owner, "name", "module")
        for owner in [tree, *(node for node in tree.body if isinstance(node, ast.FunctionDef))]
        for node in (tree.body if owner is tree else ast.walk(owner))
        if isinstance(node, ast.Import | ast.ImportFrom)
        and any("backlash" in name for name in [getattr(node, "module", "") or "", *(a.name for a in node.names)])
    }
    assert guilty == ({"judged"} if module is strangers else set())


def test_a_seed_gives_the_same_loop_again_and_another_seed_another():
    one, again, other = strangers.loop(5), strangers.loop(5), strangers.loop(6)
    assert one.truth == again.truth and one.settings == again.settings
    for key in ("time_s", "sp", "pv", "op"):
        np.testing.assert_array_equal(getattr(one, key), getattr(again, key))
    assert other.truth != one.truth


@pytest.mark.parametrize("d", [0.8, 3.0, 7.0])
def test_the_stem_follows_play_and_crosses_its_gap_as_often_as_op_turns_by_more_than_the_gap(d):
    op = 50 + np.clip(0.1 * np.cumsum(np.random.default_rng(3).normal(size=20_000)), -40, 40)
    _, stem, crossings = driven(op, gaps=(d, 0.0, 0.0, 0.0))
    place, expected = 50.0, []
    for value in op:
        place = value - d / 2 if value - place > d / 2 else value + d / 2 if place - value > d / 2 else place
        expected.append(place)
    np.testing.assert_allclose(stem, expected, atol=1e-9)
    assert crossings > 3
    assert abs(crossings - reversals(op, d)) <= 1  # where in its gap the stem stood at the start decides the first


def test_reversals_are_counted_by_size():
    zigzag = np.interp(np.arange(0, 60.5, 0.5), [0, 10, 20, 30, 40, 50, 60], [0, 5, 4, 9, 0, 2, 1.5])
    assert [reversals(zigzag, size) for size in (0.3, 0.9, 1.5, 3.0, 10.0)] == [5, 4, 2, 1, 0]


@pytest.mark.parametrize("gain", [1.7, -0.6])
def test_more_output_moves_the_measurement_by_the_gain_with_its_sign(gain):
    pv, _, _ = driven(np.where(np.arange(2000) < 500, 50.0, 60.0), gain=gain)
    assert pv[-1] - pv[0] == pytest.approx(10 * gain, rel=1e-6)


@pytest.mark.parametrize("kind", [KARNOPP, LUGRE])
@pytest.mark.parametrize(("S", "J"), [(4.0, 1.0), (3.0, 1.8)])
def test_a_sticking_stem_stands_for_s_and_slips_by_j_after_a_turn(kind, S, J):
    t = 0.2 * np.arange(8000)
    op = 50 + 20 / np.pi * np.arcsin(np.sin(2 * np.pi * t / 800))  # 0.05 %/s up and down
    _, stem, _ = driven(op, friction=(kind, (S + J) / 2, (S - J) / 2, (S + J) / 2, (S - J) / 2))
    turn = 1000  # the first turn, from up to down: it breaks away when OP has come back by S
    start = turn + int(np.argmax(stem[turn:] < stem[turn : turn + 3].max() - 0.3 * J))
    # in so slow a move the stem slips again and again, and at the turn it stands somewhere between two slips
    assert S - 0.3 < op[turn] - op[start] < S + J + 0.1
    slip = stem[start - 5] - stem[start + 5]
    assert slip == pytest.approx(J, abs=0.3 * J if kind == LUGRE else 0.1)


def test_the_gain_margin_is_that_of_a_lag_with_dead_time():
    it = SimpleNamespace(K=1.0, Ti=1e6, Td=0.0, Tf=0.0, lags=np.array([100.0]), actuator=np.zeros(2), theta=10.0,
                         dt=0.0, gain=2.0, integ=0.0, fast=0.0)
    w = np.linspace(0.01, 0.3, 200_000)  # phase of lag and dead time (and of the two 0.01 s lags, nothing)
    at = w[np.argmin(abs(np.arctan(100 * w) + 10 * w - np.pi))]
    assert gain_margin(it) == pytest.approx(np.hypot(1, 100 * at) / 2, rel=0.01)


def test_the_truth_is_complete_and_the_record_agrees_with_it():
    for seed in range(40, 48):
        one = strangers.loop(seed)
        truth = one.truth
        assert set(strangers.COLUMNS) - {"name", "file"} <= set(truth)
        assert (truth["d"] > 0) == (truth["truth"] == "worn") and (truth["S"] > 0) == (truth["truth"] == "stick")
        assert (truth["crossings"] > 0) <= (truth["truth"] == "worn")
        auto = one.op if one.mode is None else one.op[one.mode != "MAN"]
        assert truth["oprange"] == pytest.approx(np.ptp(auto))
        assert one.K_ideal * (truth["gain"] or truth["integ_gain"]) > 0
        assert len({len(one.time_s), len(one.sp), len(one.pv), len(one.op)}) == 1
        assert len(one.op) == pytest.approx(truth["dur_h"] * 3600 / one.interval_s, abs=1)
        assert np.isfinite(one.op).all() and (np.diff(one.time_s) > 0).all()


def test_the_mix_is_as_announced():
    rng = np.random.default_rng(0)
    drawn = pd.Series([strangers._pick(rng, strangers.FAMILIES) for _ in range(4000)]).value_counts(normalize=True)
    for family, share in strangers.FAMILIES.items():
        assert drawn[family] == pytest.approx(share / 100, abs=0.03)


def test_in_a_healthy_loop_output_through_lags_and_dead_time_is_the_measurement():
    zero = np.zeros(6000)
    sp = 50 + np.where(np.arange(6000) % 2000 < 1000, 0.0, 5.0)
    _, pv, op, _, _ = control_loop(
        0.2, 0, sp, zero, zero, zero, zero, np.full(6000, np.nan), np.array([-0.4, 20, 2, 0.2, 0, 0, 1]), np.zeros(5),
        np.array([20.0, 5.0, 3.0]), 25, 0.0, -1.5, 0.0, PERCENT, PERCENT, np.zeros(2), np.zeros(4),
        np.array([1e3, 1.0]), np.zeros(5), 50.0, np.array([0.0, 100.0]))
    plant = signal.TransferFunction([-1.5], np.polymul(np.polymul([20.0, 1], [5.0, 1]), [3.0, 1]))
    t = 0.2 * np.arange(6000)
    held = np.r_[np.full(26, op[0]), op[:-26]] - 50
    expected = 50 + signal.lsim(plant, held, t, interp=False)[1]
    assert np.ptp(op) > 1
    assert np.max(abs(pv - expected)) < 0.02 * np.ptp(pv)


def test_lines_through_what_a_swinging_door_keeps_miss_no_sample_by_more_than_its_size():
    rng = np.random.default_rng(5)
    for values in (np.cumsum(rng.normal(size=2000)), rng.normal(size=500), np.repeat([0.0, 1.0, 0.5], 100)):
        kept = np.flatnonzero(swinging_door(values, 0.7))
        off = np.abs(np.interp(np.arange(len(values)), kept, values[kept]) - values)
        assert off.max() <= 0.7 + 1e-9 and len(kept) < len(values)
