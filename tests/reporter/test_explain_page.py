"""Pages of the workbench: everything on one time axis, buttons for the steps, the summary of a plant."""

import csv
import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib import rc_context

from backlash_cli.errors import UsageError
from backlash_cli.record import Note
from backlash_cli.reporter import explain_figures as figures
from backlash_cli.reporter.explain_figures import binned, causes, since_reversal, spectrum
from backlash_cli.reporter.explain_report import COLUMNS, judged, summary, to_csv, write_picture
from backlash_cli.reporter.files import write_text
from backlash_cli.results import PlantExplanation
from tests.reporter.chromium import Browser, settled
from tests.reporter.explanations import SETTINGS, comparison, explanation, nothing, regions, series, signals
from tests.reporter.reports import HOSTILE

WIDE = """Array.from(document.body.querySelectorAll('*')).filter(e => !e.closest('.scroll, .plot')
&& e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML.slice(0, 200))"""


def text_of(page: str) -> str:
    """The words of a page, scripts and tags taken out."""
    return re.sub(r"<[^>]*>", " ", re.sub(r"<(script|style)\b.*?</\1>", "", page, flags=re.S))


def test_turns_of_a_triangle_are_found_where_they_are():
    wave = np.abs((np.arange(400.0) % 100) - 50) / 100  # turns up at 50, 150 ..., down at 100, 200 ...
    since, upward = since_reversal(wave + 1e-4 * np.random.default_rng(0).standard_normal(400))
    assert np.all(since[:40] == -1)
    at = np.flatnonzero(since == 0)
    np.testing.assert_allclose(at, [50, 100, 150, 200, 250, 300, 350], atol=2)
    assert upward[60] == 1 and upward[120] == -1
    assert np.all(since_reversal(np.zeros(50))[0] == -1)


def test_bins_give_mean_and_rms_of_their_samples():
    x = np.arange(1000.0)
    residual = np.where(x < 500, 1.0, -3.0)
    residual[7] = np.nan
    center, mean, rms = binned(x, residual, np.ones(1000, bool), even=True, bins=2)
    np.testing.assert_allclose(center, [249.75, 749.5], rtol=2e-3)
    np.testing.assert_allclose(mean, [1.0, -3.0])
    np.testing.assert_allclose(rms, [1.0, 3.0])
    assert len(binned(np.zeros(100), np.zeros(100), np.ones(100, bool))[0]) == 0


def test_the_spectrum_shares_out_all_of_the_error():
    residual = 0.02 * np.sin(2 * np.pi * np.arange(4096) / 64) + 0.003 * np.random.default_rng(1).standard_normal(4096)
    period, _, rms = spectrum(residual, 2.0)
    assert np.sum(rms**2) == pytest.approx(np.var(residual), rel=1e-3)
    assert period[np.argmax(rms)] == pytest.approx(128.0, rel=0.15)


def test_play_shows_in_the_time_since_op_turned():
    found = {title: figure for title, _, figure in causes(series(), {"m": signals()[2]}, 0.004)}
    assert set(found) == {"Time since OP turned", "Level of OP", "Speed of OP", "Time of the record", "Period"}
    up, down = found["Time since OP turned"]["data"]
    assert (up["name"], down["name"]) == ("m, OP turned up", "m, OP turned down")
    assert up["y"][0] * down["y"][0] < 0 and abs(up["y"][0]) > 1.0  # per cent


def test_all_signals_share_one_time_axis_and_regions_can_be_switched():
    here = regions()
    # a part of the record that is no worse than the rest is not offered
    figure = figures.overlay(series(), {"PV predicted": series().predicted}, SETTINGS, 0.004,
                             (*here, replace(here[1], region="OP above 60 %", share=0.4)))
    names = [line["name"] for line in figure["data"]]
    assert names[:5] == ["SP", "PV measured", "OP", "PV predicted", "residual, PV predicted"]
    assert all("xaxis" not in line for line in figure["data"])
    shaded = [line for line in figure["data"] if line.get("fill")]
    assert [line["visible"] for line in shaded] == [True, "legendonly"]
    assert figure["data"][1]["y"][500] == pytest.approx(900 * signals()[1][500], rel=1e-5)
    assert figure["data"][4]["y"][1050] is None  # a sample that does not count


def test_every_step_has_its_button_and_its_lines():
    e = explanation()
    figure = figures.overlay(e.series, {str(k): s.prediction for k, s in enumerate(e.steps)}, SETTINGS, 0.004)
    buttons = figure["layout"]["updatemenus"][0]["buttons"]
    assert [b["label"] for b in buttons] == ["0", "1", "2", "0 + 2", "all"]
    for button in buttons:
        assert len(button["args"][0]["visible"]) == len(figure["data"]) == 9
    assert buttons[1]["args"][0]["visible"] == [True, True, True, False, False, True, True, False, False]


