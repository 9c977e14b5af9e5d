"""The scan's pages: one file, or a folder that is switched over in one step."""

import html
import json
import re
import time
from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.record import Note
from backlash_cli.reporter import figures, scan_report
from backlash_cli.reporter.scan_report import scanned, write
from backlash_cli.results import Confirmation, Verdict
from tests.reporter.reports import HOSTILE, record, report, result
from tests.reporter.test_page import Reader, unpacked


def test_one_file_holds_every_loop_with_its_evidence():
    found = result(report("FIC101"), report("TIC202", None))
    page = scanned(found, {"FIC101": record("FIC101")}).page()
    facts = ("8 of 10 estimates agree", "Compensator gain 2.40 %", "Kp is not given", "2.70 to 3.30 %")
    for words in ("FIC101", "TIC202", *facts):
        assert words in page, words
    read = Reader(page)
    assert [d["id"] for d in read.named("details")] == ["loop-0", "loop-1"]
    assert len(json.loads(unpacked(read.scripts[0]))) == 6  # plant, trend, close look, plane, estimates, confirmation


def test_many_loops_in_one_file_keep_numbers_and_name_the_folder(monkeypatch):
    monkeypatch.setattr(scan_report, "DRAWN", 2)
    loops = [report(f"L{i}", 0.01 * (i + 1)) for i in range(4)]
    page = scanned(result(*loops), {r.loop: record(r.loop) for r in loops}).page()
    assert "--output FOLDER" in page and len(Reader(page).named("details")) == 4
    assert page.count('class="plot"') == 1 + 2 * 5


def test_hostile_names_appear_as_text():
    loops = [report(n, warnings=(Note("w", n),), reasons=(Note(n, n),)) for n in HOSTILE]
    page = scanned(result(*loops, failures=(Note("f", HOSTILE[1]),)), {n: record(n, 500) for n in HOSTILE}).page()
    read = Reader(page)
    assert not read.open and not read.named("img") and "<script>alert(1)" not in page
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]", page)


def links(folder):
    index = (folder / "index.html").read_text("utf-8")
    return [a["href"] for a in Reader(index).named("a") if a.get("href", "").endswith(".html")]


def test_folder_has_a_page_per_loop_and_the_library_once(tmp_path):
    loops = [report(n) for n in HOSTILE]
    write(result(*loops), {n: record(n, 500) for n in HOSTILE}, "html", tmp_path / "out")
    found = links(tmp_path / "out")
    assert len(set(found)) == len(HOSTILE)
    for href in found:
        body = (tmp_path / "out" / href).read_text("utf-8")
        assert "../index.html" in body and len(body) < 400_000
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    assert len(list((tmp_path / "out").rglob("plotly.js"))) == 1


def test_a_new_run_replaces_the_folder_and_older_pages_go(tmp_path):
    for d in (0.01, 0.02, 0.03):
        write(result(report("FIC101", d)), {}, "html", tmp_path)
    (tmp_path / "mine.txt").write_text("keep")
    write(result(report("FIC101", 0.03)), {}, "html", tmp_path)
    pages = [p for p in tmp_path.iterdir() if p.is_dir()]
    assert len(pages) == 1 and (tmp_path / "mine.txt").exists()
    assert "3.00" in (tmp_path / links(tmp_path)[0]).read_text("utf-8")


def test_stopped_in_the_middle_the_old_folder_is_whole(tmp_path):
    write(result(report("FIC101", 0.01)), {}, "html", tmp_path)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}

    def stop() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(result(report("FIC101", 0.02), report("b")), {}, "html", tmp_path, step=stop)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


def test_overview_of_a_thousand_loops_is_light(tmp_path):
    loops = [report(f"FIC{i:04}") for i in range(1000)]
    began = time.perf_counter()
    write(result(*loops), {}, "html", tmp_path)
    assert time.perf_counter() - began < 30
    assert (tmp_path / "index.html").stat().st_size < 1_500_000


@pytest.mark.parametrize("n", [0, 1, 2, figures.POINTS - 1, figures.POINTS, figures.POINTS + 1, 54_321])
def test_thinning_keeps_the_extremes(n):
    rng = np.random.default_rng(n)
    values = rng.normal(size=n)
    values[rng.random(n) < 0.2] = np.nan
    chosen, gaps = figures.thin(np.arange(n), values)
    assert len(chosen) <= figures.POINTS + 2 and (np.diff(chosen) > 0).all() and gaps == []
    if np.isfinite(values).any():
        assert np.nanmax(values[chosen]) == np.nanmax(values) and np.nanmin(values[chosen]) == np.nanmin(values)


def test_lines_break_at_gaps():
    index = np.concatenate([np.arange(5), np.arange(100, 105)])
    assert figures.thin(index, np.zeros(10))[1] == [5]
    trend = figures.trend(record(), report())
    assert None in trend["data"][0]["y"]


