from __future__ import annotations

import json
from pathlib import Path

import pytest

from .run import run

SAMPLE = Path(__file__).parents[2] / "sample_data"
PLANT = SAMPLE / "plant.csv"


def checked(capfd: pytest.CaptureFixture[str], *arguments: object) -> dict:
    done = run(capfd, "check", *arguments, "--format", "json")
    assert done.status == 0, done.err
    return {loop["loop"]: loop for loop in json.loads(done.out)["loops"]}


def test_the_sample_plant_is_fit_and_its_settings_agree(capfd: pytest.CaptureFixture[str]) -> None:
    loops = checked(capfd, PLANT)
    assert len(loops) == 12
    for name, loop in loops.items():
        assert loop["effect"] == "none", (name, loop["meaning"])
        assert not [f for f in loop["findings"] if f["code"].startswith("settings_")], name
        given, found = loop["settings"], loop["identified"]
        assert found["ratio"]["value"] == pytest.approx(given["K"] / given["Ti"], rel=0.05), name
    assert loops["LIC404"]["oscillation"]["looks_like"] == "backlash_integrating"
    assert loops["PIC307"]["oscillation"]["looks_like"] == "external"
    assert loops["FIC101"]["oscillation"] is None


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("K = 0.6\nTi = 0.4667", "settings_ti_minutes"),
        ("K = 0.6\nTi = 1680.0", "settings_ti_minutes"),
        ("K = 166.7\nTi = 28.0", "settings_proportional_band"),
        ("K = 0.0667\nTi = 28.0", "settings_engineering_gain"),
        ("K = -0.6\nTi = 28.0", "settings_action_sign"),
        ("K = 1.2\nTi = 28.0", "settings_contradicted"),
    ],
)
def test_wrong_settings_are_flagged(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, line: str, code: str
) -> None:
    loops_file = tmp_path / "loops.toml"
    loops_file.write_text(f"[loops.FIC101]\n{line}\npv_range = [0, 900]\nop_range = [0, 100]\n")
    loop = checked(capfd, PLANT, "--loops", loops_file, "--loop", "FIC101")["FIC101"]
    assert code in [finding["code"] for finding in loop["findings"]]
    if code != "settings_action_sign":
        assert loop["effect"] == "limits" and "dead band would have a wrong size" in loop["meaning"]


def test_the_table_says_what_it_means(capfd: pytest.CaptureFixture[str]) -> None:
    done = run(capfd, "check", PLANT)
    assert done.status == 0
    assert "12 loops: 12 good" in done.out and "fit for a verdict" in done.out
    more = run(capfd, "check", PLANT, "--loop", "FIC101", "--verbose").out
    assert "settings from the data (ideal PI): K 0.5" in more and "times an hour" in more


def test_the_report_can_go_to_a_file(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "check.json"
    done = run(capfd, "check", PLANT, "--loop", "FIC102", "--output", path)
    assert (done.status, done.out) == (0, "")
    assert json.loads(path.read_text())["loops"][0]["loop"] == "FIC102"
    text = tmp_path / "check.txt"
    run(capfd, "check", PLANT, "--loop", "FIC102", "--output", text)
    assert text.read_text().startswith("Loop")
    for command in ("check", "plan"):  # whose text would lie in a page
        done = run(capfd, command, PLANT, "--loop", "FIC102", "--output", tmp_path / "check.pdf")
        assert done.status == 2 and ".txt, .json" in done.err and not (tmp_path / "check.pdf").exists()


def test_a_loop_that_cannot_be_checked_is_named_and_the_rest_goes_on(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    sample = "0.5,0.{},0.4"
    rows = "\n".join(
        f"2026-03-02 06:{k // 60:02d}:{k % 60:02d},{sample.format(500 + k % 7)},{sample.format(500 + k % 5)}"
        for k in range(600)
    )
    path = tmp_path / "plant.csv"
    path.write_text(f"time,A1.SP,A1.PV,A1.OP,B1.SP,B1.PV,B1.OP\n{rows}\n")
    (tmp_path / "loops.toml").write_text("[loops.A1]\nK = 1.0\nTi = 20.0\n[loops.B1]\nK = 1.0\nTi = 0.0\n")
    done = run(capfd, "check", path, "--format", "json")
    assert done.status == 3 and "B1" in done.err
    loops = {loop["loop"]: loop for loop in json.loads(done.out)["loops"]}
    assert loops["B1"]["effect"] == "failed"
    assert loops["A1"]["effect"] == "blocks" and "never moves" in loops["A1"]["meaning"] + str(loops["A1"]["findings"])


def test_nothing_to_read_is_exit_status_two(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    done = run(capfd, "check", tmp_path / "missing.csv")
    assert done.status == 2 and "missing.csv" in done.err


def test_a_record_too_short_for_a_verdict_is_not_called_good(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    short = tmp_path / "short.csv"
    short.write_text("".join(PLANT.read_text().splitlines(keepends=True)[:101]))
    short.with_suffix(".loops.toml").write_bytes(PLANT.with_suffix(".loops.toml").read_bytes())
    loops = checked(capfd, short)
    scanned = json.loads(run(capfd, "scan", short, "--format", "json").out)["loops"]
    assert {loop["verdict"] for loop in scanned} <= {"insufficient_data", "cannot_tell"}
    for name, loop in loops.items():
        assert loop["effect"] == "blocks" and "ten times Ti" in loop["meaning"], (name, loop["meaning"])
