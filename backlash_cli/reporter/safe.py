"""Names and texts that come from files, made harmless for terminals, spreadsheets, pictures and file systems.

A tag name is data: it may hold escape sequences, formulas, markup or `../`. Every reporter sends foreign text through
one of these functions (pages escape by themselves)."""

import hashlib
import html
import re
import shlex
import unicodedata
from collections.abc import Iterable, Sequence
from contextvars import ContextVar
from pathlib import PurePath

from ..errors import some

ASKED: ContextVar[Sequence[str]] = ContextVar("ASKED", default=())  # the words of the command line, none from Python
_NAMED = {"\n": "\\n", "\r": "\\r", "\t": "\\t", "\x1b": "\\e"}
_FORMULA = tuple("=+-@|%\t\r\n＝＋－＠")
_RESERVED = {"con", "prn", "aux", "nul", *(f"com{i}" for i in range(10)), *(f"lpt{i}" for i in range(10))}


def terminal(text: object, limit: int = 2000) -> str:
    """Return `text` on one line with control characters, escape sequences and direction marks made visible.

    >>> terminal("FIC\\n101\\x1b[31m")
    'FIC\\\\n101\\\\e[31m'"""
    return shorten(visible(str(text)), limit)


def visible(text: str, kept: str = "") -> str:
    """Return `text` with control characters, invisible format and direction marks, surrogates and line separators
    spelled out, but for those that are `kept`."""
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
    'any dead band …'"""
    shown = visible(str(text))
    kept = shown[: limit - 1]
    return shown if len(shown) <= limit else kept[: kept.rfind(" ") + 1 or None] + "…"


def spreadsheet(value: object) -> object:
    """Return a cell that no spreadsheet runs as a formula: such a text gets an apostrophe in front.

    >>> spreadsheet("=HYPERLINK(1)"), spreadsheet("FIC101"), spreadsheet(-0.5)
    ("'=HYPERLINK(1)", 'FIC101', -0.5)"""
    if not isinstance(value, str):
        return value
    cleaned = visible(value, kept="\t\r\n")
    return "'" + cleaned if cleaned.lstrip(" \u00a0\u3000").startswith(_FORMULA) else cleaned


def asked() -> str:
    """Return the command line as a page may tell it: without what may be a password: before @, behind ?."""
    words = (re.sub(r"://(?:[^/@]*@)?([^?]*).*", r"://\1", word) for word in ASKED.get())
    return terminal(shlex.join(["backlash", *words]), 400) if ASKED.get() else ""


def entitled(title: str, inputs: Iterable[str]) -> str:
    """Return a title with the names of the files that the page is about, e.g. 'Test plans: plant.csv'."""
    names = [PurePath(name.partition("?")[0]).name or name for name in inputs]
    return f"{title}: {terminal(some(names, 2), 120)}" if names else title


def picture(text: object, limit: int = 80) -> str:
    """Return `text` for a plotly label, where a few HTML tags would be obeyed, as plain words."""
    return html.escape(terminal(text, limit), quote=False)


def counted(number: int, what: str) -> str:
    """A number of things, e.g. '1 loop', '2 loops'."""
    return f"{number} {what}{'s' * (number != 1)}"


def file_names(names: Iterable[str]) -> dict[str, str]:
    """Return name -> file name (no folder, no suffix): letters, digits, `.`, `-`, `_`, at most 60 characters.

    A name that had to be changed carries a short fingerprint, so that different loops never share a file, also where
    the file system ignores upper and lower case.

    >>> file_names(["FIC101", "../../etc/x", "fic101"])
    {'FIC101': 'FIC101', '../../etc/x': 'etc_x-56da1a2e', 'fic101': 'fic101-1b4fc58a'}"""
    given: dict[str, str] = {}
    taken = {""}
    for name in dict.fromkeys(names):
        plain = re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._-")[:60]
        stem = plain.lower()
        if plain != name or stem in taken or stem.split(".")[0] in _RESERVED or re.search("-[0-9a-f]{8}$", stem):
            mark = hashlib.sha256(name.encode("utf-8", "backslashreplace")).hexdigest()[:8]
            plain = f"{plain[:50] or 'loop'}-{mark}"
        taken.add(stem)
        given[name] = plain
    return given
