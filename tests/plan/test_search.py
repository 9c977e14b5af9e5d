"""Plans: only for what is undecided, the least that decides first, within the limits, the same for the same seed."""

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.plan import Move, PlanOptions, plan, search
from backlash_cli.plan.words import amount
from backlash_cli.record import LoopSettings, SampleState
from backlash_cli.reporter.advice import plans
from backlash_cli.results import Verdict
from backlash_cli.results.advice import PlanOption
from backlash_cli.scanning import scan
from tests.plan.test_twin import loop

FEW = PlanOptions(target=0.02, repeats=2)


@pytest.fixture(scope="module")
def quiet():
    """An hour in which little happens: a scan cannot tell."""
    record = loop(duration=3600.0)
    assert scan(record).verdict in (Verdict.CANNOT_TELL, Verdict.SUSPECTED)
    return record


@pytest.fixture(scope="module")
def planned(quiet):
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(search, "ROUNDS", (2,))  # more only cost time here
        return plan(quiet, FEW)


def test_a_decided_loop_has_no_plan(quiet):
    report = replace(scan(quiet), verdict=Verdict.NO_BACKLASH)
    assert plan(quiet, FEW, report) is None


def test_every_kind_of_test_is_weighed_with_its_chances(planned):
    assert {"wait", "setpoint_steps", "manual_test"} <= {o.kind for o in planned.options}
    for option in planned.options:
        assert option.kind == "logging" or (option.power is not None and 0 <= option.power + option.missed <= 1)
        assert option.text.endswith(".")
    decides = [o.decides for o in planned.options if o.kind != "logging"]
    assert decides == sorted(decides, reverse=True), "what decides comes first"
    assert "gain" in planned.model and planned.target == 0.02


def test_the_same_seed_gives_the_same_plan(quiet, planned):
    steps = [o for o in planned.options if o.kind == "setpoint_steps"]
    assert [o for o in plan(quiet, replace(FEW, kinds=("setpoint_steps",))).options if o.kind != "logging"] == steps


def test_what_goes_beyond_the_limits_says_by_how_much_and_comes_last(quiet, monkeypatch):
    monkeypatch.setattr(search, "ROUNDS", (4,))
    found = plan(quiet, replace(FEW, max_pv_move=Move(0.001), kinds=("manual_test",)))
    (option,) = [o for o in found.options if o.kind == "manual_test"]
    assert option.power > 0.0 and not option.within_limits and option.pv_move > 0.001
    assert f"it needs --max-pv-move {100 * option.pv_move:.2g}%." in option.text and "--max-op-move" not in option.text


def test_a_test_in_which_a_signal_leaves_its_span_is_not_offered(quiet, monkeypatch):
    monkeypatch.setattr(search, "ROUNDS", (2,))
    monkeypatch.setattr(search.Played, "moved", property(lambda played: (9.6, 0.1)))
    found = plan(quiet, replace(FEW, kinds=("manual_test",)))
    assert found.options == () and all("within their spans" in text for text in (
        plans([found], 1).text(), plans([found], 1).page()))


def test_a_test_in_manual_takes_half_an_hour_where_rounds_allow_it(planned):
    (option,) = [o for o in planned.options if o.kind == "manual_test"]
    assert option.duration_s >= 1800.0


def test_a_worn_valve_counts_as_told_where_the_evidence_has_a_margin(quiet, planned, monkeypatch):
    (before,) = [o for o in planned.options if o.kind == "manual_test"]
    monkeypatch.setattr(search, "ROUNDS", (2,))
    monkeypatch.setattr(search, "MARGIN", 1e6)
    (option,) = [o for o in plan(quiet, replace(FEW, kinds=("manual_test",))).options if o.kind == "manual_test"]
    assert before.power > 0.0 == option.power


def test_moves_stay_within_the_limits(planned):
    for option in planned.options:
        assert option.within_limits == (max(option.pv_move or 0.0, option.op_move or 0.0) <= 0.11)
        assert option.within_limits != ("beyond your limits" in option.text)


def test_a_test_in_manual_moves_op_by_its_steps_and_nothing_else(planned):
    (option,) = [o for o in planned.options if o.kind == "manual_test"]
    small, large = option.levels[:4], option.levels[4:8]
    assert max(map(abs, small)) == 1.0 < max(map(abs, large)) <= 2.5
    assert sum(option.levels) == 0.0, "a level comes back"
    assert option.op_move == pytest.approx(option.move * max(map(abs, large)))
    assert "by 2 %, then" in option.text


def test_without_op_or_settings_logging_comes_first(quiet):
    found = plan(replace(quiet, output=None))
    assert found.options[0].kind == "logging" and "OP" in found.options[0].text
    random = np.random.default_rng(0)
    unknown = replace(quiet, settings=LoopSettings(), output=0.5 + 0.01 * random.normal(size=len(quiet)))
    found = plan(unknown)
    assert found.options[0].kind == "logging" and "K and Ti" in found.options[0].text


def test_a_record_without_a_usable_sample_says_so(quiet):
    dead = replace(quiet, state=np.full(len(quiet), SampleState.MANUAL, dtype=np.uint8))
    found = plan(dead)
    assert found is not None and [o.kind for o in found.options] == ["logging"]


def test_rounds_are_counted_and_said_once():
    twice = PlanOption("manual_test", "", levels=(1.0, 2.0, 1.0, 0.0) * 2)
    assert twice.rounds == 2
    assert PlanOption("setpoint_steps", "", levels=(1.0, 0.0)).rounds == 1 == PlanOption("wait", "").rounds


def test_moves_are_said_in_units_of_the_loop():
    assert amount(0.02, (0.0, 900.0)) == "18 (2 % of span)" and amount(0.02, (0.0, 100.0)) == "2 %"


def test_an_option_decides_only_where_both_valves_are_told():
    assert PlanOption("wait", "", power=0.9, clears=0.85).decides
    assert not PlanOption("wait", "", power=0.99, clears=0.5).decides
    assert not PlanOption("wait", "", power=0.9, clears=0.85, false_alarm=0.1).decides
    assert not PlanOption("logging", "").decides
