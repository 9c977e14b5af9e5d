"""Pages that people write in TOML, checked against a schema: what is wrong is named by file and key, with a remedy."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import msgspec

from ..errors import MetadataError, nearest

T = TypeVar("T")
_WORDS = {"bool": "true or false", "str": "a text in quotes", "array": "a list", "object": "a table",
          "float": "a positive number", "int": "a positive whole number"}


class Page(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of a page; a key that it does not have is refused."""


def checked(values: Any, kind: type[T], where: str, *, words: Mapping[str, str] | None = None, remedy: str = "",
            hook: Callable[[type, Any], Any] | None = None) -> T:
    """Return plain values as a `kind` of Page. words: what keys must be, where their type does not say it all.

    hook: makes values of types that msgspec does not know. Raises MetadataError naming the key, and what it must be.
    """
    try:
        return msgspec.convert(values, kind, dec_hook=hook)
    except msgspec.ValidationError as error:
        said, _, place = str(error).partition(" - at `$")
        keys = re.findall(r"\w+", place)
        quoted = re.findall("`([^`]+)`", said)
        for key in keys:
            values = values[int(key) if isinstance(values, list) else key]
        if "unknown field" in said:
            raise MetadataError(f"unknown key {quoted[0]!r}", where=f"{where}, {'.'.join([*keys, quoted[0]])}",
                                remedy=nearest(quoted[0], _keys(kind))) from None
        if "missing" in said:
            raise MetadataError(f"no {quoted[0]} given", where=", ".join([where, *keys]), remedy=remedy) from None
        wanted = " or ".join(_WORDS[kind] for kind in quoted[0].split(" | ") if kind in _WORDS) if quoted else said
        wanted = (words or {}).get(keys[-1] if keys else "", wanted)
        place = f", {'.'.join(keys)}" if keys else ""
        raise MetadataError(f"must be {wanted}, not {values!r}", where=where + place, remedy=remedy) from None


def _keys(kind: Any) -> list[str]:
    """Return the keys of a page and of the tables in it."""
    found = msgspec.structs.fields(kind)
    keys = [key for f in found for key in (f.encode_name, *(_keys(f.type) if _is_page(f.type) else ()))]
    return [key for key in keys if key.isidentifier()]


def _is_page(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Page)
