"""One verdict from all evidence: what decides, what limits, and how disagreement is told."""

from __future__ import annotations

from dataclasses import replace

import pytest

from backlash_cli.estimator.verdict import Findings, decide
from backlash_cli.record import Note
from backlash_cli.results import Cluster, Confirmation, Verdict

CALM, SWINGING = (0.0, 0.0), (0.9, 60.0)
DETAILS = {"evidence": 60.0, "crossings": 30.0, "share": 0.98, "share_deviation": 0.06, "output_range": 0.12,
           "edge": 0.0, "trace": 1.0, "sign_known": 1.0, "output": "recorded"}
FOUND = Confirmation(0.03, (0.027, 0.034), 0.4, 113.0, 0.04, DETAILS)
NOTHING = Confirmation(0.004, (0.0, 0.008), 0.0, -6.0, 0.01, {**DETAILS, "evidence": 0.5, "trace": 0.0})
CLUSTER = Cluster(0.028, (0.026, 0.031), 0.15, 9, 0.9)


def codes(notes: tuple[Note, ...]) -> list[str]:
    return [note.code for note in notes]


def findings(**changes: object) -> Findings:
    return replace(Findings(CLUSTER, 10, 40, CALM, 500.0, FOUND), **changes)  # type: ignore[arg-type]


def test_both_methods_agree():
    decision = decide(findings())
    assert decision.verdict is Verdict.BACKLASH
    assert codes(decision.reasons) == ["play_fits", "play_or_stiction", "methods_agree"]
    assert decision.cluster is not None
    assert (decision.cluster.d, decision.cluster.n) == (0.03, 9)
    assert 0.9 < decision.confidence < 1.0


def test_disagreement_is_shown_and_not_averaged():
    decision = decide(findings(cluster=replace(CLUSTER, d=0.08)))
    assert decision.verdict is Verdict.BACKLASH
    assert decision.cluster is not None
    assert decision.cluster.d == 0.03
    differs = next(note for note in decision.reasons if note.code == "methods_differ")
    assert differs.values["published"] == 0.08


def test_no_half_periods_still_gives_a_number():
    decision = decide(findings(cluster=None, detections=0))
    assert decision.verdict is Verdict.BACKLASH
    assert decision.cluster is not None
    assert decision.cluster.n == 0


@pytest.mark.parametrize(("change", "code"), [
    ({"evidence": 6.0}, "weak_evidence"), ({"crossings": 1.0}, "few_reversals"),
    ({"share_deviation": 0.5}, "single_event"),
    ({"edge": 1.0}, "edge_of_widths"), ({"output_range": 0.034}, "little_motion"),
    ({"output_range": 0.04, "evidence": 15.0}, "little_motion"),
])
def test_a_rule_against_it_makes_it_suspected(change: dict[str, float], code: str):
    decision = decide(findings(confirmation=replace(FOUND, details={**DETAILS, **change})))
    assert decision.verdict is Verdict.SUSPECTED
    assert code in codes(decision.reasons)


def test_without_the_test_a_calm_error_says_something_only_when_it_was_watched_for_long():
    calm = findings(confirmation=None, cluster=None, detections=0, long_half_periods=0)
    assert decide(calm).verdict is Verdict.NO_BACKLASH
    short = decide(replace(calm, watched=30.0))
    assert short.verdict is Verdict.INSUFFICIENT_DATA and codes(short.reasons) == ["few_half_periods"]


def test_rounded_output_hides_what_is_smaller():
    decision = decide(findings(output_step=0.02))
    assert decision.verdict is Verdict.SUSPECTED
    assert "below_rounding" in codes(decision.reasons)


def test_sizes_below_half_a_percent_are_no_alarm():
    small = replace(FOUND, d=0.004, ci95=(0.003, 0.005))
    assert decide(findings(confirmation=small)).verdict is not Verdict.BACKLASH


def test_confidence_grows_with_the_evidence_and_stays_below_certainty():
    sure = [decide(findings(confirmation=replace(FOUND, details={**DETAILS, "evidence": e}))).confidence
            for e in (7.0, 18.0, 30.0, 60.0, 600.0)]
    assert sure == sorted(sure)
    assert 0.5 < sure[0] < 0.8
    assert sure[-1] == 0.98


