"""Searches for the effects that are missing: add the best, look again at what is there, take out what is not needed."""

from collections.abc import Sequence
from dataclasses import field, replace

import numpy as np

from ..effects import Effect, Stage
from ..record import Frozen
from .adequacy import Left, left_by
from .candidates import ENOUGH, Judge, candidate, jumpy, table, wander
from .fit import Fit, Solver, descend, finished, fit, refit_noise
from .holdout import better
from .noise import Noise
from .pipeline import Part, Shape, load_regressors, predict
from .problem import Problem

ALIKE = 20.0  # another effect that scores worse by less cannot be told apart
WEAK = 100.0  # an effect that gains less needs a closer look
# nor one of the same kind that gains less by this share only: OP between the stored samples is not known, and physical
# friction (LuGre, Karnopp; tests/benchmarks/hidden_strangers.py) jumps less than the model of a sticking valve, so that
# play gained up to 0.16 more in 60 of them
SHARE_ALIKE = 0.2
MOST_EFFECTS = 4
WORTH_A_SWAP = 3.0  # gain in score for which an effect changes places with another
SAME_LAG = 0.02  # lags this close (natural logarithm) are the same
# without an effect that is worth telling, the error on unseen samples is at least this many times larger
WORTH_TELLING = 1.08
# a short way ahead most of the error is load that nobody can know and noise: there it must be larger at all
WORTH_AHEAD = 1.002
LOOK_AROUND = 150  # random trials of an effect with many valleys after another was taken out
GAPS, SECOND = (0.01, 0.04), 0.25  # dead bands [span] that are fitted at once with a second lag, a share of Ti
NOTHING = 0.05  # of the noise of PV: an effect that moves PV by less does nothing


class Found(Frozen, eq=False):
    """What a search came to. baseline: without effects. first: the best fit with each single effect added.

    final: with all accepted effects. without: the fit without each accepted effect, by name. instead: for each
    accepted effect, other effects in its place, by both names. left: what the final model leaves."""

    baseline: Fit
    first: dict[str, Fit]
    final: Fit
    without: dict[str, Fit]
    judge: Judge
    left: Left
    instead: dict[tuple[str, str], Fit] = field(default_factory=dict)

    def gain(self, name: str) -> float:
        """Return what the accepted effect `name` is worth, in deviance; 0 where it was never left out."""
        if name not in self.without:
            return 0.0
        return self.judge.score(self.without[name]) - self.judge.score(self.final)

    def alike(self) -> list[tuple[str, str]]:
        """Return pairs of an accepted effect and another that in its place does about as well."""
        final = self.judge.score(self.final)
        out = []
        for (name, other), there in self.instead.items():
            kin = other in next(p.effect.fitting.siblings for p in self.final.shape.parts if p.effect.name == name)
            # what one more number costs does not tell two kinds of one thing apart
            dearer = max(self.judge.price(there.shape) - self.judge.price(self.final.shape), 0.0) if kin else 0.0
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
    found = fits_with(problem, ())
    return Judge(problem, min(f.shape.lag for f in found)).best(found)


def rich_fit(judge: Judge, effects: Sequence[Effect]) -> Fit:
    """Fit at once what loops have most often: play, a second lag, and steps of the load where they help.

    Each alone may gain nothing where the lag of a model without the others has moved to make up for them."""
    play, lag, steps = (next(e for e in effects if e.name == name) for name in ("backlash", "second_lag", "load_step"))
    second = Part(lag, {"tau2": SECOND * (judge.problem.settings.Ti or judge.lag)})
    found = [judge.best(fits_with(judge.problem, (Part(play, {"d": d, "position": 0.0}), second))) for d in GAPS]
    return judge.best([*found, *filter(None, (candidate(judge, f, steps, must=True) for f in found))])


def fits_with(problem: Problem, parts: tuple[Part, ...]) -> list[Fit]:
    """Fit gain, lag and offset, and `parts` beside them, from several lags and noises."""
    guess = problem.settings.Ti or problem.duration / 60.0
    found, seen = list[Fit](), list[float]()
    for share in (1.0, 0.25, 4.0):
        lag = min(max(share * guess, problem.interval), problem.duration / 10.0)
        # a wandering load can hide that the model is poor: start from the smallest error, too
        for ratio in (1.0, 1e-3):
            solver = Solver(problem, Noise(ratio, 3.0 * lag, lag))
            shape = descend(solver, Shape(lag, problem.delay or 0.0, parts))
            # starts that came to the same lag come to the same fit
            if all(abs(np.log(shape.lag / other)) > SAME_LAG for other in seen):
                found.append(fit(problem, shape, refit_noise(solver, shape, Noise(1.0, 3.0 * lag, lag))))
            seen.append(shape.lag)
    return found


