"""backlash scan from the outside: forms, exit statuses, what is said where, and bad use."""

import csv
import io
import json
from pathlib import Path

import pandas as pd
import pytest

from backlash_cli.reporter.scan_report import met, parse_rules
from tests.commands.run import files, run
from tests.reporter.reports import HOSTILE, report
from tests.small_plant import TRUTH, write_plant

pytestmark = pytest.mark.usefixtures("analysed_once")
ROWS = "".join(f"2026-03-01 00:00:{s:02},1.0,{s}.5\n" for s in range(50))


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    return write_plant(tmp_path_factory.mktemp("plant"), hours=1.0)


def test_table_is_the_default_with_the_largest_first(capfd, plant):
    done = run(capfd, "scan", plant)
    assert done.status == 0 and done.err == "" and "\x1b" not in done.out
    names = [line.split()[0] for line in done.out.splitlines()[1:4]]
    assert names[:2] == ["PIC303", "FIC101"] and max(map(len, done.out.splitlines())) <= 100


def test_settings_found_beside_the_data_are_never_written_over(capfd, tmp_path):
    plant = write_plant(tmp_path, hours=0.2)
    settings = next(tmp_path.glob("*loops.toml"))
    before = settings.read_bytes()
    done = run(capfd, "scan", plant, "--format", "csv", "--output", settings)
    assert done.status == 2 and "the file of loop settings" in done.err and settings.read_bytes() == before


def test_what_cannot_be_opened_in_a_folder_is_a_failure(capfd, tmp_path):
    write_plant(tmp_path, hours=0.2)
    (tmp_path / "lost.csv").symlink_to(tmp_path / "nowhere.csv")
    done = run(capfd, "scan", tmp_path, "--no-confirm")
    said = " ".join(done.out.split())  # a long path of the folder breaks the line
    assert done.status == 3 and "lost.csv: no such file" in said and "FIC101" in said


def test_a_file_that_is_no_history_leaves_nothing_behind(capfd, plant, tmp_path):
    (tmp_path / "h.db").write_text("no history\n" * 100)
    done = run(capfd, "scan", plant, "--history", tmp_path / "h.db")
    assert done.status == 2 and [path.name for path in tmp_path.iterdir()] == ["h.db"]


def test_json_is_one_document_on_standard_output(capfd, plant):
    done = run(capfd, "scan", plant, "--format", "json")
    found = json.loads(done.out)
    assert {loop["loop"] for loop in found["loops"]} == set(TRUTH) and done.err == ""
    assert found["inputs"] == [str(plant)]


