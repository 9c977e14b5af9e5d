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
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from typing import Annotated, Any

import msgspec

from ..effects.registry import load_effect
from ..errors import MetadataError, nearest
from ..results import Model, ModelEffect
from ..toml_text import Page, checked, line_of, parsed

Number = Annotated[float, msgspec.Meta(gt=-1e300, lt=1e300)]
Seconds = Annotated[float, msgspec.Meta(ge=0.0, lt=1e300)]
Moment = datetime | Number | None
Span = tuple[Number, Number] | None
BASELINE = {"Kp": "static gain [PV span / OP span]", "tau": "time constant [s]", "theta": "dead time [s]",
            "offset": "PV at no output [PV span]"}
WORDS = {"loop": 'write loop = "FIC101"', "start": "write start = 2026-03-02T06:00:00Z",
         "end": "write end = 2026-03-02T18:00:00Z", "pv_range": "write pv_range = [0, 100]",
         "op_range": "write op_range = [0, 100]", "output": "write output = [0.2, 0.6]",
         "baseline": "write [baseline] on a line of its own", "effects": "write [[effects]] on a line of its own",
         "interval": "give one number: between samples [s]", "rmse_holdout": "give one number: error [PV span]",
         **{key: f"give one number: {words}" for key, words in BASELINE.items()}}  # what to write instead
# what stands behind each key of a file that is written
REMARKS = {
    "loop": "", "start": "  # of the record it was fitted to; times of events count from here", "end": "",
    "interval": "  # between samples [s]", "pv_range": "", "op_range": "", "output": "  # where OP was then [span]",
    "rmse_holdout": "  # error on samples the fit did not see",
}  # fmt: skip


class Baseline(Page, frozen=True):
    """The numbers below [baseline]."""

    Kp: Number
    tau: Annotated[float, msgspec.Meta(gt=0.0, lt=1e300)]
    theta: Seconds = 0.0
    offset: Number = 0.0


class ModelPage(Page, frozen=True):
    """A model file; what stands below [[effects]] is checked by the effects themselves."""

    loop: Annotated[str, msgspec.Meta(min_length=1)]
    baseline: Baseline
    effects: Sequence[dict[str, Any]] = ()
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
    page = checked(parsed(text, where), ModelPage, where, text, words=WORDS)
    for key in ("pv_range", "op_range", "output"):
        span = getattr(page, key)
        if span is not None and not span[0] < span[1]:
            raise MetadataError(f"{key} must rise", where=line_of(text, where, key), remedy=WORDS[key])
    known = {f: getattr(page, f) for f in page.__struct_fields__ if f not in ("baseline", "effects")}
    # a time without a zone is UTC
    known |= {k: (v if v.tzinfo else v.replace(tzinfo=UTC)).timestamp() for k, v in known.items()
              if isinstance(v, datetime)}
    return Model(**known, **msgspec.structs.asdict(page.baseline),
                 effects=tuple(_effect(entry, partial(line_of, text, where, "effects", place))
                               for place, entry in enumerate(page.effects)))


def _effect(table: Mapping[str, Any], line: Callable[..., str]) -> ModelEffect:
    """Return one effect. line: names the line of the entry, or of a key in it."""
    name, column = table.get("effect"), table.get("column", "")
    if not isinstance(name, str):
        raise MetadataError("an entry names no effect", where=line(), remedy='add effect = "backlash"')
    try:
        effect = load_effect(name)
    except MetadataError as error:
        raise MetadataError(error.what, where=line("effect"), remedy=error.remedy) from error
    if not isinstance(column, str) or (effect.column and not column):
        raise MetadataError(f"{effect.name} needs the name of a measured column", remedy='add column = "DV1"',
                            where=line("column") if "column" in table else line())
    given = {k: v for k, v in table.items() if k not in ("effect", "column")}
    names = [q.name for q in effect.parameters]
    for key in given:
        if key not in names:
            raise MetadataError(f"unknown key '{key}' of {effect.name}", where=line(key), remedy=nearest(key, names))
        # one value at a time; lists go together, because their lengths must agree
        some = {k: v for k, v in given.items() if k == key or (isinstance(v, list) and isinstance(given[key], list))}
        try:
            effect.pack(some)
        except MetadataError as error:
            raise MetadataError(f"{key} = {given[key]}: {error.what}", where=line(key), remedy=error.remedy) from error
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
        out += ["", f"# {_comment(effect.sentence)}", "[[effects]]", f"effect = {_value(entry.reference)}"]
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
