"""Readings and reports of known files are what they were; `python -m tests.golden` refreshes them."""

import json

import pytest

from .digest import differences, readings, reports
from .store import READINGS, REPORTS, load


@pytest.mark.parametrize(("path", "make"), [(READINGS, readings), (REPORTS, reports)], ids=["readings", "reports"])
def test_nothing_changed_unseen(path, make):
    changed = list(differences(load(path), json.loads(json.dumps(make()))))
    assert not changed, "\n".join(["python -m tests.golden refreshes these:", *changed[:40]])


def test_changes_are_said_in_words():
    old = {"FIC101": {"samples": 100, "K": 0.5, "notes": ["a"]}, "FIC102": {}}
    new = {"FIC101": {"samples": 101, "K": 0.5 * (1 + 1e-8), "notes": ["a", "b"]}, "FIC103": {}}
    assert list(differences(old, new)) == [
        "FIC101 / samples: was 100, is 101", "FIC101 / notes: was ['a'], is ['a', 'b']", "FIC102: is gone",
        "FIC103: is new"]