@pytest.mark.parametrize(("imitation", "most"), [(29.0, 0.98), (31.0, 0.92)])
def test_much_evidence_is_less_sure_where_shapes_of_no_valve_explain_half_of_it(imitation, most):
    details = {**DETAILS, "evidence": 200.0, "gain": 60.0, "imitation": imitation}
    decision = decide(findings(confirmation=replace(FOUND, details=details)))
    assert decision.verdict is Verdict.BACKLASH and decision.confidence == pytest.approx(most)


def test_compressed_pv_needs_both_methods():
    limits = (Note("compressed_linear", "", {"effect": "limits"}),)
    assert decide(findings(quality=limits)).verdict is Verdict.BACKLASH
    assert decide(findings(quality=limits, cluster=None)).verdict is Verdict.SUSPECTED


@pytest.mark.parametrize(("code", "cleared"), [("compressed_linear", False), ("compressed_held", True)])
def test_a_swinging_door_clears_no_valve(code, cleared):
    limits = (Note(code, "", {"effect": "limits"}),)
    decision = decide(findings(quality=limits, cluster=None, confirmation=NOTHING))
    assert decision.verdict is (Verdict.NO_BACKLASH if cleared else Verdict.CANNOT_TELL)
    assert code in codes(decision.reasons)


@pytest.mark.parametrize("code", ["settings_unchecked", "settings_contradicted", "settings_action_sign"])
def test_settings_that_the_data_contradict_clear_no_valve(code):
    limits = (Note(code, "", {"effect": "limits", "severity": "contradict"}),)
    decision = decide(findings(quality=limits, cluster=None, confirmation=NOTHING))
    assert decision.verdict is Verdict.CANNOT_TELL and codes(decision.reasons) == [code]


@pytest.mark.parametrize("code", ["settings_unchecked", "settings_contradicted", "settings_action_sign"])
def test_two_methods_prove_nothing_of_an_output_that_this_controller_did_not_make(code):
    limits = (Note(code, "", {"effect": "limits", "severity": "contradict"}),)
    decision = decide(findings(quality=limits))
    assert decision.verdict is Verdict.SUSPECTED and codes(decision.reasons)[:2] == ["play_fits", code]


def test_what_blocks_comes_before_everything():
    decision = decide(findings(quality=(Note("measurement_constant", "", {"effect": "blocks"}),)))
    assert decision.verdict is Verdict.CANNOT_TELL
    assert codes(decision.reasons) == ["measurement_constant"]


def test_healthy_only_with_a_stated_limit():
    decision = decide(findings(confirmation=NOTHING))
    assert decision.verdict is Verdict.NO_BACKLASH
    assert codes(decision.reasons)[:2] == ["play_does_not_fit", "limit_of_detection"]
    assert "half_periods_only" in codes(decision.reasons)
    assert decision.cluster is not None
    assert decision.cluster.d == 0.0
    assert decision.cluster.limit_of_detection == 0.01


@pytest.mark.parametrize(("confirmation", "code"), [
    (replace(NOTHING, limit_of_detection=None), "little_information"),
    (replace(NOTHING, limit_of_detection=0.028), "little_information"),
    (replace(NOTHING, details={**NOTHING.details, "trace": 1.0}), "not_separable"),
    (Note("output_still", "OP stands still"), "output_still"),
])
def test_cannot_tell_says_why(confirmation: Confirmation | Note, code: str):
    decision = decide(findings(confirmation=confirmation))
    assert decision.verdict is Verdict.CANNOT_TELL
    assert codes(decision.reasons)[0] == code


def test_a_record_too_short_for_the_test_is_too_little_data():
    decision = decide(findings(confirmation=Note("short_record", "too short")))
    assert decision.verdict is Verdict.INSUFFICIENT_DATA
    assert codes(decision.reasons) == ["short_record"]


def test_an_oscillation_without_a_dead_band_is_an_oscillation():
    assert decide(findings(confirmation=NOTHING, oscillation=SWINGING)).verdict is Verdict.OSCILLATING
    assert decide(findings(oscillation=SWINGING)).verdict is Verdict.BACKLASH


def test_half_periods_alone_never_do_more_than_suspect():
    assert decide(findings(confirmation=None)).verdict is Verdict.SUSPECTED
    assert decide(findings(confirmation=None, cluster=None, long_half_periods=0)).verdict is Verdict.NO_BACKLASH


