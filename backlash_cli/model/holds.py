"""Why a kept model does not hold on another record: another operating point, another process, an effect that is gone.

Each possible reason is tried by itself on the new record and told only where the error falls with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..record import Note
from ..results import Model
from .fit import Solver, finished, fit
from .holdout import Tested, better, tested
from .noise import whitener
from .pipeline import Part, Shape, moved_output, moved_process
from .problem import Problem
from .recorder import fitted_problem

# errors closer than this share say the same
ABOUT = 0.1
# the model must say that PV moves by this many times its noise before it can be judged
LEAST_MOTION = 3.0
# share of this record's OP that must lie where OP was when the model was fitted
SAME_PLACE = 0.5
# less than this share of OP's travel at the stem: next to nothing reaches the process
LITTLE = 0.3
UNITS = {"span": (100.0, " %"), "OP span": (100.0, " %"), "1/s": (100.0, " % per second")}
# time constants tried beside the kept one, as shares of it; then finer around the best
SHARES = np.geomspace(0.2, 5.0, 13)


def why_not(
    problem: Problem,
    model: Model,
    shape: Shape,
    recorders: tuple[Part, ...],
    plain: Tested,
    holdout: float,
    error_of: Callable[[Model, Shape], float | None],
) -> tuple[Note, ...]:
    """Return the reasons why a kept model predicts a record no better than the plain one fitted to it; () if it does.

    shape: of the model, matched to this record. holdout: its error here. error_of: hold-out error of another model.
    """
    if holdout < (1.0 - ABOUT) * plain.rmse_holdout:
        return ()
    found = [*_motion(problem, model, shape), *_place(problem, model)]
    return tuple([*found, *_gone(model, shape, holdout, error_of), *_process(problem, model, shape, recorders, plain)])


def _motion(problem: Problem, model: Model, shape: Shape) -> list[Note]:
    motion = abs(model.Kp) * float(np.std(moved_process(problem, shape)[problem.used])) / problem.floor
    if motion >= LEAST_MOTION:
        return []
    return [Note("too_little_motion", f"after this model PV follows OP here by only {motion:.1f} times its noise: too "
                 "little motion to judge it", {"motion": motion})]


def _place(problem: Problem, model: Model) -> list[Note]:
    here = usual_output(problem)
    if model.output is None or here is None:
        return []
    u = problem.output[problem.used]
    low, high = model.output
    slack = 0.1 * (high - low)
    inside = float(np.mean((u >= low - slack) & (u <= high + slack)))
    if inside >= SAME_PLACE:
        return []
    return [Note(
        "other_operating_point",
        f"another operating point: OP was {100 * low:.3g} to {100 * high:.3g} % of its span when the model was fitted, "
        f"here it is {100 * here[0]:.3g} to {100 * here[1]:.3g} %", {"share_inside": inside},
    )]  # fmt: skip


def usual_output(problem: Problem) -> tuple[float, float] | None:
    """Return the range in which OP [span] was for all but one sample in fifty; None where it hardly moved."""
    low, high = np.quantile(problem.output[problem.used], [0.01, 0.99])
    return (float(low), float(high)) if high > low + 1e-6 else None


def _gone(
    model: Model, shape: Shape, holdout: float, error_of: Callable[[Model, Shape], float | None]
) -> list[Note]:
    """Effects without which the kept model does better here."""
    out = []
    for part in shape.parts:
        name = part.effect.name
        less = error_of(model.without(name), shape.without(name))
        if less is not None and less < (1.0 - ABOUT) * holdout:
            words = name.replace("_", " ")
            out.append(Note(
                "effect_not_here",
                f"{words} does not fit this record: without it the model's error is {100 * less:.3g} % instead of "
                f"{100 * holdout:.3g} %", {"effect": name, "rmse_holdout": less},
            ))  # fmt: skip
    return out


def _process(
    problem: Problem, model: Model, shape: Shape, recorders: tuple[Part, ...], plain: Tested
) -> list[Note]:
    """Whether the effects hold with a gain and a time constant of this record, or else with other numbers of theirs."""
    noise = plain.fit.noise
    solver = Solver(problem, whitener(noise, problem.used, problem.interval))
    seen = fitted_problem(problem, recorders)

    def best(lags: Sequence[float]) -> Shape:
        return min((replace(shape, lag=float(lag)) for lag in lags), key=solver.rss)

    least, most = 0.2 * problem.interval, 0.5 * problem.duration
    near = best(np.clip(model.tau * SHARES, least, most).tolist())
    near = best(np.clip(near.lag * np.geomspace(0.78, 1.28, 9), least, most).tolist())
    process = tested(problem, finished(seen, near, noise), recorders, rounds=0)
    whole = better(problem, fit(seen, near, noise), recorders)
    moved = _changes(shape, whole.fit.shape)
    # more numbers fit better, always: they must do so clearly to be the reason
    if moved and whole.rmse_holdout < (1.0 - ABOUT) * min(process.rmse_holdout, plain.rmse_holdout):
        numbers = ", ".join([*moved, *_of_process(model, whole)])
        message = (f"the same effects fit this record with other numbers: {numbers}; then the error is "
                   f"{100 * whole.rmse_holdout:.3g} %")
        travel, stem = (float(np.ptp(np.quantile(x[problem.used], [0.01, 0.99])))
                        for x in (problem.output, moved_output(problem, whole.fit.shape.parts)))
        if stem < LITTLE * travel:
            message += (f". Of {100 * travel:.2g} % that OP travels, only {100 * stem:.2g} % reach the stem: gain and "
                        "time constant are not well known from such a record")
        values = {"rmse_holdout": whole.rmse_holdout, "travel": travel, "stem": stem}
        return [Note("numbers_changed", message, values)]
    changed = _of_process(model, process)
    if not changed or process.rmse_holdout >= (1.0 - ABOUT) * plain.rmse_holdout:
        return []
    names = " and ".join(part.effect.name.replace("_", " ") for part in shape.parts)
    held = f", and {names} as kept" if names else ""
    return [Note(
        "process_changed",
        f"the process answers differently here: with {' and '.join(changed)}{held}, the error is "
        f"{100 * process.rmse_holdout:.3g} %",
        {"Kp": process.fit.gain, "tau": near.lag, "rmse_holdout": process.rmse_holdout},
    )]  # fmt: skip


def _of_process(model: Model, now: Tested) -> list[str]:
    """Name gain and time constant where they differ from the kept ones."""
    both = [("gain", now.fit.gain, model.Kp, ""), ("time constant", now.fit.shape.lag, model.tau, " s")]
    far = [one for one in both if abs(one[1] - one[2]) > ABOUT * abs(one[2])]
    return [f"{name} {here:.3g}{unit} (kept: {kept:.3g}{unit})" for name, here, kept, unit in far]


def _changes(before: Shape, after: Shape) -> list[str]:
    """Name the numbers of effects that differ by more than ABOUT, in words; signs, starts and events left out."""
    said = []
    for old, new in zip(before.parts, after.parts, strict=True):
        for q in old.effect.parameters:
            one, other = old.values.get(q.name), new.values.get(q.name)
            if not isinstance(one, float) or not isinstance(other, float) or q.nuisance or old.is_linear:
                continue
            if np.isfinite([one, other]).all() and abs(one - other) > ABOUT * abs(one):
                scale, unit = UNITS.get(q.unit, (1.0, "" if q.unit == "1" else f" {q.unit}"))
                name = old.effect.name.replace("_", " ")
                said.append(f"{name} {q.name} = {scale * other:.3g}{unit} (kept: {scale * one:.3g}{unit})")
    return said
