"""A fitted shape as a model that can be kept in a file, and back."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..effects import EFFECTS, Effect, Stage
from ..effects.registry import load_effect
from ..errors import LoopError
from ..record import FloatArray, Note, Record
from ..results import Model, ModelEffect
from .fit import Fit, linear_values
from .pipeline import Part, Shape, as_tuple, in_order
from .problem import Problem, usual_output


def kept_model(record: Record, problem: Problem, fitted: Fit, recorders: Sequence[Part], rmse_holdout: float) -> Model:
    """Return a fit as a model of its own, every number in it."""
    values = [*linear_values(problem, fitted), *(dict(p.values) for p in recorders)]
    entries = [ModelEffect(p.effect.name, v, p.column, reference(p.effect))
               for p, v in zip((*fitted.shape.parts, *recorders), values, strict=True)]
    start, end = record.time[[0, -1]].tolist()
    return Model(
        record.loop, fitted.gain, fitted.shape.lag, float(fitted.coefficients[1]), fitted.shape.delay, tuple(entries),
        start, end, record.interval, record.settings.pv_range, record.settings.op_range, rmse_holdout,
        usual_output(problem),
    )


def reference(effect: Effect) -> str:
    """Return `module:NAME` of an effect from outside, empty for the project's own."""
    if any(effect is own for own in EFFECTS):
        return ""
    module = getattr(effect.step, "__module__", "")
    names = vars(sys.modules[module]).items() if module in sys.modules else ()
    return next((f"{module}:{name}" for name, value in names if value is effect), "")


def apart(model: Model, problem: Problem) -> bool:
    """True when a record shares no time with the one that the model was fitted to."""
    if model.start is None or model.end is None:
        return False
    return problem.start > model.end or problem.start + problem.duration <= model.start


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
        out.append(Note("loads_of_another_day", f"{names} of the model belong{'s' * (len(gone) == 1)} to the time it "
                        "was fitted to and cannot be foretold: left out here", {"effects": ", ".join(gone)}))
    if swings := [e.name for e in effects if e.fitting.phase]:
        out.append(Note("swing_matched", "the swing from outside keeps its period and size; where it stood when this "
                        "record began was matched to this record", {"effects": ", ".join(swings)}))
    return tuple(out)


def parts_of(model: Model, problem: Problem) -> tuple[Part, ...]:
    """Return the effects of a model as parts, with the times of events moved to those of the record.

    Loads that belong to another day are left out (see `loads_left_out`).
    Raises LoopError when a measured column that the model needs is not in the record.
    """
    out = []
    later = 0.0 if model.start is None else problem.start - model.start
    for entry in model.effects:
        effect = load_effect(entry.reference)
        if of_its_day(effect) and apart(model, problem):
            continue
        if entry.column and entry.column not in problem.columns:
            known = ", ".join(problem.columns) or "none"
            raise LoopError(f"the model uses the measured column {entry.column}, which this record does not have",
                            where=problem.loop, code="missing_column",
                            remedy=f"columns here: {known}; or take {effect.name} out of the model file")
        values = {q.name: entry.parameters.get(q.name, () if q.many else q.neutral) for q in effect.parameters}
        if effect.fitting.linear:
            # what is told in seconds from the first sample; what ended before stays as a constant push
            values |= {q.name: tuple(max(t - later, 0.0) for t in as_tuple(values[q.name])) for q in effect.parameters
                       if q.many and q.unit == "s"}
        if effect.fitting.phase and "period" in values and later:
            turn = 2.0 * np.pi * later / as_tuple(values["period"])[0] + as_tuple(values[effect.fitting.phase])[0]
            values[effect.fitting.phase] = float(np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi)
        out.append(Part(effect, values, entry.column))
    return in_order(out)


def in_ranges_of(record: Record, model: Model) -> Record:
    """Return a record whose ranges were guessed from its data on the ranges of a model; others stay as they are.

    A day on which PV went higher is guessed a longer range; the numbers of a model mean something on their own only.
    """
    s = record.settings
    other = {key: (float(span[0]), float(span[1])) for key in ("pv_range", "op_range")
             if (span := getattr(model, key)) is not None and s.source.get(key) == "data"
             and tuple(span) != tuple(getattr(s, key))}
    if not other:
        return record
    pv, op = (other.get(key, getattr(s, key)) for key in ("pv_range", "op_range"))
    PV, OP = ((span[1] - span[0]) / (was[1] - was[0]) for span, was in ((pv, s.pv_range), (op, s.op_range)))

    def moved(values: FloatArray, was: tuple[float, float], span: tuple[float, float]) -> FloatArray:
        return (was[0] + (was[1] - was[0]) * values - span[0]) / (span[1] - span[0])

    settings = replace(s, pv_range=pv, op_range=op, K=None if s.K is None else s.K * PV / OP,
                       Kp=None if s.Kp is None else s.Kp * OP / PV)
    told = tuple(note for note in record.notes if note.code not in {f"guessed_{key}" for key in other})
    return replace(
        record, settings=settings, notes=told, setpoint=moved(record.setpoint, s.pv_range, pv),
        measurement=moved(record.measurement, s.pv_range, pv),
        output=None if record.output is None else moved(record.output, s.op_range, op))


def shape_of(model: Model, parts: Sequence[Part]) -> Shape:
    """Return the searched part of a model."""
    return Shape(model.tau, model.theta, tuple(p for p in parts if not p.is_recorder))


def coefficients_of(model: Model, problem: Problem, shape: Shape) -> FloatArray:
    """Return the coefficients of all regressors as the model has them; start and holes are 0."""
    out: list[float] = []
    for part in shape.parts:
        phase = part.effect.fitting.phase
        turns = (0.0, 0.5 * np.pi) if phase else (0.0,)
        turn = as_tuple(part.values[phase])[0] if phase else 0.0
        out += [v * np.cos(turn - more) for name in part.effect.fitting.linear for v in as_tuple(part.values[name])
                for more in turns]
    return np.concatenate([[model.Kp, model.offset, 0.0], np.zeros(len(problem.holes)), model.Kp * np.array(out)])
