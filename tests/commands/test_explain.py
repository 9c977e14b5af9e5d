"""backlash explain: the hidden effect is found, kept and used again; own choices and own effects; a whole plant."""

import csv
import json

import pytest

from backlash_cli.api import load_model
from tests.commands.run import run
from tests.commands.workbench import write_loop, write_two

OWN = '''"""A valve that opens with the root of its travel."""
import numpy as np
from backlash_cli.effects import Effect, Parameter, Stage

def start(p, interval, first):
    return np.empty(0)

def step(state, value, p):
    return value + p[0] * value * (1.0 - value)

EFFECT = Effect("bulge", Stage.VALVE, "Bulging characteristic.", "own", (
    Parameter("bulge", "1", "bulge", 0.0, -0.9, 0.9, (0.2, -0.2)),), start, step)
'''


WRONG = '''"""Effects with a mistake each."""
import numpy as np
from backlash_cli.effects import Effect, Parameter, Stage

def start(p, interval, first):
    return np.empty(0)

def raises(state, value, p):
    raise RuntimeError("no such valve")

def divides(state, value, p):
    return value / (p[0] - 0.2) if p[0] else value

def endless(state, value, p):
    return value + np.inf

def shifts(state, value, p):
    return value + 0.1

def falls(state, value, p):
    state[0], before = value, state[0]
    return max(value, before - 0.001)

def effect(step, stage=Stage.VALVE, first=(0.2,), start=start):
    return Effect(step.__name__, stage, "Wrong.", "own", (
        Parameter("size", "span", "size", 0.0, -1.0, 1.0, first),), start, step)

RAISES, DIVIDES, ENDLESS, SHIFTS = effect(raises), effect(divides), effect(endless), effect(shifts)
FALLS = effect(falls, start=lambda p, interval, first: np.array([first]))
NOWHERE, NO_TUPLE = effect(shifts, "valves"), effect(shifts, first=0.2)
'''


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    return write_loop(tmp_path_factory.mktemp("loop"))


def test_the_hidden_effect_is_found_kept_and_used_again(loop, tmp_path, capfd):
    files = {k: tmp_path / f"e.{k}" for k in ("json", "html", "svg", "toml")}
    done = run(capfd, "explain", loop, "--json", files["json"], "--html", files["html"], "--picture", files["svg"],
               "--save-model", files["toml"])
    assert done.status == 0, done.err
    assert "Missing in the plain model: backlash" in done.out and "+ backlash" in done.out
    found = json.loads(files["json"].read_text())
    assert found["missing_effect"] == "backlash" and found["effects"][0]["effect"] == "backlash"
    assert found["effects"][0]["parameters"]["d"]["value"] == pytest.approx(0.04, rel=0.05)
    assert found["steps"][-1]["rmse_holdout"] < 0.5 * found["steps"][0]["rmse_holdout"]
    assert found["where"] and found["candidates"] and all(p.stat().st_size for p in files.values())
    kept = load_model(files["toml"])
    assert kept.loop == "FIC101" and kept.pv_range == (0.0, 900.0) and kept.rmse_holdout == pytest.approx(
        found["steps"][-1]["rmse_holdout"], rel=1e-6)
    compared = json.loads(run(capfd, "compare", loop, "--model", files["toml"], "--json", "-").out)
    assert compared["fitness"]["rmse"] < 0.5 * compared["baseline"]["rmse"]
    # going on from the model finds nothing more, and the file may be replaced by the new one
    done = run(capfd, "explain", loop, "--model", files["toml"], "--save-model", files["toml"], "--json", "-")
    again = json.loads(done.out)
    assert [e["effect"] for e in again["effects"]] == ["backlash"] and again["steps"][1]["chosen"] == "user"


def test_own_choice_replaces_the_search(loop, capfd):
    found = json.loads(run(capfd, "explain", loop, "--add", "rate_limit", "--add", "backlash", "--json", "-").out)
    assert [(s["added"], s["chosen"]) for s in found["steps"][1:]] == [("rate_limit", "user"), ("backlash", "user")]
    assert found["candidates"] == []
    assert "added by choice, without a search" in " ".join(run(capfd, "explain", loop, "--add", "backlash").out.split())


