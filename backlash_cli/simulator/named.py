"""The scenarios that come with the tool: the paper's examples and the sample plant, each a TOML file to start from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from importlib import resources
from pathlib import Path

from ..errors import UsageError, nearest
from .applied import use
from .scenario import Scenario
from .scenario_file import loop_seed, parse_scenarios, read_scenarios


def scenario_names() -> tuple[str, ...]:
    """Return the names of the scenarios that come with the tool."""
    folder = resources.files(__package__) / "scenarios"
    return tuple(sorted(f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")))


def scenario_text(name: str) -> str:
    """Return the TOML text of a named scenario, to be copied and changed. Raises UsageError for an unknown name."""
    if name not in scenario_names():
        remedy = nearest(name, scenario_names()) + " (or give the path of a TOML file)"
        raise UsageError(f"no scenario '{name}'", remedy=remedy)
    return (resources.files(__package__) / "scenarios" / f"{name}.toml").read_text(encoding="utf-8")


def load_scenarios(name_or_path: str) -> tuple[Scenario, ...]:
    """Return the loops of a named scenario or of a user's own TOML file."""
    if name_or_path.endswith(".toml") or Path(name_or_path).is_file():
        return read_scenarios(Path(name_or_path))
    return parse_scenarios(scenario_text(name_or_path), where=name_or_path)


def with_dead_band(scenarios: Iterable[Scenario], d: float | None) -> tuple[Scenario, ...]:
    """Return the loops with dead band d [span] in their valves; None leaves them as they are."""
    if d is None:
        return tuple(scenarios)
    gap = use("backlash", d=d)
    return tuple(
        replace(s, effects=(gap, *(a for a in s.effects if a.effect is not gap.effect))) for s in scenarios
    )


def with_seed(scenarios: Iterable[Scenario], seed: int | None) -> tuple[Scenario, ...]:
    """Return the loops with other random numbers; None leaves them as they are."""
    if seed is None:
        return tuple(scenarios)
    return tuple(replace(s, seed=loop_seed(seed, place)) for place, s in enumerate(scenarios))
