"""docs/effects.md lists every effect; the code and files shown in docs/simulate.md work as written."""

import re
from pathlib import Path

from backlash_cli.effects import EFFECTS
from backlash_cli.simulator import simulate
from backlash_cli.simulator.scenario_file import parse_scenarios, scenario_names

DOCS = Path(__file__).resolve().parents[2] / "docs"


def blocks(name, language):
    return re.findall(rf"```{language}\n(.*?)```", (DOCS / name).read_text(encoding="utf-8"), flags=re.S)


def test_every_effect_is_described_with_its_parameters():
    lines = (DOCS / "effects.md").read_text(encoding="utf-8").splitlines()
    rows = {line.split("`")[1]: line for line in lines if line.startswith("| `")}
    assert list(rows) == [e.name for e in EFFECTS]
    for effect in EFFECTS:
        assert f"| {effect.stage} |" in rows[effect.name]
        shown = [q for q in effect.parameters if not q.nuisance and not q.choices]
        assert all(q.name in rows[effect.name] for q in shown), effect.name


def test_scenario_and_python_of_the_docs():
    (loop,) = parse_scenarios(blocks("simulate.md", "toml")[0])
    assert len(simulate(loop)) == 3600
    names = {}
    exec(blocks("simulate.md", "python")[0], names)
    assert len(names["record"]) == 20000 and names["inside"].valve.size == 20000


def test_named_scenarios_are_listed():
    text = (DOCS / "simulate.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in text for name in scenario_names())
