"""The README's blocks do what they say.

Making environments and running the tests themselves is for `.ci/run`, which types the first two blocks as they stand
(here it would call itself); the commands and programs in them run with what is already installed.
"""

import re

import pytest

from tests.commands.run import run
from tests.readme_blocks import README, ROOT, backlash_lines, blocks, output, same, shown

pytestmark = pytest.mark.usefixtures("analysed_once")
LINES = [line for block in blocks("sh") for line in backlash_lines(block)]


def test_first_screen_holds_the_two_command_blocks():
    first = README.read_text("utf-8").splitlines()[:60]
    assert first.count("```sh") >= 2
    install, check = blocks("sh")[:2]
    assert "pip install" in install and install.endswith("backlash scan sample_data/plant.csv\n")
    assert "[test]" in check and "pytest" in check


@pytest.mark.parametrize(("language", "block", "promised"), shown(), ids=[f"{s[0]}{i}" for i, s in enumerate(shown())])
def test_the_output_shown_is_the_present_one(language, block, promised):
    assert same(promised, output(language, block)), "python -m tests.readme_blocks refresh mends it"


def test_outputs_are_shown_for_the_first_command_and_for_python():
    assert {language for language, _, _ in shown()} == {"sh", "python"}


@pytest.mark.parametrize("line", LINES, ids=" ".join)
def test_command_lines_work(line, tmp_path, capfd, monkeypatch):
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    monkeypatch.chdir(tmp_path)
    done = run(capfd, *line)
    assert done.status == ("--fail-on" in line), done.err


def test_settings_shown_are_understood(tmp_path):
    from backlash_cli.loaders.sources import read_metadata
    from backlash_cli.settings.schema import settings_of

    (tmp_path / "loops.toml").write_text(blocks("toml")[0])
    values = read_metadata(str(tmp_path / "loops.toml")).loops["FIC101"]
    assert values is not None
    settings = settings_of(values)
    assert settings.loop.Ti == 28.0 and settings.pv_range == (0.0, 900.0)


def test_links_to_files_exist():
    for target in re.findall(r"\]\(([^)#:]+)\)", README.read_text("utf-8")):
        assert (ROOT / target).exists(), target