def test_a_dash_is_standard_output(capfd, plant, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for words in (["scan", plant, "--format", "json"], ["check", plant]):
        assert run(capfd, *words, "--output", "-").out == run(capfd, *words).out
    assert not list(tmp_path.glob("-*"))


def test_the_same_result_in_every_form(capfd, plant, tmp_path):
    sizes = {}
    for form in ("json", "csv", "parquet"):
        path = tmp_path / f"r.{form}"
        done = run(capfd, "scan", plant, "--output", path)
        assert done.status == 0 and done.out == "" and f"{form} written to" in done.err
        if form == "json":
            loops = json.loads(path.read_text())["loops"]
            sizes[form] = {x["loop"]: x["cluster"] and x["cluster"]["d"] for x in loops}
        else:
            frame = pd.read_csv(path) if form == "csv" else pd.read_parquet(path)
            sizes[form] = {loop: None if pd.isna(d) else d for loop, d in zip(frame.loop, frame.d, strict=True)}
    assert sizes["csv"] == pytest.approx(sizes["json"]) and sizes["parquet"] == pytest.approx(sizes["json"])


def test_estimates_as_a_table(capfd, plant):
    done = run(capfd, "scan", plant, "--format", "csv", "--table", "estimates")
    rows = list(csv.DictReader(io.StringIO(done.out)))
    assert {r["loop"] for r in rows} <= set(TRUTH) and len(rows) > 50
    assert {r["accepted"] for r in rows} == {"true", "false"}


def test_html_to_a_file_and_to_a_folder(capfd, plant, tmp_path):
    assert run(capfd, "scan", plant, "--output", tmp_path / "r.html").status == 0
    page = (tmp_path / "r.html").read_text()
    assert page.startswith("<!doctype html>") and f"<h1>Dead band report: {plant.name}</h1>" in page
    assert f"<code>backlash scan {plant} --output {tmp_path / 'r.html'}</code>" in page
    assert run(capfd, "scan", plant, "--format", "html", "--output", tmp_path / "pages").status == 0
    assert len(list((tmp_path / "pages").rglob("*.html"))) == 1 + len(TRUTH)


def test_a_picture_per_loop(capfd, plant, tmp_path):
    done = run(capfd, "scan", plant, "--loop", "FIC*", "--plot", tmp_path / "new" / "pictures")
    assert done.status == 0 and "1 picture written" in done.err and "FIC101" in done.out
    assert (tmp_path / "new" / "pictures" / "FIC101.png").read_bytes().startswith(b"\x89PNG")
    assert run(capfd, "scan", plant, "--plot", plant / "x").status == 2


@pytest.mark.parametrize(
    ("rule", "status"),
    [("backlash", 1), ("any", 1), ("suspected", 1), ("d>0.03", 1), ("d>3%", 1), ("d>20%", 0), ("error,d>1%", 1)],
)
def test_fail_on(capfd, plant, rule, status):
    done = run(capfd, "scan", plant, "--format", "json", "--fail-on", rule)
    assert done.status == status and ("met by" in done.err) == (status == 1)


def test_rules_look_at_verdict_and_size():
    loops = [report("a", 0.02), report("b", 0.03)]
    assert met(parse_rules(["d>2%"]), loops) == ["b"] and met(parse_rules(["d>=0.02"]), loops) == ["a", "b"]
    assert met(parse_rules(["D > 2.5 %"]), loops) == ["b"] and met(parse_rules(["cannot-tell", "error"]), loops) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--fail-on", "backlsh"], ["did you mean backlash?", "d>0.03"]),
        (["--fail-on", "d>3"], ["d>3%"]),
        (["--fail-on", "d"], ['--fail-on "d>3%"']),
        (["--fail-on", ""], ["no rule"]),
        (["--format", "xml"], ["xml", "json"]),
        (["--format", "parquet"], ["--output"]),
        (["--output", "report.xlsx"], [".xlsx", ".json, .csv", "--format"]),
        (["--output", "x" * 300 + ".csv"], ["the name is too long", "choose a shorter name"]),
        (["--history", "x" * 300 + ".db"], ["the name is too long"]),
        (["--output", "nowhere/report.csv"], ["the folder does not exist"]),
        (["--table", "loop", "--format", "csv"], ["'loop' is not one of 'loops', 'estimates'"]),
        (["--table", "estimates"], ["--format csv"]),
        (["--jobs", "0"], ["--jobs"]),
        (["--no-such"], ["--no-such"]),
        (["--loop", "FIC110"], ["FIC110", "did you mean FIC101"]),
        (["--loops", "nowhere.toml"], ["nowhere.toml"]),
        (["--timezone", "Europe/Berln"], ["Europe/Berlin"]),
        (["--decimal", ";"], ["--decimal"]),
    ],
)
def test_wrong_use_is_one_message_and_status_2(capfd, plant, arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run(capfd, "scan", plant, *arguments)
    assert done.status == 2 and done.out == ""
    for word in words:
        assert word in done.err, done.err
    assert not files(tmp_path)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda d: [], "INPUT"),
        (lambda d: [d / "none.csv"], "none.csv"),
        (lambda d: [d], "no "),
        (lambda d: [_written(d, "empty.csv", "")], "empty"),
        (lambda d: [_written(d, "x.csv", "time,FIC1.SP,FIC1.OP\n" + ROWS)], "PV"),
    ],
)
def test_nothing_to_read_is_status_2(capfd, tmp_path, make, words):
    inputs = make(tmp_path)
    before = files(tmp_path)
    done = run(capfd, "scan", *inputs)
    assert done.status == 2 and words in done.err and done.out == "" and files(tmp_path) == before


def _written(folder, name, text):
    (folder / name).write_text(text)
    return folder / name


def test_output_that_cannot_be_written_is_status_2(capfd, plant, tmp_path):
    done = run(capfd, "scan", plant, "--output", tmp_path / "no" / "r.json")
    assert done.status == 2 and "does not exist" in done.err and not files(tmp_path)
    assert run(capfd, "scan", plant, "--format", "json", "--output", tmp_path).status == 2
    assert run(capfd, "scan", plant, "--format", "html", "--output", plant / "x").status == 2


def test_one_bad_file_among_good_ones_is_status_3(capfd, plant, tmp_path):
    bad = _written(tmp_path, "bad.csv", "")
    done = run(capfd, "scan", plant, bad)
    assert done.status == 3 and "PIC303" in done.out and "bad.csv" in done.out
    done = run(capfd, "scan", plant, bad, "--format", "json")
    found = json.loads(done.out)
    assert done.status == 3 and len(found["loops"]) == 3 and "bad.csv" in found["failures"][0]["message"]
    assert "bad.csv" in done.err
    assert run(capfd, "scan", plant, bad, "--fail-on", "backlash").status == 1


def test_one_bad_loop_among_good_ones_is_in_the_list(capfd, plant, tmp_path):
    lines = plant.read_text().splitlines()
    half = _written(tmp_path, "plant.csv", "\n".join(line.rsplit(",", 2)[0] for line in lines) + "\n")
    (tmp_path / "plant.loops.toml").write_text((plant.parent / "plant.loops.toml").read_text())
    done = run(capfd, "scan", half, "--format", "json")
    loops = {x["loop"]: x for x in json.loads(done.out)["loops"]}
    assert done.status == 3 and loops["PIC303"]["verdict"] == "error" and loops["PIC303"]["reasons"]
    assert loops["FIC101"]["verdict"] == "backlash"


