"""The order of repair: groups by the rule, order within them, and a reason in words for each place."""

from dataclasses import replace
from types import SimpleNamespace

from backlash_cli.history.plant import rank
from backlash_cli.history.store import night_of, night_row
from backlash_cli.history.trend import wear
from backlash_cli.record import Note
from backlash_cli.reporter.templates import lines
from backlash_cli.results import Verdict
from backlash_cli.results.history import Limit
from tests.history.nights import growing, made

LIMIT = Limit(0.03, "no_positioner", "rule of practice")


def places(plant, horizon=90.0, travel=None):
    nights = {name: [night_of({**night_row(r), "travel": (travel or {}).get(name)}) for r in reports]
              for name, reports in plant.items()}
    return {p.loop: SimpleNamespace(**vars(p), why=tuple(lines("why_place", p)))
            for p in rank([wear(name, found, (), LIMIT) for name, found in nights.items()], horizon)}


def steady(d, name="X", seed=0, **options):
    return growing(30, first=d, last=d, seed=seed, loop=name, **options)


def test_every_group_has_its_kind_of_loop():
    found = places({
        "SURE": steady(0.05), "GROWS": growing(30, first=0.01, last=0.02), "HIGH": steady(0.025),
        "LOW": steady(0.01), "QUIET": [made(k, None, verdict=Verdict.NO_BACKLASH, lod=None) for k in range(30)],
        "BLIND": [made(k, None, verdict=Verdict.CANNOT_TELL, lod=None) for k in range(30)],
        "SLOW": growing(30, first=0.005, last=0.006, noise=0.005),
        "DOUBT": [made(k, 0.05, confidence=0.3) for k in range(30)], "NEW": [made(k, 0.02) for k in range(3)],
        "FIRST": [made(0, 0.08)],
    })
    assert {name: p.action for name, p in found.items()} == {
        "SURE": "pull", "DOUBT": "room", "GROWS": "room", "HIGH": "watch", "SLOW": "watch", "NEW": "watch",
        "FIRST": "room", "LOW": "leave", "QUIET": "leave", "BLIND": "check"}
    assert found["SURE"].rank == 1 and found["BLIND"].rank == 10
    assert all(p.why and all(words.endswith(".") for words in p.why) for p in found.values())
    assert "1.7 times the limit of 3 % (rule of practice)" in found["SURE"].why[0]
    assert any("reaches the limit about" in words for words in found["GROWS"].why)
    assert found["QUIET"].why == ("No dead band was seen in 14 of the last 14 nights.",)
    assert "made" in found["BLIND"].why[0]


def test_a_far_limit_is_watched_and_a_longer_horizon_pulls_it_forward():
    plant = {"A": growing(60, first=0.01, last=0.013, noise=0.01)}
    assert places(plant)["A"].action == "watch" and places(plant, horizon=500)["A"].action == "room"


def test_of_two_alike_the_valve_that_moves_more_goes_first():
    plant = {"A": steady(0.05, "A"), "B": steady(0.05, "B"), "C": steady(0.05, "C")}
    found = places(plant, travel={"A": 1.0, "B": 4.0, "C": 0.2})
    assert [name for name, _ in sorted(found.items(), key=lambda item: item[1].rank)] == ["B", "A", "C"]
    assert any("moves more than most" in words for words in found["B"].why)
    assert any("moves less than most" in words for words in found["C"].why)


def test_a_growing_one_goes_before_a_steady_one_of_the_same_size():
    found = places({"A": growing(30, first=0.03, last=0.045), "B": steady(0.045)})
    assert found["A"].rank == 1


def test_recent_silence_outweighs_old_sizes():
    nights = steady(0.05)[:10] + [made(k, None, verdict=Verdict.NO_BACKLASH, lod=0.005) for k in range(10, 30)]
    found = places({"A": nights})["A"]
    assert found.action in ("leave", "watch") and any("saw no dead band" in words for words in found.why)


def test_a_loop_that_oscillates_is_a_case_for_the_control_engineer():
    found = places({"A": [made(k, None, verdict=Verdict.OSCILLATING, lod=None) for k in range(10)]})["A"]
    assert found.action == "check" and "oscillated in 10 of the last 10 nights" in found.why[0]


def test_nights_without_a_size_are_told_in_words_and_in_the_singular():
    def blind(day):
        return replace(made(day, None, verdict=Verdict.CANNOT_TELL, lod=None),
                       reasons=(Note("not_separable", "a trace of 0.92 %"),))

    found = places({"A": [blind(0), blind(1)], "B": [blind(0)],
                    "C": [made(0, None, verdict=Verdict.OSCILLATING, lod=None)]})
    assert found["A"].why[0] == found["B"].why[0] == "No night gave an answer: a trace of 0.92 %."
    assert found["C"].why[0] == "The loop oscillated in the one night that there is, so its dead band has no size."
    assert lines("remarks", found["B"].wear) == ["1 of 1 night without a size."]
    mixed = places({"A": [*steady(0.05), blind(30)]})["A"]
    assert "1 of 31 nights without a size: a trace of 0.92 %." in lines("remarks", mixed.wear)
    assert any("% sure over 14 nights" in words for words in mixed.why)


def test_nothing_to_rank():
    assert rank([]) == []