def search(problem: Problem, effects: Sequence[Effect], start: Fit) -> Found:
    """Add effects to `start` while each brings enough, or begin with several; then swap and take out until nothing does
    better. Where the usual effects leave more than noise and load, the seldom ones are tried, too."""
    judge = Judge(problem, min(start.shape.lag, problem.settings.Ti or start.shape.lag))
    usual, seldom = ([e for e in effects if e.fitting.seldom is rare] for rare in (False, True))
    now, first, known = start, dict[str, Fit](), [start]
    while len(now.shape.parts) < MOST_EFFECTS:
        trials = table(judge, now, usual)
        first, known = first or trials, [*known, *trials.values()]
        worth = [t for t in sorted(trials.values(), key=judge.score) if judge.score(t) <= judge.score(now) - ENOUGH]
        if not worth:
            break
        if problem.by_load:
            # the likeliest model of a load need not be the one that knows what comes a short way ahead
            limit = better(problem, now).rmse_holdout
            worth = [t for t in worth if better(problem, t).rmse_holdout < limit] or worth
        now = worth[0]
    found = settled(Found(start, first, longest_first(judge, now), {}, judge, Left()), effects, known)
    if usual and not start.shape.parts:
        found = kept(found, prune(judge, rich_fit(judge, usual), start, known)[0], effects, known)
    final, names = found.final, {effect.name for effect in seldom}
    others = [there for (_, other), there in found.instead.items() if other in names]
    # steps and bends of a load follow what they are not, and leave nothing that would show it
    loads = [p.effect.name for p in final.shape.parts if p.effect.fitting.fixed and p.effect.name in found.without]
    if loads or not found.adequate:
        process = replace(final.shape, parts=tuple(p for p in final.shape.parts if p.effect.name not in loads and (
            p.is_linear or p.effect.name in start.shape.names or p.effect.stage == Stage.PROCESS)))
        grounds = {ground.shape.names: ground for ground in (() if found.adequate else (start, final))}
        if process.names not in grounds:
            grounds[process.names] = fit(problem, process, final.noise)
        for ground in grounds.values():
            others += table(judge, ground, seldom).values()
    return kept(found, judge.best(others), effects, others) if others else found


def kept(found: Found, other: Fit, effects: Sequence[Effect], known: list[Fit]) -> Found:
    """Return what `other` settles to, where it does better by ENOUGH before and after; else what was found."""
    limit = found.judge.score(found.final) - ENOUGH
    there = settled(replace(found, final=other), effects, known) if found.judge.score(other) < limit else found
    return there if found.judge.score(there.final) < limit else found


def settled(found: Found, effects: Sequence[Effect], known: list[Fit]) -> Found:
    """Take out what is not worth its price, then swap what another does better, until nothing does."""
    judge, seldom = found.judge, {effect.name for effect in effects if effect.fitting.seldom}
    now, without = prune(judge, found.final, found.baseline, known)
    if judge.problem.by_load and without and (
            better(judge.problem, now).rmse_holdout > better(judge.problem, found.baseline).rmse_holdout):
        now, without = found.baseline, {}
    for _ in range(MOST_EFFECTS):
        found = replace(found, final=now, without=without, left=left_by(judge.problem, now), instead={})
        found = replace(found, instead=in_place(found, effects))
        known += found.instead.values()
        swaps = [there for (_, other), there in found.instead.items() if other not in seldom]
        if not swaps or judge.score(judge.best(swaps)) >= judge.score(now) - WORTH_A_SWAP:
            break
        now = judge.best(swaps)
        without = left_out(judge, now, found.baseline, known)
    return replace(found, instead={both: fit for both, fit in found.instead.items() if both[0] != both[1]})


def in_place(found: Found, effects: Sequence[Effect]) -> dict[tuple[str, str], Fit]:
    """Return the best fit with another effect in the place of each accepted one, or with itself from other starts."""
    judge, by_name, instead = found.judge, {effect.name: effect for effect in effects}, dict[tuple[str, str], Fit]()
    alone = len(found.final.shape.parts) == 1
    for part in found.final.shape.parts:
        name, near = part.effect.name, {*part.effect.fitting.siblings, *part.effect.fitting.rivals}
        if name not in found.without:
            continue
        if alone:
            # each of them was tried alone already; what a seldom effect is a case of starts again from its numbers
            again = part.effect.fitting.siblings if part.effect.fitting.seldom else ()
            instead.update({(name, other): fit for other, fit in found.first.items() if other not in (name, *again)})
        else:
            near.add(name)
        if found.gain(name) < WEAK and part.effect.stage != Stage.LOAD:
            # what gains little is compared with everything
            near |= {n for n, e in by_name.items() if e.fitted and not (e.fitting.seldom or jumpy(e) or
                                                                        e.fitting.bounds)}
        # what stands in the place of a look-alike finds the rest of the model as it is; without the effect that has
        # moved to make up for it, mostly into another valley
        bare = finished(judge.problem, found.final.shape.without(name), found.final.noise)
        for other in by_name:
            if other in near and other not in found.final.shape.without(name).names and (name, other) not in instead:
                base = bare if other in part.effect.fitting.siblings else found.without[name]
                if there := candidate(judge, base, by_name[other], known={name: found.final}, must=True):
                    instead[name, other] = there
    return instead


