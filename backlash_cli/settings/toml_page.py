"""Loop settings as a TOML page, checked key by key; what is wrong is named with its line."""

from __future__ import annotations

import re
import tomllib
from typing import Any

import msgspec

from ..errors import MetadataError, nearest
from .schema import LoopValues, Metadata, check_keys, inherit


class Page(msgspec.Struct):
    """A loops file: keys that hold for all loops, and those of single loops."""

    defaults: dict[str, Any] = {}
    loops: dict[str, dict[str, Any]] = {}


def parse_toml(text: str, where: str) -> Metadata:
    """Read metadata from TOML text. Raises MetadataError naming line and key, with the nearest known ones."""
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        line = re.search(r"\(at line (\d+)", str(error))
        raise MetadataError(f"invalid TOML syntax: {error}", where=f"{where}, line {line[1]}" if line else where,
                            remedy="mend that line (text in quotes, every bracket closed, every key once)") from None
    except (RecursionError, ValueError, OverflowError):
        raise MetadataError("invalid TOML: nested too deeply or a number too long", where=where) from None
    for key in document:
        if key not in ("defaults", "loops"):
            raise MetadataError(
                f"unknown table or key {key!r} in the loops file", where=_line_of(text, where, key, None),
                remedy=f"{nearest(key, ['defaults', 'loops'])} settings of a loop stand under [loops.NAME]",
            )
    try:
        page = msgspec.convert(document, Page)
    except msgspec.ValidationError as error:
        name = _table_of(document)
        raise MetadataError(f"{name!r} must be a table ({error})", where=where,
                            remedy=f"write it as [{name}] with keys below") from None
    check_keys(page.defaults, lambda key: _line_of(text, where, key, "defaults"))
    loops: dict[str, LoopValues] = {}
    for name, values in page.loops.items():
        check_keys(values, lambda key, name=name: _line_of(text, where, key, name))
        inherited = inherit(page.defaults, values)
        loops[name] = LoopValues({**inherited, **values}, where, frozenset(inherited))
    return Metadata(loops, page.defaults, (where,))


def _table_of(document: dict[str, Any]) -> str:
    """The name of what should be a table and is none."""
    for name, value in document.items():
        if not isinstance(value, dict):
            return name
    return next((f"loops.{name}" for name, value in document["loops"].items() if not isinstance(value, dict)), "loops")


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
