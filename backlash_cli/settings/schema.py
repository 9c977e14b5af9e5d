"""Loop settings as users write them, of all loops of one or several files.

Nothing is converted here; `loop_settings.py` turns the values of one loop into LoopSettings.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from ..errors import MetadataError, nearest

ROLE_KEYS = ("sp", "pv", "op", "mode")
LOOP_KEYS = (  # limit_class: class of dead-band limit, for the wear report
    "K", "Ti", "Td", "Tf", "Kp", "theta", "pv_range", "op_range", *ROLE_KEYS, "form", "PB", "Ki", "Kd", "reset",
    "units", "auto_modes", "description", "limit_class",
)  # fmt: skip
_SEPARATOR = re.compile(r"[\s./\\:_|-]+")


@dataclass(frozen=True)
class LoopValues:
    """What the metadata say about one loop; `from_defaults` are the keys that come from [defaults]."""

    values: Mapping[str, Any]
    where: str
    from_defaults: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Metadata:
    """Settings of all loops of one or several files; `defaults` hold for loops that are not listed."""

    loops: Mapping[str, LoopValues] = field(default_factory=dict)
    defaults: Mapping[str, Any] = field(default_factory=dict)
    files: tuple[str, ...] = ()
    conflicts: tuple[str, ...] = ()

    def of(self, loop: str) -> LoopValues | None:
        """Return the settings of a loop by its name, without regard to case where that is unambiguous."""
        name = self.match(loop)
        return None if name is None else self.loops[name]

    def part_of(self, loop: str) -> str | None:
        """Return the one loop whose name is a whole part of a longer name in the data (AREA1/FIC101, FIC101_2026)."""
        longer = _spaced(loop)
        inside = [name for name, spaced in self._spaced_names if spaced in longer]
        return inside[0] if len(inside) == 1 and loop not in self.loops else None

    @cached_property
    def _spaced_names(self) -> list[tuple[str, str]]:
        return [(name, _spaced(name)) for name in self.loops if name.strip()]

    def fallback(self) -> LoopValues | None:
        """Return the settings of a loop that is not listed: the defaults alone."""
        return LoopValues(self.defaults, self.files[0], frozenset(self.defaults)) if self.defaults else None

    def match(self, loop: str) -> str | None:
        """Return the name under which the metadata know a loop of the data, or None."""
        if loop in self.loops:
            return loop
        same = [name for name in self.loops if name.strip().lower() == loop.strip().lower()]
        return same[0] if len(same) == 1 else None


def inherit(defaults: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the defaults that hold for a loop: not set by it, and not contradicted by another form of the same."""
    rivals = ({"K", "PB"}, {"Ti", "Ki", "reset"}, {"Td", "Kd"})
    return {key: value for key, value in defaults.items() if key not in values and not any(key in rival
                                                                                           and rival & set(values)
                                                                                           for rival in rivals)}


def check_keys(values: Mapping[str, Any], line_of: Any) -> None:
    """Raise MetadataError for a key that is not known, with the nearest known ones."""
    for key in values:
        if key not in LOOP_KEYS:
            raise MetadataError(f"unknown key {key!r}", where=line_of(key), remedy=nearest(key, LOOP_KEYS))


def merge(parts: Iterable[Metadata]) -> Metadata:
    """Put the metadata of several files together; the first file that sets a loop counts."""
    loops: dict[str, LoopValues] = {}
    defaults: dict[str, Any] = {}
    files: list[str] = []
    conflicts: list[str] = []
    for part in parts:
        files.extend(part.files)
        for key, value in part.defaults.items():
            defaults.setdefault(key, value)
        for name, values in part.loops.items():
            if name in loops and dict(loops[name].values) != dict(values.values):
                conflicts.append(f"{name}: {loops[name].where} and {values.where} differ; the first is used")
            loops.setdefault(name, values)
    return Metadata(loops, defaults, tuple(files), tuple(conflicts))


def _spaced(name: str) -> str:
    return f" {_SEPARATOR.sub(' ', name).strip().lower()} "