def test_quiet_says_nothing_when_all_is_well(capfd, plant, tmp_path):
    done = run(capfd, "scan", plant, "--quiet")
    assert (done.status, done.out, done.err) == (0, "", "")
    done = run(capfd, "scan", plant, "--quiet", "--fail-on", "backlash", "--output", tmp_path / "r.csv")
    assert (done.status, done.out) == (1, "") and (tmp_path / "r.csv").exists()
    assert done.err == "backlash: --fail-on backlash: met by 2 loops: FIC101, PIC303\n"  # what cron mails
    assert json.loads(run(capfd, "scan", plant, "--quiet", "--format", "json").out)["loops"]
    assert "bad.csv" in run(capfd, "scan", plant, _written(tmp_path, "bad.csv", ""), "--quiet").err


def test_verbose_gives_the_reasons_of_every_loop(capfd, plant):
    plain, verbose = run(capfd, "scan", plant).out, run(capfd, "scan", plant, "--verbose").out
    assert verbose.count("  reason ") >= len(TRUTH) and "  reason " not in plain
    assert verbose.count("half periods not used") == len(TRUTH)


def test_only_the_loops_asked_for(capfd, plant):
    found = json.loads(run(capfd, "scan", plant, "--loop", "FIC*", "--format", "json").out)
    assert [x["loop"] for x in found["loops"]] == ["FIC101"]


def test_processes_give_the_same_report(capfd, plant):
    alone = run(capfd, "scan", plant, "--format", "json")
    assert run(capfd, "scan", plant, "--format", "json", "--jobs", "2").out == alone.out


@pytest.mark.parametrize("name", [n for n in HOSTILE if "\udc80" not in n])
def test_hostile_loop_names_in_every_form(capfd, tmp_path, name):
    path = write_plant(tmp_path, {"FIC101": name}, hours=0.5)
    before = files(tmp_path)
    table = run(capfd, "scan", path, "--verbose", "--no-confirm")
    assert table.status in (0, 3)
    for c in ("\x1b", "\x07", "\u202e", "FIC\n101"):
        assert c not in table.out + table.err
    assert max(map(len, table.out.splitlines())) <= 100
    loops = json.loads(run(capfd, "scan", path, "--no-confirm", "--format", "json").out)["loops"]
    assert name in [x["loop"] for x in loops]
    assert "<script>alert(1)" not in run(capfd, "scan", path, "--no-confirm", "--format", "html").out
    rows = list(csv.DictReader(io.StringIO(run(capfd, "scan", path, "--no-confirm", "--format", "csv").out)))
    assert len(rows) == 3 and not any(r["loop"].startswith("=") for r in rows)
    assert files(tmp_path) == before
    run(capfd, "scan", path, "--no-confirm", "--format", "html", "--output", tmp_path / "pages")
    made = set(files(tmp_path)) - set(before)
    assert all(m.startswith("pages/") for m in made) and len(made) == 5


def test_the_demo_needs_no_export_and_says_what_the_sample_says(capfd):
    shipped = run(capfd, "scan", Path(__file__).parents[2] / "sample_data" / "plant.csv", "--format", "csv")
    demo = run(capfd, "scan", "--demo", "--format", "csv")
    assert demo.status == 0 and demo.out == shipped.out
    assert demo.err.count("\n") == 1 and "demo: twelve simulated loops" in demo.err
    assert run(capfd, "scan", "--demo", "--quiet").err == ""


def test_nothing_to_scan_is_one_message_that_names_the_demo(capfd, plant):
    done = run(capfd, "scan")
    assert done.status == 2 and "nothing to scan" in done.err and "--demo" in done.err
    assert "do not fit together" in run(capfd, "scan", plant, "--demo").err


def test_two_files_of_settings_are_refused(capfd, tmp_path):
    (tmp_path / "x.csv").write_text("time,F1.SP,F1.PV\n" + ROWS)
    for name in "ab":
        (tmp_path / f"{name}.toml").write_text("[loops.F1]\nK = 1.0\n")
    done = run(capfd, "scan", tmp_path / "x.csv", "--loops", tmp_path / "a.toml", "--loops", tmp_path / "b.toml")
    assert done.status == 2 and "two files of loop settings are given" in done.err


def test_the_whole_reason_of_a_loop_that_is_lost_stands_below_the_table(capfd, tmp_path):
    rows = ROWS.replace("\n", ",1,2\n")
    (tmp_path / "x.csv").write_text("time,F1.SP,F1.PV,F9.SP,F9.OP\n" + rows)
    done = run(capfd, "scan", tmp_path / "x.csv", "--no-confirm")
    assert done.status == 3 and "times, lists or records" in " ".join(done.out.split())