def test_a_size_that_is_not_known_is_suspected_at_most():
    """As wide as twice the size: it might be none."""
    decision = decide(findings(confirmation=replace(FOUND, ci95=(0.0, 2.1 * FOUND.d))))
    assert decision.verdict is Verdict.SUSPECTED
    assert "size_unknown" in codes(decision.reasons)
    known = decide(findings(confirmation=replace(FOUND, ci95=(0.1 * FOUND.d, 1.9 * FOUND.d))))
    assert known.verdict is Verdict.BACKLASH


def test_an_oscillation_gets_no_size_that_is_not_called():
    weak = replace(FOUND, details={**DETAILS, "evidence": 6.0})
    decision = decide(findings(confirmation=weak, oscillation=SWINGING))
    assert decision.verdict is Verdict.OSCILLATING
    assert decision.cluster is None


BY_HAND = {"source": "manual_test", "evidence": 20.0, "elsewhere": 9.0, "crossings": 3.0, "output_range": 0.06,
           "edge": 0.0, "trace": 1.0, "sign_known": 1.0, "output": "recorded", "recordings": 1.0}
TESTED = Confirmation(0.02, (0.017, 0.023), 0.4, 30.0, None, BY_HAND)
CLEARED = Confirmation(0.004, (0.0, 0.008), 0.0, -6.0, 0.015, {**BY_HAND, "evidence": 0.5, "trace": 0.0})
ONE_TURN = replace(TESTED, details={**BY_HAND, "crossings": 1.0})
WEAK = replace(FOUND, d=0.021, ci95=(0.012, 0.03), details={**DETAILS, "evidence": 5.5})
SHORT = Note("short_record", "too short")
NO_ANSWER = Note("manual_no_answer", "PV did not answer", {"at_least": 0.03})
VAGUE = replace(CLEARED, limit_of_detection=None)


@pytest.mark.parametrize(("automatic", "manual", "verdict", "d", "first"), [
    (SHORT, TESTED, Verdict.BACKLASH, 0.02, "manual_test"),
    (SHORT, CLEARED, Verdict.NO_BACKLASH, 0.0, "manual_test"),
    (SHORT, ONE_TURN, Verdict.SUSPECTED, 0.02, "manual_test"),
    (SHORT, VAGUE, Verdict.INSUFFICIENT_DATA, None, "short_record"),
    (SHORT, NO_ANSWER, Verdict.SUSPECTED, None, "manual_no_answer"),
    (FOUND, NO_ANSWER, Verdict.BACKLASH, 0.03, "play_fits"),
    (FOUND, TESTED, Verdict.BACKLASH, 0.02, "manual_test"),  # the narrower of two intervals
    (FOUND, replace(TESTED, ci95=(0.01, 0.04)), Verdict.BACKLASH, 0.03, "manual_test"),
    (FOUND, CLEARED, Verdict.NO_BACKLASH, 0.0, "manual_test"),
    (FOUND, replace(CLEARED, limit_of_detection=0.04), Verdict.BACKLASH, 0.03, "manual_test"),
    (WEAK, replace(CLEARED, limit_of_detection=0.03), Verdict.SUSPECTED, 0.021, "manual_test"),
    (FOUND, VAGUE, Verdict.BACKLASH, 0.03, "play_fits"),
    (NOTHING, TESTED, Verdict.BACKLASH, 0.02, "manual_test"),
    (NOTHING, CLEARED, Verdict.NO_BACKLASH, 0.0, "manual_test"),
    (NOTHING, ONE_TURN, Verdict.SUSPECTED, 0.02, "manual_test"),  # of a size that normal operation would have excluded
    (replace(NOTHING, limit_of_detection=0.02), ONE_TURN, Verdict.NO_BACKLASH, 0.0, "play_does_not_fit"),
    (WEAK, ONE_TURN, Verdict.BACKLASH, 0.02, "manual_test"),  # the same size twice
    (WEAK, replace(ONE_TURN, d=0.04, ci95=(0.035, 0.045)), Verdict.SUSPECTED, 0.021, "play_fits"),
])
def test_a_test_in_manual_and_normal_operation_together(automatic, manual, verdict, d, first):
    decision = decide(findings(cluster=None, detections=0, confirmation=automatic, manual=manual))
    assert (decision.verdict, decision.cluster and decision.cluster.d) == (verdict, d)
    found = codes(decision.reasons)
    assert found[0] == first and any(code.startswith("manual_") for code in found)
    clash = (automatic, manual) in ((FOUND, CLEARED), (NOTHING, TESTED), (NOTHING, ONE_TURN))
    assert ("tests_differ" in found) == clash
    if clash:
        assert decision.confidence <= 0.6


