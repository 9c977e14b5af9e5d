"""The JSON document: fields of the contract, strict, whatever the numbers and names are."""

import json
from dataclasses import replace
from math import inf, nan

import pytest

from backlash_cli.record import Note
from backlash_cli.reporter.json_report import iso_time, to_json
from tests.reporter.reports import HOSTILE, report, result

LOOP_FIELDS = [
    "loop",
    "verdict",
    "reasons",
    "confidence",
    "start",
    "end",
    "samples",
    "interval_s",
    "settings",
    "half_periods",
    "long_half_periods",
    "detections",
    "detection_rate",
    "detections_per_hour",
    "rejected",
    "estimates",
    "cluster",
    "confirmation",
    "compensator",
    "warnings",
]


def strict(text: str) -> dict:
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


def test_fields_of_the_contract():
    found = strict(to_json(result()))
    assert found["schema_version"] == 1 and found["tool"]["name"] == "backlash" and found["inputs"] == ["plant.csv"]
    for loop in found["loops"]:
        assert set(LOOP_FIELDS) <= set(loop)
    first = found["loops"][0]
    assert set(first["estimates"][0]) == {"start", "end", "dt_s", "dy", "e_max", "d", "direction", "accepted", "why"}
    assert set(first["cluster"]) == {"d", "ci95", "spread", "n", "share", "limit_of_detection"}
    assert {"d", "ci95", "error_reduction", "delta_bic"} <= set(first["confirmation"])
    assert set(first["compensator"]) == {"gain", "scheme", "reason"}
    assert {"K", "Ti", "Kp", "source"} <= set(first["settings"])
    assert found["loops"][3]["cluster"] is None


def test_numbers_that_json_does_not_know_are_null():
    odd = report(d=nan, confidence=inf, warnings=(Note("x", "y", {"a": nan, "b": -inf}),), details={"z": [inf, 1]})
    loop = strict(to_json(result(odd)))["loops"][0]
    assert loop["confidence"] is None and loop["cluster"]["d"] is None
    assert loop["warnings"][0]["values"] == {"a": None, "b": None} and loop["details"] == {"z": [None, 1]}


@pytest.mark.parametrize("name", HOSTILE)
def test_names_come_back_as_they_were(name):
    text = to_json(result(report(name)))
    text.encode("utf-8")
    assert strict(text)["loops"][0]["loop"] == name.replace("\udc80", "\\udc80")


def test_times_are_utc_and_odd_ones_null():
    assert iso_time(1773734400.0) == "2026-03-17T08:00:00Z"
    assert iso_time(1773734400.25) == "2026-03-17T08:00:00.250Z"
    assert iso_time(-1.0) == "1969-12-31T23:59:59Z"
    assert [iso_time(t) for t in (None, nan, inf, 1e300)] == [None] * 4


def test_failures_and_warnings_are_listed():
    found = strict(to_json(replace(result(report()), failures=(Note("unreadable_input", "b.csv: empty"),))))
    assert found["failures"] == [{"code": "unreadable_input", "message": "b.csv: empty"}]
