"""Why an effect was not taken, and what is said of a gap that is small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.effects import EFFECTS
from backlash_cli.model import explain
from backlash_cli.model.problem import problem_from_record
from backlash_cli.model.reasons import marked, usual_move, with_reasons
from backlash_cli.record import Note
from backlash_cli.results import Candidate, FittedEffect, FittedParameter

from .loops import loop

SIBLINGS = {e.name: e.fitting.siblings for e in EFFECTS}


def gap(d: float, *, reduction: float = 0.0, evidence: float = 5.0, name: str = "backlash") -> Candidate:
    key = "d" if name == "backlash" else "S"
    parameters = {key: FittedParameter(d, "span")}
    return Candidate(name, parameters, stage="valve", rmse_holdout=0.01, error_reduction=reduction, evidence=evidence,
                     verdict="not needed")


def code(candidate: Candidate, *, accepted: tuple[str, ...] = (), alike: tuple[tuple[str, str], ...] = (),
         reason: Note | None = None, turning: bool = True) -> str | None:
    problem = problem_from_record(loop(noise=0.001))
    if not turning:
        problem = replace(problem, output=np.linspace(0.3, 0.6, problem.samples))
    (told,) = with_reasons(problem, 1.2, [candidate], accepted, alike, SIBLINGS, reason, 20.0)
    return told.why.code if told.why else None


def test_each_reason_has_its_case() -> None:
    assert code(gap(0.03), accepted=("backlash",)) is None
    assert code(gap(0.03, name="stiction"), accepted=("backlash",), alike=(("backlash", "stiction"),)) == "look_alike"
    assert code(gap(0.03, name="stiction"), accepted=("backlash",)) == "look_alike_better"
    assert code(gap(0.03), reason=Note("too_little_motion", "x")) == "too_little_motion"
    assert code(gap(0.03), turning=False) == "op_never_turns"
    assert code(gap(0.0)) == "fits_nothing"
    assert code(gap(0.0004)) == "below_resolution"
    assert code(gap(0.03, evidence=50.0), accepted=("dead_time",)) == "other_explains"
    assert code(gap(0.03, reduction=0.4)) == "little_evidence"
    assert code(gap(0.03)) == "no_better_prediction"
    assert code(gap(0.03, evidence=50.0, reduction=0.05)) == "no_better_prediction"


def test_only_a_gap_of_the_valve_is_a_gap() -> None:
    assert gap(0.03).gap == 0.03
    stop = FittedEffect("saturation", {"low": FittedParameter(0.2, "span", level=True)}, stage="valve")
    assert stop.gap is None and replace(gap(0.03), stage="sensor").gap is None


@pytest.mark.parametrize(("d", "gain", "codes"), [
    (0.03, 1.2, set()),
    (0.008, 1.2, {"small_gap"}),
    (0.03, 0.05, {"small_against_noise"}),
])
def test_a_small_gap_is_marked(d: float, gain: float, codes: set[str]) -> None:
    problem = problem_from_record(loop(noise=0.001))
    effect = FittedEffect("backlash", {"d": FittedParameter(d, "span")}, stage="valve")
    assert {n.code for n in marked(problem, gain, effect).notes} - {"coarse_samples"} == codes
    fast = replace(problem, output=0.5 + 0.02 * np.sin(np.arange(problem.samples)))
    assert usual_move(fast) > 0.01
    assert "coarse_samples" in {n.code for n in marked(fast, gain, effect).notes}


def test_an_explanation_gives_a_reason_for_all_that_was_not_taken() -> None:
    found = explain(loop(d=0.03, noise=0.0005))
    assert [e.effect for e in found.effects] == ["backlash"] and found.effects[0].notes == ()
    for c in found.candidates:
        assert (c.why is None) == (c.effect == "backlash"), c.effect
