"""What is said of a loop to people: the sentences of words.toml with their numbers put in."""

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from string import Formatter

from .record import Note

WORDS: dict[str, dict[str, str]] = tomllib.loads((files(__package__) / "words.toml").read_text("utf-8"))


class _Shares(Formatter):
    """A number of spans or a share is shown in per cent where its format ends so: {d:.2g%}."""

    def format_field(self, value: object, spec: str) -> str:
        return f"{100.0 * value:{spec[:-1]}} %" if spec.endswith("%") else format(value, spec)  # type: ignore[operator]


def said(code: str, values: Mapping[str, object] = {}, /, **shown: object) -> str:
    """Return a sentence of words.toml."""
    return _Shares().vformat(WORDS["notes"][code], (), {**values, **shown})


def noted(code: str, values: Mapping[str, float | str] = {}, /, **shown: object) -> Note:
    """Return a note of words.toml; its code is what stands before a colon. values: kept in it; shown: only said."""
    return Note(code.partition(":")[0], said(code, values, **shown), values)


def times(count: float) -> str:
    """A count in words: once, twice, 3 times."""
    return ("never", "once", "twice")[int(count)] if count < 3 else f"{count:.0f} times"
