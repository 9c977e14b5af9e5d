"""A model as TOML text that a person can read, change by hand and use again tomorrow.

    loop = "FIC101"

    [baseline]
    Kp = 1.3       # static gain [PV span / OP span]
    tau = 20.0     # time constant [s]

    [[effects]]
    effect = "backlash"
    d = 0.03       # dead band [span]
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

from ..effects import Effect
from ..effects.registry import load_effect
from ..errors import MetadataError, nearest
from ..results import Model, ModelEffect


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


TIMES, NUMBERS, SPANS = ("start", "end"), ("interval", "rmse_holdout"), ("pv_range", "op_range", "output")
TOP = ("loop", *TIMES, *NUMBERS, *SPANS, "baseline", "effects")
BASELINE = {
    "Kp": "static gain [PV span / OP span]",
    "tau": "time constant [s]",
    "theta": "dead time [s]",
    "offset": "PV at no output [PV span]",
}
ENTRY = "[[effects]]"
Value = float | tuple[float, ...]


def parse_model(text: str, where: str = "model file") -> Model:
    """Return the model that the text of a model file describes.

    Raises MetadataError with file, line and the nearest known names for whatever is not understood.
    """
    page = TomlPage(text, where)
    document = page.document
    page.known(document, TOP)
    loop = document.get("loop")
    if not isinstance(loop, str) or not loop:
        raise page.wrong("the model does not say which loop it is of", 'add loop = "FIC101"', key="loop")
    entries = document.get("effects", [])
    if not isinstance(entries, list):
        raise page.wrong("effects must be a list", f"write {ENTRY} above each effect", key="effects")
    return Model(
        loop=loop,
        **_baseline(page),
        effects=tuple(_effect(page, entry, place) for place, entry in enumerate(entries)),
        **_known_about_the_record(page),
    )


def _known_about_the_record(page: TomlPage) -> dict[str, Any]:
    document = page.document
    return {
        **{key: page.number(document[key], key) for key in NUMBERS if key in document},
        **{key: page.moment(document[key], key) for key in TIMES if key in document},
        **{key: page.span(document[key], key) for key in SPANS if key in document},
    }


def _baseline(page: TomlPage) -> dict[str, Any]:
    head = "[baseline]"
    table = page.table(page.document.get("baseline", {}), head)
    page.known(table, BASELINE, head)
    for key in ("Kp", "tau"):
        if key not in table:
            raise page.wrong(f"{key} is missing", f"add {key} = ... below {head}: {BASELINE[key]}", head)
    numbers = {key: page.number(value, key, head) for key, value in table.items()}
    for key, possible in (("tau", numbers["tau"] > 0.0), ("theta", numbers.get("theta", 0.0) >= 0.0)):
        if not possible:
            raise page.wrong(f"{key} = {numbers[key]:g} s is not possible", "give seconds", head, key)
    return numbers


def _effect(page: TomlPage, entry: object, place: int) -> ModelEffect:
    table = page.table(entry, ENTRY, place)
    name, column = table.get("effect"), table.get("column", "")
    if not isinstance(name, str):
        raise page.wrong("an entry names no effect", 'add effect = "backlash"', ENTRY, place=place)
    try:
        effect = load_effect(name)
    except MetadataError as error:
        raise page.wrong(error.what, error.remedy, ENTRY, "effect", place) from error
    if not isinstance(column, str) or (effect.column and not column):
        key = "column" if "column" in table else ""
        raise page.wrong(f"{effect.name} needs the name of a measured column", 'add column = "DV1"', ENTRY, key, place)
    given = {k: v for k, v in table.items() if k not in ("effect", "column")}
    names = [q.name for q in effect.parameters]
    for key in given:
        if key not in names:
            raise page.wrong(f"unknown key '{key}' of {effect.name}", nearest(key, names), ENTRY, key, place)
        _check(page, effect, given, key, place)
    values: dict[str, Value] = {k: tuple(map(float, v)) if isinstance(v, list) else float(v) for k, v in given.items()}
    return ModelEffect(effect.name, values, column, name if ":" in name else "")


def _check(page: TomlPage, effect: Effect, given: Mapping[str, object], key: str, place: int) -> None:
    """Have the effect check one value; lists go together, because their lengths must agree."""
    some = {k: v for k, v in given.items() if k == key or (isinstance(v, list) and isinstance(given[key], list))}
    try:
        effect.pack(some)
    except MetadataError as error:
        raise page.wrong(f"{key} = {given[key]}: {error.what}", error.remedy, ENTRY, key, place) from error


def model_text(model: Model) -> str:
    """Return a model as TOML text with a comment on every number; `parse_model` reads it back."""
    out = [
        "# Model of one loop, made by backlash: PV = Kp x lag(effects(OP)) + offset.",
        "# Change what you know better, then: backlash compare EXPORT --model THIS_FILE",
        "# Signals are normalised by the ranges (0.03 = 3 % of span), times are in seconds.",
        f"loop = {_text(model.loop)}",
    ]
    if model.start is not None:
        out.append(f"start = {_time(model.start)}  # of the record it was fitted to; times of events count from here")
    if model.end is not None:
        out.append(f"end = {_time(model.end)}")
    if model.interval is not None:
        out.append(f"interval = {_number(model.interval)}  # between samples [s]")
    for key, span in (("pv_range", model.pv_range), ("op_range", model.op_range)):
        if span is not None:
            out.append(f"{key} = [{_number(span[0])}, {_number(span[1])}]")
    if model.output is not None:
        out.append(f"output = [{_number(model.output[0])}, {_number(model.output[1])}]  # where OP was then [span]")
    if model.rmse_holdout is not None:
        out.append(f"rmse_holdout = {_number(model.rmse_holdout)}  # error on samples the fit did not see")
    out += ["", "[baseline]"]
    out += [f"{key} = {_number(getattr(model, key))}  # {words}" for key, words in BASELINE.items()]
    for entry in model.effects:
        out += ["", *_entry(entry)]
    return "\n".join(out) + "\n"


def _entry(entry: ModelEffect) -> list[str]:
    """The lines of one effect; values that do nothing are left out."""
    effect = load_effect(entry.reference)
    out = [f"# {_comment(effect.sentence)}", ENTRY, f"effect = {_text(entry.reference)}"]
    if entry.column:
        out.append(f"column = {_text(entry.column)}")
    for q in effect.parameters:
        value = entry.parameters.get(q.name)
        if value is None or value == q.neutral or value == ():
            continue
        shown = f"[{', '.join(map(_number, value))}]" if isinstance(value, tuple) else _number(value)
        out.append(f"{q.name} = {shown}  # {_comment(q.meaning)} [{_comment(q.unit)}]")
    return out


def _number(value: float) -> str:
    return repr(float(f"{float(value):.8g}"))


def _time(epoch: float) -> str:
    """A TOML date-time; a number where it is no date."""
    try:
        return datetime.fromtimestamp(round(epoch, 3), UTC).isoformat().replace("+00:00", "Z")
    except (OverflowError, ValueError, OSError):
        return _number(epoch)


def _comment(text: str) -> str:
    """Text on one line, without what a TOML comment may not hold."""
    return re.sub(r"\s+", " ", "".join(c if c.isprintable() else " " for c in text)).strip()


def _text(value: str) -> str:
    """A TOML basic string: quotes, backslashes and control characters escaped."""
    kept = value.encode("utf-8", "replace").decode().replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in kept) + '"'
