"""The scan of one loop: the published example, independence of block cuts, time shifts and units."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli import read, scanning
from backlash_cli import scan as scan_plant
from backlash_cli.estimator.identify import identify, with_constant_setpoint
from backlash_cli.record import LoopSettings, Note, SampleState, record_from_arrays
from backlash_cli.results import Verdict
from backlash_cli.scanning import LoopScanner, ScanOptions, scan
from backlash_cli.simulator import simulate
from backlash_cli.simulator.scenario_file import load_scenarios
from tests.benchmarks.random_loops import draw
from tests.estimator.closed_loop import slow_loop

RECORD = slow_loop()


def assert_same(a, b, shift=0.0):
    assert (a.verdict, a.half_periods, a.detections, dict(a.rejected)) == (
        b.verdict, b.half_periods, b.detections, dict(b.rejected))
    for x, y in zip(a.estimates, b.estimates, strict=True):
        assert (x.accepted, x.why, x.direction) == (y.accepted, y.why, y.direction)
        np.testing.assert_allclose([x.start + shift, x.dt_s, x.dy, x.e_max, x.d],
                                   [y.start, y.dt_s, y.dy, y.e_max, y.d], rtol=1e-6, atol=1e-9)
    for name in ("cluster", "confirmation"):
        x, y = getattr(a, name), getattr(b, name)
        assert (x is None) == (y is None)
        if x is not None:
            np.testing.assert_allclose([x.d, *x.ci95], [y.d, *y.ci95], rtol=1e-6)


def test_a_dead_band_is_found_with_its_size():
    report = scan(RECORD)
    assert report.verdict is Verdict.BACKLASH
    assert report.cluster.ci95[0] <= 0.05 <= report.cluster.ci95[1]
    assert report.compensator.gain < 0.05


@given(st.lists(st.integers(0, len(RECORD)), max_size=8))
@settings(max_examples=15, deadline=None)
def test_any_cut_into_blocks_gives_the_same_report(cuts):
    scanner = LoopScanner(RECORD.loop, RECORD.settings, RECORD.start, RECORD.interval)
    edges = [0, *sorted(cuts), len(RECORD)]
    for first, last in pairwise(edges):
        scanner.update(RECORD.slice(first, last))
    assert_same(scan(RECORD), scanner.finish())


def test_a_time_shift_moves_the_report_and_changes_nothing_else():
    assert_same(scan(RECORD), scan(replace(RECORD, start=1.0e6)), shift=1.0e6)


def test_a_loop_with_negative_action_gives_the_same_dead_band():
    turned = replace(RECORD, measurement=1.0 - RECORD.measurement, setpoint=1.0 - RECORD.setpoint,
                     settings=replace(RECORD.settings, K=-RECORD.settings.K, Kp=-RECORD.settings.Kp))
    a, b = scan(RECORD), scan(turned)
    assert a.verdict == b.verdict
    assert [e.d for e in a.estimates] == pytest.approx([e.d for e in b.estimates])
    assert [e.direction for e in a.estimates] == [-e.direction for e in b.estimates]


def test_nothing_is_estimated_on_the_first_and_last_half_period_or_beside_a_manual_period():
    state = RECORD.state.copy()
    state[3000:3200] = SampleState.MANUAL
    report = scan(replace(RECORD, state=state))
    refused = [e for e in report.estimates if e.why == "incomplete"]
    assert len(refused) == report.rejected["incomplete"] == 4
    assert not any(e.accepted for e in refused)
    assert not any(e.start < 3200 and e.end > 3000 for e in report.estimates if e.accepted)


def test_default_process_gain_is_named():
    report = scan(replace(RECORD, settings=replace(RECORD.settings, Kp=None)))
    assert report.settings.Kp == 1.5 and report.settings.source["Kp"] == "default"
    assert "default_kp" in [w.code for w in report.warnings]


def test_sampling_too_coarse_for_the_rule_is_said():
    coarse = replace(RECORD, interval=5.0)
    report = scan(coarse)
    assert [w.values["why"] for w in report.warnings if w.code == "rule_left_out"] == ["sampling_too_coarse"]
    assert not len(report.estimates)
    assert report.confirmation is not None
    without = scan(coarse, ScanOptions(confirm=False))
    assert without.verdict is Verdict.CANNOT_TELL
    assert without.reasons[0].code == "sampling_too_coarse"


@pytest.mark.parametrize(("samples", "known"), [(1, True), (40, True), (40, False)])
def test_a_record_that_is_too_short_is_insufficient(samples: int, known: bool):
    part = RECORD.slice(0, samples)
    report = scan(part if known else replace(part, settings=LoopSettings()))
    assert report.verdict is Verdict.INSUFFICIENT_DATA
    assert report.reasons[0].code in ("insufficient_data", "short_record", "missing_settings")
    told = ("samples can be used", "usable samples", "needed", "has 60 that can be used")
    assert any(words in report.reasons[0].message for words in told)


def test_an_empty_record_is_insufficient():
    report = scan(RECORD.slice(0, 0))
    assert report.samples == 0 and report.start is None
    assert report.verdict is Verdict.INSUFFICIENT_DATA


@pytest.mark.parametrize("size", [1, 977, 2500, 10_000])
def test_of_a_long_record_the_last_samples_are_kept_and_all_of_them_counted(monkeypatch, size):
    """Settings that are not given are read as soon as so many were taken; half periods are those of all samples."""
    monkeypatch.setattr(scanning, "MOST", 4000)
    blocks = [RECORD.slice(k, k + size) for k in range(0, len(RECORD), size)]
    bare = [replace(block, settings=LoopSettings()) for block in blocks]
    report = scanning.scan_blocks(bare, ScanOptions(carry=True))
    found = identify(RECORD.slice(0, 4000))
    assert not isinstance(found, Note) and float(f"{found.K.value:.6g}") == report.settings.K
    assert (report.samples, report.end) == (len(RECORD), RECORD.time[-1]) and report.carry is None
    assert report.confirmation is not None and report.confirmation.details["left_out"] == len(RECORD) - 4000
    monkeypatch.undo()
    whole = scan(replace(RECORD, settings=report.settings), ScanOptions(confirm=False))
    assert (whole.half_periods, whole.detections) == (report.half_periods, report.detections)
    assert [e.d for e in whole.estimates] == pytest.approx([e.d for e in report.estimates], rel=1e-6)


def test_a_setpoint_that_is_assumed_early_holds_for_what_follows(monkeypatch):
    record = draw(4, "steps", 0.04).record
    bare = replace(record, setpoint=np.full(len(record), np.nan), settings=LoopSettings(),
                   notes=(Note("no_setpoint", "none"),))
    monkeypatch.setattr(scanning, "MOST", len(record) - 2000)
    report = scanning.scan_blocks([bare.slice(k, k + 700) for k in range(0, len(bare), 700)])
    codes = [note.code for note in report.warnings]
    assert codes.count("assumed_setpoint") == 1 and "no_setpoint" not in codes
    monkeypatch.undo()
    level = with_constant_setpoint(bare.slice(0, len(bare) - 2000)).setpoint[0]
    held = scan(replace(bare, setpoint=np.full(len(bare), level), settings=report.settings))
    assert held.half_periods == report.half_periods > 0


def test_a_record_of_few_samples_per_integral_time_clears_no_valve():
    """Every 60th second of FIC105 (2.5 % of play, Ti 20 s), which was cleared below 1.5 %."""
    record = read(Path(__file__).parents[1] / "sample_data" / "plant.csv")["FIC105"]
    for first in (0, 40):
        kept = slice(first, None, 60)
        thin = record_from_arrays(record.setpoint[kept], record.measurement[kept], record.output[kept], interval=60.0,
                                  settings=record.settings)
        found = scan(thin)
        assert found.verdict is Verdict.CANNOT_TELL and found.reasons[0].code == "sampling_too_coarse"


def test_what_leaves_no_sample_is_the_reason(tmp_path):
    rows = [f"{k},50,{50 + 5 * np.sin(k / 9):.2f},{40 + 5 * np.cos(k / 9):.2f}" for k in range(3000)]
    (tmp_path / "p.csv").write_text("\n".join(["time,F1.SP,F1.PV,F1.OP", *rows]))
    (tmp_path / "loops.toml").write_text("[loops.F1]\nK = 1.0\nTi = 10.0\npv_range = [0, 100]\nop_range = [0, 1]\n")
    report = scan(read(tmp_path / "p.csv")["F1"])
    assert report.verdict is Verdict.INSUFFICIENT_DATA
    assert "0 of 3000 samples can be used: all of OP lies outside op_range" in report.reasons[0].message


def test_output_of_another_controller_is_at_most_suspected():
    """OP that goes back and forth through the gap of its valve, but not as this controller would move it."""
    plain = simulate(load_scenarios("sample-plant")[0])
    assert scan(plain).verdict is Verdict.BACKLASH
    other = simulate(load_scenarios("sample-plant")[2]).output
    mixed = replace(plain, output=other[: len(plain)])
    report = scan(mixed)
    assert report.verdict in (Verdict.SUSPECTED, Verdict.CANNOT_TELL)
    assert any("of the output's motion" in note.message for note in (*report.reasons, *report.warnings))


@pytest.mark.parametrize("K", [1.0, 0.4, 2.5])  # of the settings, in parts of the true one: they may be wrong as well
def test_manual_that_is_none_makes_no_test_of_the_valve(K):
    """The mode says manual throughout, and OP is moved by the controller all the same."""
    plain = simulate(load_scenarios("sample-plant")[0])
    settings = plain.settings.with_values("metadata", K=K * plain.settings.K)
    report = scan(replace(plain, state=np.full(len(plain), SampleState.MANUAL, np.uint8), settings=settings))
    assert report.verdict is Verdict.INSUFFICIENT_DATA
    assert "manual_follows" in [note.code for note in report.warnings]


def test_signals_that_are_not_of_one_loop_get_no_verdict(tmp_path):
    """PV of another loop: 1.5 spans, where SP is 0.5; most of its samples count as spikes, and lie apart as well."""
    rows = [f"{k},{50 + k % 3},{148 + 5 * np.sin(k / 9):.2f},{40 + 5 * np.cos(k / 9):.2f}" for k in range(3000)]
    (tmp_path / "p.csv").write_text("\n".join(["time,F1.SP,F1.PV,F1.OP", *rows]))
    (tmp_path / "loops.toml").write_text("[loops.F1]\nK = 1.0\nTi = 10.0\npv_range = [0, 100]\nop_range = [0, 100]\n")
    report = scan(read(tmp_path / "p.csv")["F1"])
    assert report.verdict is Verdict.CANNOT_TELL and report.reasons[0].code == "setpoint_apart"


def test_loops_that_are_copies_of_one_another_are_told():
    others = replace(RECORD, loop="B"), replace(RECORD, loop="C", measurement=RECORD.measurement + 1e-6 * RECORD.index)
    for options in (ScanOptions(), ScanOptions(confirm=False)):
        (said,) = scan_plant([RECORD, *others], options).warnings
        assert said.code == "copied_loops" and said.message.startswith(f"{RECORD.loop}, B give the same numbers")
    assert not scan_plant([RECORD, others[1]]).warnings