def longest_first(judge: Judge, now: Fit) -> Fit:
    """Return the model with the longest lag as that of the process: which of two lags comes first makes no odds."""
    for place, part in enumerate(now.shape.parts):
        names = [q.name for q in part.effect.parameters if q.unit == "s"]
        if part.effect.fitting.on_loads and len(names) == 1:
            other = float(part.values[names[0]])  # type: ignore[arg-type]
            if other > now.shape.lag:
                turned = replace(now.shape, lag=other).with_values(place, **{names[0]: now.shape.lag})
                found = fit(judge.problem, turned, now.noise)
                now = found if judge.score(found) < judge.score(now) + ENOUGH / 10.0 else now
    return now


def idle(problem: Problem, fitted: Fit, part: Part) -> bool:
    """True when an effect that is not linear ended where it does nothing: PV is predicted the same without it."""
    if part.is_linear or part.is_recorder:
        return False
    less = fitted.shape.without(part.effect.name)
    # what a further lag has to forget of the start stands in the last columns
    c = fitted.coefficients[: 1 + load_regressors(problem, less).shape[1]]
    there = np.append(c, np.zeros(len(fitted.coefficients) - len(c)))
    moved = predict(problem, fitted.shape, there) - predict(problem, less, c)
    return float(np.std(moved[problem.used])) < NOTHING * problem.floor


def best_known(judge: Judge, fitted: Fit, known: Sequence[Fit]) -> Fit:
    """Return the best of a fit and those known with the same effects or their look-alikes.

    Slopes alone may end in a poorer valley, and an effect taken out may leave the other look-alike the better one."""
    return judge.best([fitted, *(k for k in known if families(k.shape.parts) == families(fitted.shape.parts))])


def families(parts: Sequence[Part]) -> list[str]:
    """Return for each effect the first name among it and its look-alikes."""
    return sorted(min(part.effect.name, *part.effect.fitting.siblings, "~") for part in parts)


def taken_out(judge: Judge, now: Fit, name: str) -> Fit:
    """Return the model without one effect, the others refitted; an effect with many valleys looks around for a better.

    Else the effect taken out would seem to be worth what the other lost by staying in its valley."""
    problem = judge.problem
    less = fit(problem, now.shape.without(name), now.noise)
    if not any(jumpy(part.effect) for part in less.shape.parts):
        return less
    moved = wander(Solver(problem, less.noise), less.shape, np.random.default_rng(problem.seed), LOOK_AROUND)
    return judge.best([less, fit(problem, moved, less.noise)])


def left_out(judge: Judge, now: Fit, start: Fit, known: Sequence[Fit]) -> dict[str, Fit]:
    """Return the best fit without each effect that was added to `start`."""
    return {name: best_known(judge, taken_out(judge, now, name), known) for name in now.shape.names
            if name not in start.shape.names}


def prune(judge: Judge, now: Fit, start: Fit, known: Sequence[Fit]) -> tuple[Fit, dict[str, Fit]]:
    """Take out effects that are not worth their price, the least worthy first; return also the fits without each."""
    problem = judge.problem
    while True:
        now = best_known(judge, now, known)
        parts = {part.effect.name: part for part in now.shape.parts}
        without = left_out(judge, now, start, known)
        # an effect whose numbers ended where it does nothing is no effect, whatever the fit around it gained
        worth = {name: -np.inf if idle(problem, now, parts[name]) else judge.score(less) - judge.score(now)
                 for name, less in without.items()}
        if worth and min(worth.values()) < ENOUGH:
            now = without[min(worth, key=lambda name: worth[name])]
            continue
        best, tests = better(problem, now), {name: better(problem, less) for name, less in without.items()}
        # so much likelihood is no accident, even where load hides how much better PV is predicted
        lower = {name: test.rmse_holdout / best.rmse_holdout for name, test in tests.items()
                 if problem.by_load or worth[name] < WEAK or best.surely_worse(test)}
        if not lower or min(lower.values()) >= (WORTH_AHEAD if problem.by_load else WORTH_TELLING):
            return now, without
        now = without[min(lower, key=lambda name: lower[name])]
