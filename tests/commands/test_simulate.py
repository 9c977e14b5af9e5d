"""`backlash simulate` and `backlash effects` as a user meets them."""

import tomllib

import pandas as pd
import pytest
from click.testing import CliRunner

from backlash_cli.__main__ import cli
from backlash_cli.effects import EFFECTS
from backlash_cli.errors import BacklashError
from backlash_cli.loaders import read
from backlash_cli.simulator.scenario_file import scenario_text


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*arguments, command="simulate"):
        result = CliRunner().invoke(cli.commands[command], list(arguments), standalone_mode=False)
        if result.exception is not None:
            raise result.exception
        return result

    return run


def test_writes_export_settings_and_truth(run, tmp_path):
    run("example-2", "--dead-band", "0.03", "--out", "e2.csv")
    table = pd.read_csv("e2.csv")
    assert list(table.columns) == ["timestamp", "EXAMPLE2.SP", "EXAMPLE2.PV", "EXAMPLE2.OP"]
    assert len(table) == 20000 and table["timestamp"][1] == "2026-03-02T06:00:00.010Z"
    settings = tomllib.loads((tmp_path / "e2.loops.toml").read_text())["loops"]["EXAMPLE2"]
    assert (settings["K"], settings["Ti"], settings["Td"], settings["Kp"]) == (1.2, 2.2, 1.2, 1.0)
    assert "EXAMPLE2,backlash,d,0.03,span" in (tmp_path / "e2.truth.csv").read_text()


def test_two_results_have_two_names(run):
    with pytest.raises(BacklashError, match="this file is named for two things"):
        run("example-2", "--out", "a.csv", "--truth", "a.csv")


def test_the_truth_never_takes_the_place_of_settings_or_scenario(run, tmp_path):
    (tmp_path / "s.toml").write_text(scenario_text("example-1"))
    for arguments in (["a.loops.toml"], ["s.toml", "--force"], ["./s.toml", "--force"]):
        with pytest.raises(BacklashError, match="this file is named for two things"):
            run("s.toml", "--out", "a.csv", "--truth", *arguments)
    assert (tmp_path / "s.toml").read_text() == scenario_text("example-1") and not (tmp_path / "a.csv").exists()


def test_layouts_and_formats_agree(run):
    run("industrial-fixed", "--out", "a.csv")
    run("industrial-fixed", "--out", "a.parquet", "--force")
    run("industrial-fixed", "--out", "b.csv.gz", "--layout", "long", "--truth", "planted.csv")
    run("industrial-fixed", "--out", "c.parquet", "--layout", "long")
    wide, parquet, long = pd.read_csv("a.csv"), pd.read_parquet("a.parquet"), pd.read_csv("b.csv.gz")
    pd.testing.assert_frame_equal(wide.iloc[:, 1:], parquet.iloc[:, 1:], check_dtype=False)
    assert list(long.loc[long["tag"] == "FIC.PV", "value"]) == list(wide["FIC.PV"])
    assert list(pd.read_parquet("c.parquet")["value"]) == list(long["value"])
    assert wide["FIC.PV"].between(300, 450).all() and parquet["timestamp"].dt.tz is not None
    assert pd.read_csv("planted.csv")["loop"].unique() == ["FIC"]


def test_never_overwrites_without_force(run, tmp_path):
    (tmp_path / "x.loops.toml").write_text("mine")
    with pytest.raises(BacklashError, match=r"x\.loops\.toml exists.*--force"):
        run("example-1", "--out", "x.csv")
    assert (tmp_path / "x.loops.toml").read_text() == "mine" and not (tmp_path / "x.csv").exists()
    run("example-1", "--out", "x.csv", "--force")
    assert (tmp_path / "x.loops.toml").read_text() != "mine"


def test_show_gives_a_file_that_makes_the_same_record(run, tmp_path):
    (tmp_path / "mine.toml").write_text(run("example-2", "--show").output)
    run("example-2", "--out", "a.csv")
    run("mine.toml", "--out", "b.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["exmple-2", "--out", "x.csv"], "did you mean example-2"),
        (["example-2"], "--out FILE"),
        (["example-2", "--out", "x.xlsx"], "cannot write 'x.xlsx'"),
        (["missing.toml", "--out", "x.csv"], "cannot be read: No such file or directory -> check the path"),
        (["unstable.toml", "--out", "x.csv"], "unstable"),
        (["typo.toml", "--out", "x.csv"], "unknown key 'duratoin' -> did you mean duration"),
        (["two.toml", "--out", "x.csv"], "different times.*--layout long"),
    ],
)
def test_wrong_use_is_one_message_and_writes_nothing(run, tmp_path, arguments, says):
    loop = "[loops.{}]\ncontroller = {{K = {}, Ti = 2.0}}\nprocess = {{lags = [1, 1, 1]}}\nduration = {}\nstep = 0.1\n"
    bump = 'effects = [{ effect = "load_step", times = [1], sizes = [0.1] }]\n'
    (tmp_path / "unstable.toml").write_text(loop.format("A", 50, 200) + bump)
    (tmp_path / "typo.toml").write_text(loop.format("A", 0.5, 20).replace("duration", "duratoin"))
    (tmp_path / "two.toml").write_text(loop.format("A", 0.5, 20) + loop.format("B", 0.5, 30))
    with pytest.raises(BacklashError, match=says):
        run(*arguments)
    assert not list(tmp_path.glob("x*"))


def test_effects_are_listed_each_in_a_sentence(run):
    text = run(command="effects").output
    assert max(map(len, text.splitlines())) <= 100
    assert all(f"{e.name} ({e.stage})" in text and e.sentence in " ".join(text.split()) for e in EFFECTS)
    verbose = run("--verbose", command="effects").output
    assert all(e.source in verbose for e in EFFECTS)


@pytest.mark.parametrize("layout", ["wide", "long"])
def test_a_loop_may_have_a_comma_in_its_name(run, tmp_path, layout):
    (tmp_path / "mine.toml").write_text(run("example-2", "--show").output.replace("EXAMPLE2", '"A,B\\u007f"'))
    run("mine.toml", "--out", "x.csv", "--layout", layout)
    assert [record.loop for record in read("x.csv")] == ["A,B\x7f"]
    assert set(pd.read_csv("x.truth.csv")["loop"]) == {"A,B\x7f"}
    assert read("x.csv")["A,B\x7f"].settings.Ti == 2.2
