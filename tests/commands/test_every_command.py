"""Walks the commands: a new one without help, summary or example fails at once."""

import inspect
import re
import shlex
import shutil
from pathlib import Path

import click
import pytest

from backlash_cli.__main__ import cli
from backlash_cli.commands.options import PAGE, function_of

from .run import run

NAMES, SAMPLES = list(cli.commands), Path(__file__).parents[2] / "sample_data"


def help_of(name: str) -> str:
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    return command.get_help(click.Context(command, info_name=f"backlash {name}", max_content_width=100))


@pytest.mark.parametrize("name", NAMES)
def test_command_has_help_and_an_example_that_its_options_allow(name):
    text = help_of(name)
    command = cli.get_command(click.Context(cli), name)
    assert command is not None and command.help and len(command.help.split(".")[0]) > 10
    examples = re.findall(rf"^ *(?:Examples?: )?backlash ({name}\b.*)$", text, re.MULTILINE)
    assert examples, f"backlash {name} --help ends without an example"
    for parameter in command.params:
        if isinstance(parameter, click.Option):
            assert parameter.help, f"backlash {name} {parameter.opts[0]} has no help"
    known = {flag for p in command.params for flag in (*p.opts, *p.secondary_opts)}
    for sub in getattr(command, "commands", {}).values():
        known |= {flag for p in sub.params for flag in (*p.opts, *p.secondary_opts)}
    for example in examples:
        used = {word.split("=")[0] for word in shlex.split(example) if word.startswith("-")}
        assert used <= known, f"{example}: {sorted(used - known)} do not exist"


@pytest.mark.parametrize("name", NAMES)
def test_command_is_named_in_the_summary_with_a_whole_sentence(name):
    command = cli.commands[name]
    assert command.name == name and command.short_help and command.short_help.endswith(".")
    summary = cli.get_help(click.Context(cli, max_content_width=100))
    assert re.search(rf"^  {name} +{re.escape(command.short_help)}$", summary, re.MULTILINE)


def test_unknown_command_names_the_nearest():
    with pytest.raises(click.UsageError, match="did you mean scan"):
        cli.main(["scna"], standalone_mode=False)


@pytest.mark.parametrize("name", NAMES)
def test_the_page_gives_what_the_function_takes(name):
    command = cli.commands[name]
    assert command.callback is not None
    inspect.signature(function_of(name)).bind(**{p.name: None for p in command.params})


def test_nothing_on_the_page_is_left_over():
    tables = {name: PAGE[name] for name in NAMES}
    assert set(PAGE) == {"groups", "options", *NAMES}
    known = {"module", "summary", "help", "epilog", "examples", "also", "options"}
    assert not {key for words in tables.values() for key in words} - known
    asked = {entry for words in tables.values() for entry in words.get("also", ())}
    used = asked | {name for words in tables.values() for name in words.get("options", {})}
    used |= {name for group in asked & set(PAGE["groups"]) for name in PAGE["groups"][group]}
    assert not set(PAGE["options"]) - used and not set(PAGE["groups"]) - asked


@pytest.mark.parametrize("arguments", [
    "scan P --output P", "scan ./P --output P", "scan P --history P", "scan P --plot P", "check P --output P",
    "plan P --output P", "compare P --json P", "scan P --loops L --output L",
    "scan . --output P.csv", "scan . --output sub/P.csv", "scan . --output loops.toml", "compare P --model M --json M"])
def test_what_a_command_reads_is_never_written_over(arguments, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    for name in ("P", "L", "M", "P.csv", "sub/P.csv", "loops.toml"):
        (tmp_path / name).write_text("is not even read")
    done = run(capfd, *arguments.split())
    read = "the model" if "--model" in arguments else "the file of loop settings" if "L" in arguments or (
        "loops.toml" in arguments) else "the export itself"
    assert done.status == 2 and f"this is {read}, that is read" in done.err and "name another file" in done.err
    assert {path.read_text() for path in tmp_path.rglob("*") if path.is_file()} == {"is not even read"}


@pytest.mark.parametrize("arguments", ["scan P --output no/x.csv", "scan P --plot no/x.html",
                                       "plan P --output no/x.csv"])
def test_a_folder_that_does_not_exist_is_told_before_the_work(arguments, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "P").write_text("is not even read")
    done = run(capfd, *arguments.split())
    assert done.status == 2 and "the folder does not exist -> make the folder first" in done.err


def test_the_report_of_the_night_before_is_written_over_though_it_lies_among_the_exports(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(SAMPLES, tmp_path, dirs_exist_ok=True)
    for _ in range(2):
        assert run(capfd, "scan", ".", "--no-confirm", "--output", "report.csv").status == 0
    assert (tmp_path / "report.csv").read_text().startswith('"loop","verdict",')


@pytest.mark.parametrize(("arguments", "words"), [
    (["scan", "P", "--jobs", "-2"], "-2 is not in the range"), (["scan", ""], "an input has an empty name"),
    (["scan", "P", "--sample=-3"], "'-3' is no size of a sample"),
    (["paper", "--html", "P.csv"], "a page ends in .html"),
    (["plan", "P", "--target", "-1"], "a size of -1 allows nothing")])
def test_odd_values_are_told_as_what_they_are(arguments, words, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "P").write_text("time,FIC101.PV\n2026-03-02 06:00:00,1\n2026-03-02 06:00:01,2\n")
    done = run(capfd, *arguments)
    assert done.status == 2 and words in " ".join(done.err.split())
