"""backlash compare: from an export to the error and where it is; every mistake is one message that says what to do."""

import json
import re
import shlex
from pathlib import Path

import click
import pytest

from backlash_cli.__main__ import cli
from backlash_cli.api import save_model
from backlash_cli.results import Model, ModelEffect
from tests.commands.run import run
from tests.commands.workbench import HEAD, write_loop, write_two

PLAY = ModelEffect("backlash", {"d": 0.04})
MODEL = Model("FIC101", Kp=1.3, tau=20.0, offset=-0.02, effects=(PLAY,), rmse_holdout=0.002)


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    return write_loop(tmp_path_factory.mktemp("loop"))


def test_the_only_loop_is_taken_and_all_outputs_are_written(loop, tmp_path, capfd):
    done = run(capfd, "compare", loop, "--json", tmp_path / "c.json", "--html", tmp_path / "c.html",
               "--picture", tmp_path / "c.png", "--verbose")
    assert done.status == 0, done.err
    for words in ("FIC101: model against measurement", "plain model", "noise floor", "Where the model fails"):
        assert words in done.out
    found = json.loads((tmp_path / "c.json").read_text())
    assert found["loop"] == "FIC101" and found["steps"][0]["added"] is None and found["where"]
    assert found["noise_floor"] < found["baseline"]["rmse"]
    assert "<h1>FIC101" in (tmp_path / "c.html").read_text("utf-8") and (tmp_path / "c.png").stat().st_size > 5000


def test_a_right_model_beats_the_plain_one_and_a_wrong_one_does_not_hold(loop, tmp_path, capfd):
    save_model(MODEL, tmp_path / "m.toml")
    done = run(capfd, "compare", loop, "--model", tmp_path / "m.toml", "--json", "-")
    found = json.loads(done.out)
    assert found["steps"][-1]["added"] == "backlash"
    assert found["fitness"]["rmse"] < 0.6 * found["baseline"]["rmse"]
    (tmp_path / "w.toml").write_text((tmp_path / "m.toml").read_text().replace("Kp = 1.3", "Kp = -1.3"))
    assert "does not hold here" in run(capfd, "compare", loop, "--model", tmp_path / "w.toml").out


def test_a_model_whose_file_was_changed_since_the_fit_says_so(loop, tmp_path, capfd):
    assert run(capfd, "explain", loop, "--save-model", tmp_path / "m.toml").status == 0
    text = (tmp_path / "m.toml").read_text()
    assert "the error that the file keeps from that fit" in " ".join(
        run(capfd, "compare", loop, "--model", tmp_path / "m.toml").out.split())
    promised = re.search(r"rmse_holdout = ([\d.e-]+)", text)[1]
    (tmp_path / "m.toml").write_text(re.sub(r"\nKp = \S+", "\nKp = -1.0", text))
    said = " ".join(run(capfd, "compare", loop, "--model", tmp_path / "m.toml").out.split())
    assert f"the file promises {100 * float(promised):.3g} %" in said and "its numbers were changed" in said
    assert "that the file keeps" not in said


def test_a_time_of_a_model_that_no_process_has_is_refused(loop, tmp_path, capfd):
    for line in ("tau = 20.0\ntheta = 1e9", "tau = 1e7"):
        (tmp_path / "m.toml").write_text(f'loop = "FIC101"\n[baseline]\nKp = 1.3\n{line}\n')
        done = run(capfd, "compare", loop, "--model", tmp_path / "m.toml")
        assert done.status == 2
        assert re.search(r"line \d: (theta = 1000000000.0|tau = 10000000.0) is not possible", done.err)


def test_a_model_of_another_loop_or_range_is_refused_unless_asked(loop, tmp_path, capfd):
    text = 'loop = "TIC7"\n[baseline]\nKp = 1.3\ntau = 20.0\n'
    (tmp_path / "m.toml").write_text(text)
    done = run(capfd, "compare", loop, "--loop", "FIC101", "--model", tmp_path / "m.toml")
    assert done.status == 2 and "this model is of loop TIC7, not of FIC101" in done.err and "--other-loop" in done.err
    done = run(capfd, "compare", loop, "--model", tmp_path / "m.toml")
    assert done.status == 2 and "of loop TIC7, which is not in this export -> known: FIC101" in done.err, done.err
    assert run(capfd, "compare", loop, "--model", tmp_path / "m.toml", "--other-loop").status == 0
    (tmp_path / "r.toml").write_text(text.replace("TIC7", "FIC101").replace("[base", "op_range = [4, 20]\n[base"))
    done = run(capfd, "compare", loop, "--model", tmp_path / "r.toml")
    assert done.status == 2 and "op_range = [4, 20]" in done.err and "[0, 100]" in done.err