def test_the_picture_of_the_plant_has_sizes_intervals_bounds_and_words():
    loops = [report("a", 0.05), report("b", 0.02), report("c", 0.004, Verdict.NO_BACKLASH, confirmation=None),
             report("d", None, Verdict.CANNOT_TELL)]
    found = {trace["name"]: trace for trace in scan_report.plant_picture(loops)["data"]}
    sizes = found["backlash (2)"]
    assert sizes["x"] == [5.0, 2.0] and sizes["y"] == [0, 1] and sizes["text"] == ["", ""]
    assert sizes["error_x"]["array"] == pytest.approx([0.5, 0.2])
    assert sizes["error_x"]["arrayminus"] == pytest.approx([0.5, 0.2])
    assert found["no backlash (1)"]["x"] == [0.4] and found["no backlash (1)"]["text"] == ["below 0.40 %"]
    assert found["cannot tell (1)"]["text"] == ["cannot tell"] and not found["cannot tell (1)"]["showlegend"]
    one = loops[0]
    assert one.confirmation is not None and one.cluster is not None
    seen = replace(one, confirmation=replace(one.confirmation, limit_of_detection=0.09),
                   cluster=replace(one.cluster, limit_of_detection=0.05))
    ticks = scan_report.plant_picture([seen])["data"][-1]
    assert ticks["name"] == "limit of detection" and ticks["x"] == [5.0]  # a size that is called is never below it


@pytest.mark.parametrize("loops", [12, scan_report.DRAWN])
def test_a_page_of_noisy_loops_stays_below_3_mb(loops):
    rng = np.random.default_rng(1)
    noisy = {f"L{k}": record(f"L{k}", 20_000) for k in range(loops)}
    for made in noisy.values():
        made.measurement[:] += rng.normal(0.0, 0.005, len(made))
    assert len(scanned(result(*map(report, noisy)), noisy).page()) < 3_000_000


def test_figures_use_engineering_units_and_bounded_points():
    plain = record()
    settings = plain.settings.with_values("metadata", pv_range=(0.0, 200.0), op_range=(0.0, 100.0))
    made = replace(plain, settings=settings)
    data = figures.trend(made, report())["data"]
    assert data[0]["y"][0] == 100.0 and 38 <= min(y for y in data[-1]["y"] if y is not None) <= 42
    assert all(len(line["x"]) <= 1.2 * figures.POINTS for line in data)
    assert data[2]["name"] == "PV in the half periods used"


def test_pages_do_not_depend_on_the_clock_or_place():
    loops = {"FIC101": record()}
    assert scanned(result(report()), loops).page() == scanned(result(report()), loops).page()
    assert not re.search(r"/(home|root|tmp)/", scanned(result(report()), loops).page().split("/**")[0])


JARGON = ("Cluster", "Confirmation", "Detections", "BIC", "nats", "eq. (", "(15)", "log likelihood of")


def facts(page):
    """What stands in the rows of the page's tables: first cell -> the others."""
    rows = re.findall(r"<tr>(.*?)</tr>", page, re.S)
    cells = [[html.unescape(re.sub("<[^>]*>", "", c)) for c in re.findall(r"<td.*?>(.*?)</td>", row)] for row in rows]
    return {first: rest for first, *rest in filter(None, cells)}


def test_the_size_and_what_the_half_periods_say_stand_in_rows_of_their_own():
    page = scanned(result(report("FIC101", confirmation=confirmed(0.03))), {"FIC101": record("FIC101")}).page()
    said = facts(page)
    assert said["Size"][0] == "3.00 % (2.70 to 3.30 %)" and said["Of them alike"][0] == "8 (80 %)"
    assert said["Evidence"][0] == "16.2 points" and said["Found"][0].startswith("10 (50 %")
    assert not [word for word in JARGON if word in page.split("<script")[0]]
    assert {"Sure [%]", "Found"} <= set(re.findall(r'<th scope="col">(.*?)</th>', page))


def test_of_a_loop_without_a_verdict_nothing_is_found_or_sure():
    loop = report("PIC307", None, Verdict.CANNOT_TELL, confidence=0.0, confirmation=confirmed(0.0272), compensator=None)
    page = scanned(result(loop), {"PIC307": record("PIC307")}).page()
    said = facts(page)
    assert "not claimed" in said["Best size tried"][1] and not {"Size", "Sure", "Of them alike"} & {*said}
    assert "No dead band is claimed for this loop" in page
    assert said["PIC307"][4] == "–"  # sure
    names = [shape["name"] for shape in figures.profile(loop)["layout"]["shapes"] if "name" in shape]
    assert "best size tried: 2.72 %" in names and not [name for name in names if "found" in name]


def test_a_half_period_says_in_words_why_it_is_not_used():
    refused = replace(report().estimates[0], accepted=False, why="shape", d=0.014)
    figure = figures.estimates(report(estimates=(refused,), cluster=None))
    assert figure["data"][0]["text"] == ["not flat, 100 s"] and figure["layout"]["showlegend"]
    assert figure["layout"]["yaxis"]["range"] == [0, pytest.approx(1.75)]


def test_reasons_on_a_page_are_sentences():
    reasons = Note("a", "play or stiction: alike"), Note("b", "pv_range is a guess.")
    page = scanned(result(report(reasons=reasons)), {}).page()
    assert "<p>Play or stiction: alike.</p>" in page and "<p>pv_range is a guess.</p>" in page


def confirmed(d):
    return Confirmation(d, (0.8 * d, 1.2 * d), 0.04, 25.2, details={"evidence": 16.18},
                        profile=((0.5 * d, 4.0), (d, 9.0)))
