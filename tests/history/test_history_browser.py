"""The wear report in a real browser: no error, no request outside its folder, sorting, figures and hostile names."""

import pytest

from backlash_cli.history.limits import read_limits
from backlash_cli.history.plant import plant_history
from backlash_cli.history.store import History
from backlash_cli.reporter.history_report import write_report
from backlash_cli.results import Verdict
from tests.history.nights import growing, made, result
from tests.reporter.chromium import quiet_page, settled  # noqa: F401  the first acts on every test here

HOSTILE = "</script><img src=x onerror=alert(1)>"
CELLS = "Array.from(document.querySelector('tbody').rows).filter(r => !r.hidden).map(r => r.cells[%d].textContent)"
WIDE = """Array.from(document.body.querySelectorAll('*')).filter(e => !e.closest('.scroll')
&& e.getBoundingClientRect().right > innerWidth + 1).length"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wear")
    with History(folder / "h.db", create=True) as history:
        for k in range(4):
            history.add(*[result(r) for r in growing(40, loop=f"FIC{k}", seed=k, repair=20 if k % 2 else None)])
        history.add(*[result(made(k, None, loop=HOSTILE, verdict=Verdict.NO_BACKLASH, lod=0.004))
                         for k in range(10)])
        history.mark_repair("FIC2", 1774000000.0, "new <b>packing</b>")
        plant = plant_history(history, read_limits())
        for name in ("wear.html", "wear"):
            write_report(folder / name, plant, history.half_periods)
    return folder


@pytest.mark.parametrize("width", [360, 768, 1600])
@pytest.mark.parametrize("dark", [False, True])
def test_opens_at_every_width_without_sideways_scrolling(browser, folder, width, dark):
    assert browser.open(folder / "wear.html", width=width, dark=dark) < 3.0
    assert settled(browser, WIDE, 0) == 0


def test_days_stand_on_one_line_and_no_room_is_left_below_a_low_figure(browser, folder):
    browser.open(folder / "wear.html", width=768)
    browser.wait("document.querySelectorAll('.main-svg').length > 0")
    high = "Math.max(...Array.from(document.querySelectorAll('tbody td'), c => /^[0-9-]{10}$/.test(c.textContent)"
    assert 0 < browser.evaluate(f"{high} ? c.clientHeight : 0))") < 45
    assert browser.evaluate("(p => p.clientHeight - p._fullLayout.height)(document.querySelector('.plot'))") == 0


def test_sorting_filter_and_hostile_names(browser, folder):
    browser.open(folder / "wear" / "index.html")
    assert HOSTILE in browser.evaluate(CELLS % 1)
    before = browser.evaluate(CELLS % 0)
    browser.evaluate("document.querySelectorAll('th button')[0].click()")
    browser.evaluate("document.querySelectorAll('th button')[0].click()")
    assert sorted(before) == sorted(browser.evaluate(CELLS % 0))
    assert browser.evaluate(CELLS % 0)[0] in ("1", "5")
    browser.evaluate("(() => {const s = document.querySelector('select'); s.value = 'Leave alone'; "
                     "s.dispatchEvent(new Event('input', {bubbles: true}))})()")
    assert browser.evaluate(CELLS % 1) == [HOSTILE]


def test_a_loop_page_draws_its_wear_and_leads_back(browser, folder):
    browser.open(folder / "wear" / "index.html")
    browser.evaluate("Array.from(document.querySelectorAll('tbody a')).find(a => a.textContent === 'FIC2').click()")
    browser.wait("document.querySelector('h1') && document.querySelector('h1').textContent === 'FIC2'")
    browser.wait("document.querySelectorAll('.js-plotly-plot .scatterlayer .trace').length >= 3")
    assert "repair: new <b>packing</b>" in browser.evaluate("document.querySelector('.annotation').textContent")
    assert browser.evaluate("document.querySelector('a[href=\"../index.html\"]') !== null")


def test_a_link_to_a_loop_in_the_single_file_opens_it(browser, folder):
    browser.open(folder / "wear.html", fragment="#loop-1")
    browser.wait("document.querySelector('#loop-1').open")
    browser.wait("document.querySelectorAll('#loop-1 .js-plotly-plot').length >= 1")
