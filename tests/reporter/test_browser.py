"""The pages in a real browser: no console error, nothing requested from outside, sorting, filter and zoom work."""

import json

import pytest

from backlash_cli.reporter.files import write_text
from backlash_cli.reporter.scan_report import scanned, write
from backlash_cli.results import Verdict
from tests.reporter.chromium import quiet_page, settled  # noqa: F401  the first acts on every test here
from tests.reporter.reports import HOSTILE, record, report, result

ROWS = "Array.from(document.querySelector('tbody').rows).filter(r => !r.hidden)"
COLUMN = ROWS + ".map(r => r.cells[%d].textContent)"
FILL = """(() => {const i = document.querySelector('%s'); i.value = '%s';
i.dispatchEvent(new Event('input', {bubbles: true}))})()"""
WIDE = """Array.from(document.body.querySelectorAll('*')).filter(e => !e.closest('.scroll')
&& e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML.slice(0, 200))"""
CLICK = "document.querySelectorAll('th button')[%d].click()"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    loops = [report("FIC10", 0.02), report("FIC9", 0.05), report("TIC1", None, Verdict.NO_BACKLASH)]
    loops += [report(name, 0.01) for name in HOSTILE]
    write_text(path, scanned(result(*loops), {"FIC10": record("FIC10"), HOSTILE[1]: record(HOSTILE[1])}).page())
    return path


@pytest.mark.parametrize("width", [360, 768, 1600])
@pytest.mark.parametrize("dark", [False, True])
def test_opens_quickly_at_every_width_without_sideways_scrolling(browser, page, width, dark):
    assert browser.open(page, width=width, dark=dark) < 3.0
    assert settled(browser, WIDE, []) == []
    assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


def test_hostile_names_are_shown_as_text(browser, page):
    browser.open(page)
    names = browser.evaluate(COLUMN % 0)
    assert "<script>alert(1)</script>" in names and "</script><img src=x onerror=alert(1)>" in names
    assert browser.evaluate("document.querySelectorAll('main img, main script:not([type])').length") == 0


def test_sorting_by_number_and_by_name(browser, page):
    browser.open(page)
    browser.evaluate(CLICK % 2)
    sizes = browser.evaluate(COLUMN % 2)
    assert sizes[:3] == ["5.00", "2.00", "1.00"] and sizes[-1] == "–"
    browser.evaluate(CLICK % 2)
    assert browser.evaluate(COLUMN % 2)[-3:] == ["2.00", "5.00", "–"]
    assert browser.evaluate("document.querySelectorAll('th')[2].getAttribute('aria-sort')") == "ascending"
    browser.evaluate(CLICK % 0)
    names = [n for n in browser.evaluate(COLUMN % 0) if n.startswith("FIC") and "\n" not in n]
    assert names == ["FIC9", "FIC10"]


def test_filter_by_words_and_by_verdict(browser, page):
    browser.open(page)
    browser.evaluate(FILL % (".filter-text", "fic back"))
    assert sorted(n for n in browser.evaluate(COLUMN % 0) if "\n" not in n) == ["FIC10", "FIC9"]
    browser.evaluate(FILL % (".filter-text", ""))
    browser.evaluate(FILL % (".filter-choice", "no backlash"))
    assert browser.evaluate(COLUMN % 0) == ["TIC1"]
    assert browser.evaluate("document.querySelector('.filter-count').textContent").startswith("1 of")


def test_sorting_by_keyboard(browser, page):
    browser.open(page)
    browser.evaluate("document.querySelectorAll('th button')[2].focus()")
    enter = {"key": "Enter", "code": "Enter", "windowsVirtualKeyCode": 13, "text": "\r"}
    for kind in ("keyDown", "keyUp"):
        browser.call("Input.dispatchKeyEvent", type=kind, **enter)
    assert browser.evaluate(COLUMN % 2)[0] == "5.00"


