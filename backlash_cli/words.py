"""What is said to people: the sentences of words.toml with their numbers put in."""

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from string import Formatter
from typing import Any

from .record import Note


class Words(Formatter):
    """The words.toml of a package: its tables, and the sentences in two of them, of notes and of errors."""

    def __init__(self, package: str) -> None:
        self.tables: dict[str, dict[str, Any]] = tomllib.loads((files(package) / "words.toml").read_text("utf-8"))

    def format_field(self, value: Any, spec: str) -> str:
        """A number of spans or a share is shown in per cent where its format ends so: {d:.2g%}."""
        return f"{100.0 * value:{spec[:-1]}} %" if spec.endswith("%") else format(value, spec)

    def said(self, code: str, values: Mapping[str, object] = {}, /, **shown: object) -> str:
        """Return the sentence of a note."""
        return self.vformat(self.tables["notes"][code], (), {**values, **shown})

    def noted(self, code: str, values: Mapping[str, float | str] = {}, /, **shown: object) -> Note:
        """Return a note; its code is what stands before a colon. values: kept in it; shown: only said."""
        return Note(code.partition(":")[0], self.said(code, values, **shown), values)

    def explained(self, name: str, **shown: object) -> dict[str, str]:
        """Return the arguments of an error: what is wrong, the remedy, perhaps a code."""
        texts = (self.vformat(text, (), shown) for text in self.tables["errors"][name])
        return dict(zip(("what", "remedy", "code"), texts, strict=False))


_OWN = Words(__package__)
WORDS, said, noted, explained = _OWN.tables, _OWN.said, _OWN.noted, _OWN.explained


def times(count: float) -> str:
    """A count in words: not once, once, twice, 3 times."""
    return ("not once", "once", "twice")[int(count)] if count < 3 else f"{count:.0f} times"
