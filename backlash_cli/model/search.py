"""Searches for the effects that are missing: add the best, look again at what is there, take out what is not needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..effects import Effect, Stage
from .adequacy import Left, left_by
from .candidates import candidate, table
from .fit import Fit, Solver, descend, fit, refit_noise
from .holdout import better
from .judge import ENOUGH, Judge, judge_for, jumpy
from .noise import Noise, whitener
from .pipeline import Shape
from .problem import Problem
from .prune import prune

# another effect that scores worse by less than this cannot be told apart
ALIKE = 20.0
# an effect that gains less than this needs a closer look
WEAK = 100.0
# nor one of the same kind that gains less by this share only: OP between the stored samples is not known
SHARE_ALIKE = 0.05
MOST_EFFECTS = 4
# lags this close (natural logarithm) are the same
SAME_LAG = 0.02


@dataclass(frozen=True, eq=False)
class Found:
    """What a search came to. baseline: without effects. first: the best fit with each single effect added.

    final: with all accepted effects. without: the fit without each accepted effect, by name. instead: for each
    accepted effect, other effects in its place, by both names. left: what the final model leaves.
    """

    baseline: Fit
    first: dict[str, Fit]
    final: Fit
    without: dict[str, Fit]
    judge: Judge
    left: Left
    instead: dict[tuple[str, str], Fit] = field(default_factory=dict)

    def gain(self, name: str) -> float:
        """Return what the accepted effect `name` is worth, in units of deviance."""
        return self.judge.score(self.without[name]) - self.judge.score(self.final)

    def alike(self) -> list[tuple[str, str]]:
        """Return pairs of an accepted effect and another that in its place does about as well."""
        final = self.judge.score(self.final)
        out = []
        for (name, other), there in self.instead.items():
            # what one more number costs does not tell two kinds of one thing apart
            dearer = max(self.judge.price(there.shape) - self.judge.price(self.final.shape), 0.0)
            kin = other in next(p.effect.fitting.siblings for p in self.final.shape.parts if p.effect.name == name)
            if self.judge.score(there) - final - dearer < max(ALIKE, SHARE_ALIKE * self.gain(name) if kin else 0.0):
                out.append((name, other))
        return out

    @property
    def adequate(self) -> bool:
        """True when the final model leaves nothing that matters but noise and load (see `adequacy.Left`)."""
        stages = {part.effect.name: part.effect.stage for part in self.final.shape.parts}
        return self.left.adequate(self.gain(name) for name in self.without if stages.get(name) != Stage.LOAD)


def baseline(problem: Problem) -> Fit:
    """Fit gain, lag and offset, plus the dead time of the settings where they give one."""
    delay = problem.delay or 0.0
    guess = problem.settings.Ti or problem.duration / 60.0
    found: list[Fit] = []
    seen: list[float] = []
    for share in (1.0, 0.25, 4.0):
        lag = min(max(share * guess, problem.interval), problem.duration / 10.0)
        # a wandering load can hide that the model is poor: start from the smallest error, too
        for ratio in (1.0, 1e-3):
            noise = Noise(ratio, 3.0 * lag, lag)
            shape = descend(Solver(problem, whitener(noise, problem.used, problem.interval)), Shape(lag, delay))
            # starts that came to the same lag come to the same fit
            if all(abs(np.log(shape.lag / other)) > SAME_LAG for other in seen):
                first = Noise(1.0, noise.slow, noise.fast)
                found.append(fit(problem, shape, refit_noise(problem, shape, noise, first)))
            seen.append(shape.lag)
    judge = judge_for(problem, min(f.shape.lag for f in found))
    return judge.best(found)


def search(problem: Problem, effects: Sequence[Effect], start: Fit, *, seed: int = 0) -> Found:
    """Search with the usual effects; where they leave more than noise and load, try the seldom ones, too."""
    found = climb(problem, [e for e in effects if not e.fitting.seldom], start, seed)
    if not found.adequate:
        found = with_seldom(problem, found, [e for e in effects if e.fitting.seldom], start, seed)
    return rivals(problem, found, effects, seed)


def with_seldom(problem: Problem, found: Found, seldom: Sequence[Effect], start: Fit, seed: int) -> Found:
    """Return what a search finds with one of the seldom effects in the model, where that does clearly better."""
    judge, final = found.judge, found.final
    given = {part.effect.name for part in start.shape.parts}
    usual = replace(final.shape, parts=tuple(
        p for p in final.shape.parts if p.is_linear or p.effect.stage == Stage.PROCESS or p.effect.name in given))
    grounds = [final, start] if usual.parts == start.shape.parts else [final, start, fit(problem, usual, final.noise)]
    trials = [fitted for ground in grounds for fitted in table(problem, judge, ground, seldom, seed).values()]
    if not trials or judge.score(judge.best(trials)) > judge.score(final) - ENOUGH:
        return found
    now, without = prune(problem, judge, judge.best(trials), start, trials, seed)
    if judge.score(now) > judge.score(final) - ENOUGH:
        return found
    return replace(found, final=now, without=without, left=left_by(problem, now, now.rmse))


def climb(problem: Problem, effects: Sequence[Effect], start: Fit, seed: int) -> Found:
    """Add effects to `start` while each brings enough, then improve and prune."""
    judge = judge_for(problem, min(start.shape.lag, problem.settings.Ti or start.shape.lag))
    now = start
    first: dict[str, Fit] = {}
    known: list[Fit] = []
    while len(now.shape.parts) < MOST_EFFECTS:
        trials = table(problem, judge, now, effects, seed)
        first = first or trials
        known += trials.values()
        if not trials:
            break
        best = next_best(problem, judge, now, trials, effects, seed)
        if best is None:
            break
        now = improve(problem, judge, best, effects, seed, known) if now.shape.parts else best
        known.append(now)
    now = longest_first(problem, judge, now)
    now, without = prune(problem, judge, now, start, known, seed)
    if problem.by_load and without and better(problem, now).rmse_holdout > better(problem, start).rmse_holdout:
        # the likeliest model of a load need not be the one that knows what comes
        now, without = start, {}
    return Found(start, first, now, without, judge, left_by(problem, now, now.rmse))


def rivals(problem: Problem, found: Found, effects: Sequence[Effect], seed: int) -> Found:
    """Try look-alikes and rivals in the place of each accepted effect; take one that does better."""
    judge, by_name = found.judge, {effect.name: effect for effect in effects}
    instead: dict[tuple[str, str], Fit] = {}
    for part in found.final.shape.parts:
        name, fitting = part.effect.name, part.effect.fitting
        if name not in found.without:
            continue
        if len(found.final.shape.parts) == 1:
            # each of them was tried alone already
            instead.update({(name, other): fit for other, fit in found.first.items() if other != name})
        # what gains little is compared with everything
        weak = found.gain(name) < WEAK and part.effect.stage != Stage.LOAD
        for other in by_name if weak else (*fitting.siblings, *fitting.rivals):
            effect = by_name.get(other)
            if weak and other not in (*fitting.siblings, *fitting.rivals) and effect is not None and (
                    effect.fitting.seldom or jumpy(effect) or not effect.fitted or effect.fitting.bounds):
                continue
            if other in by_name and other not in found.final.shape.names and (name, other) not in instead:
                there = candidate(problem, judge, found.without[name], by_name[other], known={name: found.final},
                                  seed=seed, must=True)
                if there is not None:
                    instead[name, other] = there
    if not instead:
        return found
    pair = min(instead, key=lambda both: judge.score(instead[both]))
    best = instead[pair]
    swap = replace(found, instead=instead)
    if judge.score(best) >= judge.score(found.final) - (ENOUGH if by_name[pair[1]].fitting.seldom else 0.0):
        return swap
    turned = {(pair[1], pair[0]): found.final}
    without = {pair[1] if n == pair[0] else n: fit for n, fit in found.without.items()}
    return replace(found, final=best, without=without, instead=turned,
                   left=left_by(problem, best, best.rmse))


def next_best(
    problem: Problem, judge: Judge, now: Fit, trials: dict[str, Fit], effects: Sequence[Effect], seed: int
) -> Fit | None:
    """Return the model to go on with: one more effect, or two that show only together; None when nothing is worth it.

    Where OP answers to the load, an effect must also lower the error a short way ahead: the likeliest model of a load
    need not be the one that knows what comes.
    """
    worth = [t for t in sorted(trials.values(), key=judge.score) if judge.score(now) - judge.score(t) >= ENOUGH]
    if problem.by_load and worth:
        limit = better(problem, now).rmse_holdout
        worth = [t for t in worth if better(problem, t).rmse_holdout < limit] or worth
    if now.shape.parts or (worth and not worth[0].shape.parts[0].is_linear):
        return worth[0] if worth else None
    # the best effect on the way of the output beside the loads: friction hides what a load did and the other way, and
    # several load steps do what one stop does
    valve = [t for t in (worth or trials.values()) if not t.shape.parts[0].is_linear]
    if not valve:
        return worth[0] if worth else None
    near = min(valve, key=lambda t: t.deviance)
    pairs = table(problem, judge, near, [e for e in effects if e.fitting.linear], seed)
    both = judge.best(list(pairs.values())) if pairs else None
    if not worth:
        return both if both is not None and judge.score(now) - judge.score(both) >= 2.0 * ENOUGH else None
    if both is None:
        return worth[0]
    own = [e for e in effects if e.name == near.shape.parts[0].effect.name]
    other = judge.best([worth[0], *table(problem, judge, worth[0], own, seed).values()])
    return both if judge.score(both) < judge.score(other) - 1e-6 else worth[0]


def longest_first(problem: Problem, judge: Judge, now: Fit) -> Fit:
    """Return the model with the longest lag as that of the process: which of two lags comes first makes no odds."""
    for place, part in enumerate(now.shape.parts):
        names = [q.name for q in part.effect.parameters if q.unit == "s"]
        if part.effect.fitting.on_loads and len(names) == 1:
            other = float(part.values[names[0]])  # type: ignore[arg-type]
            if other > now.shape.lag:
                turned = replace(now.shape, lag=other).with_values(place, **{names[0]: now.shape.lag})
                found = fit(problem, turned, now.noise)
                now = found if judge.score(found) < judge.score(now) + ENOUGH / 10.0 else now
    return now


def improve(
    problem: Problem, judge: Judge, now: Fit, effects: Sequence[Effect], seed: int, known_fits: list[Fit]
) -> Fit:
    """Look at each effect of a model again, now that the others are there: other start values, or its look-alike."""
    by_name = {effect.name: effect for effect in effects}
    for part in now.shape.parts:
        if part.effect.name not in now.shape.names or part.is_recorder:
            continue
        less = fit(problem, now.shape.without(part.effect.name), now.noise, rounds=1)
        known: dict[str, Fit] = {}
        likes = [by_name[n] for n in part.effect.fitting.siblings
                 if n in by_name and n not in now.shape.names and not jumpy(by_name[n])]
        # the smooth one first: it shows the jumpy one where to look
        for effect in sorted([part.effect, *likes], key=jumpy):
            found = candidate(problem, judge, less, effect, known=known, seed=seed)
            if found is not None:
                known[effect.name] = found
                known_fits.append(found)
                if judge.score(found) < judge.score(now):
                    now = found
    return now
