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

import re
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Annotated, Any

import msgspec

from ..effects.registry import load_effect
from ..errors import MetadataError, nearest
from ..results import Model, ModelEffect
from ..toml_text import parsed

Number = Annotated[float, msgspec.Meta(gt=-1e300, lt=1e300)]
Seconds = Annotated[float, msgspec.Meta(ge=0.0, lt=1e300)]
Moment = datetime | Number | None
Span = tuple[Number, Number] | None
# what a number is, or an example of it
BASELINE = {
    "Kp": "static gain [PV span / OP span]",
    "tau": "time constant [s]",
    "theta": "dead time [s]",
    "offset": "PV at no output [PV span]",
}
EXAMPLES = {"loop": '"FIC101"', "start": "2026-03-02T06:00:00Z", "end": "2026-03-02T18:00:00Z", "pv_range": "[0, 100]",
            "op_range": "[0, 100]", "output": "[0.2, 0.6]"}  # fmt: skip
# what stands behind each key of a file that is written
REMARKS = {
    "loop": "", "start": "  # of the record it was fitted to; times of events count from here", "end": "",
    "interval": "  # between samples [s]", "pv_range": "", "op_range": "", "output": "  # where OP was then [span]",
    "rmse_holdout": "  # error on samples the fit did not see",
}  # fmt: skip
HEADS = {"baseline": "[baseline]", "effects": "[[effects]]"}


class Baseline(msgspec.Struct, forbid_unknown_fields=True):
    """The numbers below [baseline]."""

    Kp: Number
    tau: Annotated[float, msgspec.Meta(gt=0.0, lt=1e300)]
    theta: Seconds = 0.0
    offset: Number = 0.0


class Page(msgspec.Struct, forbid_unknown_fields=True):
    """A model file; what stands below [[effects]] is checked by the effects themselves."""

    loop: Annotated[str, msgspec.Meta(min_length=1)]
    baseline: Baseline
    effects: list[dict[str, Any]] = []
    start: Moment = None
    end: Moment = None
    interval: Number | None = None
    pv_range: Span = None
    op_range: Span = None
    rmse_holdout: Number | None = None
    output: Span = None


def parse_model(text: str, where: str = "model file") -> Model:
    """Return the model that the text of a model file describes.

    Raises MetadataError with file, line and the nearest known names for whatever is not understood.
    """
    document = parsed(text, where)

    def wrong(what: str, remedy: str, head: str = "", key: str = "", place: int = 0) -> MetadataError:
        return MetadataError(what, where=_line(text, where, head, key, place), remedy=remedy)

    try:
        page = msgspec.convert(document, Page)
    except msgspec.ValidationError as error:
        raise _mistake(str(error), document, wrong) from None
    for key in ("pv_range", "op_range", "output"):
        span = getattr(page, key)
        if span is not None and not span[0] < span[1]:
            raise wrong(f"{key} must rise", f"write {key} = {EXAMPLES[key]}", key=key)
    known = {f: getattr(page, f) for f in page.__struct_fields__ if f not in ("baseline", "effects")}
    # a time without a zone is UTC
    known |= {k: (v if v.tzinfo else v.replace(tzinfo=UTC)).timestamp() for k, v in known.items()
              if isinstance(v, datetime)}
    return Model(**known, **msgspec.structs.asdict(page.baseline),
                 effects=tuple(_effect(entry, place, wrong) for place, entry in enumerate(page.effects)))


def _line(text: str, where: str, head: str, key: str, place: int) -> str:
    """Name file and line of a key below the heading numbered `place` of that name; else the file alone."""
    lines = [line.strip() for line in text.splitlines()]
    heads = [i + 1 for i, line in enumerate(lines) if head and line.replace(" ", "").startswith(head)]
    if head and place >= len(heads):
        return where
    first = heads[place] if head else 0
    for number, line in enumerate(lines[first:], first + 1):
        if not key or line.startswith("["):
            break
        if re.match(rf"['\"]?{re.escape(key)}['\"]?\s*=", line):
            return f"{where}, line {number}"
    return f"{where}, line {first}" if head and not key else where


