"""One verdict from all evidence: what decides, what limits, and how disagreement is told."""

from __future__ import annotations

from dataclasses import replace

import pytest

from backlash_cli.estimator.oscillation import Oscillation
from backlash_cli.estimator.verdict import Findings, decide
from backlash_cli.record import Note
from backlash_cli.results import Cluster, Confirmation, Verdict

CALM = Oscillation(False, 0.0)
SWINGING = Oscillation(True, 0.9, 60.0, 0.02)
DETAILS = {"evidence": 60.0, "crossings": 30.0, "share": 0.98, "share_deviation": 0.06, "output_range": 0.12,
           "edge": 0.0, "trace": 1.0, "sign_known": 1.0}
FOUND = Confirmation(0.03, (0.027, 0.034), 0.4, 113.0, 0.04, DETAILS)
NOTHING = Confirmation(0.004, (0.0, 0.008), 0.0, -6.0, 0.01, {**DETAILS, "evidence": 0.5, "trace": 0.0})
CLUSTER = Cluster(0.028, (0.026, 0.031), 0.15, 9, 0.9)


def codes(notes: tuple[Note, ...]) -> list[str]:
    return [note.code for note in notes]


def findings(**changes: object) -> Findings:
    return replace(Findings(CLUSTER, 10, 40, CALM, FOUND), **changes)  # type: ignore[arg-type]


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


def test_compressed_pv_needs_both_methods():
    limits = (Note("compressed_linear", "", {"effect": "limits"}),)
    assert decide(findings(quality=limits)).verdict is Verdict.BACKLASH
    assert decide(findings(quality=limits, cluster=None)).verdict is Verdict.SUSPECTED


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
    decision = decide(findings(confirmation=replace(FOUND, ci95=(0.005, 0.06))))
    assert decision.verdict is Verdict.SUSPECTED
    assert "size_unknown" in codes(decision.reasons)


def test_an_oscillation_gets_no_size_that_is_not_called():
    weak = replace(FOUND, details={**DETAILS, "evidence": 6.0})
    decision = decide(findings(confirmation=weak, oscillation=SWINGING))
    assert decision.verdict is Verdict.OSCILLATING
    assert decision.cluster is None
