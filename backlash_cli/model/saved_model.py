"""A fitted shape as a model that can be kept in a file of TOML text, changed by hand and used again tomorrow."""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from typing import Annotated, Any

import msgspec
import numpy as np

from ..effects import EFFECTS, Effect, Stage
from ..effects.registry import load_effect
from ..errors import LoopError, MetadataError, nearest
from ..record import BoolArray, FloatArray, Note, Record
from ..results import Model, ModelEffect
from ..toml_text import Page, checked, line_of, parsed, toml_value
from ..words import WORDS, explained, noted
from .fit import Fit, linear_values
from .pipeline import Part, Shape, as_tuple, in_order
from .problem import Problem, usual_output

Number = Annotated[float, msgspec.Meta(gt=-1e300, lt=1e300)]
Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=30 * 86400.0)]
Moment = datetime | Number | None
Span = tuple[Number, Number] | None
KEYS = WORDS["model_file"]
REMEDIES = KEYS["remedies"] | {key: f"give one number: {words}" for key, words in KEYS["numbers"].items()}
REMARKS = KEYS["remarks"] | {key: f"  # {words}" for key, words in KEYS["numbers"].items()}


class Baseline(Page, frozen=True):
    """The numbers below [baseline]."""

    Kp: Number
    tau: Annotated[float, msgspec.Meta(gt=0.0, le=30 * 86400.0)]
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
    output: Span = None
    rmse_holdout: Number | None = None


PLAIN = [key for key in ModelPage.__struct_fields__ if key not in ("baseline", "effects")]


def parse_model(text: str, where: str = "model file") -> Model:
    """Return the model that the text of a model file describes. Raises MetadataError with file, line and the nearest
    known names for whatever is not understood."""
    page = checked(parsed(text, where), ModelPage, where, text, words=REMEDIES)
    known = {key: getattr(page, key) for key in PLAIN}
    # a time without a zone is UTC
    known |= {k: (v if v.tzinfo else v.replace(tzinfo=UTC)).timestamp() for k, v in known.items()
              if isinstance(v, datetime)}
    rising = {key: known[key] for key in ("pv_range", "op_range", "output")} | {"end": (known["start"], known["end"])}
    for key, span in rising.items():
        if span is not None and None not in span and not span[0] < span[1]:
            what = "end lies before start" if key == "end" else f"{key} must rise"
            raise MetadataError(what, where=line_of(text, where, key), remedy=REMEDIES.get(key, "mend one of them"))
    if page.baseline.Kp == 0.0:
        where = line_of(text, where, "baseline", "Kp")
        raise MetadataError("with Kp = 0 OP moves nothing", where=where, remedy=REMEDIES["Kp"])
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
        raise MetadataError(**explained("no_effect_column", effect=effect.name), where=line(*{"column"} & table.keys()))
    given = {k: v for k, v in table.items() if k not in ("effect", "column")}
    names = [q.name for q in effect.parameters]
    for key in given:
        if key not in names:
            raise MetadataError(f"unknown key '{key}' of {effect.name}", where=line(key), remedy=nearest(key, names))
    try:
        effect.pack(given)
    except MetadataError as error:
        key = error.where.removeprefix(f"{effect.name}.")
        said = f"{key} = {given[key]}: {error.what}" if key else error.what
        raise MetadataError(said, where=line(key) if key else line(), remedy=error.remedy) from error
    values = {k: tuple(map(float, v)) if isinstance(v, list) else float(v) for k, v in given.items()}
    return ModelEffect(effect.name, values, column, name if ":" in name else "")


def model_text(model: Model) -> str:
    """Return a model as TOML text with a comment on every number; `parse_model` reads it back."""
    out = ["# Model of one loop, made by backlash: PV = Kp x lag(effects(OP)) + offset.",
        "# Change what you know better, then: backlash compare EXPORT --model THIS_FILE",
        "# Signals are normalised by the ranges (0.03 = 3 % of span), times are in seconds."]
    told = {key: getattr(model, key) for key in PLAIN}
    told |= {key: datetime.fromtimestamp(round(told[key], 3), UTC) for key in ("start", "end") if told[key] is not None}
    out += [f"{key} = {toml_value(value)}{REMARKS.get(key, '')}" for key, value in told.items() if value is not None]
    numbers = Baseline.__struct_fields__
    out += ["", "[baseline]", *(f"{key} = {toml_value(getattr(model, key))}{REMARKS[key]}" for key in numbers)]
    for entry in model.effects:
        effect = load_effect(entry.reference)
        out += ["", f"# {_comment(effect.sentence)}", "[[effects]]", f"effect = {toml_value(entry.reference)}"]
        out += [f"column = {toml_value(entry.column)}"] if entry.column else []
        # values that do nothing are left out
        out += [f"{q.name} = {toml_value(value)}  # {_comment(f'{q.meaning} [{q.unit}]')}" for q in effect.parameters
                if (value := entry.parameters.get(q.name)) not in (None, q.neutral, ())]
    return "\n".join(out) + "\n"


