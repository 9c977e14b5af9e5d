"""Fits every way in which one effect could enter a model, and keeps the most likely one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from ..effects import Effect, Stage
from ..effects.fitting import Values
from .clues import Clue
from .fit import Fit, Solver, descend, finished, fit, refit_noise
from .free import free_numbers, get, put
from .noise import Noise, whitener
from .pipeline import Part, Shape, as_tuple
from .problem import Problem

LAG_SHARES = (0.6, 1.0)
KEEP = 1
KEEP_JUMPY = 6
# gain in deviance of a look-alike below which an effect with many valleys is not searched for
WORTH_A_LOOK = 6.0


def default_starts(effect: Effect) -> list[Values]:
    """Return all combinations of the start values and choices of the parameters."""
    axes = [(q.name, q.choices or q.start or (q.neutral,)) for q in effect.parameters if not q.many]
    return [dict(zip([n for n, _ in axes], values, strict=True)) for values in product(*[v for _, v in axes])]


def starts(effect: Effect, clues: Clue, columns: Iterable[str]) -> list[Part]:
    """Return the parts worth trying for one effect, one for each start value and measured column."""
    values = list(effect.fitting.propose(clues)) if effect.fitting.propose else default_starts(effect)
    names = list(columns) if effect.column else [""]
    return [Part(effect, v, name) for name in names for v in values]


def loose(noise: Noise) -> Noise:
    """Return a noise that hides little: with hardly any load, the fit must follow the measurement at all periods."""
    return Noise(min(noise.ratio, 0.05), noise.slow, noise.fast)


def group(part: Part) -> tuple[object, ...]:
    """Return what sets apart the kinds of one effect: its switches, its column, and which values it has."""
    picks = tuple((q.name, part.values.get(q.name)) for q in part.effect.parameters if q.choices)
    lengths = tuple(len(v) if isinstance(v, tuple) else 1 for v in part.values.values())
    return part.column, picks, tuple(part.values), lengths


def candidate(
    problem: Problem, base: Fit, effect: Effect, *, known: Mapping[str, Fit] | None = None, seed: int = 0
) -> Fit | None:
    """Return the most likely fit of `base` with `effect` added, None when the data offer no start for it."""
    known = known or {}
    values = {name: values_of(fitted, name) for name, fitted in known.items()}
    like = min((known[name] for name in effect.fitting.siblings if name in known), key=lambda f: f.deviance, default=None)
    if jumpy(effect):
        # a look-alike with smooth slopes shows cheaply where to look, and whether to look at all
        if like is not None and base.deviance - like.deviance < WORTH_A_LOOK:
            return None
        grounds = [(base.shape if like is None else replace(base.shape, lag=like.shape.lag, delay=like.shape.delay), (like or base).noise)]
    else:
        grounds = [(base.shape, base.noise), (base.shape, loose(base.noise))]
    trials: list[tuple[float, Noise, Shape]] = []
    random = np.random.default_rng(seed)
    for ground, noise in grounds:
        solver = Solver(problem, whitener(noise, problem.used, problem.interval))
        parts = starts(effect, Clue(problem, ground, solver.white, values), problem.columns)
        for shape in scan(solver, ground, parts, KEEP_JUMPY if jumpy(effect) else KEEP):
            shape = wander(solver, shape, random, 40) if jumpy(effect) else descend(solver, shape, rounds=3)
            trials.append((*likelihood(problem, shape, base.noise), shape))
    return best_of(problem, trials, random, jumpy(effect), base)


def jumpy(effect: Effect) -> bool:
    """True when the error of an effect has narrow valleys, so that slopes alone do not find the lowest."""
    return effect.fitting.search == "jumpy"


def best_of(
    problem: Problem, trials: list[tuple[float, Noise, Shape]], random: np.random.Generator, valleys: bool, base: Fit
) -> Fit | None:
    """Return the likeliest fit of the most promising trials, each searched and fitted to the end."""
    n = float(np.log(problem.used.sum()))
    trials.sort(key=lambda t: t[0] + price(t[2], n))
    best: Fit | None = None
    for _, noise, shape in trials[: 3 if valleys else 2]:
        if valleys:
            solver = Solver(problem, whitener(noise, problem.used, problem.interval))
            shape = descend(solver, wander(solver, shape, random, 120), rounds=3)
            noise = refit_noise(problem, shape, noise)
            solver = Solver(problem, whitener(noise, problem.used, problem.interval))
            shape = wander(solver, shape, random, 120, scale=0.2)
        found = fit(problem, shape, noise)
        if best is None or score(found, n) < score(best, n):
            best = found
    return best


def score(fitted: Fit, log_samples: float) -> float:
    """Return deviance plus price: smaller is better."""
    return fitted.deviance + price(fitted.shape, log_samples)


def price(shape: Shape, log_samples: float) -> float:
    """Return what the values of all effects of a shape cost, in units of deviance (Schwarz 1978: log n for each).

    An event costs as much again for the many places it was looked for at, and so does an effect with many valleys.
    """
    total = 0.0
    for part in shape.parts:
        for q in part.effect.parameters:
            value = part.values.get(q.name)
            if value is None or q.choices or (q.nuisance and not q.many) or not np.all(np.isfinite(as_tuple(value))):
                continue
            total += len(as_tuple(value)) * log_samples * (2.0 if q.many and q.name in part.effect.fitting.fixed else 1.0)
        if jumpy(part.effect):
            total += log_samples
    return total


def likelihood(problem: Problem, shape: Shape, noise: Noise) -> tuple[float, Noise]:
    """Return the deviance of a shape under its own best noise, and that noise."""
    noise = refit_noise(problem, shape, noise)
    return finished(problem, shape, noise).deviance, noise


def finish(problem, trials, jumpy, seed):
    trials.sort(key=lambda t: t[0])
    best = None
    random = np.random.default_rng(seed + 1)
    for _, noise, shape in trials[: 4 if jumpy else 2]:
        if jumpy:
            solver = Solver(problem, whitener(noise, problem.used, problem.interval))
            shape = wander(solver, shape, random, 150)
            shape = descend(solver, shape, rounds=3)
            noise = refit_noise(problem, shape, noise)
            solver = Solver(problem, whitener(noise, problem.used, problem.interval))
            shape = wander(solver, shape, random, 150, scale=0.2)
        found = fit(problem, shape, noise)
        if best is None or found.deviance < best.deviance:
            best = found
    return best


def scan(solver: Solver, shape: Shape, parts: list[Part], keep: int) -> list[Shape]:
    """Return the best starts of each kind, at most `keep` per kind, by the whitened sum of squares."""
    kinds: dict[tuple[object, ...], list[tuple[float, int, Shape]]] = {}
    several = bool(parts) and not parts[0].is_linear and not jumpy(parts[0].effect)
    for share in LAG_SHARES if several else (1.0,):
        near = replace(shape, lag=shape.lag * share)
        trials = [near.with_part(part) for part in parts]
        for number, (part, trial, rss) in enumerate(zip(parts, trials, solver.rss_of_many(trials), strict=True)):
            kinds.setdefault(group(part), []).append((rss, number, trial))
    out = []
    for found in kinds.values():
        found.sort(key=lambda f: (f[0], f[1]))
        out += [trial for _, _, trial in found[:keep]]
    return out


def wander(solver: Solver, shape: Shape, random: np.random.Generator, trials: int, scale: float = 1.0) -> Shape:
    """Return the best of many random trials around a shape, with a reach that grows on success and shrinks else."""
    free = free_numbers(solver.problem, shape)
    numbers = get(shape, free)
    own = np.array([f.place >= 0 for f in free])
    reach = np.array([0.3 if f.nuisance else 0.08 * max(abs(x), 4.0 * f.step) for f, x in zip(free, numbers, strict=True)])
    best = solver.rss(shape)
    for _ in range(trials):
        pick = random.random(len(free)) < np.where(own, 0.6, 0.15)
        trial = put(shape, free, numbers + scale * reach * random.standard_normal(len(free)) * pick)
        rss = solver.rss(trial)
        if rss < best:
            best, shape, numbers = rss, trial, get(trial, free)
            scale = min(scale * 1.5, 2.0)
        else:
            scale = max(scale * 0.97, 0.003)
    return shape


def values_of(fitted: Fit, name: str) -> Values:
    """Return the parameter values of the effect called `name` in a fit."""
    return next(part.values for part in fitted.shape.parts if part.effect.name == name)


def table(problem: Problem, base: Fit, effects: Iterable[Effect], seed: int = 0) -> Mapping[str, Fit]:
    """Return the best fit with each effect added that is not in the model yet."""
    out: dict[str, Fit] = {}
    for effect in effects:
        if not effect.fitted or effect.name in base.shape.names or effect.fitting.bounds is not None:
            continue
        found = candidate(problem, base, effect, known=out, seed=seed)
        if found is not None:
            out[effect.name] = found
    return out


__all__ = ["Stage", "candidate", "finished", "table"]