def test_an_effect_from_outside_takes_part_and_stays_in_the_model(loop, tmp_path, capfd, monkeypatch):
    (tmp_path / "own_bulge.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    found = json.loads(run(capfd, "explain", loop, "--effect", "own_bulge:EFFECT", "--json", "-").out)
    assert "bulge" in [c["effect"] for c in found["candidates"]] and found["missing_effect"] == "backlash"
    done = run(capfd, "explain", loop, "--add", "own_bulge:EFFECT", "--save-model", "m.toml")
    assert done.status == 0 and "bulge" in done.out
    assert load_model("m.toml").effects[0].source == "own_bulge:EFFECT"
    assert run(capfd, "compare", loop, "--model", "m.toml").status == 0


@pytest.mark.parametrize(("arguments", "said"), [
    (["--add", "backlsh"], "no effect 'backlsh' -> did you mean backlash"),
    (["--effect", "no_such_module:X"], "cannot load effect 'no_such_module:X'"),
    (["--add", "random_load"], "random_load"),
    (["--add", "measured_disturbance"], "measured_disturbance needs a measured column"),
    (["--output", "x.csv"], "--output goes with --all"),
    (["--all", "--json", "x.json"], "--json and --all do not fit together"),
    (["--picture", "x.pdf"], "a picture is .png or .svg"),
    (["--loop", "FIC9"], "no loop 'FIC9'"),
    (["--effect", "wrong_effects"], "one of your own is given as MODULE:NAME"),
    (["--effect", "wrong_effects:NOTHING"], "'NOTHING' in wrong_effects is not an Effect -> known: RAISES"),
    (["--effect", "wrong_effects:RAISES"], "wrong_effects.py: RuntimeError: no such valve"),
    (["--add", "wrong_effects:RAISES"], "fails on a trial signal in line 9 of"),
    (["--add", "wrong_effects:DIVIDES"], "effect 'wrong_effects:DIVIDES' gives no numbers on a trial signal"),
    (["--effect", "wrong_effects:ENDLESS"], "gives no numbers on a trial signal"),
    (["--effect", "wrong_effects:SHIFTS"], "changes the signal at its neutral values"),
    (["--effect", "wrong_effects:FALLS"], "changes the signal at its neutral values"),
    (["--effect", "wrong_effects:NOWHERE"], "'valves' is not a valid Stage"),
    (["--effect", "wrong_effects:NO_TUPLE"], "a tuple of one ends with a comma"),
])
def test_wrong_use_is_one_message(loop, tmp_path, tmp_path_factory, capfd, monkeypatch, arguments, said):
    beside = tmp_path_factory.mktemp("own")
    (beside / "wrong_effects.py").write_text(WRONG)
    monkeypatch.syspath_prepend(beside)
    monkeypatch.chdir(tmp_path)
    done = run(capfd, "explain", loop, *arguments)
    assert done.status == 2 and said in done.err and " -> " in done.err, done.err
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_no_model_is_not_replaced(loop, tmp_path, capfd):
    (tmp_path / "plant.csv").write_text("time,PV\n")
    done = run(capfd, "explain", loop, "--add", "backlash", "--save-model", tmp_path / "plant.csv")
    assert done.status == 2 and "will not replace a file that is no model" in done.err
    assert (tmp_path / "plant.csv").read_text() == "time,PV\n"


def test_a_whole_plant_into_a_folder_one_failure_stops_nothing_and_old_pages_only_are_taken_away(tmp_path, capfd):
    path = write_two(tmp_path, second_moves=False)
    foreign, old = tmp_path / "out" / "loops-202603020600", tmp_path / "out" / "loops-0123456789ab"
    for folder, name in ((foreign, "plant.csv"), (old, "plotly.js")):
        folder.mkdir(parents=True)
        (folder / name).write_text("")
    done = run(capfd, "explain", path, "--all", "--jobs", "1", "--output", tmp_path / "out")
    assert done.status == 3, done.err
    assert "1 loop explained; missing: backlash in 1" in done.err and "FIC102: OP is constant" in done.err
    rows = list(csv.DictReader((tmp_path / "out" / "summary.csv").open()))
    assert [(r["loop"], r["missing_effect"]) for r in rows] == [("FIC101", "backlash"), ("FIC102", "")]
    found = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert found["missing"] == {"backlash": 1} and found["failures"][0]["code"] == "constant_signal"
    index = (tmp_path / "out" / "index.html").read_text("utf-8")
    assert (foreign / "plant.csv").exists() and not old.exists()
    (pages,) = {*(tmp_path / "out").glob("loops-*")} - {foreign}
    assert f"{pages.name}/FIC101.html" in index and json.loads((pages / "FIC101.json").read_text())["loop"] == "FIC101"


def test_a_whole_plant_in_processes_to_a_table(tmp_path, capfd):
    path = write_two(tmp_path)
    done = run(capfd, "explain", path, "--all", "--jobs", "2")
    assert done.status == 0, done.err
    assert "2 loops explained" in done.out and "backlash d =" in done.out


@pytest.mark.parametrize("option", ["--json", "--html", "--save-model"])
def test_the_export_itself_is_never_written_over(loop, capfd, option):
    before = loop.read_bytes()
    for arguments in (["explain", loop, option, loop], ["explain", loop, "--all", "--output", loop]):
        done = run(capfd, *arguments)
        assert done.status == 2 and "this is the export itself" in done.err
    assert loop.read_bytes() == before
