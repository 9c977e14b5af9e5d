"""The nightly job from the outside: what is new, late, missing, repeated and broken; exit status, log and rotation."""

import json

import numpy as np
import pytest

from backlash_cli.history.nightly import lock
from backlash_cli.history.store import History
from tests.commands.run import run

CONFIG = """
inputs = ["p_{date}.csv"]
history = "h.db"
fail_on = ["d>90%"]
[outputs]
report = "out/wear.html"
scan = "out/scan_{date}.json"
trend = "out/trend.json"
keep = 2
[log]
file = "out/nightly.log"
format = "json"
"""


def export(folder, day, seed=0):
    rng = np.random.default_rng([seed, day])
    rows = [f"2026-03-{day:02}T00:{s // 60:02}:{s % 60:02},50,{50 + rng.normal():.3f},40" for s in range(900)]
    (folder / f"p_2026-03-{day:02}.csv").write_text("\n".join(["time,F1.SP,F1.PV,F1.OP", *rows]) + "\n")


@pytest.fixture
def job(tmp_path):
    (tmp_path / "loops.toml").write_text(
        "[loops.F1]\nK = 1.0\nTi = 10.0\npv_range = [0, 100]\nop_range = [0, 100]\n")
    (tmp_path / "n.toml").write_text(CONFIG)
    return tmp_path


def events(folder):
    return [json.loads(line) for line in (folder / "out/nightly.log").read_text().splitlines()]


def test_an_export_of_another_day_and_loops_that_went_are_named(capfd, job):
    for day in (1, 2, 3):
        export(job, day)
    text = (job / "p_2026-03-02.csv").read_text().replace("F1.OP", "F1.OP,F2.SP,F2.PV,F2.OP")
    (job / "p_2026-03-02.csv").write_text(text.replace(",40\n", ",40,1,2,3\n"))
    (job / "p_2026-03-06.csv").write_text((job / "p_2026-03-03.csv").read_text())
    done = run(capfd, "nightly", job / "n.toml")
    assert "; misdated 2026-03-06" in done.out and "; nothing new in 2026-03-06" in done.out
    assert "; no longer there F2" in done.out
    assert {(e["event"], e.get("night"), e.get("loop")) for e in events(job)} >= {
        ("misdated", "2026-03-06", None), ("nothing new in", "2026-03-06", None), ("no longer there", None, "F2")}
    done = run(capfd, "nightly", job / "n.toml")
    assert "misdated" not in done.out and "nothing new in" not in done.out


def test_new_late_missing_and_repeated_nights_are_named_on_one_line(capfd, job):
    for day in (1, 2, 4):
        export(job, day)
    done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 0 and done.out.count("\n") == 1 and done.err == ""
    assert "scanned 2026-03-01, 2026-03-02, 2026-03-04 (loop nights: 3 new)" in done.out
    assert "missing 2026-03-03" in done.out and "; late" not in done.out
    export(job, 3)
    done = run(capfd, "nightly", job / "n.toml")
    assert "scanned 2026-03-03 (" in done.out and "late 2026-03-03" in done.out and "; missing" not in done.out
    done = run(capfd, "nightly", job / "n.toml")
    assert "nothing new (4 known)" in done.out and done.status == 0
    assert sorted(p.name for p in (job / "out").glob("scan*")) == ["scan_2026-03-03.json", "scan_2026-03-04.json"]
    assert "Valve wear report" in (job / "out/wear.html").read_text()
    assert json.loads((job / "out/trend.json").read_text())["loops"][0]["nights"] == 4
    found = events(job)
    assert {e["event"] for e in found} >= {"scanned", "missing", "known", "removed", "report", "done"}
    assert [e["night"] for e in found if e.get("late")] == ["2026-03-03"]
    with History(job / "h.db") as history:
        assert len(history.nights("F1")) == 4


def test_a_corrected_export_or_new_settings_are_scanned_again(capfd, job):
    export(job, 1)
    run(capfd, "nightly", job / "n.toml")
    export(job, 1, seed=1)
    assert "1 revised" in run(capfd, "nightly", job / "n.toml").out
    (job / "loops.toml").write_text("[loops.F1]\nK = 1.0\nTi = 12.0\npv_range = [0, 100]\nop_range = [0, 100]\n")
    assert "1 revised" in run(capfd, "nightly", job / "n.toml").out
    with History(job / "h.db") as history:
        assert len(history.nights("F1")) == 1 and history.nights("F1")[0].settings["Ti"] == 12.0