def test_a_link_opens_the_loop_draws_its_figures_and_zoom_works(browser, page):
    browser.open(page)
    plot = "document.querySelector('details[open] .plot')"
    assert browser.evaluate("document.querySelectorAll('details .main-svg').length") == 0
    browser.evaluate("Array.from(document.links).find(a => a.textContent === 'FIC10').click()")
    browser.wait("document.querySelectorAll('details[open] .main-svg').length > 0")
    before = browser.evaluate(f"{plot}.layout.xaxis.range")
    browser.evaluate(f"{plot}.scrollIntoView()")
    box = f"{plot}.querySelector('.nsewdrag').getBoundingClientRect()"
    left, top, width, height = (browser.evaluate(f"{box}.{side}") for side in ("left", "top", "width", "height"))
    for kind, share in (("mousePressed", 0.3), ("mouseMoved", 0.5), ("mouseMoved", 0.6), ("mouseReleased", 0.6)):
        browser.call("Input.dispatchMouseEvent", type=kind, x=left + share * width, y=top + share * height,
                     button="left", buttons=1, clickCount=1)
    browser.wait(f"JSON.stringify({plot}.layout.xaxis.range) !== {json.dumps(json.dumps(before))}")


def test_the_figures_follow_a_change_to_dark(browser, page):
    browser.open(page, fragment="#loop-1")
    browser.wait("document.querySelectorAll('details[open] .main-svg').length > 0")
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
    browser.wait("document.querySelector('details[open] .plot').layout.font.color === '#e6eaee'")


@pytest.mark.parametrize("width", [390, 1280])
def test_figures_keep_their_height_when_the_window_changes(browser, page, width):
    browser.open(page, width=width, fragment="#loop-1")
    plot = "document.querySelector('details[open] .plot')"
    browser.wait(f"{plot}._responsiveChartHandler !== undefined")
    before = browser.evaluate(f"{plot}.clientHeight")
    browser.call("Emulation.setDeviceMetricsOverride", width=width - 60, height=700, deviceScaleFactor=1,
                 mobile=width < 500)
    browser.wait(f"{plot}._fullLayout.width < {width - 60}")
    assert before >= 420 and browser.evaluate(f"{plot}.clientHeight") == before


def test_the_plant_is_drawn_at_the_top_and_the_table_fits_a_usual_screen(browser, tmp_path):
    write_text(tmp_path / "r.html", scanned(result(), {}).page())
    browser.open(tmp_path / "r.html", width=1280)
    browser.wait("document.querySelectorAll('.main-svg').length > 0")
    drawn = browser.evaluate("Array.from(document.querySelectorAll('.yaxislayer-above .ytick, .ytick'))"
                             ".map(t => t.textContent)")
    assert drawn == ["LARGE", "small", "maybe", "fine", "waves", "short", "odd", "broken"]
    assert browser.evaluate("document.querySelectorAll('.errorbar').length") == 3
    box = "document.querySelector('.scroll')"
    assert browser.evaluate(f"{box}.scrollWidth <= {box}.clientWidth")


def test_a_half_wide_window_shows_what_to_do_without_sideways_scrolling(browser, tmp_path):
    write_text(tmp_path / "r.html", scanned(result(), {}).page())
    browser.open(tmp_path / "r.html", width=768)
    last = "Array.from(document.querySelectorAll('th')).find(h => h.textContent === 'Advice or reason')"
    assert browser.evaluate(f"{last}.getBoundingClientRect().right <= innerWidth")


def test_on_a_phone_facts_are_read_whole_and_the_tools_of_a_figure_hide_nothing(browser, page):
    browser.open(page, width=400, fragment="#loop-1")
    browser.wait("document.querySelectorAll('details[open] .legend').length > 0")
    cut = "Array.from(document.querySelectorAll('details[open] .scroll')).filter(s => s.scrollWidth > s.clientWidth)"
    assert browser.evaluate(f"document.querySelectorAll('details[open] td.long').length && {cut}.length") == 0
    over = """Array.from(document.querySelectorAll('.js-plotly-plot')).filter(p => p.querySelector('.legend')
    && p.querySelector('.modebar-group').getBoundingClientRect().bottom
    > p.querySelector('.legend').getBoundingClientRect().top).length"""
    assert settled(browser, over, 0) == 0


