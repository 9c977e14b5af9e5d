"""Loop settings as users write them: a TOML sidecar or a CSV table, checked key by key.

Nothing is converted here; `loop_settings.py` turns the values of one loop into LoopSettings.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from typing import Any

from ..errors import MetadataError, nearest
from .places import place

ROLE_KEYS = ("sp", "pv", "op", "mode")
LOOP_KEYS = (
    "K",
    "Ti",
    "Td",
    "Tf",
    "Kp",
    "theta",
    "pv_range",
    "op_range",
    *ROLE_KEYS,
    "form",
    "PB",
    "Ki",
    "Kd",
    "reset",
    "units",
    "auto_modes",
    "description",
    "limit_class",  # class of dead-band limit, for the wear report
)
_SEPARATOR = re.compile(r"[\s./\\:_|-]+")
SIZE_LIMIT = 32 << 20


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


def read_metadata(path: str | PathLike[str]) -> Metadata:
    """Read one metadata file: TOML with [defaults] and [loops.NAME], or a CSV table with a column `loop`.

    Raises MetadataError naming file, line and key, with the nearest known ones.
    """
    path = place(path)
    try:
        if path.stat().st_size > SIZE_LIMIT:
            raise MetadataError("metadata file is larger than 32 MB", where=str(path), remedy="is this the data file?")
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise MetadataError(
            "loops file not found: no such file", where=str(path), remedy="check the path given to --loops"
        ) from None
    except OSError as error:
        raise MetadataError(f"cannot read the loops file: {error.strerror}", where=str(path)) from None
    except UnicodeDecodeError as error:
        raise MetadataError(
            f"loops file is not UTF-8 text (byte {error.start})", where=str(path), remedy="save it as UTF-8"
        ) from None
    if path.suffix.lower() in (".csv", ".txt", ".tsv"):
        from .metadata_table import parse_table

        return parse_table(text, str(path))
    return parse_toml(text, str(path))


def parse_toml(text: str, where: str) -> Metadata:
    """Read metadata from TOML text."""
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        line = re.search(r"\(at line (\d+)", str(error))
        raise MetadataError(
            f"invalid TOML syntax: {error}",
            where=f"{where}, line {line[1]}" if line else where,
            remedy="mend that line (text in quotes, every bracket closed, every key once)",
        ) from None
    except (RecursionError, ValueError, OverflowError):
        raise MetadataError("invalid TOML: nested too deeply or a number too long", where=where) from None
    for key in document:
        if key not in ("defaults", "loops"):
            raise MetadataError(
                f"unknown table or key {key!r} in the loops file",
                where=_line_of(text, where, key, None),
                remedy=f"{nearest(key, ['defaults', 'loops'])} settings of a loop stand under [loops.NAME]",
            )
    defaults = _table(document.get("defaults", {}), where, "defaults")
    check_keys(defaults, lambda key: _line_of(text, where, key, "defaults"))
    loops: dict[str, LoopValues] = {}
    for name, given in _table(document.get("loops", {}), where, "loops").items():
        values = _table(given, where, f"loops.{name}")
        check_keys(values, lambda key, name=name: _line_of(text, where, key, name))
        inherited = inherit(defaults, values)
        loops[name] = LoopValues({**inherited, **values}, where, frozenset(inherited))
    return Metadata(loops, defaults, (where,))


def inherit(defaults: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the defaults that hold for a loop: not set by it, and not contradicted by another form of the same."""
    rivals = ({"K", "PB"}, {"Ti", "Ki", "reset"}, {"Td", "Kd"})
    return {
        key: value
        for key, value in defaults.items()
        if key not in values and not any(key in rival and rival & set(values) for rival in rivals)
    }


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


def _table(value: Any, where: str, name: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise MetadataError(f"{name!r} must be a table", where=where, remedy=f"write it as [{name}] with keys below")
    return value


def _line_of(text: str, where: str, key: str, table: str | None) -> str:
    """Name file and line of a key; the line is left out when it cannot be found for sure."""
    inside = table is None
    for number, line in enumerate(text.splitlines(), 1):
        bare = line.strip()
        if bare.startswith("["):
            names = bare.strip("[] \t").replace('"', "").replace("'", "")
            last = names.split(".", 1)[-1] if names.startswith("loops.") else names
            inside = table is None or last == table
            if names == key or names == f"loops.{key}" or names.startswith(f"{key}."):
                return f"{where}, line {number}"
        elif inside and re.match(rf"['\"]?{re.escape(key)}['\"]?\s*[=.]", bare):
            return f"{where}, line {number}"
    return where