def _comment(text: str) -> str:
    """Text on one line, without what a TOML comment may not hold."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def kept_model(record: Record, problem: Problem, fitted: Fit, recorders: Sequence[Part], rmse_holdout: float) -> Model:
    """Return a fit as a model of its own, every number in it."""
    values = [*linear_values(fitted), *(dict(p.values) for p in recorders)]
    entries = [ModelEffect(p.effect.name, v, p.column, reference(p.effect))
               for p, v in zip((*fitted.shape.parts, *recorders), values, strict=True)]
    start, end = record.time[[0, -1]].tolist()
    return Model(record.loop, fitted.gain, fitted.shape.lag, float(fitted.coefficients[1]), fitted.shape.delay,
        tuple(entries), start, end, record.interval, record.settings.pv_range, record.settings.op_range, rmse_holdout,
        usual_output(problem))


def reference(effect: Effect) -> str:
    """Return `module:NAME` of an effect from outside, empty for the project's own."""
    if any(effect is own for own in EFFECTS):
        return ""
    module = getattr(effect.step, "__module__", "")
    names = vars(sys.modules[module]).items() if module in sys.modules else ()
    return next((f"{module}:{name}" for name, value in names if value is effect), "")


def seen_by(model: Model, problem: Problem) -> BoolArray:
    """Return which grid points lie in the record that the model was fitted to, (samples,); none when it is not told."""
    time, slack = problem.time, 0.5 * problem.interval
    if model.start is None or model.end is None:
        return np.zeros(problem.samples, dtype=bool)
    return (time >= model.start - slack) & (time <= model.end + slack)


def apart(model: Model, problem: Problem) -> bool:
    """True when a record shares no time with the one that the model was fitted to."""
    return model.start is not None and model.end is not None and not seen_by(model, problem).any()


def of_its_day(effect: Effect) -> bool:
    """True for a load that nobody measured and that does not come back: it says nothing about another day."""
    return effect.stage == Stage.LOAD and bool(effect.fitting.linear) and not effect.column and not effect.fitting.phase


def loads_left_out(model: Model, problem: Problem) -> tuple[Note, ...]:
    """Return what a reader should know about loads of the model that belong to another day than this record."""
    if not apart(model, problem):
        return ()
    effects = [load_effect(entry.reference) for entry in model.effects]
    out = []
    if gone := [e.name for e in effects if of_its_day(e)]:
        names = " and ".join(name.replace("_", " ") for name in gone)
        out.append(noted("loads_of_another_day", {"effects": ", ".join(gone)}, names=names, s="s" * (len(gone) == 1)))
    if swings := [e.name for e in effects if e.fitting.phase]:
        out.append(noted("swing_matched", {"effects": ", ".join(swings)}))
    return tuple(out)


def shape_of(model: Model, problem: Problem) -> tuple[Shape, tuple[Part, ...]]:
    """Return the shape of a model, with the times of events moved to those of the record and without loads of another
    day, and its recorders. Raises LoopError when a measured column that the model needs is not in the record."""
    parts, recorders = list[Part](), list[Part]()
    later = 0.0 if model.start is None else problem.start - model.start
    for entry in model.effects:
        effect = load_effect(entry.reference)
        if of_its_day(effect) and apart(model, problem):
            continue
        if entry.column and entry.column not in problem.columns:
            known = ", ".join(problem.columns) or "none"
            raise LoopError(**explained("missing_column", column=entry.column, known=known, effect=effect.name),
                            where=problem.loop)
        values = {q.name: entry.parameters.get(q.name, () if q.many else q.neutral) for q in effect.parameters}
        if effect.fitting.linear:
            # what is told in seconds from the first sample; what ended before stays as a constant push
            values |= {q.name: tuple(max(t - later, 0.0) for t in as_tuple(values[q.name])) for q in effect.parameters
                       if q.many and q.unit == "s"}
        if effect.fitting.phase and "period" in values and later:
            turn = 2.0 * np.pi * later / as_tuple(values["period"])[0] + as_tuple(values[effect.fitting.phase])[0]
            values[effect.fitting.phase] = float(np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi)
        part = Part(effect, values, entry.column)
        (recorders if part.is_recorder else parts).append(part)
    return Shape(model.tau, model.theta, in_order(parts)), in_order(recorders)


def in_ranges_of(record: Record, model: Model) -> Record:
    """Return a record whose ranges were guessed from its data on the ranges of a model: a day on which PV went higher
    is guessed a longer range, and the numbers of a model mean something on their own only. Others stay as they are."""
    s, spans = record.settings, dict[str, tuple[float, float]]()
    for key in ("pv_range", "op_range"):
        span = getattr(model, key)
        if span is not None and s.source.get(key) == "data" and tuple(span) != tuple(getattr(s, key)):
            spans[key] = float(span[0]), float(span[1])
    if not spans:
        return record

    def moved(values: FloatArray, key: str) -> FloatArray:
        (was, end), (low, high) = getattr(s, key), spans.get(key, getattr(s, key))
        return np.asarray((was + (end - was) * values - low) / (high - low))

    pv, op = (float(np.ptp(moved(np.arange(2.0), key))) for key in ("pv_range", "op_range"))
    settings = replace(s, **spans, K=s.K and s.K * op / pv, Kp=s.Kp and s.Kp * pv / op)  # type: ignore[arg-type]
    told = tuple(note for note in record.notes if note.code not in {f"guessed_{key}" for key in spans})
    return replace(record, settings=settings, notes=told, setpoint=moved(record.setpoint, "pv_range"),
                   measurement=moved(record.measurement, "pv_range"),
                   output=None if record.output is None else moved(record.output, "op_range"))
