"""TOML that people write (settings, models, scenarios, limits, the nightly job): read in one way, wrong in one way."""

import json
import re
import tomllib
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from os import PathLike
from typing import Any, TypeVar

import msgspec

from .errors import MetadataError, nearest
from .places import place

T = TypeVar("T")
_WORDS = {"bool": "true or false", "str": "a text in quotes", "array": "a list", "object": "a table",
          "float": "a positive number", "int": "a positive whole number"}


class Page(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of a page; a key that it does not have is refused."""


def read_page(path: str | PathLike[str], what: str, remedy: str, otherwise: str = "utf-8") -> str:
    """Return the text of a page; otherwise: its encoding where it is neither UTF-8 nor UTF-16. Raises MetadataError
    with `what` it is and the `remedy`."""
    try:
        with place(path).open("rb") as file:
            text = file.read(256 << 20)  # bytes, more than any page: /dev/zero has no end
        with suppress(UnicodeDecodeError):  # Excel saves "Unicode text" in UTF-16
            return text.decode("utf-16" if text.startswith((BOM_UTF16_LE, BOM_UTF16_BE)) else "utf-8-sig")
        return text.decode(otherwise)
    except (OSError, UnicodeDecodeError) as error:
        problem = getattr(error, "strerror", None) or "not UTF-8 text: save it as UTF-8 text, a workbook as CSV"
        raise MetadataError(f"{what} cannot be read: {problem}", where=str(path), remedy=remedy) from None


def parsed(text: str, where: str) -> dict[str, Any]:
    """Return TOML text as plain values. Raises MetadataError naming the line."""
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError as error:
        line = re.search(r"\(at line (\d+)", str(error))
        at = "".join(text.splitlines()[int(line[1]) - 1 :][:1]) if line else ""
        remedy = ("write a decimal point, as in 0.95" if re.search(r"=\s*[-+]?\d+,\d", at) else
                  "this looks like JSON: write it as TOML" if text.lstrip().startswith("{") else
                  "mend it or the line above (quotes and brackets closed, keys once)")
        raise MetadataError(f"not valid TOML: {error}", where=f"{where}, line {line[1]}" if line else where,
                            remedy=remedy) from None
    except (RecursionError, ValueError, OverflowError):
        raise MetadataError("not valid TOML: nested too deeply or a number too long", where=where) from None


def ways_of(text: str) -> Iterator[tuple[int, list[str | int]]]:
    """Yield the number of each line that begins a table or sets a key, and the way to it: names of tables, the number
    of an entry where there are several, a key."""
    here, entries = list[str | int](), Counter[str]()
    for number, line in enumerate(text.splitlines(), 1):
        head = re.match(r"\s*(\[+)([^]]*)\]", line)
        key = head or re.match(r"()\s*((?:[\w-]++|\"[^\"]*\"|'[^']*'|\s*+\.\s*+)+)\s*=", line)
        if key is None:
            continue
        names: list[str | int] = [name.strip("\"'") for name in re.findall(r"[\w-]+|\"[^\"]*\"|'[^']*'", key[2])]
        if head:
            here = names
            if head[1] == "[[":
                here = [*names, entries[head[2]]]
                entries[head[2]] += 1
        yield number, [*here, *names * (not head)]


def line_of(text: str, where: str, *way: str | int) -> str:
    """Name file and line where what the way (`ways_of`) leads to begins; the file alone where no line does."""
    return next((f"{where}, line {n}" for n, keys in ways_of(text) if way and keys[: len(way)] == [*way]), where)


def checked(values: Any, kind: type[T], where: str, text: str = "", *way: str | int,
            words: Mapping[str, str] | None = None, remedy: str = "", hook: Callable[[type, Any], Any] | None = None
            ) -> T:
    """Return plain values as a `kind` of Page.

    text, way: of the whole page, and to these values in it. words: what keys must be, where their type does not say it
    all. hook: makes values of types that msgspec does not know. Raises MetadataError naming the line, the key, and what
    it must be; remedy: what else it says of what is missing or not known."""
    try:
        return msgspec.convert(values, kind, dec_hook=hook)
    except msgspec.ValidationError as error:
        said, _, place = str(error).partition(" - at `$")
        keys: Sequence[str | int] = [int(key) if key.isdigit() else key for key in re.findall(r"\w+", place)]
        quoted = re.findall("`([^`]+)`", said)
        if "unknown field" in said:
            raise MetadataError(f"unknown key {quoted[0]!r}", where=line_of(text, where, *way, *keys, quoted[0]),
                remedy=(words or {}).get(quoted[0], f"{nearest(quoted[0], _keys(kind))} {remedy}".rstrip())) from None
        if "missing" in said:
            add = f"add [{quoted[0]}]" if _keys(kind)[quoted[0]] else f"add {quoted[0]} = ..."
            raise MetadataError(f"{quoted[0]} is missing", where=line_of(text, where, *way, *keys),
                                remedy=f"{add} {remedy}".rstrip()) from None
        for key in keys:
            values = values[key]
        wanted = " or ".join(_WORDS[kind] for kind in quoted[0].split(" | ") if kind in _WORDS) if quoted else said
        name = [str(key) for key in ("this", *way, *keys) if not isinstance(key, int)][-1]
        shown = "a table" if isinstance(values, dict) else f"{values!r:.80}"
        raise MetadataError(f"{name} = {shown} is not possible", where=line_of(text, where, *way, *keys),
                            remedy=(words or {}).get(name, f"give {wanted}")) from None


def _keys(kind: Any) -> dict[str, bool]:
    """Return the keys of a page and of the tables in it; True for a table."""
    known: dict[str, bool] = {}
    for field in msgspec.structs.fields(kind):
        table = isinstance(field.type, type) and issubclass(field.type, Page)
        known |= {field.encode_name: table, **(_keys(field.type) if table else {})}
    return {key: table for key, table in known.items() if key.isidentifier()}


def toml_value(value: object) -> str:
    """A value as TOML, whose strings are those of JSON but for one character."""
    match value:
        case str():
            kept = value.encode("utf-8", "replace").decode()
            return json.dumps(kept, ensure_ascii=False).replace("\x7f", "\\u007f")
        case tuple():
            return f"[{', '.join(map(toml_value, value))}]"
        case datetime():
            return value.isoformat().replace("+00:00", "Z")
    return repr(float(f"{value:.8g}"))