def test_every_axis_says_its_unit():
    e, c = judged(explanation()).drawn(), judged(comparison()).drawn()
    drawn = [e["overlay"], e["beside"], c["overlay"], c["beside"], *(figure for *_, figure in e["causes"])]
    titles = {axis["title"]["text"] for figure in drawn for name, axis in figure["layout"].items()
              if "axis" in name and "overlaying" not in axis and axis.get("type") != "category"}
    assert titles >= {"SP, PV [span 0 to 900]", "OP [%]", "residual [as PV]", "time (UTC)"}
    assert not [title for title in titles if not title.endswith(("]", "(UTC)"))]


def test_pages_say_the_answer_in_words():
    said = " ".join(text_of(judged(explanation()).page()).split())
    for words in ("Missing in the plain model", "has 6.02 % of play", "cannot tell them apart", "plain model 3.2 %",
                  "4 % stays unexplained", "After the output turned", "the record is short"):
        assert words in said, words
    assert "Nothing was found" in text_of(judged(nothing()).page())
    assert "leaves 5 % unexplained" in text_of(judged(comparison()).page())
    assert judged(replace(comparison(), series=None)).page() and judged(explanation().light()).page()


@pytest.mark.parametrize("name", HOSTILE)
def test_foreign_names_do_not_run(name):
    for page in (judged(explanation(name)).page(), judged(comparison(name)).page(), summary(plant(name)).page()):
        assert "<script>alert" not in page and "<img" not in page


def plant(*names: str) -> PlantExplanation:
    loops = tuple(explanation(name).light() for name in names)
    lost = Note("constant_signal", "TIC9: OP is constant", {"loop": "TIC9"})
    return PlantExplanation((*loops, nothing().light()), ("plant.csv",), failures=(lost,))


def test_the_summary_counts_effects_and_names_what_failed():
    found = plant("FIC1", "FIC2")
    rows = list(csv.DictReader(io.StringIO(to_csv(found))))
    assert tuple(rows[0]) == COLUMNS and [r["loop"] for r in rows] == ["FIC1", "FIC2", "FIC102", "TIC9"]
    assert rows[0]["missing_effect"] == "backlash" and rows[3]["failure"] == "TIC9: OP is constant"
    document = json.loads(summary(found).json())
    assert document["missing"] == {"backlash": 2, "load_step": 2, "nothing": 1} and len(document["loops"]) == 3
    text = summary(found).text()
    assert "backlash in 2" in text and "nothing in 1" in text and "TIC9: OP is constant" in text
    assert "backlash in 2" in text_of(summary(found).page())


def test_pages_open_without_errors_and_the_buttons_work(tmp_path):
    browser = Browser()
    try:
        pages = {"e": judged(explanation()).page(), "c": judged(comparison()).page(), "s": summary(plant("a")).page()}
        for name, text in pages.items():
            path = tmp_path / f"{name}.html"
            write_text(path, text)
            for width in (360, 1200):
                browser.open(path, width=width)
                browser.wait("document.querySelectorAll('.main-svg').length > 0")
                assert settled(browser, WIDE, []) == []
        browser.open(tmp_path / "e.html")
        plots = "Array.from(document.querySelectorAll('.plot'))"
        browser.evaluate(f"{plots}[1].scrollIntoView()")
        browser.wait(f"{plots}[1].querySelectorAll('.updatemenu-button').length === 5")
        click = "['mousedown', 'mouseup', 'click'].forEach(k => b.dispatchEvent(new MouseEvent(k, {bubbles: true})))"
        browser.evaluate(f"(() => {{const b = {plots}[1].querySelectorAll('.updatemenu-button')[1]; {click}}})()")
        browser.wait(f"{plots}[1].data[5].visible === true && {plots}[1].data[3].visible === false")
        assert not browser.errors
        assert not [r for r in browser.requests if not r.startswith(("file:", "data:", "blob:"))]
    finally:
        browser.close()


def test_a_still_picture_is_written_whole_as_png_or_svg(tmp_path):
    drawn = [(explanation(), ".png"), (nothing(), ".svg"), (comparison(), ".png"), (comparison(), ".svg"),
             (comparison(model=None), ".png")]
    for found, suffix in drawn:  # what is drawn does not depend on the form, and the explanation comes as .svg below
        write_picture(found, tmp_path / f"x{suffix}")
        assert 5_000 < (tmp_path / f"x{suffix}").stat().st_size < 500_000
    with rc_context({"svg.fonttype": "none"}):
        write_picture(explanation(), tmp_path / "x.svg")
    assert "Missing in the plain model: " in (tmp_path / "x.svg").read_text()
    with pytest.raises(UsageError, match=r"a picture is \.png or \.svg"):
        write_picture(comparison(), tmp_path / "x.jpg")
    with pytest.raises(UsageError, match="no samples"):
        write_picture(explanation().light(), tmp_path / "x.png")
