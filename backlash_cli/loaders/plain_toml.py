"""TOML as loop settings are nearly always written, a line at a time: a plant of thousands of loops is read at once.

Tables with one or two names, keys with a number, a text, true or false, or a list of numbers. For a text with anything
else in it `plain_toml` gives None, and the full reader takes its turn.
"""

from __future__ import annotations

import re
from typing import Any

_NUMBER = r"[+-]?(?:0|[1-9][0-9]*)(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?"
_LINE = re.compile(
    rf"""[ \t]*(?:
    (?P<key>[A-Za-z0-9_-]+)[ \t]*=[ \t]*
        (?:(?P<number>{_NUMBER})|"(?P<text>[^"\\\x00-\x08\x0a-\x1f\x7f]*)"|(?P<truth>true|false)
        |\[[ \t]*(?P<numbers>{_NUMBER}(?:[ \t]*,[ \t]*{_NUMBER})*)[ \t]*\])
    |\[(?P<table>[A-Za-z0-9_-]+)(?:\.(?:(?P<bare>[A-Za-z0-9_-]+)|"(?P<quoted>[^"\\\x00-\x08\x0a-\x1f\x7f]*)"))?\]
    )?[ \t]*(?:\#[^\x00-\x08\x0a-\x1f\x7f]*)?""",
    re.VERBOSE,
)


def plain_toml(text: str) -> dict[str, Any] | None:
    """Return what tomllib makes of a text, None where that is not certain."""
    document: dict[str, Any] = {}
    table = document
    opened: set[tuple[str, str | None]] = set()
    for line in text.replace("\r\n", "\n").split("\n"):
        found = _LINE.fullmatch(line)
        if found is None:
            return None
        key, number, words, truth, numbers, name, bare, quoted = found.groups()
        if key is not None:
            if key in table:
                return None
            if number is not None:
                table[key] = _number(number)
            elif words is not None:
                table[key] = words
            else:
                table[key] = truth == "true" if truth else [_number(n.strip()) for n in numbers.split(",")]
        elif name is not None:
            inner = bare if bare is not None else quoted
            if (name, inner) in opened or not isinstance(document.get(name, {}), dict):
                return None
            opened.add((name, inner))
            table = document.setdefault(name, {})
            if inner is not None:
                if inner in table:
                    return None
                table[inner] = table = {}
    return document


def _number(text: str) -> int | float:
    return int(text) if text.lstrip("+-").isdigit() else float(text)
