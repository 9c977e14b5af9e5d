"""The workbench on a terminal: ladder, numbers with units, what it means, regions; JSON as in the contract."""

import json
import re
from dataclasses import replace

import pytest

from backlash_cli.effects import EFFECTS
from backlash_cli.record import LoopSettings
from backlash_cli.reporter.explain_report import judged
from backlash_cli.reporter.templates import sentence
from backlash_cli.reporter.words import error_size, fill, meaning, quantity, share
from backlash_cli.results import FittedEffect, FittedParameter, Rest, Step
from tests.reporter.explanations import SETTINGS, comparison, explanation, nothing
from tests.reporter.reports import HOSTILE


def test_the_ladder_is_one_line():
    steps = [Step(None, 0.032), Step("dead_time", 0.021), Step("backlash", 0.008)]
    said = "plain model 3.2 % -> + dead time 2.1 % -> + backlash 0.8 % (noise floor 0.75 %)"
    assert sentence("ladder", steps, 0.0075) == said


@pytest.mark.parametrize(("parameter", "stage", "said"), [
    (FittedParameter(0.03, "span", (0.0295, 0.0307)), "valve", "3.00 % of OP span (95 %: 2.95 to 3.07 %)"),
    (FittedParameter(0.005, "span"), "sensor", "0.500 % of PV span, 4.5 in PV units"),
    (FittedParameter(0.0002, "span", (0.0, 0.03)), "valve", "0.020 % of OP span (95 %: 0 to 3 %)"),
    (FittedParameter(1.0, "0 or 1"), "valve", "yes"),
    (FittedParameter(0.02, "1/s"), "valve", "2.00 % of OP span per second"),
    (FittedParameter(12.34, "s", (11.9, 12.8)), "process", "12.3 s (95 %: 11.9 to 12.8 s)"),
    (FittedParameter(-1.4, "1"), "valve", "-1.40"),
    (FittedParameter(float("-inf"), "span"), "valve", "none"),
    (FittedParameter(0.0, "span"), "valve", "0 % of OP span"),
    (FittedParameter(3.0, "bar"), "", "3.00 bar"),
    (FittedParameter((1.0, 2.0), "s"), "load", "1.00 s, 2.00 s"),
])
def test_a_number_has_its_unit_and_interval(parameter, stage, said):
    assert quantity(parameter, stage, SETTINGS) == said


def test_amounts_and_levels_in_engineering_units():
    milliamperes = LoopSettings(op_range=(4.0, 20.0))
    assert quantity(FittedParameter(0.05, "span"), "valve", milliamperes).endswith(", 0.8 in OP units")
    assert quantity(FittedParameter(0.5, "span", level=True), "valve", milliamperes).endswith(", 12 in OP units")


def test_events_are_told_by_the_clock_and_counted_when_many():
    events = FittedParameter(tuple(60.0 * k for k in range(9)), "s")
    said = quantity(events, "load", SETTINGS, 1773734400.0)
    assert said.startswith("2026-03-17 08:00:00, 08:01:00, ") and said.endswith(" and 3 more UTC")
    assert quantity(events, "load", SETTINGS, 0.0).startswith("0 s, 60.0 s")


def test_small_words():
    assert (share(0.412), share(0.013), share(None), share(0.0)) == ("41 %", "1.3 %", "–", "0 %")
    assert (error_size(0.00812), error_size(float("nan"))) == ("0.812 %", "–")
    assert fill("{d} and {", {"d": "3"}) == "3 and "  # a template that is none loses its braces
    assert fill("{d!r:>9} {e}", {"d": "3"}) == "3 none"


def test_explanation_gives_answer_meaning_look_alikes_and_the_rest():
    text = judged(explanation()).text()
    order = ["plain model 3.2 % -> + backlash 0.81 %", "Missing in the plain model: backlash or stiction and load step",
             "also holds on samples", "What it means", "backlash: d = 6.02 % of OP span (95 %: 5.94 to 6.11 %)",
             "has 6.02 % of play", "cannot tell them apart", "Each effect tried alone", "4 % stays unexplained",
             "Where the model fails", "After the output turned", "short: the record is short"]
    places = [text.find(words) for words in order]
    assert -1 not in places and places == sorted(places), dict(zip(order, places, strict=True))
    assert "position" not in text  # how the record began is no answer


def test_nothing_missing_is_said_plainly():
    text = judged(nothing()).text()
    assert "The error is 4.3 times the noise, though" in " ".join(text.split())
    assert "Nothing was found" in text and "backlash scan" in text and "What it means" not in text
    quiet = replace(nothing(), baseline=replace(nothing().baseline, rmse_holdout=1.5 * nothing().noise_floor))
    text = judged(quiet).text()
    assert "Nothing is missing" in text and "times the noise, though" not in text


def test_the_users_own_choice_is_not_called_missing():
    e = explanation()
    steps = (e.steps[0], replace(e.steps[1], chosen="user"), e.steps[2])
    text = " ".join(judged(replace(e, steps=steps)).text().split())
    assert "With your own choice, backlash, the error on unseen samples goes from 3.2 % to 0.81 %." in text
    assert "Missing in the model: load step." in text
    text = judged(replace(e, steps=steps[:2])).text()
    assert "Missing" not in text