@pytest.mark.parametrize(("text", "said"), [
    ("loop = 'FIC101'\n[baseline]\nKp = 1\ntua = 2\n", "m.toml, line 4: unknown key 'tua' -> did you mean tau"),
    ("loop = 'FIC101'\n[baseline]\nKp = 1\ntau = 2\n[[effects]]\neffect = 'backlsh'\n",
     "m.toml, line 6: no effect 'backlsh' -> did you mean backlash"),
    ("loop = 'FIC101'\n[baseline]\nKp = 1\ntau = 2\n[[effects]]\neffect = 'measured_disturbance'\ncolumn = 'DV9'\n",
     "the measured column DV9, which this record does not have"),
    ("\xff", "not UTF-8 text"),
])
def test_a_wrong_model_file_names_line_and_remedy(loop, tmp_path, capfd, text, said):
    (tmp_path / "m.toml").write_bytes(text.encode("latin-1"))
    done = run(capfd, "compare", loop, "--loop", "FIC101", "--model", tmp_path / "m.toml")
    assert done.status == 2 and said in done.err, done.err


def test_missing_model_file_and_wrong_picture(loop, tmp_path, capfd):
    done = run(capfd, "compare", loop, "--model", tmp_path / "x.toml")
    assert "the model file cannot be read: No such file" in done.err
    done = run(capfd, "compare", loop, "--picture", tmp_path / "x.gif")
    assert done.status == 2 and "a picture is .png or .svg" in done.err


def test_several_loops_are_listed_and_an_unknown_one_names_the_nearest(tmp_path, capfd):
    path = write_two(tmp_path)
    done = run(capfd, "compare", path)
    assert done.status == 2 and "several loops here: FIC101, FIC102" in done.err and "--loop FIC101" in done.err
    done = run(capfd, "compare", path, "--loop", "FIC*")
    assert done.status == 2 and "'FIC*' means several loops" in done.err
    done = run(capfd, "compare", path, "--loop", "FIC103")
    assert done.status == 2 and "no loop 'FIC103'" in done.err and "did you mean" in done.err
    assert run(capfd, "compare", path, "--loop", "FIC102", "--json", "-").status == 0


@pytest.mark.parametrize(("change", "said"), [
    (lambda r: r[:3], "no controller output (OP)"),
    (lambda r: [r[0], r[1], r[2], "40"], "OP is constant"),
    (lambda r: [r[0], r[1], "450", r[3]], "PV is constant"),
])
def test_a_record_that_says_nothing_is_refused_with_the_reason(loop, tmp_path, capfd, change, said):
    head, *rows = [line.split(",") for line in loop.read_text().splitlines()]
    short = [head[: len(change(rows[0]))], *map(change, rows)]
    path = tmp_path / "FIC101.csv"
    path.write_text("\n".join(",".join(row) for row in short) + "\n")
    (tmp_path / "loops.toml").write_text(HEAD)
    for command in ("compare", "explain"):
        done = run(capfd, command, path)
        assert done.status == 2 and said in done.err and " -> " in done.err, done.err


def test_twenty_samples_are_too_few(loop, tmp_path, capfd):
    (tmp_path / "FIC101.csv").write_text("\n".join(loop.read_text().splitlines()[:21]) + "\n")
    (tmp_path / "loops.toml").write_text(HEAD)
    for command in ("compare", "explain"):
        done = run(capfd, command, tmp_path / "FIC101.csv")
        assert done.status == 2 and "20 usable samples" in done.err and "longer" in done.err


def test_the_examples_of_the_help_work_one_after_the_other(tmp_path, monkeypatch, capfd):
    command = cli.get_command(click.Context(cli), "compare")
    text = command.get_help(click.Context(command, max_content_width=120))
    (tmp_path / "sample_data").symlink_to(Path(__file__).parents[2] / "sample_data")
    monkeypatch.chdir(tmp_path)
    examples = re.findall(r"^ *backlash (.*)$", text, re.MULTILINE)
    assert len(examples) == 4
    for example in examples:
        done = run(capfd, *shlex.split(example))
        assert done.status == 0, (example, done.err)
    assert "This is the record that the model was fitted to" in done.out
