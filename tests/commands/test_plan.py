"""backlash plan: forms, messages, and plans that are kept."""

import csv
import io
import json
import re

import pandas as pd
import pytest

from tests.plan import test_twin

from .run import run

PLANT = "sample_data/plant.csv"


@pytest.fixture(autouse=True)
def kept(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_text_json_csv_and_sheets_say_the_same(capfd, tmp_path, kept):
    r = test_twin.loop(duration=3600.0)
    table = {"time": pd.to_datetime(r.time, unit="s", utc=True), "TIC207.SP": r.setpoint, "TIC207.PV": r.measurement,
             "TIC207.OP": r.output}
    pd.DataFrame(table).to_csv(tmp_path / "plant.csv", index=False)
    (tmp_path / "plant.loops.toml").write_text("[defaults]\nK = 0.6\nTi = 60\npv_range = [0, 1]\nop_range = [0, 1]\n")
    few = ("plan", tmp_path / "plant.csv", "--target", "2%", "--repeats", 2, "--jobs", 1)
    document = json.loads(run(capfd, *few, "--format", "json").out)
    (loop,) = document["loops"]
    assert (loop["loop"], loop["target"], document["schema_version"]) == ("TIC207", 0.02, 1)
    assert len(list(kept.rglob("*.json"))) == 1
    for option in loop["options"]:
        assert {"kind", "duration_s", "op_move", "pv_move", "power", "clears", "false_alarm", "text"} <= set(option)
    # from here on the plan is read, not made
    rows = list(csv.DictReader(io.StringIO(run(capfd, *few, "--format", "csv").out)))
    for row, option in zip(rows, loop["options"], strict=True):
        assert (row["kind"], row["text"]) == (option["kind"], option["text"])
        assert (row["decides"], row["within_limits"]) == tuple(str(option[key]).lower() for key in
                                                               ("decides", "within_limits"))
    text = run(capfd, *few).out
    assert f"TIC207: {loop['verdict'].replace('_', ' ')}" in text and "advice to a person" in text
    for option in loop["options"]:
        assert " ".join(option["text"].split()) in " ".join(text.split())
    done = run(capfd, *few, "-o", tmp_path / "sheets.html")
    page = (tmp_path / "sheets.html").read_text("utf-8")
    assert "<h1>Test plans: " in page and "<code>backlash plan " in page and "sheets.html</code>" in page
    assert done.status == 0 and 'id="sheet-0"' in page and "Nothing is written to the control system" in page
    assert "<th scope=\"col\">Round</th>" in page  # a line for each round, with room for what is read
    assert ">0:00:00</td>" in page and re.search(r">\d+:[0-5]\d:[0-5]\d</td>\s*<td", page.split(">0:00:00</td>")[1])
    assert len(list(kept.rglob("*.json"))) == 1


def test_a_loop_that_is_decided_needs_no_plan(capfd):
    done = run(capfd, "plan", PLANT, "--loop", "FIC101", "--jobs", 1)
    assert done.status == 0 and "0 of 1 loop undecided" in done.out


@pytest.mark.parametrize(("arguments", "message"), [
    (("--loop", "FIC999"), "no loop 'FIC999'"),
    (("--target", "0"), "--target"),
    (("--target", "much"), "'much' is not a size"),
    (("--max-pv-move", "0%"), "allows nothing"),
    (("--max-op-move", "wide"), "'wide' is not a move"),
    (("--max-op-move", "nan"), "allows nothing"),
])
def test_wrong_use_is_one_clear_message(capfd, arguments, message):
    done = run(capfd, "plan", PLANT, *arguments)
    assert done.status == 2 and message in done.err and done.out == ""


def test_without_a_home_nothing_is_kept(capfd, tmp_path, monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr("os.path.expanduser", lambda path: path)  # as for a user that the system does not know
    rows = "".join(f"2026-03-01 00:{k // 60:02}:{k % 60:02},50,{50 + k % 7},40\n" for k in range(600))
    (tmp_path / "p.csv").write_text("time,F1.SP,F1.PV,F1.OP\n" + rows)
    monkeypatch.chdir(tmp_path)
    done = run(capfd, "plan", "p.csv", "--jobs", 1)
    assert done.status == 0 and "1 of 1 loop undecided" in done.out and not (tmp_path / "~").exists()