def test_all_columns_fit_the_paper(browser, tmp_path):
    write_text(tmp_path / "r.html", scanned(result(), {}).page())
    browser.open(tmp_path / "r.html", width=718)  # A4 with a browser's usual margins
    browser.call("Emulation.setEmulatedMedia", media="print")
    try:
        assert browser.evaluate("document.documentElement.scrollWidth") == 718
    finally:
        browser.call("Emulation.setEmulatedMedia", media="")


def test_a_browser_that_cannot_unpack_says_so_and_shows_the_numbers(browser, page):
    old = browser.call("Page.addScriptToEvaluateOnNewDocument", source="delete window.DecompressionStream")
    try:
        browser.open(page)
        browser.wait("getComputedStyle(document.querySelector('.plot'), '::before').visibility === 'visible'")
        assert "2023" in browser.evaluate("getComputedStyle(document.querySelector('.plot'), '::before').content")
        assert "FIC10" in browser.evaluate(COLUMN % 0)
    finally:
        browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=old["identifier"])


MESSAGE = "getComputedStyle(document.querySelector('%s'), '::before')"


def test_figures_below_the_window_and_in_folded_loops_show_no_message(browser, page, tmp_path):
    browser.open(page)
    assert browser.evaluate("document.querySelectorAll('details .plot:empty').length") > 0
    assert browser.evaluate(MESSAGE % "details .plot:empty" + ".content") == "none"
    write(result(report("FIC101")), {"FIC101": record("FIC101")}, "html", tmp_path)
    (loop,) = tmp_path.glob("loops-*/FIC101.html")
    browser.open(loop)
    assert browser.evaluate("document.documentElement.scrollHeight > 3 * innerHeight")
    assert browser.evaluate("document.querySelectorAll('.plot:empty').length") == 0


def test_a_page_taken_out_of_its_folder_says_what_is_missing(browser, tmp_path):
    write(result(report("FIC101")), {"FIC101": record("FIC101")}, "html", tmp_path)
    (loop,) = tmp_path.glob("loops-*/FIC101.html")
    loop.rename(tmp_path / "alone.html")
    browser.open(tmp_path / "alone.html")
    browser.wait(MESSAGE % ".plot" + ".visibility === 'visible'")
    assert "folder" in browser.evaluate(MESSAGE % ".plot" + ".content")
    browser.errors.clear()  # of the library that is not there


def test_a_folder_of_a_thousand_loops_opens_at_once_and_loads_a_loop_when_asked(browser, tmp_path):
    loops = [report(f"FIC{i:04}") for i in range(1000)]
    write(result(*loops), {"FIC0007": record("FIC0007")}, "html", tmp_path)
    assert browser.open(tmp_path / "index.html") < 3.0
    assert len(browser.evaluate(COLUMN % 0)) == 1000
    browser.evaluate("Array.from(document.links).find(a => a.textContent === 'FIC0007').click()")
    browser.wait("location.pathname.endsWith('FIC0007.html') && document.querySelectorAll('.main-svg').length > 0")


def test_printed_at_the_moment_of_loading_it_has_its_figures(browser, page):
    browser.open(page, width=1280)
    browser.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert browser.evaluate("document.querySelectorAll('.plot').length") > 2
    assert browser.evaluate("document.querySelectorAll('.plot:not(.js-plotly-plot)').length") == 0


def test_printing_opens_every_loop_and_figures_fit_the_paper(browser, page):
    browser.open(page, width=1280)
    browser.wait("document.querySelectorAll('.main-svg').length > 0")
    width = "document.querySelector('.js-plotly-plot .main-svg').getBoundingClientRect().width"
    before = browser.evaluate(width)
    browser.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    browser.wait(f"{width} === 700")
    assert browser.evaluate("document.querySelectorAll('details:not([open])').length") == 0
    assert browser.evaluate("Array.from(document.querySelectorAll('.plot:not(.js-plotly-plot)')).length") == 0
    browser.evaluate("window.dispatchEvent(new Event('afterprint'))")
    browser.wait(f"{width} === {before}")