def test_a_broken_export_does_not_stop_the_others(capfd, job):
    export(job, 1)
    (job / "p_2026-03-02.csv").write_bytes(b"\x00\x01\x02" * 50)
    done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 3 and "failed 2026-03-02" in done.out and "scanned 2026-03-01" in done.out
    assert [e["level"] for e in events(job) if e["event"] == "failed"] == ["error"]
    export(job, 2)
    assert run(capfd, "nightly", job / "n.toml").status == 0


def test_nothing_at_all_is_an_error_with_a_remedy(capfd, job):
    done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 2 and "no export fits the patterns" in done.err
    (job / "p_2026-03-02.csv").write_bytes(b"\x00\x01\x02" * 50)
    done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 2 and "none of 1 exports could be read" in done.err


def test_an_input_without_an_export_is_named(capfd, job):
    export(job, 1)
    (job / "n.toml").write_text(CONFIG.replace('["p_{date}.csv"]', '["p_{date}.csv", "gone.csv"]'))
    done = run(capfd, "nightly", job / "n.toml", "--check")
    assert done.status == 3 and done.out.splitlines()[-1].endswith("gone.csv: no export found")
    done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 3 and "no export found " in done.out and "scanned 2026-03-01" in done.out
    assert [e["inputs"].endswith("gone.csv") for e in events(job) if e["event"] == "no export found"] == [True]


def test_a_rule_that_is_met_makes_the_status_1(capfd, job):
    export(job, 1)
    (job / "n.toml").write_text(CONFIG.replace("d>90%", "no_such"))
    assert run(capfd, "nightly", job / "n.toml").status == 2
    verdict = json.loads(run(capfd, "scan", job / "p_2026-03-01.csv", "--format", "json").out)["loops"][0]["verdict"]
    rule = verdict if verdict in ("cannot_tell", "backlash", "oscillating", "insufficient_data") else None
    if rule is None:
        pytest.skip(f"no rule for {verdict}")
    (job / "n.toml").write_text(CONFIG.replace("d>90%", rule))
    done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 1 and "alarm F1" in done.out


def test_a_second_job_is_told_of_the_first(capfd, job):
    export(job, 1)
    with lock(job / "h.db.lock"):
        done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 2 and "another nightly job is working (process" in done.err
    (job / "h.db.lock").write_text("process 1 on elsewhere\n")
    assert run(capfd, "nightly", job / "n.toml").status == 0
    assert "taken over" in events(job)[-4]["event"] or any("taken over" in e["event"] for e in events(job))


def test_check_lists_what_would_be_scanned_and_changes_nothing(capfd, job):
    for day in (1, 3):
        export(job, day)
    done = run(capfd, "nightly", job / "n.toml", "--check")
    assert done.out.splitlines() == ["2026-03-01: p_2026-03-01.csv", "2026-03-03: p_2026-03-03.csv",
                                     "2026-03-02: missing"]
    assert not (job / "h.db").exists() and not (job / "out").exists()


def test_check_reads_limits_and_loop_settings_and_a_wrong_path_is_named(capfd, job):
    export(job, 1)
    for key, name in (("limits", "limit.toml"), ("loops", "loop.toml")):
        (job / "n.toml").write_text(f'{key} = "{name}"\n' + CONFIG.replace('loops = "loops.toml"\n', ""))
        done = run(capfd, "nightly", job / "n.toml", "--check")
        assert done.status == 2 and name in done.err and "->" in done.err


def test_exports_too_old_to_be_looked_at_are_named_until_they_are_in_the_history(capfd, job):
    for day in (1, 2, 9):
        export(job, day)
    (job / "n.toml").write_text("look_back = 3\n" + CONFIG)
    assert "2026-03-01: older than look_back\n" in run(capfd, "nightly", job / "n.toml", "--check").out
    assert "older than look_back 2026-03-01, 2026-03-02" in run(capfd, "nightly", job / "n.toml").out
    (job / "n.toml").write_text(CONFIG)
    run(capfd, "nightly", job / "n.toml")
    (job / "n.toml").write_text("look_back = 3\n" + CONFIG)
    assert "older" not in run(capfd, "nightly", job / "n.toml").out