def test_a_model_that_does_worse_than_the_plain_one_does_not_hold():
    c = comparison()
    assert "does not hold" in judged(replace(c, fitness=replace(c.fitness, rmse_holdout=0.05))).text()
    assert "hold here" not in judged(comparison(model=None)).text()


def test_comparison_with_and_without_a_model():
    text = judged(comparison()).text()
    said = "hold-out error was 0.8 %; on this one, of which it has seen nothing, it is 0.81 %. The model holds here"
    assert said in " ".join(text.split())
    own = " ".join(judged(replace(comparison(), seen=1.0)).text().split())
    assert "This is the record that the model was fitted to" in own
    assert "fitted to 40 % of this record" in " ".join(judged(replace(comparison(), seen=0.4)).text().split())
    assert re.search(r"this model +0.79 % +0.81 % +with backlash", text) and "leaves 5 % unexplained" in text
    plain = judged(comparison(model=None)).text()
    assert "this is the model compared" in plain and "this model  " not in plain


@pytest.mark.parametrize("make", [explanation, nothing, comparison])
@pytest.mark.parametrize("name", HOSTILE)
def test_foreign_names_stay_on_their_line_and_within_100_columns(make, name):
    found = make(name)
    text = judged(found).text(verbose=True)
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\ud800-\udfff]", text)
    assert all(len(line) <= 100 for line in text.splitlines())
    assert json.loads(judged(found).json())["loop"] == name.encode("utf-8", "backslashreplace").decode()


def test_json_has_the_fields_of_the_contract_and_no_nan():
    text = judged(explanation()).json()
    found = json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} in strict JSON"))
    assert set(found) >= {"loop", "baseline", "noise_floor", "candidates", "steps", "effects", "missing_effect",
                          "where", "unexplained", "warnings"}
    assert set(found["baseline"]) == {"rmse", "rmse_holdout", "parameters"}
    assert found["missing_effect"] == "backlash" and found["steps"][0] == {
        "added": None, "rmse_holdout": 0.032, "rmse": 0.031, "chosen": "search"}
    first, second = found["effects"]
    assert first["parameters"] == {"d": {"value": 0.0602, "ci95": [0.0594, 0.0611], "unit": "span"}}
    assert second["parameters"]["sizes"]["ci95"] == [[0.015, 0.025], [-0.02, 0.0]]
    assert found["candidates"][2]["parameters"]["column"]["value"] == "DV1"
    assert set(found["where"][0]) >= {"region", "rmse", "share", "samples"}
    assert found["details"]["seconds"] is None


def test_json_of_nothing_and_of_a_comparison():
    found = json.loads(judged(nothing()).json())
    assert found["missing_effect"] is None and found["effects"] == [] and len(found["steps"]) == 1
    compared = json.loads(judged(comparison()).json())
    assert compared["candidates"] == [] and compared["missing_effect"] is None
    assert [s["added"] for s in compared["steps"]] == [None, "backlash"]
    assert json.loads(judged(replace(comparison(), series=None)).json())["samples"] is None


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.name)
def test_no_sentence_keeps_an_unfilled_place_whatever_is_missing(effect):
    template = effect.fitting.meaning or effect.sentence
    names = [q.name for q in effect.parameters]
    for left_out in [*names, None, "all"]:
        given = {n: FittedParameter(0.02, "span") for n in names if left_out not in (n, "all")}
        one = FittedEffect(effect.name, given, "", effect.sentence, template, str(effect.stage))
        said = meaning(one, SETTINGS)
        assert "{" not in said and "}" not in said and said.strip()
    e = explanation()
    bare = replace(e, effects=tuple(replace(f, parameters={}) for f in e.effects), margin=None, unexplained=None)
    assert "{" not in judged(bare).text(verbose=True)


def test_the_answer_says_how_sure_it_is_and_what_is_left():
    e = explanation()
    first, *others = e.effects

    def told(confidence, **more):
        sure = replace(e, effects=(replace(first, confidence=confidence), *others), **more)
        return " ".join(judged(sure).text().split()), sentence("verdict", sure)

    text, said = told("clear", look_alikes=(), adequate=True, rest=Rest(1.2))
    assert said.startswith("Missing in the plain model: backlash") and "conditional" not in text
    assert "What is left is 1.2 times the noise, as a wandering load and noise would leave it." in text
    text, said = told("likely", look_alikes=())
    assert "backlash (likely)" in said and "Likely, not certain" in text
    text, said = told("clear", look_alikes=(("backlash", "stiction"),))
    assert said.startswith("Missing in the plain model: backlash or stiction") and "Likely, not certain" not in text
    rest = Rest(5.0, ("time: the gain changes in the course of the record",))
    text, said = told("stand_in", look_alikes=(("backlash", "sensor_hysteresis"),), adequate=False, rest=rest)
    assert "acts like backlash, but may be something else: sensor hysteresis would look the same" in said
    assert "5 times the noise and more than noise and load: it goes with time" in said
    assert "the numbers are conditional" in text
    document = json.loads(judged(replace(e, adequate=False, rest=rest)).json())
    assert document["adequate"] is False and document["rest"]["times_noise"] == 5.0 and document["rest"]["goes_with"]


def test_backlash_or_stiction_comes_with_the_band_and_what_would_tell():
    text = " ".join(judged(replace(explanation(), look_alikes=(("backlash", "stiction"),))).text().split())
    assert "backlash or stiction" in text and "the output must travel 6 % of its span" in text
    assert "A slow ramp of the output by hand" in text
