"""Which dead band is too much for which loop, and who says so: the editable profile `limits.toml`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from importlib.resources import files
from pathlib import Path
from typing import Any

from ..errors import MetadataError, nearest
from ..results.history import Limit


@dataclass(frozen=True)
class Limits:
    """Limits of all loops: classes by name, patterns in order, single loops, and the class of all others."""

    classes: Mapping[str, Limit]
    default: str
    assign: tuple[tuple[str, str], ...] = ()
    loops: Mapping[str, Limit] | None = None

    def of(self, loop: str) -> Limit:
        """Return the limit of a loop: its own, else that of the first pattern that fits, else the default's."""
        if self.loops and loop in self.loops:
            return self.loops[loop]
        for pattern, name in self.assign:
            if fnmatchcase(loop.lower(), pattern.lower()):
                return self.classes[name]
        return self.classes[self.default]

    def with_classes(self, chosen: Mapping[str, str], default: str | None, where: str) -> Limits:
        """Return a copy in which loops have the class that their settings name; the profile's own loops go first.

        chosen: loop -> class, default: class of the loops that have none, both from the loops file `where`.
        Raises MetadataError for a class that the profile does not know.
        """
        for name in [*chosen.values(), *([default] if default is not None else [])]:
            _class(name, self.classes, f"{where}, limit_class")
        loops = {loop: self.classes[name] for loop, name in chosen.items()}
        return replace(self, default=default or self.default, loops={**loops, **(self.loops or {})})


def read_limits(path: str | Path | None = None) -> Limits:
    """Read a limits profile; without `path` the one that comes with the tool.

    Raises MetadataError naming the file, the entry, and the remedy.
    """
    if path is None:
        return parse_limits(files("backlash_cli.history").joinpath("limits.toml").read_text("utf-8"), "limits.toml")
    try:
        text = Path(path).read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise MetadataError(f"cannot read the limits profile: {getattr(error, 'strerror', None) or 'not UTF-8 text'}",
                            where=str(path), remedy="check the path given to --limits") from None
    return parse_limits(text, str(path))


def parse_limits(text: str, where: str) -> Limits:
    """Read a limits profile from TOML text; limits in per cent of the output span."""
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise MetadataError(f"invalid TOML syntax: {error}", where=where, remedy="mend that line") from None
    _known(document, ("default", "classes", "assign", "loops"), where, "the profile")
    classes = {name: _limit(entry, name, f"{where}, [classes.{name}]")
               for name, entry in _table(document.get("classes", {}), where, "classes").items()}
    if not classes:
        raise MetadataError("no class of limits", where=where, remedy="add [classes.NAME] with limit = 3.0")
    default = document.get("default", next(iter(classes)))
    _class(default, classes, f"{where}, default")
    assign = []
    entries = document.get("assign", [])
    if not isinstance(entries, list):
        raise MetadataError("'assign' must be a list", where=where, remedy="write [[assign]] with loops and class")
    for number, entry in enumerate(entries, 1):
        place = f"{where}, [[assign]] number {number}"
        _known(_table(entry, place, "assign"), ("loops", "class"), place, "assign")
        patterns = entry.get("loops", [])
        patterns = [patterns] if isinstance(patterns, str) else patterns
        if not isinstance(patterns, list) or not patterns or not all(isinstance(p, str) for p in patterns):
            raise MetadataError("'loops' must be a name, a pattern, or a list of them", where=place,
                                remedy='for example loops = ["FIC1*"]')
        _class(entry.get("class"), classes, place)
        assign += [(pattern, entry["class"]) for pattern in patterns]
    loops: dict[str, Limit] = {}
    for name, entry in _table(document.get("loops", {}), where, "loops").items():
        place = f"{where}, [loops.{name}]"
        if "class" in _table(entry, place, name):
            _known(entry, ("class",), place, name)
            _class(entry["class"], classes, place)
            loops[name] = classes[entry["class"]]
        else:
            loops[name] = _limit(entry, name, place)
    return Limits(classes, default, tuple(assign), loops)


def _limit(entry: Any, name: str, where: str) -> Limit:
    _known(_table(entry, where, name), ("limit", "source"), where, name)
    value = entry.get("limit")
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 < value <= 100.0:
        raise MetadataError(f"'limit' must be a number of per cent between 0 and 100, not {value!r}", where=where,
                            remedy="for example limit = 3.0")
    return Limit(value / 100.0, name, str(entry.get("source", "not given")))


def _class(name: Any, classes: Mapping[str, Limit], where: str) -> None:
    if not isinstance(name, str) or name not in classes:
        raise MetadataError(f"no class {name!r}", where=where, remedy=nearest(str(name), classes))


def _known(entry: Mapping[str, Any], keys: tuple[str, ...], where: str, name: str) -> None:
    for key in entry:
        if key not in keys:
            raise MetadataError(f"unknown key {key!r} in {name}", where=where, remedy=nearest(key, keys))


def _table(value: Any, where: str, name: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise MetadataError(f"{name!r} must be a table", where=where, remedy=f"write it as [{name}] with keys below")
    return value
