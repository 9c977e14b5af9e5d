"""Names and texts that come from files, made harmless for terminals, spreadsheets, pictures and file systems.

A tag name is data: it may hold escape sequences, formulas, markup or `../`. Every reporter sends foreign text through
one of these functions (HTML pages escape by themselves, through the template engine).
"""

from __future__ import annotations

import hashlib
import html
import re
import unicodedata
from collections.abc import Iterable

_NAMED = {"\n": "\\n", "\r": "\\r", "\t": "\\t", "\x1b": "\\e"}
_FORMULA = tuple("=+-@|%\t\r\n＝＋－＠")
_RESERVED = {"con", "prn", "aux", "nul", *(f"com{i}" for i in range(10)), *(f"lpt{i}" for i in range(10))}


def terminal(text: object, limit: int = 2000) -> str:
    """Return `text` on one line with control characters, escape sequences and direction marks made visible.

    >>> terminal("FIC\\n101\\x1b[31m")
    'FIC\\\\n101\\\\e[31m'
    """
    return shorten(_visible(str(text)), limit)


def _visible(text: str, kept: str = "") -> str:
    """Control characters, invisible format and direction marks, surrogates and line separators spelled out."""
    return text if text.isprintable() else "".join(
        c if c in kept or c.isprintable() or unicodedata.category(c) == "Zs" else
        _NAMED.get(c) or (f"\\x{ord(c):02x}" if ord(c) < 256 else f"\\u{ord(c):04x}") for c in text)


def shorten(text: str, limit: int) -> str:
    """Return `text` with its middle left out when it is longer than `limit` characters."""
    tail = (limit - 1) // 3
    return text if len(text) <= limit else text[: limit - 1 - tail] + "…" + text[len(text) - tail :]


def clip(text: object, limit: int) -> str:
    """Return a message for a terminal, ended after a whole word when it is longer than `limit` characters.

    >>> clip("any dead band would look the same", 20)
    'any dead band …'
    """
    shown = _visible(str(text))
    kept = shown[: limit - 1]
    return shown if len(shown) <= limit else kept[: kept.rfind(" ") + 1 or None] + "…"


def spreadsheet(value: object) -> object:
    """Return a cell that no spreadsheet runs as a formula: such a text gets an apostrophe in front.

    >>> spreadsheet("=HYPERLINK(1)"), spreadsheet("FIC101"), spreadsheet(-0.5)
    ("'=HYPERLINK(1)", 'FIC101', -0.5)
    """
    if not isinstance(value, str):
        return value
    cleaned = _visible(value, kept="\t\r\n")
    return "'" + cleaned if cleaned.lstrip(" \u00a0\u3000").startswith(_FORMULA) else cleaned


def picture(text: object, limit: int = 80) -> str:
    """Return `text` for a plotly label, where a few HTML tags would be obeyed, as plain words."""
    return html.escape(terminal(text, limit), quote=False)


def file_name(name: str) -> str:
    """Return a file name (no folder, no suffix) for a loop: letters, digits, `.`, `-`, `_`, at most 60 characters.

    A name that had to be changed carries a short fingerprint, so that different loops never share a file.

    >>> file_name("FIC101"), file_name("../../etc/x")
    ('FIC101', 'etc_x-56da1a2e')
    """
    plain = re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._-")[:60]
    if plain and plain == name and plain.split(".")[0].lower() not in _RESERVED:
        return plain
    return f"{plain[:50] or 'loop'}-{_mark(name)}"


def _mark(name: str) -> str:
    return hashlib.sha256(name.encode("utf-8", "backslashreplace")).hexdigest()[:8]


def file_names(names: Iterable[str]) -> dict[str, str]:
    """Return name -> file name for a plant, different also where the file system ignores upper and lower case."""
    given: dict[str, str] = {}
    taken: set[str] = set()
    for name in dict.fromkeys(names):
        given[name] = file_name(name)
        while given[name].lower() in taken:
            given[name] = f"{given[name][:60]}-{_mark(name + given[name])}"
        taken.add(given[name].lower())
    return given
