"""Compares a model with the measurements of a loop: how far off, how far at best, and where."""

from dataclasses import replace

import numpy as np

from ..effects.process import delayed_lag
from ..record import BoolArray, FloatArray, Note, Record
from ..results import Comparison, Fitness, FittedParameter, Model, Series
from ..words import noted
from .fit import BENT_ROUNDS, predicted_by, rms, with_load
from .holdout import better, distance, folds
from .intervals import described, process_parameters
from .locate import regions
from .pipeline import Part, Shape, as_tuple, load_regressors, moved_output, moved_process, sensed_slopes, through
from .problem import FEWEST_SAMPLES, Problem, problem_from_record, readings
from .reasons import why_not
from .saved_model import apart, in_ranges_of, kept_model, loads_left_out, seen_by, shape_of
from .search import baseline

STEADY = 1e-3  # a setpoint that stays within this range [span] does not move


def compare(record: Record, model: Model | None = None) -> Comparison:
    """Predict PV from OP with a model, by default the plain one fitted to this record, and say where it fails.

    The numbers of a given model are kept; only the offset, the forgotten start and the place of the stem at the
    start are matched, in turn on the other blocks for the hold-out error. A record that the model was not fitted to
    is all hold-out; for its own record the hold-out error is the one that the model keeps.
    Raises LoopError when there is nothing to compare (no OP, constant signals, too few samples)."""
    record = record if model is None else in_ranges_of(record, model)
    problem = problem_from_record(record)
    plain = better(problem, baseline(problem))
    base = fitness = Fitness(plain.rmse, plain.rmse_holdout, process_parameters(problem, plain.fit))
    parts, recorders, reasons, seen = tuple[Part, ...](), tuple[Part, ...](), tuple[Note, ...](), 1.0
    if model is None:
        shape, predicted = plain.fit.shape, predicted_by(problem, plain.fit)
        kept = kept_model(record, problem, plain.fit, (), plain.rmse_holdout)
    else:
        kept, (shape, recorders) = model, shape_of(model, problem)
        parts = (*shape.parts, *recorders)
        # OP as recorded, or as it was before rounding where the model predicts better from it
        problem = min(readings(problem), key=lambda p: rms((p.measurement - matched(p, kept, shape)[1])[p.used]))
        known = seen_by(model, problem)
        seen = float(np.mean(known[problem.used]))
        shape, predicted = matched(problem, model, shape)
        predicted = with_load(problem, predicted, None)
        rmse = rms(distance(problem, recorders, predicted)[problem.used])
        holdout = error_unseen(problem, model, shape, recorders, known)
        if holdout is None:
            # numbers fitted to these very samples: what the file says, unless numbers were changed for the worse since
            holdout = max(rmse, model.rmse_holdout or 0.0)
        if seen < 1.0:
            reasons = why_not(problem, model, shape, recorders, plain, holdout,
                              lambda less, of: error_unseen(problem, less, of, recorders, known))
        units = {"Kp": "1", "tau": "s", "theta": "s", "offset": "PV span"}
        fitness = Fitness(rmse, holdout, {n: FittedParameter(getattr(model, n), unit) for n, unit in units.items()})
    return Comparison(loop=record.loop, baseline=base, fitness=fitness, fitted=model is None, noise_floor=problem.floor,
        seen=seen, where=regions(problem, distance(problem, recorders, predicted), shape),
        effects=tuple(described(part, part.values) for part in parts),
        unexplained=unexplained(fitness.rmse_holdout, base.rmse_holdout, problem.floor), reasons=reasons,
        warnings=notes(problem, record, model), series=series_of(problem, predicted, shape), settings=record.settings,
        model=kept)


def error_unseen(problem: Problem, model: Model, shape: Shape, recorders: tuple[Part, ...], known: BoolArray
                 ) -> float | None:
    """Return the error of a kept model on samples that neither its fit nor the matching of offset and start saw; None
    where these are fewer than FEWEST_SAMPLES."""
    if np.count_nonzero(problem.used & ~known) < FEWEST_SAMPLES:
        return None
    errors = []
    for left_out in folds(problem, problem.settings.Ti or model.tau):
        shown = replace(problem, used=problem.used & ~left_out)
        predicted = with_load(problem, matched(shown, model, shape)[1], None)
        errors.append(distance(problem, recorders, predicted)[left_out & problem.used & ~known])
    unseen = np.concatenate(errors)
    return rms(unseen) if unseen.size else None


