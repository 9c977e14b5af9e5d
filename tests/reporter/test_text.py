"""The terminal table: order, width, colour only where asked, foreign names on one line."""

import re
from dataclasses import replace

import pytest

from backlash_cli.record import Note
from backlash_cli.reporter.scan_report import scanned
from backlash_cli.results import ScanResult, Verdict
from tests.reporter.reports import HOSTILE, report, result


def to_text(found: ScanResult, **how: bool) -> str:
    return scanned(found, {}).text(**how)


def table_rows(text: str) -> list[str]:
    return text.split("\n\n")[0].splitlines()[1:]


def test_largest_dead_band_first_then_the_rest():
    names = [line.split()[0] for line in table_rows(to_text(result())) if not line.startswith(" ")]
    assert names == ["LARGE", "small", "maybe", "fine", "waves", "short", "odd", "broken"]


def test_a_row_says_size_interval_confidence_count_and_advice():
    row = " ".join(table_rows(to_text(result(report()))))
    assert re.split(r"\s{2,}", row) == [
        "FIC101", "backlash", "3.00", "2.70–3.30", "90 %", "10 of 20", "repair, or compensate 2.40 % (by error sign)"
    ]


def test_a_valve_without_compensator_is_to_be_repaired():
    assert "repair; a compensator is not advised" in " ".join(to_text(result(report(compensator=None))).split())


def test_no_backlash_says_what_it_excludes():
    none = report("fine", 0.002, Verdict.NO_BACKLASH, compensator=None)
    assert " <0.40 " in table_rows(to_text(result(replace(none, confirmation=None))))[0]
    assert "<" not in table_rows(to_text(result(report("fine", None, Verdict.NO_BACKLASH))))[0]


@pytest.mark.parametrize("verbose", [False, True])
def test_fits_100_columns_whatever_the_names(verbose):
    loops = [report(n, warnings=(Note("w", f"about {n} " * 9),), reasons=(Note("r", n * 3),)) for n in HOSTILE]
    found = replace(result(*loops), failures=tuple(Note("f", n) for n in HOSTILE))
    for line in to_text(found, verbose=verbose).splitlines():
        assert len(line) <= 100, line


@pytest.mark.parametrize("verbose", [False, True])
@pytest.mark.parametrize("name", HOSTILE)
def test_foreign_names_carry_no_control_characters(name, verbose):
    text = to_text(result(report(name, None, warnings=(Note("w", name),), reasons=(Note("r", name),))), verbose=verbose)
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\ud800-\udfff]", text)
    assert "FIC\n101" not in text


def test_a_stroke_in_a_name_opens_no_new_cell():
    row = table_rows(to_text(result(report("|a|b|"))))[0]
    assert re.split(r"\s{2,}", row)[:3] == ["|a|b|", "backlash", "3.00"]


def test_colour_only_when_asked():
    assert "\x1b[" not in to_text(result(), verbose=True)
    assert "\x1b[" in to_text(result(), colour=True)


def test_warnings_are_summarised_and_verbose_lists_them():
    found = result(report("a"), report("b"))
    assert to_text(found).count("default_kp") == 1 and "a (and 1 more loop)" in to_text(found)
    assert to_text(found, verbose=True).count("default_kp") == 2
    assert "half periods not used: 8 too short, 2 not flat" in to_text(found, verbose=True)


def test_failures_are_listed_and_many_are_cut():
    found = replace(result(report()), failures=tuple(Note("bad", f"file {i}") for i in range(40)))
    text = to_text(found)
    assert "bad: file 0" in text and "file 39" not in text and "and 28 more" in text


def test_no_loops_at_all():
    assert "0 loops" in to_text(replace(result(report()), loops=()))


def test_a_long_reason_ends_after_a_whole_word():
    message = "PV does not answer to OP, " + "any dead band above the range it moved over would look the same " * 4
    found = report(d=None, verdict=Verdict.CANNOT_TELL, reasons=(Note("no_response", message),))
    shown = " ".join(to_text(result(found)).split())
    words = shown[shown.index("PV does not answer"): shown.index(" …")].split()
    assert words == message.split()[: len(words)]


def test_the_worst_of_the_loops_that_share_a_warning_is_shown():
    few, many = (Note("bad_quality", f"{n:g} samples have bad quality", {"samples": n}) for n in (5.0, 900.0))
    said = to_text(result(report("LARGE", 0.05, warnings=(few,)), report("small", 0.01, warnings=(many,))))
    assert "bad_quality, small (and 1 more loop): 900 samples have bad quality" in said
