"""The tutorial docs/workbench.md and docs/own-effect.md: their commands run as they stand, with the output shown."""

import json
import re

import pytest

from backlash_cli import load_model
from tests.commands.run import run
from tests.docs_blocks import DOCS, commands, first_block, write_files
from tests.readme_blocks import same

REFRESH = "python -m tests.docs_blocks workbench own-effect puts the present output there"


def walk(page, folder, capfd, monkeypatch):
    """Run every command block of a page in an empty folder; the output shown must be the present one, nearly."""
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(folder)
    write_files(page, folder)
    shown = 0
    for block, text in commands(page):
        for line in block:
            done = run(capfd, *line)
            assert done.status == 0, (line, done.err)
        if text is not None:
            shown += 1
            promised, present = text.splitlines(), done.out.splitlines()
            whole = promised[-1] != "..."
            for number, said in enumerate(promised if whole else promised[:-1]):
                assert same(said, present[number]), f"{said!r} is now {present[number]!r}; {REFRESH}"
            assert not whole or len(promised) == len(present), REFRESH
    return shown


@pytest.fixture
def workbench(tmp_path, capfd, monkeypatch):
    assert walk("workbench", tmp_path, capfd, monkeypatch) == 4
    return tmp_path


def test_the_tutorial_finds_its_hidden_effect_and_the_error_falls(workbench, capfd):
    truth = (workbench / "monday.truth.csv").read_text()
    d = float(re.search(r"backlash,d,([\d.]+)", truth).group(1))
    found = load_model(workbench / "fic101.toml")
    assert [e.effect for e in found.effects] == ["backlash"]
    assert found.effects[0].parameters["d"] == pytest.approx(d, rel=0.04)
    tuesday = json.loads((workbench / "tuesday.json").read_text())
    low, high = tuesday["effects"][0]["parameters"]["d"]["ci95"]
    assert low < d < high and tuesday["missing_effect"] == "backlash"
    for name in ("compare.html", "explain.html", "compare.png", "explain.png"):
        assert (workbench / name).stat().st_size > 10_000
    # the Python of the page uses what its commands have written
    exec(first_block("workbench", "python"), {})
    out = capfd.readouterr().out
    assert out.startswith("backlash 0.03") and "of the plain model" in out


def test_a_model_written_by_hand_as_shown_is_understood(tmp_path):
    (tmp_path / "m.toml").write_text(first_block("workbench", "toml"))
    assert load_model(tmp_path / "m.toml").effects[0].parameters == {"d": 0.03}


def test_the_own_effect_of_forty_lines_wins_and_is_kept(tmp_path, capfd, monkeypatch):
    assert walk("own-effect", tmp_path, capfd, monkeypatch) == 2
    assert len(first_block("own-effect", "python").splitlines()) <= 42
    (kept,) = load_model(tmp_path / "valve.model.toml").effects
    assert kept.reference == "slow_draining:SLOW_DRAINING"
    assert kept.parameters["rate"] == pytest.approx(0.0005, rel=0.1)


def test_pictures_exist_and_are_small():
    shown = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", (DOCS / "workbench.md").read_text("utf-8"))
    assert len(shown) == 2 and sum((DOCS / name).stat().st_size for name in shown) < 300_000


@pytest.mark.parametrize("page", ["workbench", "own-effect"])
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#:]+)\)", (DOCS / f"{page}.md").read_text("utf-8")):
        assert (DOCS / target).exists(), target
