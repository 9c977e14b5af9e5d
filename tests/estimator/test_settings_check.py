from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.estimator.identify import identify
from backlash_cli.estimator.settings_check import check_settings, clocks, contradicts
from backlash_cli.record import LoopSettings, Note, record_from_arrays
from backlash_cli.results import Verdict
from backlash_cli.scanning import scan

from .closed_loop import Loop, load_steps, run

LOOP = Loop(K=0.6, Ti=28.0, dead_band=0.02)
FOUND = identify(run(LOOP, 5000, load=load_steps(5000)))
PID = identify(run(Loop(K=0.8, Ti=30.0, Td=8.0), 5000, load=load_steps(5000)))


def codes(K: float | None, Ti: float | None, **more: object) -> list[str]:
    settings = LoopSettings(K=K, Ti=Ti, source={"K": "metadata", "Ti": "metadata"}, **more)  # type: ignore[arg-type]
    return [note.code for note in check_settings(settings, FOUND)]


@pytest.mark.parametrize(("K", "Ti"), [(0.6, 28.0), (0.63, 27.0), (None, 28.0), (0.6, None), (None, None)])
def test_right_settings_are_left_alone(K: float | None, Ti: float | None) -> None:
    assert codes(K, Ti, pv_range=(0.0, 900.0), op_range=(0.0, 100.0)) == []


@pytest.mark.parametrize(
    ("K", "Ti", "code"),
    [
        (0.6, 28.0 / 60, "settings_ti_minutes"),
        (0.6, 28.0 * 60, "settings_ti_minutes"),
        (None, 28.0 / 60, "settings_ti_minutes"),
        (0.6, 60 / 28.0, "settings_ti_repeats"),
        (0.6, 1 / 28.0, "settings_ti_repeats"),
        (100 / 0.6, 28.0, "settings_proportional_band"),
        (100 / 0.6, 28.0 / 60, "settings_proportional_band"),
        (-0.6, 28.0, "settings_action_sign"),
        (0.6, 28.0 * 1.3, "settings_disagree"),
        (1.2, 28.0, "settings_contradicted"),
        (2.4, 28.0 * 4, "settings_gain"),
    ],
)
def test_wrong_settings_are_named(K: float | None, Ti: float, code: str) -> None:
    assert codes(K, Ti) == [code]


def test_an_action_of_the_other_sign_is_a_contradiction() -> None:
    given = LoopSettings(K=-0.6, Ti=28.0, source={"K": "metadata", "Ti": "metadata"})
    found = identify(run(LOOP, 9000, load=load_steps(9000)))
    assert [contradicts(note) for note in check_settings(given, found)] == [True]


@pytest.mark.parametrize("span", [16.0, 60.0, 150.0, 900.0])
def test_a_gain_in_engineering_units_is_named_when_the_spans_are_known(span: float) -> None:
    assert codes(0.6 * 100 / span, 28.0, pv_range=(0.0, span), op_range=(0.0, 100.0)) == ["settings_engineering_gain"]


@pytest.mark.parametrize("span", [60.0, 150.0])
def test_the_factor_of_the_spans_is_believed_where_the_data_say_less(span: float) -> None:
    """Sampled at Ti/2 K/Ti is known to 9 %: enough to see 1.5 where the spans say 1.5, not enough for any 1.5."""
    record = run(LOOP, 9000, load=load_steps(9000))
    assert record.output is not None
    signals = (record.setpoint[::14], record.measurement[::14], record.output[::14])
    found = identify(record_from_arrays(*signals, interval=14.0))
    assert not isinstance(found, Note) and found.ratio.ci95[1] > 1.07 * found.ratio.value
    source = {"K": "metadata", "Ti": "metadata"}
    given = LoopSettings(K=0.6 * 100 / span, Ti=28.0, pv_range=(0.0, span), op_range=(0.0, 100.0), source=source)
    assert [note.code for note in check_settings(given, found)] == ["settings_engineering_gain"]
    unknown = replace(given, pv_range=(0.0, 1.0), op_range=(0.0, 1.0), K=0.6 / 1.45)
    assert check_settings(unknown, found) == ()


