"""The examples in the documents are read by the code they describe."""

import re
import shlex
from pathlib import Path

import click
import pytest

from backlash_cli.__main__ import cli
from backlash_cli.history.limits import parse_limits
from backlash_cli.history.nightly import read_config

DOCS = Path(__file__).parents[2] / "docs"


def blocks(name, language):
    return re.findall(rf"^```{language}\n(.*?)^```", (DOCS / name).read_text(), re.MULTILINE | re.DOTALL)


def test_the_nightly_example_is_a_valid_configuration(tmp_path):
    (text,) = blocks("nightly.md", "toml")
    (tmp_path / "nightly.toml").write_text(text)
    found = read_config(tmp_path / "nightly.toml")
    assert found.outputs.keep == 30
    assert found.fail_on == ("d>5%", "pull") and found.reading["timezone"] == "Europe/Berlin"


def test_the_limits_example_is_a_valid_profile():
    (text,) = blocks("reading-the-report.md", "toml")
    limits = parse_limits(text, "docs")
    assert limits.of("FIC101").value == 0.01 and limits.of("TIC310").value == 0.015


@pytest.mark.parametrize("name", ["nightly.md", "reading-the-report.md"])
def test_commands_exist_with_their_options(name):
    text = "\n".join([*blocks(name, "sh"), *re.findall(r"`(backlash [^`]+)`", (DOCS / name).read_text())])
    for line in re.findall(r"^backlash (.+)$", text, re.MULTILINE):
        words = shlex.split(line)
        command = cli.get_command(click.Context(cli), words[0])
        assert command is not None, line
        known = {flag for p in command.params for flag in p.opts}
        assert {w for w in words if w.startswith("--")} <= known, line
