"""Foreign names: harmless in terminals, spreadsheets, pictures and as file names."""

import doctest
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backlash_cli.reporter import safe
from tests.reporter.reports import HOSTILE

ANY_TEXT = st.text(st.characters(codec=None, exclude_categories=()))


def test_examples():
    assert doctest.testmod(safe).failed == 0


@given(ANY_TEXT)
def test_terminal_text_is_one_line_without_controls(text):
    shown = safe.terminal(text)
    assert not re.search(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]", shown)
    shown.encode("utf-8")


def test_terminal_keeps_letters_of_all_countries():
    assert safe.terminal("Druckregler Ö1 (Süd) 温度") == "Druckregler Ö1 (Süd) 温度"


def test_long_text_keeps_both_ends():
    assert safe.terminal("A" * 5000 + "B" * 5000, 20) == "A" * 13 + "…" + "B" * 6
    assert len(safe.shorten("x" * 100, 31)) == 31


@pytest.mark.parametrize("start", ["=", "+", "-", "@", "|", "%", "\t=", "\r=", "\n=", " =", "  +", "＝", "\u00a0="])
def test_formulas_become_text(start):
    cell = safe.spreadsheet(f"{start}1+1")
    assert isinstance(cell, str) and cell.startswith("'")


@given(ANY_TEXT)
def test_no_text_starts_a_formula(text):
    cell = safe.spreadsheet(text)
    assert isinstance(cell, str) and cell.lstrip(" \u00a0\u3000")[:1] not in ("=", "+", "-", "@", "\t", "\r", "\n")


def test_numbers_stay_numbers():
    assert safe.spreadsheet(-0.5) == -0.5 and safe.spreadsheet(None) is None


def test_picture_label_has_no_markup():
    assert safe.picture("<a href='x'>A & B</a>") == "&lt;a href='x'&gt;A &amp; B&lt;/a&gt;"


@given(st.lists(ANY_TEXT, max_size=12))
def test_file_names_are_plain_short_and_different(names):
    given_names = safe.file_names(names)
    assert set(given_names) == set(names)
    assert len({n.lower() for n in given_names.values()}) == len(given_names)
    for name in given_names.values():
        assert re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,69}", name), name
        assert name.split(".")[0].lower() not in ("con", "nul", "prn", "aux", "com1")


def test_file_names_of_hostile_and_similar_loops():
    names = safe.file_names([*HOSTILE, "FIC101", "fic101", "FIC101-2"])
    assert names["FIC101"] == "FIC101" and names["fic101"].startswith("fic101-") and names["FIC101-2"] == "FIC101-2"
    assert "/" not in "".join(names.values()) and ".." not in "".join(names.values())


def test_the_command_line_is_told_without_passwords():
    given = "https://me:secret@host/a b.csv?sig=secret", "s3://key:secret@bucket/x", "FIC?01.csv"
    token = safe.ASKED.set(("scan", *given))
    try:
        assert safe.asked() == "backlash scan 'https://host/a b.csv' s3://bucket/x 'FIC?01.csv'"
    finally:
        safe.ASKED.reset(token)
    assert safe.asked() == ""


def test_titles_name_the_files():
    assert safe.entitled("Test plans", ("data/plant.csv",)) == "Test plans: plant.csv"
    assert safe.entitled("T", ("a/b/", "https://h/c.csv?sig=x", "d.csv")) == "T: b, c.csv and 1 more"
    assert safe.entitled("T", ()) == "T" and safe.entitled("T", (".",)) == "T: ."
