"""Reads one file of loop settings, a TOML sidecar or a CSV table, and checks it key by key."""

from __future__ import annotations

import re
import tomllib
from os import PathLike
from typing import Any

from ..errors import MetadataError, nearest
from .metadata import LoopValues, Metadata, check_keys, inherit
from .metadata_table import parse_table
from .places import place
from .plain_toml import plain_toml

SIZE_LIMIT = 32 << 20


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
        return parse_table(text, str(path))
    return parse_toml(text, str(path))


def parse_toml(text: str, where: str) -> Metadata:
    """Read metadata from TOML text."""
    try:
        document = plain_toml(text)
        if document is None:
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