def matched(problem: Problem, model: Model, shape: Shape) -> tuple[Shape, FloatArray]:
    """Return the shape with the stem placed as this record begins, on another day the phase of a swing as well, and PV
    predicted with offset and start matched."""

    def predict(s: Shape) -> tuple[FloatArray, float]:
        loads = [*(p for p in s.parts if p.is_linear), *(p for p in s.parts if p.effect.fitting.on_loads)]
        pushed = delayed_lag(through(problem, loads, np.zeros(problem.samples)), problem.interval, s.lag, 0.0)
        process = model.Kp * (moved_process(problem, s) + pushed) + model.offset
        # offset and start belong to the record, not to the model
        own = load_regressors(problem, replace(s, parts=tuple(p for p in s.parts if not p.is_linear)))
        small = 1e-6 * np.eye(own.shape[1])
        for _ in range(BENT_ROUNDS if s.sensors else 1):
            rest = problem.measurement - through(problem, s.sensors, process)
            A = sensed_slopes(problem, s, process, own)[problem.used]
            process = process + own @ np.linalg.solve(A.T @ A + small, A.T @ rest[problem.used])
        predicted = through(problem, s.sensors, process)
        return predicted, float(np.sum((problem.measurement - predicted)[problem.used] ** 2))

    def best(place: int, name: str, values: FloatArray) -> Shape:
        tries = [shape.with_values(place, **{name: float(v)}) for v in values]
        return min([shape, *tries], key=lambda s: predict(s)[1])

    for place, part in enumerate(shape.parts):
        for q in part.effect.parameters:
            if q.nuisance and not q.many and not part.is_linear and np.isfinite([q.low, q.high]).all():
                shape = best(place, q.name, np.linspace(q.low, q.high, 9))
        if part.effect.fitting.phase and apart(model, problem):
            # the period of a swing is not known well enough to tell its phase a day later
            name, turn = part.effect.fitting.phase, np.linspace(-np.pi, np.pi, 16, endpoint=False)
            shape = best(place, name, turn)
            shape = best(place, name, as_tuple(shape.parts[place].values[name])[0] + turn / 16.0)
    return shape, predict(shape)[0]


def unexplained(rmse: float, base: float, floor: float) -> float:
    """Return the share of the squared error above the noise floor that a model leaves of the baseline's."""
    above = base**2 - floor**2
    return float(np.clip((rmse**2 - floor**2) / above, 0.0, 1.0)) if above > 0.0 else float(rmse >= base)


def series_of(problem: Problem, predicted: FloatArray, shape: Shape) -> Series:
    """Return measured and predicted PV on the grid, with the stem position for pictures."""
    valve = moved_output(problem, [p for p in shape.parts if p.effect.stage in ("command", "valve")])
    return Series(problem.time, problem.setpoint, problem.output, problem.recorded, predicted, problem.used.copy(),
                  {"valve": valve})


def notes(problem: Problem, record: Record, model: Model | None = None) -> tuple[Note, ...]:
    """Return what a reader should know about the record before believing a model of it."""
    out = [*record.notes]
    out += () if model is None else loads_left_out(model, problem)
    missing = float(np.mean(np.isnan(problem.recorded)))
    if missing > 0.1:
        out.append(noted("many_gaps", {"share": missing}))
    if problem.by_load:
        steady = float(np.ptp(problem.setpoint[problem.used])) < STEADY
        out.append(noted("load_driven" if steady else "predicted_ahead",
                         {"driven": problem.driven, "ahead_s": problem.ahead * problem.interval}))
    if problem.holes:
        out.append(noted("output_holes", {"holes": problem.holes}))
    if problem.origin == "completed":
        out.append(noted("output_completed"))
    return tuple(out)