def test_right_settings_are_left_alone_where_the_setpoint_moves_and_values_are_rounded() -> None:
    moved = run(LOOP, 9000, setpoint=0.5 + 0.05 * (np.arange(9000) // 900 % 2), load=load_steps(9000))
    assert moved.output is not None
    given = LoopSettings(K=0.6, Ti=28.0, source={"K": "metadata", "Ti": "metadata"})
    for record in (moved, replace(moved, output=np.round(moved.output, 3))):
        assert check_settings(given, identify(record)) == ()


def test_what_was_identified_is_not_compared_with_itself() -> None:
    settings = LoopSettings(K=5.0, Ti=28.0, source={"K": "identified", "Ti": "identified"})
    assert check_settings(settings, FOUND) == ()


def test_a_check_that_is_not_possible_says_why() -> None:
    why = Note("no_output", "the record has no controller output")
    (note,) = check_settings(LoopSettings(K=1.0, Ti=2.0), why)
    assert note.code == "settings_unchecked" and note.values["why"] == "no_output"


@pytest.mark.parametrize(("code", "Ti", "severe"), [
    ("integral_part_unseen", 28.0, True), ("integral_part_unseen", 1.5, False),
    ("integral_part_unseen", 1.6, True),
    ("integral_part_unseen", None, False), ("not_this_controller", 28.0, True),
    ("proportional_part_unseen", 28.0, False)])
def test_an_output_without_the_integral_part_that_is_given_is_not_of_this_controller(code, Ti, severe):
    (note,) = check_settings(LoopSettings(K=1.0, Ti=Ti), Note(
        code, "why", {"interval": 1.0} if code == "integral_part_unseen" else {}))
    assert contradicts(note) is severe


@pytest.mark.parametrize("late", [0, 1, 3, 5])
@pytest.mark.parametrize("noise", [0.0, 0.0002, 0.001])
@pytest.mark.parametrize("given", [True, False])
def test_an_output_that_is_pv_in_another_unit_is_no_proof_of_a_worn_valve(late, noise, given):
    healthy = run(Loop(K=0.6, Ti=28.0, noise=0.001), 7200, load=load_steps(7200, 0.03))
    rng = np.random.default_rng(late)
    pv = np.round(healthy.measurement, 4)
    op = np.round(0.5 * np.roll(pv, late) + noise * rng.normal(size=len(pv)), 3)
    source = {"K": "metadata", "Ti": "metadata"}
    settings = LoopSettings(K=0.6, Ti=28.0, source=source) if given else LoopSettings()
    report = scan(record_from_arrays(0.5, pv, op, interval=1.0, settings=settings))
    assert report.verdict is not Verdict.BACKLASH, report.reasons


def test_a_slow_picture_of_a_record_is_no_coarse_record() -> None:
    ends = replace(FOUND, Ti=replace(FOUND.Ti, value=24000.0, ci95=(-2e6, 2e6)), interval=128.0, ratio=replace(
        FOUND.ratio, value=-4e-5, ci95=(-2e-4, 1e-4)), K=replace(FOUND.K, value=-1.05, ci95=(-1.1, -1.0)))
    given = LoopSettings(K=0.9, Ti=40.0, source={"K": "metadata", "Ti": "metadata"})
    assert [note.code for note in check_settings(given, ends)] == ["settings_contradicted"]
    coarse = replace(ends, Ti=replace(ends.Ti, value=300.0))
    assert [note.code for note in check_settings(given, coarse)] == ["settings_unchecked"]


def test_a_forgotten_derivative_is_mentioned() -> None:
    notes = check_settings(LoopSettings(K=0.8, Ti=30.0), PID)
    assert [note.code for note in notes] == ["settings_derivative"]
    assert check_settings(LoopSettings(K=0.8, Ti=30.0, Td=8.0), PID) == ()


def test_messages_name_the_mistake_and_the_value_from_the_data() -> None:
    (note,) = check_settings(LoopSettings(K=0.6, Ti=28.0 / 60), FOUND)
    assert "given in minutes?" in note.message and "Ti 28.1" in note.message
    assert note.values["severity"] == "contradict"
    assert note.values["factor"] == pytest.approx(60.0)


@pytest.mark.parametrize("loop", [LOOP, Loop(K=0.8, Ti=30.0, Td=8.0), Loop(K=-0.6, Ti=28.0, gain=-1.0)])
@pytest.mark.parametrize(("late", "told"), [(-70, True), (-25, True), (-1, False), (0, False), (3, False), (120, True)])
def test_clocks_that_differ_are_told_by_the_noise_that_op_answers(loop: Loop, late: int, told: bool) -> None:
    """As a brute-force correlation, distance by distance, has it; whatever the load and the valve do."""
    record = run(loop, 6000, load=load_steps(6000))
    assert record.output is not None
    shifted = replace(record, output=np.roll(record.output, late), settings=LoopSettings(K=loop.K, Ti=loop.Ti))
    record = shifted.slice(130, 5870)
    assert record.output is not None
    found = clocks(record)
    bent = [np.diff(x, 2) for x in (record.measurement, record.output)]
    plain = {far: np.corrcoef(bent[0][200:-200], np.roll(bent[1], -far)[200:-200])[0, 1] for far in range(-150, 151)}
    best = max(plain, key=lambda far: -np.sign(loop.K) * plain[far])
    assert 0 <= best - late <= 2
    assert [(note.code, note.values["effect"]) for note in found] == [("clocks_differ", "blocks")] * told
    assert not told or found[0].values["seconds"] == best


def test_a_swing_of_few_samples_is_no_difference_of_clocks() -> None:
    swing = np.sin(np.arange(6000) * 2 * np.pi / 6)
    noise = 0.05 * np.random.default_rng(0).normal(size=(2, 6000))
    pv, op = 0.5 + 0.02 * (swing + noise[0]), 0.5 - 0.02 * (np.roll(swing, 12) + noise[1])
    assert clocks(record_from_arrays(0.5, pv, op, interval=5.0, settings=LoopSettings(K=0.6, Ti=9.0))) == ()


def test_without_noise_in_op_nothing_is_said_about_clocks() -> None:
    record = run(Loop(noise=0.0), 6000, load=load_steps(6000))
    assert record.output is not None
    late = replace(record, output=np.roll(record.output, 40), settings=LoopSettings(K=0.6, Ti=20.0))
    coarse = replace(late, output=np.round(late.output, 2))
    assert clocks(coarse) == () == clocks(replace(late, output=None)) == clocks(replace(late, settings=LoopSettings()))


def test_no_dead_band_is_excluded_from_tags_of_different_clocks() -> None:
    record = run(replace(LOOP, dead_band=0.05), 12000, load=load_steps(12000))
    assert record.output is not None
    early = replace(record, output=np.roll(record.output, -25), settings=LoopSettings(
        K=0.6, Ti=28.0, Kp=1.0, source={"K": "metadata", "Ti": "metadata"})).slice(0, 11900)
    report = scan(early)
    assert report.verdict is Verdict.CANNOT_TELL and report.reasons[0].code == "clocks_differ"
