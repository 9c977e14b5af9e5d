"""Loop settings as users write them, of all loops of one or several files, and what they mean: ideal form, seconds."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from ..errors import MetadataError, nearest
from ..record import LoopSettings, Note
from .pid_forms import RIVALS, number, seconds, to_ideal

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


def with_defaults(loops: Mapping[str, Mapping[str, Any]], defaults: Mapping[str, Any], where: str) -> Metadata:
    """Return the settings of a file: of each loop its own and the defaults that hold for it, which are those that it
    does not set, nor contradict by another form of the same."""
    found = {}
    for name, values in loops.items():
        taken = set(values).union(*(rivals for rivals in RIVALS if set(rivals) & set(values)))
        inherited = {key: value for key, value in defaults.items() if key not in taken}
        found[name] = LoopValues({**inherited, **values}, where, frozenset(inherited))
    return Metadata(found, defaults, (where,))


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


@dataclass(frozen=True)
class Settings:
    """Settings of one loop before the data are seen.

    loop: K and Kp as given (see `engineering`), times in seconds. pv_range, op_range: None when not given.
    engineering: K and Kp are in output units per measurement unit and back. notes: what was assumed.
    """

    loop: LoopSettings
    pv_range: tuple[float, float] | None = None
    op_range: tuple[float, float] | None = None
    engineering: bool = False
    auto_modes: tuple[str, ...] = ()
    constant_setpoint: float | None = None
    notes: tuple[Note, ...] = ()


def settings_of(values: LoopValues | None) -> Settings:
    """Check and convert the settings of one loop. Raises MetadataError naming the key, the value and the remedy."""
    if values is None:
        return Settings(LoopSettings())
    given = values.values
    tuning = to_ideal(given)
    notes: list[Note] = []
    times = {key: seconds(given[key], key) for key in ("Tf", "theta") if key in given}
    for key, value in times.items():
        if value < 0:
            raise MetadataError(f"{key} must not be negative, not {value:g}", remedy=f"give {key} in seconds")
    gain = number(given["Kp"], "Kp") if "Kp" in given else None
    if gain == 0:
        raise MetadataError("Kp (static process gain) must not be zero",
                            remedy="give the gain, or leave Kp out for the default 1.5")
    if gain is not None and tuning.K is not None and gain * tuning.K < 0:
        gain = -gain
        notes.append(Note("kp_sign", f"Kp has the opposite sign of K, with which no loop is stable: taken as {gain:g}"))
    units = str(given.get("units", "normalised")).lower()
    if units not in ("normalised", "normalized", "engineering"):
        raise MetadataError(f"units = {given['units']!r} is not known", remedy='units is "normalised" or "engineering"')
    named = {"PB": "K", "Ki": "Ti", "reset": "Ti", "Kd": "Td"}
    keys = ("Tf", "Kp", "theta", "pv_range", "op_range", "K", "PB", "Ti", "Ki", "reset", "Td", "Kd")
    source = {named.get(key, key): "default" if key in values.from_defaults else "metadata"
              for key in keys if key in given}
    setpoint, modes = given.get("sp"), given.get("auto_modes", ())
    loop = LoopSettings(K=tuning.K, Ti=tuning.Ti, Td=tuning.Td, Tf=times.get("Tf"), Kp=gain, theta=times.get("theta"),
                        source=source)
    return Settings(loop, _range(given, "pv_range"), _range(given, "op_range"), units == "engineering",
                    tuple(map(str, modes if isinstance(modes, (list, tuple)) else [modes])),
                    number(setpoint, "sp") if isinstance(setpoint, (int, float)) else None, tuple(notes))


def _range(given: Any, key: str) -> tuple[float, float] | None:
    if key not in given:
        return None
    value = given[key]
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise MetadataError(f"{key} must be two numbers, not {value!r}", remedy=f"write {key} = [0, 100]")
    low, high = number(value[0], key), number(value[1], key)
    if low == high:
        raise MetadataError(f"{key} = [{low:g}, {high:g}] has zero width", remedy="give the span: [low, high]")
    if low > high:
        raise MetadataError(f"{key} = [{low:g}, {high:g}] is reversed: low must be less than high",
                            remedy=f"[{high:g}, {low:g}]?")
    if high - low == float("inf"):
        raise MetadataError(f"{key} is too wide", remedy="give the span: [low, high]")
    return low, high
