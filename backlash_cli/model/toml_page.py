"""The text of a TOML file and its values, so that every complaint names file, line and key."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

from ..errors import MetadataError, nearest


class TomlPage:
    """A parsed TOML text that knows where its keys stand. Raises MetadataError when the text is no TOML."""

    def __init__(self, text: str, where: str) -> None:
        self.where = where
        self.lines = [line.strip() for line in text.splitlines()]
        try:
            self.document: Mapping[str, Any] = tomllib.loads(text.removeprefix("\ufeff"))
        except tomllib.TOMLDecodeError as error:
            line = re.search(r"\(at line (\d+)", str(error))
            place = f"{where}, line {line[1]}" if line else where
            remedy = "mend that line (text in quotes, every bracket closed, every key once)"
            raise MetadataError(f"invalid TOML: {error}", where=place, remedy=remedy) from None
        except (RecursionError, ValueError, OverflowError):
            raise MetadataError("invalid TOML: nested too deeply or a number too long", where=where) from None

    def at(self, head: str = "", key: str = "", place: int = 0) -> str:
        """Name file and line of a key below the heading numbered `place` of that name; else the file alone."""
        first = 0
        if head:
            heads = [i for i, line in enumerate(self.lines) if line.replace(" ", "").startswith(head)]
            if place >= len(heads):
                return self.where
            first = heads[place] + 1
            if not key:
                return f"{self.where}, line {first}"
        for number, line in enumerate(self.lines[first:], first + 1):
            if line.startswith("["):
                break
            if re.match(rf"['\"]?{re.escape(key)}['\"]?\s*=", line):
                return f"{self.where}, line {number}"
        return self.where

    def wrong(self, what: str, remedy: str, head: str = "", key: str = "", place: int = 0) -> MetadataError:
        """Return the error to raise for a key."""
        return MetadataError(what, where=self.at(head, key, place), remedy=remedy)

    def known(self, table: Mapping[str, Any], names: Iterable[str], head: str = "", place: int = 0) -> None:
        """Refuse keys that are not among `names`."""
        for key in table:
            if key not in names:
                raise self.wrong(f"unknown key '{key}'", nearest(key, list(names)), head, key, place)

    def table(self, value: object, head: str, place: int = 0) -> Mapping[str, Any]:
        """Return a value that must be a table."""
        if not isinstance(value, Mapping):
            raise self.wrong(f"{value!r} is not a table", f"write {head} on a line of its own", head, place=place)
        return value

    def number(self, value: object, key: str, head: str = "") -> float:
        """Return a value that must be a finite number."""
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self.wrong(f"{key} = {value!r} is not a number", "give one number", head, key)
        return float(value)

    def span(self, value: object, key: str) -> tuple[float, float]:
        """Return a value that must be two rising numbers."""
        remedy = f"write {key} = [0, 100]"
        if not isinstance(value, list) or len(value) != 2:
            raise self.wrong(f"{key} must be two numbers", remedy, key=key)
        low, high = (self.number(v, key) for v in value)
        if not low < high:
            raise self.wrong(f"{key} must rise", remedy, key=key)
        return low, high

    def moment(self, value: object, key: str) -> float:
        """Return a value that must be a date and time, or epoch seconds, as epoch seconds; without zone it is UTC."""
        if isinstance(value, datetime):
            return (value if value.tzinfo else value.replace(tzinfo=UTC)).timestamp()
        if isinstance(value, int | float) and not isinstance(value, bool):
            return self.number(value, key)
        raise self.wrong(f"{key} = {value!r} is not a time", f"write {key} = 2026-03-02T06:00:00Z", key=key)