def _mistake(said: str, document: Mapping[str, Any], wrong: Callable[..., MetadataError]) -> MetadataError:
    """Say in words what does not fit the page; said: what msgspec says of it, with the way to it."""
    what, _, way = said.partition(" - at `$")
    table, _, key = way.strip(".`").split("[")[0].rpartition(".")
    head = HEADS.get(table, "")
    if name := re.search(r"(unknown|missing required) field `(.+)`$", what):
        head = HEADS.get(key, "")
        if name[1] == "unknown":
            return wrong(f"unknown key '{name[2]}'", nearest(name[2], Baseline.__struct_fields__ if head else
                                                             Page.__struct_fields__), head, name[2])
        if name[2] == "loop":
            return wrong("the model does not say which loop it is of", 'add loop = "FIC101"', key="loop")
        return wrong(f"{name[2]} is missing", f"add {name[2]} = ... below {head or name[2]}", head)
    if key in HEADS:
        return wrong(f"{document[key]!r} is no {HEADS[key]}", f"write {HEADS[key]} on a line of its own", key=key)
    value = (document[table] if table else document)[key]
    remedy = f"write {key} = {EXAMPLES[key]}" if key in EXAMPLES else f"give one number: {BASELINE.get(key, key)}"
    return wrong(f"{key} = {value!r} is not possible", remedy, head, key)


def _effect(table: Mapping[str, Any], place: int, wrong: Callable[..., MetadataError]) -> ModelEffect:
    name, column, head = table.get("effect"), table.get("column", ""), HEADS["effects"]
    if not isinstance(name, str):
        raise wrong("an entry names no effect", 'add effect = "backlash"', head, place=place)
    try:
        effect = load_effect(name)
    except MetadataError as error:
        raise wrong(error.what, error.remedy, head, "effect", place) from error
    if not isinstance(column, str) or (effect.column and not column):
        key = "column" if "column" in table else ""
        raise wrong(f"{effect.name} needs the name of a measured column", 'add column = "DV1"', head, key, place)
    given = {k: v for k, v in table.items() if k not in ("effect", "column")}
    names = [q.name for q in effect.parameters]
    for key in given:
        if key not in names:
            raise wrong(f"unknown key '{key}' of {effect.name}", nearest(key, names), head, key, place)
        # one value at a time; lists go together, because their lengths must agree
        some = {k: v for k, v in given.items() if k == key or (isinstance(v, list) and isinstance(given[key], list))}
        try:
            effect.pack(some)
        except MetadataError as error:
            raise wrong(f"{key} = {given[key]}: {error.what}", error.remedy, head, key, place) from error
    values = {k: tuple(map(float, v)) if isinstance(v, list) else float(v) for k, v in given.items()}
    return ModelEffect(effect.name, values, column, name if ":" in name else "")


def model_text(model: Model) -> str:
    """Return a model as TOML text with a comment on every number; `parse_model` reads it back."""
    out = [
        "# Model of one loop, made by backlash: PV = Kp x lag(effects(OP)) + offset.",
        "# Change what you know better, then: backlash compare EXPORT --model THIS_FILE",
        "# Signals are normalised by the ranges (0.03 = 3 % of span), times are in seconds.",
    ]
    told = {key: getattr(model, key) for key in REMARKS}
    told |= {key: _time(told[key]) for key in ("start", "end") if told[key] is not None}
    out += [f"{key} = {_value(value)}{REMARKS[key]}" for key, value in told.items() if value is not None]
    out += ["", "[baseline]", *(f"{key} = {_value(getattr(model, key))}  # {words}" for key, words in BASELINE.items())]
    for entry in model.effects:
        effect = load_effect(entry.reference)
        out += ["", f"# {_comment(effect.sentence)}", HEADS["effects"], f"effect = {_value(entry.reference)}"]
        out += [f"column = {_value(entry.column)}"] if entry.column else []
        # values that do nothing are left out
        out += [f"{q.name} = {_value(value)}  # {_comment(q.meaning)} [{_comment(q.unit)}]" for q in effect.parameters
                if (value := entry.parameters.get(q.name)) not in (None, q.neutral, ())]
    return "\n".join(out) + "\n"


def _time(epoch: float) -> datetime | float:
    """A date; a number where it is no date."""
    try:
        return datetime.fromtimestamp(round(epoch, 3), UTC)
    except (OverflowError, ValueError, OSError):
        return epoch


def _value(value: object) -> str:
    """A value as TOML; of text quotes, backslashes and control characters are escaped."""
    match value:
        case str():
            kept = value.encode("utf-8", "replace").decode().replace("\\", "\\\\").replace('"', '\\"')
            return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in kept) + '"'
        case tuple():
            return f"[{', '.join(map(_value, value))}]"
        case datetime():
            return value.isoformat().replace("+00:00", "Z")
    return repr(float(f"{value:.8g}"))


def _comment(text: str) -> str:
    """Text on one line, without what a TOML comment may not hold."""
    return re.sub(r"\s+", " ", "".join(c if c.isprintable() else " " for c in text)).strip()
