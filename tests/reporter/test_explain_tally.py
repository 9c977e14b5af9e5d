"""In how many loops each effect was found, and why not in the others: counted, told once, the same in all forms."""

import csv
import io
import json
from dataclasses import replace

from backlash_cli.record import LoopSettings, Note
from backlash_cli.reporter.explain_report import (
    reason,
    summary,
    tallies,
    to_csv,
)
from backlash_cli.reporter.templates import sentence
from backlash_cli.reporter.words import quantity
from backlash_cli.results import Candidate, FittedParameter, PlantExplanation
from tests.reporter.explanations import backlash, explanation, nothing

SMALL = Note("small_gap", "0.6 % of span is less than a good valve may have")
STILL = Note("too_little_motion", "PV follows OP by only 1.2 times its noise")


def tried(name, code, evidence, *, size=0.02):
    found = Candidate(name, {"d": FittedParameter(size, "span")}, stage="valve", rmse_holdout=0.03, error_reduction=0.0,
                      evidence=evidence)
    return replace(found, why=Note(code, f"because {code}"))


def plant():
    found = explanation("FIC1")
    found = replace(found, effects=(replace(backlash(), notes=(SMALL,)),),
                    candidates=(*found.candidates[:1], tried("stiction", "look_alike", 300.0)))
    none = replace(nothing("FIC2"), candidates=(tried("backlash", "no_better_prediction", -5.0),
                                                tried("stiction", "below_resolution", -1.0)))
    still = replace(nothing("FIC3"), reasons=(STILL,), candidates=(tried("backlash", "too_little_motion", 1.0),))
    lost = Note("constant_signal", "FIC4: OP is constant", {"loop": "FIC4"})
    return PlantExplanation((found, none, still), ("plant.csv",), failures=(lost,))


def test_gaps_are_counted_together_and_each_alone():
    together, one, other = tallies(plant())
    assert together.name == "backlash or stiction" and together.loops == together.small == ("FIC1",)
    # of two that were tried the likelier one gives the reason
    assert together.why == {"below_resolution": 1, "too_little_motion": 1, "not_explained": 1}
    assert one.name == "backlash" and one.why == {
        "no_better_prediction": 1, "too_little_motion": 1, "not_explained": 1}
    assert other.name == "stiction" and other.loops == () and sum(other.why.values()) == 4
    said = "Of 4 loops, in 1 PV moves too little to tell and 1 could not be explained."
    assert sentence("silent", plant(), 1).startswith(said)
    assert sentence("silent", PlantExplanation(plant().loops[:2]), 0) == ""
    assert reason(plant().loops[1], ["dead_time"]).code == "not_tried"
    assert [row["no_gap"] for row in csv.DictReader(to_csv(plant()).splitlines())][:2] == ["", "below_resolution"]


def test_all_forms_say_the_same():
    text = " ".join(summary(plant()).text().split())
    assert "backlash or stiction 1 smaller than the recording shows (1)" in text
    assert f"Found, but small: FIC1: {SMALL.message}" in text and "(small)" in text
    assert max(map(len, summary(plant()).text().splitlines())) <= 100
    told = json.loads(summary(plant()).json())["effects"][0]
    assert told["accepted"] == 1 and told["of"] == 4 and told["small"] == ["FIC1"] and told["not_accepted"]
    one, two, three, four = csv.DictReader(io.StringIO(to_csv(plant())))
    assert one["gap_small"] == SMALL.message and one["no_gap"] == ""
    assert two["no_gap"] == "below_resolution" and two["no_gap_because"] == "because below_resolution"
    assert three["no_gap"] == "too_little_motion" and four["failure"] == "FIC4: OP is constant"
    page = summary(plant()).page()
    assert "Why found, why not" in page and "smaller than the recording shows" in page


def test_an_interval_that_says_nothing_is_not_a_number():
    endless = FittedParameter(0.25, "span", (-8e16, 8e16))
    assert quantity(endless, "valve", LoopSettings()) == "25 % of OP span (95 %: not known from this record)"
