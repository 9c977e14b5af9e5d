"""scan --history, history, trend and report from the outside, and the scan of single nights against one clean pass."""

import json
import shutil
import signal
import sqlite3
import subprocess
import time

import numpy as np
import pandas as pd
import pytest

from backlash_cli.__main__ import _guarded
from backlash_cli.history import plant as plant_history
from backlash_cli.history.store import History
from tests.commands.run import COMMAND, files, run
from tests.history.nights import growing, made, result
from tests.remembered import remembered
from tests.small_plant import TRUTH, write_plant

DAY = np.timedelta64(1, "D")
QUICK = ("--jobs", 1, "--no-confirm")


@pytest.fixture(scope="module", autouse=True)
def wear_once():
    """The wear of the same nights, repairs and limit is worked out once, however many commands show it."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(plant_history, "wear", remembered(plant_history.wear))
        yield


@pytest.fixture(scope="module")
def nights(tmp_path_factory):
    """Four nights of the small plant, with the same signals and their own dates."""
    folder = tmp_path_factory.mktemp("nights")
    plant = write_plant(folder, hours=1.0)
    head, *rows = plant.read_text().splitlines()
    stamps = np.array([row.split(",", 1)[0] for row in rows], "datetime64[s]")
    for k in range(4):
        moved = np.datetime_as_string(stamps + k * DAY)
        lines = [f"{t},{row.split(',', 1)[1]}" for t, row in zip(moved, rows, strict=True)]
        (folder / f"night{k}.csv").write_text("\n".join([head, *lines]) + "\n")
    shutil.move(folder / "plant.loops.toml", folder / "loops.toml")
    plant.unlink()
    return folder


@pytest.fixture(scope="module")
def db(tmp_path_factory):
    path = tmp_path_factory.mktemp("db") / "made.db"
    with History(path, create=True) as history:
        for name, options in {"FIC101": {}, "FIC102": {"repair": 30}, "TIC1": {"first": 0.015, "last": 0.015}}.items():
            history.add(*[result(report) for report in growing(60, loop=name, **options)])
    return path


def dump(path):
    with sqlite3.connect(path) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
        return list(connection.iterdump())


@pytest.fixture(scope="module")
def clean(nights, tmp_path_factory):
    """The history of one clean pass, one night after the other."""
    path = tmp_path_factory.mktemp("clean") / "h.db"
    for k in range(4):
        assert _guarded(["scan", str(nights / f"night{k}.csv"), "--history", str(path), "-q", *map(str, QUICK)]) == 0
    return dump(path)


def test_nights_out_of_order_and_twice_give_the_history_of_one_clean_pass(capfd, nights, clean, tmp_path):
    for k in (2, 0, 3, 2, 1, 0):
        done = run(capfd, "scan", nights / f"night{k}.csv", "--history", tmp_path / "h.db", *QUICK)
        assert done.status == 0
    assert "known and unchanged" in done.err
    assert dump(tmp_path / "h.db") == clean


def test_an_empty_file_becomes_a_history(capfd, nights, tmp_path):
    (tmp_path / "new.db").write_bytes(b"")
    done = run(capfd, "scan", nights / "night0.csv", "--history", tmp_path / "new.db", *QUICK)
    assert done.status == 0, done.err
    with History(tmp_path / "new.db") as store:
        assert store.rows("SELECT * FROM nights")


def test_several_nights_on_one_command_line_are_single_nights(capfd, nights, clean, tmp_path):
    exports = [nights / f"night{k}.csv" for k in (3, 1, 0, 2)]
    assert run(capfd, "scan", *exports, "--history", tmp_path / "h.db", *QUICK).status == 0
    assert dump(tmp_path / "h.db") == clean


def test_one_night_that_cannot_be_read_leaves_the_others_nights(capfd, nights, tmp_path):
    head = "time,FIC101.SP,FIC101.PV\n"
    (tmp_path / "bad.csv").write_text(head + "2026-03-09 00:00:00,1,1\n")
    exports = [nights / "night0.csv", nights / "night1.csv", nights / "night3.csv", tmp_path / "bad.csv"]
    done = run(capfd, "scan", *exports, "--loops", nights / "loops.toml", "--history", tmp_path / "h.db", *QUICK)
    with History(tmp_path / "h.db") as history:
        assert len(history.nights("PIC303")) == 3
    assert "bad.csv" in done.err


def test_a_scan_killed_at_random_moments_leaves_the_history_of_a_clean_pass(capfd, nights, clean, tmp_path):
    path = tmp_path / "h.db"
    rng = np.random.default_rng(5)
    for k in range(4):
        job = subprocess.Popen([*COMMAND, "scan", str(nights / f"night{k}.csv"), "--history", str(path), "--jobs", "1",
                                "--no-confirm"],
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(float(rng.uniform(0.3, 1.6)))
        job.send_signal(signal.SIGKILL)
        job.wait()
    for k in range(4):
        assert run(capfd, "scan", nights / f"night{k}.csv", "--history", path, *QUICK).status == 0
    assert dump(path) == clean


def test_dated_files_of_one_loop_are_nights_of_one_loop(capfd, tmp_path):
    rng = np.random.default_rng(0)
    for day in (2, 3):
        rows = [f"2026-03-0{day}T00:{s // 60:02}:{s % 60:02},50,{50 + rng.normal():.3f},40" for s in range(900)]
        (tmp_path / f"FIC7_2026030{day}_2155.csv").write_text("\n".join(["time,SP,PV,OP", *rows]) + "\n")
    (tmp_path / "loops.toml").write_text("[defaults]\nK = 1.0\nTi = 10.0\npv_range = [0, 100]\n")
    for day in (2, 3):
        run(capfd, "scan", tmp_path / f"FIC7_2026030{day}_2155.csv", "--history", tmp_path / "h.db")
    with History(tmp_path / "h.db") as history:
        assert history.loops() == ["FIC7"] and len(history.nights("FIC7")) == 2


@pytest.mark.parametrize("path", ["{loop}.{tag}_2026030{day}.csv", "{tag}/{loop}/2026-03-0{day}.csv",
                                  "loop={loop}/date=2026-03-0{day}/part-0.csv"])
def test_a_night_of_a_folder_is_all_files_of_that_night(path, capfd, tmp_path):
    """One file per tag and day, or partitions by loop and day: the nights of single files with all signals."""
    rng, frames = np.random.default_rng(3), {}
    for loop in ("FIC7", "FIC8"):
        for day in (2, 3, 4):
            frames[loop, day] = pd.DataFrame(
                {"time": pd.date_range(f"2026-03-0{day}", periods=900, freq="s"), "SP": 50.0,
                 "PV": 50 + rng.normal(size=900).cumsum().round(3) * 0.01, "OP": 40 + rng.normal(size=900).round(3)})
    for (loop, day), frame in frames.items():
        for tag in ("SP", "PV", "OP"):
            file = tmp_path / "set" / path.format(loop=loop, tag=tag, day=day)
            file.parent.mkdir(parents=True, exist_ok=True)
            columns = ["time", tag] if "{tag}" in path else list(frame)
            frame[columns].rename(columns={tag: "value"} if "{tag}" in path else {}).to_csv(file, index=False)
        frame.add_prefix(f"{loop}.").rename(columns={f"{loop}.time": "time"}).to_csv(
            tmp_path / f"{loop}-{day}.csv", index=False)
    (tmp_path / "loops.toml").write_text("[defaults]\nK = 1.0\nTi = 10.0\npv_range = [0, 100]\n")
    assert run(capfd, "scan", tmp_path / "set", "--loops", tmp_path / "loops.toml", "--history", tmp_path / "set.db",
               *QUICK).status == 0
    for loop, day in frames:
        run(capfd, "scan", tmp_path / f"{loop}-{day}.csv", "--history", tmp_path / "single.db", *QUICK)
    with History(tmp_path / "set.db") as found, History(tmp_path / "single.db") as expected:
        assert found.loops() == expected.loops() == ["FIC7", "FIC8"]
        for loop in expected.loops():
            assert [(n.start, n.samples, n.verdict) for n in found.nights(loop)] == [
                (n.start, n.samples, n.verdict) for n in expected.nights(loop)]
            assert len(found.nights(loop)) == 3


def test_the_list_names_loops_nights_verdicts_and_repairs(capfd, db):
    done = run(capfd, "history", db)
    assert done.status == 0 and "FIC101  60" in done.out and "60 backlash" in done.out
    assert run(capfd, "history", "--history", db, "--runs").out.count("FIC101.csv") == 60
    assert run(capfd, "history", db, "--loop", "FIC10").status == 2
    chosen = run(capfd, "history", db, "--loop", "fic1*", "--loop", "/^T/").out
    assert "FIC101" in chosen and "TIC1" in chosen and "LIC" not in chosen


def test_export_to_csv_and_parquet(capfd, db, tmp_path):
    for suffix in ("csv", "parquet"):
        path = tmp_path / f"n.{suffix}"
        assert "180 rows of nights" in run(capfd, "history", db, "--export", path).err
        frame = pd.read_csv(path, parse_dates=["start"]) if suffix == "csv" else pd.read_parquet(path)
        assert list(frame.columns[:6]) == ["loop", "date", "start", "end", "verdict", "confidence"]
        assert frame.d.max() > 0.03 and str(frame.start.dtype).startswith("datetime64")
    assert "600 rows" in run(capfd, "history", db, "--export", path, "--table", "half_periods", "--loop", "TIC1").err
    assert run(capfd, "history", db, "--export", tmp_path / "n.xls").status == 2
    assert "'night' is not one of 'nights', 'half_periods', 'repairs', 'runs'" in run(
        capfd, "history", db, "--export", path, "--table", "night").err
    assert "0 rows" in run(capfd, "history", db, "--export", tmp_path / "r.csv", "--table", "repairs").err
    assert "rows of runs" in run(capfd, "history", db, "--export", tmp_path / "r.csv", "--runs").err
    two = run(capfd, "history", db, "--history", tmp_path / "other.db")
    assert two.status == 2 and "name its file, once" in two.err


@pytest.mark.parametrize("words", [
    ("history", "h.csv", "--export", "h.csv"), ("trend", "--history", "h.json", "--output", "./h.json"),
    ("report", "--history", "h.html", "--output", "{here}/h.html")])
def test_no_result_is_written_over_the_history_that_is_read(capfd, db, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / next(word for word in words if word.startswith("h."))
    path.write_bytes(db.read_bytes())
    done = run(capfd, *(word.format(here=tmp_path) for word in words))
    assert done.status == 2 and ("this is the history, that is read" in done.err or "named for two things" in done.err)
    assert path.read_bytes() == db.read_bytes()


def test_a_repair_is_entered_taken_back_and_splits_the_trend(capfd, db, tmp_path):
    path = tmp_path / "h.db"
    shutil.copy(db, path)
    assert "entered" in run(capfd, "history", path, "--repair", "FIC101", "2026-03-21", "new packing").err
    assert "already" in run(capfd, "history", path, "--repair", "FIC101", "2026-03-21", "new packing").err
    (loop,) = json.loads(run(capfd, "trend", "--history", path, "--format", "json", "--loop", "FIC101").out)["loops"]
    assert [s["nights"] for s in loop["segments"]] == [20, 40]
    assert loop["repairs"] == [{"date": "2026-03-21", "time": "2026-03-21T00:00:00Z", "note": "new packing",
                                "found": False, "before": None, "after": None}]
    assert run(capfd, "history", path, "--repair", "*IC1", "2026-03-25", "shutdown").err.count("entered: shutdown") == 1
    assert run(capfd, "history", path, "--remove-repair", "FIC101", "2026-03-22").status == 2
    assert "taken back" in run(capfd, "history", path, "--remove-repair", "FIC101", "2026-03-21").err
    for bad in (("FIC1", "2026-03-21"), ("FIC101", "yesterday"), ("FIC101", "2999-03-21")):
        done = run(capfd, "history", path, "--repair", *bad, "x")
        assert done.status == 2 and "->" in done.err


def test_trend_json_has_the_names_of_the_contract(capfd, db):
    loops = {x["loop"]: x for x in json.loads(run(capfd, "trend", "--history", db, "--format", "json").out)["loops"]}
    worn = loops["FIC101"]
    assert worn["nights"] == 60 and worn["limit"] == 0.03 and worn["repairs"] == []
    assert worn["slope_per_day"]["value"] == pytest.approx(0.03 / 59, rel=0.15)
    low, high = worn["slope_per_day"]["ci95"]
    assert low < worn["slope_per_day"]["value"] < high
    early, late = worn["limit_date"]["ci95"]
    assert early <= worn["limit_date"]["value"] <= late and worn["limit_date"]["value"].startswith("2026-04-")
    assert len(loops["FIC102"]["segments"]) == 2 and loops["FIC102"]["repairs"][0]["found"] is True
    assert loops["TIC1"]["limit_date"] is None and loops["TIC1"]["state"] == "no_trend"


def test_the_name_of_the_file_decides_on_the_form_of_a_trend(capfd, db, tmp_path):
    assert run(capfd, "trend", "--history", db, "--output", tmp_path / "t.json").status == 0
    assert json.loads((tmp_path / "t.json").read_text())["loops"]
    done = run(capfd, "trend", "--history", db, "--output", tmp_path / "t.html")
    assert done.status == 2 and ".txt, .json" in done.err and not (tmp_path / "t.html").exists()


def test_trend_table_limits_and_reasons(capfd, db, tmp_path):
    text = run(capfd, "trend", "--history", db, "-v").out
    assert "FIC101  pull" in text and "no trend" in text and "1. FIC101: Pull at the next shutdown" in text
    (tmp_path / "l.toml").write_text('[classes.a]\nlimit = 10\nsource = "ours"\n')
    assert "'nan' is not a finite number" in run(capfd, "trend", "--history", db, "--horizon", "nan").err
    done = run(capfd, "trend", "--history", db, "--limits", tmp_path / "l.toml", "--horizon", 30, "-o", tmp_path / "t")
    assert done.status == 0 and done.out == ""
    assert " 10 " in (tmp_path / "t").read_text()
    assert run(capfd, "trend", "--history", tmp_path / "absent.db").status == 2
    assert run(capfd, "trend", "--history", db, "--loop", "FIC").status == 2


def test_a_loops_file_names_the_class_of_a_limit(capfd, db, tmp_path):
    loops = tmp_path / "loops.toml"
    loops.write_text('[defaults]\nlimit_class = "nominal"\n[loops.FIC101]\nlimit_class = "positioner"\n')
    done = run(capfd, "trend", "--history", db, "--loops", loops, "--format", "json")
    limits = {x["loop"]: x["limit"] for x in json.loads(done.out)["loops"]}
    assert limits == {"FIC101": 0.01, "FIC102": 0.02, "TIC1": 0.02}
    loops.write_text('[loops.FIC101]\nlimit_class = "positoner"\n')
    done = run(capfd, "report", "--history", db, "--loops", loops, "-o", tmp_path / "w.html")
    assert done.status == 2 and "did you mean positioner" in done.err


def test_report_as_a_file_and_as_a_folder(capfd, db, tmp_path):
    assert run(capfd, "report", "--history", db, "-o", tmp_path / "w.html").status == 0
    page = (tmp_path / "w.html").read_text()
    assert f"<h1>Valve wear report: {db.name}</h1>" in page and "<code>backlash report --history " in page
    assert run(capfd, "report", "--history", db, "-o", tmp_path / "w").status == 0
    first = files(tmp_path / "w")
    assert {name.split("/")[-1] for name in first} == {"index.html", "plotly.js", "FIC101.html", "FIC102.html",
                                                      "TIC1.html"}
    run(capfd, "report", "--history", db, "-o", tmp_path / "w")
    assert files(tmp_path / "w") == first


def test_hostile_names_go_through_every_table(capfd, tmp_path):
    name = '=1+"\x1b[31m<b>'
    with History(tmp_path / "h.db", create=True) as history:
        for k in range(6):
            history.add(result(made(k, 0.02, loop=name)))
    assert "\x1b" not in run(capfd, "history", tmp_path / "h.db").out + run(capfd, "trend", "--history",
                                                                           tmp_path / "h.db", "-v").out
    run(capfd, "history", tmp_path / "h.db", "--export", tmp_path / "n.csv")
    assert "\n\"'=1" in (tmp_path / "n.csv").read_text()
    assert run(capfd, "report", "--history", tmp_path / "h.db", "-o", tmp_path / "w.html").status == 0
    assert "<b>" not in (tmp_path / "w.html").read_text()


def test_the_small_plant_is_ranked_by_its_truth(capfd, nights, tmp_path):
    run(capfd, "scan", *sorted(nights.glob("*.csv")), "--history", tmp_path / "h.db", *QUICK)
    found = json.loads(run(capfd, "trend", "--history", tmp_path / "h.db", "--format", "json").out)["loops"]
    assert {x["loop"] for x in found} == set(TRUTH) and found[0]["loop"] == "PIC303"


def test_a_table_without_a_file_to_write_is_refused(capfd, db):
    done = run(capfd, "history", db, "--table", "half_periods")
    assert done.status == 2 and "--export half_periods.csv" in done.err
