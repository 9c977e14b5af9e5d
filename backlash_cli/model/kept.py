"""A fitted shape as a model that can be kept in a file, and back."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..effects import EFFECTS, Effect
from ..effects.registry import load_effect
from ..errors import LoopError
from ..record import FloatArray, Record
from ..results import Model, ModelEffect
from .fit import Fit
from .linear import linear_values
from .pipeline import Part, Shape, as_tuple, in_order
from .problem import Problem


def kept_model(record: Record, problem: Problem, fitted: Fit, recorders: Sequence[Part], rmse_holdout: float) -> Model:
    """Return a fit as a model of its own, every number in it."""
    entries = [
        ModelEffect(part.effect.name, values, part.column, reference(part.effect))
        for part, values in zip(fitted.shape.parts, linear_values(problem, fitted), strict=True)
    ]
    entries += [ModelEffect(p.effect.name, dict(p.values), p.column, reference(p.effect)) for p in recorders]
    times = record.time
    return Model(
        loop=record.loop,
        Kp=fitted.gain,
        tau=fitted.shape.lag,
        theta=fitted.shape.delay,
        offset=float(fitted.coefficients[1]),
        effects=tuple(entries),
        start=float(times[0]),
        end=float(times[-1]),
        interval=record.interval,
        pv_range=record.settings.pv_range,
        op_range=record.settings.op_range,
        rmse_holdout=rmse_holdout,
    )


def reference(effect: Effect) -> str:
    """Return `module:NAME` of an effect from outside, empty for the project's own."""
    if any(effect is own for own in EFFECTS):
        return ""
    module = getattr(effect.step, "__module__", "")
    for name, value in vars(sys.modules.get(module, object)).items() if module in sys.modules else ():
        if value is effect:
            return f"{module}:{name}"
    return ""


def parts_of(model: Model, problem: Problem, start: float) -> tuple[Part, ...]:
    """Return the effects of a model as parts, with the times of events moved to a record that begins at `start`.

    Raises LoopError when a measured column that the model needs is not in the record.
    """
    out = []
    later = 0.0 if model.start is None else start - model.start
    for entry in model.effects:
        effect = load_effect(entry.reference)
        if entry.column and entry.column not in problem.columns:
            known = ", ".join(problem.columns) or "none"
            raise LoopError(
                f"the model uses the measured column {entry.column}, which this record does not have",
                where=problem.loop, remedy=f"columns here: {known}; or take {effect.name} out of the model file",
                code="missing_column",
            )  # fmt: skip
        values = {q.name: entry.parameters.get(q.name, () if q.many else q.neutral) for q in effect.parameters}
        out.append(Part(effect, _moved(effect, values, later, problem), entry.column))
    return in_order(out)


def _moved(
    effect: Effect, values: dict[str, float | tuple[float, ...]], later: float, problem: Problem
) -> dict[str, float | tuple[float, ...]]:
    """Move what is told in seconds from the first sample; what ended before the record stays as a constant push."""
    if later == 0.0 or not effect.fitting.linear:
        return values
    for q in effect.parameters:
        if q.many and q.unit == "s":
            values[q.name] = tuple(max(t - later, 0.0) for t in as_tuple(values[q.name]))
    if effect.fitting.phase and "period" in values:
        turn = 2.0 * np.pi * later / as_tuple(values["period"])[0] + as_tuple(values[effect.fitting.phase])[0]
        values[effect.fitting.phase] = float(np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi)
    return values


def shape_of(model: Model, parts: Sequence[Part]) -> Shape:
    """Return the searched part of a model."""
    return Shape(model.tau, model.theta, tuple(p for p in parts if not p.is_recorder))


def coefficients_of(model: Model, problem: Problem, shape: Shape) -> FloatArray:
    """Return the coefficients of all regressors as the model has them; start and holes are 0."""
    out = [model.Kp, model.offset, 0.0, *(0.0 for _ in problem.holes)]
    for part in shape.parts:
        for name in part.effect.fitting.linear if part.is_linear else ():
            for value in as_tuple(part.values[name]):
                if part.effect.fitting.phase:
                    turn = as_tuple(part.values[part.effect.fitting.phase])[0]
                    out += [model.Kp * value * np.cos(turn), model.Kp * value * np.sin(turn)]
                else:
                    out.append(model.Kp * value)
    return np.array(out, dtype=np.float64)


def freed(model: Model, parts: Sequence[Part], problem: Problem) -> Shape:
    """Return the shape of a model as a start for a fit: what is solved for is set to nothing."""
    shape = shape_of(model, parts)
    delay = shape.delay if problem.delay is None else problem.delay
    return replace(shape, delay=delay)
