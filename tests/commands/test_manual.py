"""A record with a test of the valve in manual, from CSV to JSON."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from tests.benchmarks.strange_plant import control_loop
from tests.commands.run import run

pytestmark = pytest.mark.usefixtures("analysed_once")
PERCENT = np.linspace(0, 100, 1001)
WORDS = ("AUTO", "MAN")
STEPS = (0, 3, 6, 3, 0, 3, 6)
HOLD = 150


def record(d, *, steps=STEPS, begin=1500, after=600, load=0.02, seed=0):
    """SP, PV, OP [%] and True in manual, samples of 1 s: a quiet loop whose valve is tested from `begin` on."""
    hand = np.repeat(np.asarray(steps, dtype=float), HOLD)
    n = begin + len(hand) + after
    rng, zero, manual = np.random.default_rng(seed), np.zeros(n), np.full(n, np.nan)
    manual[begin : begin + len(hand)] = 50.0 + hand
    sp, pv, op, _, _ = control_loop(
        1.0, 0, zero + 50.0, load * np.cumsum(rng.normal(size=n)), zero, 0.1 * rng.normal(size=n), zero, manual,
        np.array([0.4, 25, 0, 0, 0, 0, 1.0]), np.zeros(5), np.array([15.0, 4.0]), 3, 0.0, 1.0, 0.0,
        PERCENT, PERCENT, np.zeros(2), np.array([d, 0.0, 0.0, 0.0]), np.array([1e3, 1.0]), np.zeros(5), 50.0,
        np.array([0.0, 100.0]))
    return sp, pv, op, np.isfinite(manual)


def export(folder, signals, words=WORDS, settings="K = 0.4\nTi = 25.0\n"):
    sp, pv, op, hand = signals
    stamps = pd.Timestamp("2026-03-01") + pd.to_timedelta(np.arange(len(sp)), unit="s")
    path = folder / "plant.csv"
    signals = {f"FIC1.{name}": np.round(values, 4) for name, values in (("SP", sp), ("PV", pv), ("OP", op))}
    mode = np.where(hand, words[1], words[0])
    pd.DataFrame({"Time": stamps, **signals, "FIC1.MODE": mode}).to_csv(path, index=False)
    ranges = "pv_range = [0, 100]\nop_range = [0, 100]\n"
    (folder / "plant.loops.toml").write_text(f"[loops.FIC1]\n{settings}{ranges}")
    return path


def scanned(capfd, path, *options):
    done = run(capfd, "scan", path, "--format", "json", *options)
    assert done.status == 0
    loop = json.loads(done.out)["loops"][0]
    return loop, [reason["code"] for reason in loop["reasons"]]


@pytest.mark.parametrize("words", [WORDS, ("CAS", "Manual"), (1, 0), ("RUN", "HAND")])
def test_a_worn_valve_is_called_by_its_test(capfd, tmp_path, words):
    path = export(tmp_path, record(2.0), words)
    if words[0] == "RUN":
        (tmp_path / "plant.loops.toml").write_text((tmp_path / "plant.loops.toml").read_text()
                                                   + 'auto_modes = ["RUN"]\n')
    loop, codes = scanned(capfd, path)
    assert loop["verdict"] == "backlash" and codes[:2] == ["manual_test", "play_fits"]
    assert loop["cluster"]["d"] == pytest.approx(0.02, rel=0.12)
    low, high = loop["cluster"]["ci95"]
    assert low <= 0.02 <= high
    assert loop["confirmation"]["details"]["source"] == "manual_test"
    assert "6 % of its span, once" in loop["reasons"][0]["message"]


def test_a_healthy_valve_is_cleared_by_its_test(capfd, tmp_path):
    loop, codes = scanned(capfd, export(tmp_path, record(0.0)))
    assert loop["verdict"] == "no_backlash" and codes[0] == "manual_test" and "limit_of_detection" in codes
    assert loop["cluster"]["limit_of_detection"] <= 0.02


def test_without_a_test_nothing_is_said_of_one(capfd, tmp_path):
    for signals in (record(2.0, steps=(0, 0, 0, 0)), record(2.0, steps=(0, 4, 8, 12))):  # OP stands; one way only
        _, codes = scanned(capfd, export(tmp_path, signals))
        assert not any(code.startswith(("manual_test", "manual_no")) for code in codes)
    _, codes = scanned(capfd, export(tmp_path, record(2.0)), "--no-confirm")
    assert "manual_test" not in codes


def test_one_turn_says_what_is_missing(capfd, tmp_path):
    loop, codes = scanned(capfd, export(tmp_path, record(2.0, steps=(0, 3, 6, 3, 0), begin=0, after=0)))
    assert loop["verdict"] == "suspected" and codes[0] == "manual_test" and "few_reversals" in codes


def test_steps_smaller_than_the_gap_say_how_wide_it_is_at_least(capfd, tmp_path):
    loop, codes = scanned(capfd, export(tmp_path, record(8.0, steps=(0, 1, 2, 1, 0, 1, 2), load=0.001)))
    assert loop["verdict"] == "suspected" and codes[0] == "manual_no_answer"
    assert "2 % of its span" in loop["reasons"][0]["message"]


@pytest.mark.parametrize("settings", ["K = 0.4\nTi = 25.0\n", ""])
def test_a_record_that_is_all_manual(capfd, tmp_path, settings):
    loop, codes = scanned(capfd, export(tmp_path, record(2.0, begin=0, after=0), settings=settings))
    assert loop["verdict"] == "backlash" and codes[0] == "manual_test"
    assert loop["cluster"]["d"] == pytest.approx(0.02, rel=0.12)


def test_holes_and_a_valve_at_its_limit(capfd, tmp_path):
    sp, pv, op, hand = record(2.0, after=1500)
    pv[1700:1710] = np.nan
    op[3000:3100], hand[2900:3300] = 100.0, True  # later the valve was opened by hand, and closed again
    loop, codes = scanned(capfd, export(tmp_path, (sp, pv, op, hand)))
    assert loop["verdict"] == "backlash" and codes[0] == "manual_test"
    assert loop["cluster"]["d"] == pytest.approx(0.02, rel=0.15)
