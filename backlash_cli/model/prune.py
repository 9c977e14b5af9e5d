"""Takes out of a model what is not worth its price: whole effects, and single events such as one of several steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .candidates import wander
from .fit import Fit, Solver, fit
from .holdout import better
from .judge import ENOUGH, Judge, jumpy
from .noise import whitener
from .pipeline import Part, Shape, as_tuple, moved_process, predict, through
from .problem import Problem

# without an effect that is worth telling, the error on unseen samples is at least this many times larger
WORTH_TELLING = 1.08
# with this gain in score it may also be a little smaller
BEYOND_DOUBT = 200.0
# a short way ahead most of the error is load that nobody can know and noise: there it must be larger at all
WORTH_AHEAD = 1.002
# random trials of an effect with many valleys after another was taken out
LOOK_AROUND = 150
# an effect that moves PV by less than this share of its noise does nothing
NOTHING = 0.05


def idle(problem: Problem, fitted: Fit, part: Part) -> bool:
    """True when an effect that is not linear ended where it does nothing: PV is predicted the same without it."""
    if part.is_linear or part.is_recorder:
        return False
    if part.on_sensor:
        process = predict(problem, replace(fitted.shape, parts=tuple(p for p in fitted.shape.parts if not p.on_sensor)),
                          fitted.coefficients)
        moved = through(problem, (part,), process) - process
        return float(np.std(moved[problem.used])) < NOTHING * problem.floor
    there = Shape(fitted.shape.lag, fitted.shape.delay, tuple(p for p in fitted.shape.parts if not p.is_linear))
    moved = moved_process(problem, there) - moved_process(problem, there.without(part.effect.name))
    return float(np.std(moved[problem.used])) * abs(fitted.gain) < NOTHING * problem.floor


def best_known(judge: Judge, fitted: Fit, known: Sequence[Fit]) -> Fit:
    """Return the best of a fit and those known with the same effects or their look-alikes.

    Slopes alone may end in a poorer valley, and an effect taken out may leave the other look-alike the better one.
    """
    return judge.best([fitted, *(k for k in known if families(k.shape) == families(fitted.shape))])


def families(shape: Shape) -> list[str]:
    """Return for each effect of a model the first name among it and its look-alikes."""
    return sorted(min(part.effect.name, *part.effect.fitting.siblings, "~") for part in shape.parts)


def taken_out(problem: Problem, judge: Judge, now: Fit, name: str, seed: int) -> Fit:
    """Return the model without one effect, the others refitted; an effect with many valleys looks around for a better.

    Else the effect taken out would seem to be worth what the other lost by staying in its valley.
    """
    less = fit(problem, now.shape.without(name), now.noise)
    if not any(jumpy(part.effect) for part in less.shape.parts):
        return less
    solver = Solver(problem, whitener(less.noise, problem.used, problem.interval))
    moved = wander(solver, less.shape, np.random.default_rng(seed), LOOK_AROUND)
    return judge.best([less, fit(problem, moved, less.noise)])


def prune(
    problem: Problem, judge: Judge, now: Fit, start: Fit, known: Sequence[Fit], seed: int
) -> tuple[Fit, dict[str, Fit]]:
    """Take out effects that are not worth their price, the least worthy first; return also the fits without each."""
    kept = {part.effect.name for part in start.shape.parts}
    while True:
        now = thinned(problem, judge, best_known(judge, now, known))
        without = {
            name: best_known(judge, taken_out(problem, judge, now, name, seed), known)
            for name in now.shape.names if name not in kept
        }
        worth = {name: judge.score(less) - judge.score(now) for name, less in without.items()}
        # an effect whose numbers ended where it does nothing is no effect, whatever the fit around it gained
        parts = [part for part in now.shape.parts if part.effect.name in worth]
        worth.update({part.effect.name: -np.inf for part in parts if idle(problem, now, part)})
        if worth and min(worth.values()) < ENOUGH:
            now = without[min(worth, key=lambda name: worth[name])]
            continue
        best = better(problem, now).rmse_holdout
        lower = {name: better(problem, less).rmse_holdout / best for name, less in without.items()}
        # so much likelihood is no accident, even where what is known of OP does not let PV be predicted much better
        sure = {name for name in lower if worth[name] >= BEYOND_DOUBT and lower[name] > 1.0 / WORTH_TELLING}
        lower = {name: ratio for name, ratio in lower.items() if name not in sure or problem.by_load}
        if not lower or min(lower.values()) >= (WORTH_AHEAD if problem.by_load else WORTH_TELLING):
            return now, without
        now = without[min(lower, key=lambda name: lower[name])]


def thinned(problem: Problem, judge: Judge, now: Fit) -> Fit:
    """Take out single events, such as one of several load steps, that are not worth their place and size."""
    for place, part in enumerate(now.shape.parts):
        many = [q.name for q in part.effect.parameters if q.many and q.name in part.values]
        events = part.effect.fitting.dear and many
        while events and (count := len(as_tuple(now.shape.parts[place].values[many[0]]))) > 1:
            values = now.shape.parts[place].values
            less = [
                fit(problem, now.shape.with_values(place, **{
                    name: tuple(v for j, v in enumerate(as_tuple(values[name])) if j != i) for name in many
                }), now.noise, rounds=1) for i in range(count)
            ]  # fmt: skip
            best = judge.best(less)
            if judge.score(best) > judge.score(now):
                break
            now = best
    return now
