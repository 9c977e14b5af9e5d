"""Searches for the effects that are missing: add the best, look again at what is there, take out what is not needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..effects import Effect, Stage
from .adequacy import Left, left_by
from .candidates import candidate, table, wander
from .fit import Fit, Solver, descend, fit, refit_noise
from .holdout import better
from .noise import Noise, whitener
from .pipeline import Part, Shape, as_tuple, moved_process, predict, through
from .problem import Problem
from .score import ENOUGH, Judge, judge_for, jumpy

# another effect that scores worse by less than this cannot be told apart
ALIKE = 20.0
# an effect that gains less than this needs a closer look
WEAK = 100.0
# nor one of the same kind that gains less by this share only: OP between the stored samples is not known, and physical
# friction (LuGre, Karnopp; tests/benchmarks/hidden_strangers.py) jumps less than the model of a sticking valve
SHARE_ALIKE = 0.09
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
            solver = Solver(problem, whitener(noise, problem.used, problem.interval))
            shape = descend(solver, Shape(lag, delay))
            # starts that came to the same lag come to the same fit
            if all(abs(np.log(shape.lag / other)) > SAME_LAG for other in seen):
                first = Noise(1.0, noise.slow, noise.fast)
                found.append(fit(problem, shape, refit_noise(solver, shape, first)))
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