def test_text_log_and_standard_error(capfd, job):
    for day in (1, 3):
        export(job, day)
    (job / "n.toml").write_text(CONFIG.split("[log]")[0])
    done = run(capfd, "nightly", job / "n.toml")
    assert done.err == "backlash: missing night=2026-03-02\n"
    (job / "n.toml").write_text(CONFIG.replace('"json"', '"text"'))
    run(capfd, "nightly", job / "n.toml")
    assert "info known night=2026-03-01" in (job / "out/nightly.log").read_text()


def test_the_report_of_a_night_comes_though_the_job_was_stopped_before_it(capfd, job, monkeypatch):
    export(job, 1)
    with monkeypatch.context() as stopped:
        stopped.setattr("backlash_cli.commands.nightly._write_scan", lambda *given: 1 / 0)
        assert run(capfd, "nightly", job / "n.toml").status == 2
    done = run(capfd, "nightly", job / "n.toml")
    assert "scanned 2026-03-01" in done.out and (job / "out/scan_2026-03-01.json").exists()
    assert "nothing new" in run(capfd, "nightly", job / "n.toml").out


def test_a_folder_of_reports_that_is_a_file_is_named(capfd, job):
    export(job, 1)
    (job / "out").mkdir()
    (job / "out/scans").write_text("")
    (job / "n.toml").write_text(CONFIG.replace("out/scan_{date}", "out/scans/{date}"))
    done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 2 and "out/scans" in done.err and "fault of backlash" not in done.err


def test_a_log_in_json_on_standard_error_is_nothing_else(capfd, job):
    export(job, 1)
    (job / "n.toml").write_text(CONFIG.replace('file = "out/nightly.log"\n', ""))
    lines = run(capfd, "nightly", job / "n.toml").err.splitlines()
    assert [json.loads(line)["event"] for line in lines] == ["scanned", "report", "done"]


def test_a_wrong_rule_is_named_with_its_file(capfd, job):
    export(job, 1)
    (job / "n.toml").write_text(CONFIG.replace("d>90%", "bcklash"))
    done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 2 and "n.toml, fail_on: no rule 'bcklash' -> did you mean backlash" in done.err


def test_a_loop_that_is_lost_and_a_damaged_export_are_named_with_the_reason(capfd, job):
    (job / "n.toml").write_text('inputs = ["p_{date}.csv"]\nhistory = "h.db"\n')
    export(job, 1)
    text = (job / "p_2026-03-01.csv").read_text().replace("F1.OP", "F1.OP,F2.SP,F2.PV,F2.OP")
    text = text.replace(",40\n", ",40,1,2,3\n")
    (job / "p_2026-03-01.csv").write_text(text[: text.rindex(":")])  # cut off within the last row
    done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 0
    assert "ragged_rows" in done.err and "if that is the last line the file was cut off" in done.err
    (job / "loops.toml").write_text("[loops.F1]\nK = 0\nTi = 10.0\n")
    done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 3 and "not analysed" in done.err and "K must not be zero" in done.err


def test_an_incomplete_export_is_told_each_time(capfd, job):
    export(job, 1)
    text = (job / "p_2026-03-01.csv").read_text().replace("F1.OP", "F1.OP,F2.SP,F2.PV,F2.OP")
    (job / "p_2026-03-01.csv").write_text(text.replace(",40\n", ",40,1,,3\n"))
    for _ in range(2):
        done = run(capfd, "nightly", job / "n.toml")
        assert done.status == 3 and "; incomplete 2026-03-01" in done.out


def test_two_exports_of_one_night_that_differ_are_told(capfd, job):
    export(job, 1, seed=5)
    (job / "p_2026-03-01.csv").rename(job / "again.csv")
    export(job, 1)
    (job / "n.toml").write_text(CONFIG.replace('["p_{date}.csv"]', '["p_{date}.csv", "again.csv"]'))
    done = run(capfd, "nightly", job / "n.toml")
    assert "; revised by again.csv" in done.out or "; revised by 2026-03-01" in done.out
    assert "revised by" not in run(capfd, "nightly", job / "n.toml").out


def test_an_export_of_a_day_that_no_calendar_has_is_named(capfd, job):
    export(job, 1)
    (job / "p_2026-02-30.csv").write_text((job / "p_2026-03-01.csv").read_text())
    (job / "p_copy-of-old.csv").write_text("no day at all")
    done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 3 and "no export found p_2026-02-30.csv (no such day)" in done.out and "copy" not in done.out
    (job / "p_2026-03-01.csv").unlink()
    done = run(capfd, "nightly", job / "n.toml")
    assert done.status == 2 and "p_2026-02-30.csv (no such day)" in done.err