@pytest.mark.parametrize(("automatic", "cluster", "verdict", "d"), [
    (NOTHING, CLUSTER, Verdict.SUSPECTED, 0.02), (FOUND, CLUSTER, Verdict.BACKLASH, 0.03),
    (NOTHING, replace(CLUSTER, ci95=(0.022, 0.034)), Verdict.BACKLASH, 0.02),
    (NOTHING, replace(CLUSTER, n=2), Verdict.BACKLASH, 0.02)])
def test_half_periods_of_a_larger_dead_band_speak_against_a_test_in_manual(automatic, cluster, verdict, d):
    """A load that moves PV just after a step by hand passes for the answer of a valve with a small gap."""
    decision = decide(findings(confirmation=automatic, manual=TESTED, cluster=cluster))
    assert (decision.verdict, decision.cluster and decision.cluster.d) == (verdict, d)
    assert decision.confidence <= 0.5 or verdict is Verdict.BACKLASH
    if d == 0.03:
        assert decision.confirmation is FOUND and "2.8 %" in decision.reasons[-1].message


def test_what_a_test_in_manual_lacks_is_said():
    decision = decide(findings(manual=ONE_TURN))
    assert decision.verdict is Verdict.BACKLASH and "once in this record" in decision.reasons[-1].message
    assert decision.confirmation is FOUND


def test_a_test_in_manual_decides_on_the_valve_of_a_loop_that_swings_and_the_swing_is_said():
    sound, worn = (decide(findings(confirmation=NOTHING, oscillation=SWINGING, manual=m)) for m in (CLEARED, TESTED))
    assert sound.verdict is Verdict.NO_BACKLASH and worn.verdict is Verdict.BACKLASH
    for decision in (sound, worn):
        assert codes(decision.reasons)[0] == "manual_test" and codes(decision.reasons)[-1] == "oscillation"
    vague = decide(findings(confirmation=NOTHING, oscillation=SWINGING, manual=VAGUE))
    assert vague.verdict is Verdict.OSCILLATING and "manual_test" in codes(vague.reasons)


def test_a_compressed_pv_limits_a_test_in_manual_as_well():
    held = Note("compressed_held", "stored by exception", {"effect": "blocks"})
    decision = decide(findings(quality=(held,), manual=TESTED))
    assert decision.verdict is Verdict.SUSPECTED and "compressed_held" in codes(decision.reasons)


def test_records_all_in_manual_are_judged_by_their_test():
    nothing = Note("no_usable_data", "no usable sample", {"effect": "blocks"})
    assert decide(findings(quality=(nothing,), confirmation=None, manual=TESTED)).verdict is Verdict.BACKLASH


@pytest.mark.parametrize(("output", "evidence", "code", "verdict"), [
    ("completed", 14.0, "interpolated", Verdict.BACKLASH), ("completed", 12.0, "interpolated", Verdict.SUSPECTED),
    ("recorded", 14.0, "interpolated", Verdict.SUSPECTED), ("completed", 14.0, "compressed_held", Verdict.SUSPECTED)])
def test_pv_on_lines_is_no_obstacle_where_the_output_is_known_in_between(output, evidence, code, verdict) -> None:
    """Twice the evidence is asked for, and tells the confidence that half of it would."""
    found = replace(FOUND, details={**DETAILS, "output": output, "evidence": evidence})
    limit = Note(code, "as it was stored", {"effect": "limits"})
    decision = decide(findings(confirmation=found, quality=(limit,), cluster=None))
    assert decision.verdict is verdict and code in codes(decision.reasons)
    if verdict is Verdict.BACKLASH:
        half = decide(findings(cluster=None, confirmation=replace(
            found, details={**found.details, "evidence": 0.5 * evidence})))
        assert decision.confidence == half.confidence


@pytest.mark.parametrize("confirmation", [None, Note("too_few_blocks", "")])
def test_what_limits_the_data_is_said_where_nothing_else_can_be(confirmation):
    limits = (Note("compressed_linear", "", {"effect": "limits"}), Note("filled", "", {"effect": "info"}))
    for cluster in (CLUSTER, None):
        decision = decide(findings(cluster=cluster, confirmation=confirmation, quality=limits))
        assert codes(decision.reasons)[1:] == ["compressed_linear"], decision.verdict
