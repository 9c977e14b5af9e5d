"""Fits every way in which one effect could enter a model, and keeps the most likely one.

Where in time a load step, or at which period a swing, explains most of what is missed is told by the gain in likelihood
of one more column. For a step at every possible sample this takes one backward pass per column of the model, because
<whitened step at k, z> = sum over j >= k of (transposed z)_j."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from ..effects import Effect, Stage
from ..effects.fitting import Clues, Values
from ..effects.process import delayed_lag, lag_transposed
from ..record import FloatArray, Frozen
from .fit import Fit, Solver, descend, finished, fit, free_numbers, get, linear_values, put, refit_noise
from .pipeline import Part, Shape, as_tuple, moved_output, predict
from .problem import LAGS_PER_STRETCH, MOST_STRETCHES, Problem, trust

LAG_SHARES = (0.6, 1.0)
LOOSE = 0.05  # of a random load that hides little, times the noise
KEEP_JUMPY, FIRST_WANDERINGS = 4, 30  # where there are many valleys: starts of each kind, random trials from each
KEEP_WANDERING, WANDERINGS = 3, 100  # then the best of all kinds, and trials from each of them
WORTH_A_LOOK = 6.0  # gain in deviance of a look-alike below which an effect with many valleys is not searched for
HOPELESS = 4.0  # a start that is still this much worse than the model without the effect is not refined further
LITTLE = 10.0  # gain in deviance below which another noise was never found to help
BEHIND = 30.0  # a second start that is worse than the best by less is refined, too
ANSWERED = 10.0  # a controller has made up for a load after about this many time constants
HOPEFUL = 0.5  # share of the gain of the best effect that the look-alike of a jumpy one must reach
LEAST_NEW = 0.05  # a column of which less than this share is new to the model cannot carry an effect of its own
MOST_APART = 0.02  # load steps may follow each other after this share of the record, however slow the process
LEAST_STRETCHES = 30.0  # in a slow loop, too, a model that does not predict cannot win
# gain in score that an effect must bring, price paid: about what one more value costs twice. Loops with nothing hidden
# gain up to 10 by chance; `python -m tests.benchmarks.explain_benchmark --kind none` counts those that gain more
ENOUGH = 20.0
WRONG_WAY = 1e7  # more than any likelihood


def jumpy(effect: Effect) -> bool:
    """True when the error of an effect has narrow valleys, so that slopes alone do not find the lowest."""
    return effect.fitting.search == "jumpy"


class Judge(Frozen):
    """Scores fits of the loop `problem`, whose process has about the time constant `lag` [s].

    A random load that may wander without limit explains a drift or a step as well as the real cause does, but does not
    predict PV from OP. The error of that prediction, over as many stretches as are independent, decides where the
    deviance cannot; it counts for less the more OP only answers to the load (see `problem`)."""

    problem: Problem
    lag: float

    def price(self, shape: Shape) -> float:
        """Return what the values of all effects cost, in units of deviance (Schwarz 1978: ln n for each): twice for one
        picked from all places of the record, two values more for narrow valleys, as one is always deep by chance."""
        total = 0.0
        for part in shape.parts:
            fitting = part.effect.fitting
            total += 2.0 if jumpy(part.effect) or fitting.seldom else 0.0
            for q in part.effect.parameters:
                numbers = as_tuple(part.values.get(q.name, ()))
                if not q.choices and (q.many or not q.nuisance) and np.all(np.isfinite(numbers)):
                    total += len(numbers) * (2.0 if q.name in fitting.dear else 1.0)
        return total * float(np.log(np.count_nonzero(self.problem.used)))

    def score(self, fitted: Fit) -> float:
        """Return deviance plus price plus prediction error: smaller is better."""
        problem = self.problem
        stretches = problem.duration / (LAGS_PER_STRETCH * max(self.lag, problem.interval))
        stretches = min(max(stretches, LEAST_STRETCHES), MOST_STRETCHES) * trust(problem.driven)
        # a loop under control has a process of the sign of its controller; the mirror image is the controller itself
        wrong = WRONG_WAY if (problem.settings.K or problem.settings.Kp or 0.0) * fitted.gain < 0.0 else 0.0
        return wrong + fitted.deviance + self.price(fitted.shape) + stretches * 2.0 * float(np.log(fitted.rmse))

    def best(self, fits: Sequence[Fit]) -> Fit:
        """Return the fit of the smallest score."""
        return min(fits, key=self.score)


def step_times(solver: Solver, shape: Shape, count: int) -> list[tuple[float, ...]]:
    """Return sets of 1..count times at which a step load explains most of what the model misses."""
    problem, white, h, lag = solver.problem, solver.white, solver.problem.interval, shape.lag
    # pushes that come sooner than the loop can answer are one event, and its shape that of the process
    apart = max(int(min(max(lag, problem.settings.Ti or 0.0), MOST_APART * problem.duration) / h), 2)

    def step(k: int) -> FloatArray:
        return white.columns(delayed_lag(np.where(np.arange(problem.samples) < k, 0.0, 1.0), h, lag, 0.0))

    def from_there_on(z: FloatArray) -> FloatArray:
        """Return <whitened step at k, z> for every k, (samples,)."""
        return np.cumsum(lag_transposed(white.transposed(z), h, lag)[::-1])[::-1]

    Q, _ = np.linalg.qr(solver.columns(shape))
    rest = solver.rest(shape)[2]
    rest = rest - Q @ (Q.T @ rest)
    own = np.cumsum(step(1) ** 2)[::-1]
    left = own - sum(from_there_on(q) ** 2 for q in np.ascontiguousarray(Q.T))
    meets = from_there_on(rest)

    def best(others: list[int]) -> int:
        """Return the sample at which one more step beside `others` gains most: by what is new of it, and meets."""
        steps = np.array([step(k) for k in others]).reshape(len(others), len(rest)).T
        extra = np.ascontiguousarray(np.linalg.qr(steps - Q @ (Q.T @ steps))[0].T)
        reach = np.array([from_there_on(e) for e in extra]).reshape(steps.T.shape)
        new, met = left - np.sum(reach**2, axis=0), meets - (extra @ rest) @ reach
        gain = np.where(new > LEAST_NEW * own, met**2 / np.maximum(new, 1e-300), 0.0)
        gain[: max(2, int(lag / h))] = gain[-2:] = 0.0
        for k in others:
            gain[max(0, k - apart) : k + apart + 1] = 0.0
        return int(np.argmax(gain))

    chosen, sets = list[int](), list[tuple[float, ...]]()
    for _ in range(count):
        chosen.append(best(chosen))
        for i in range(len(chosen) - 1):  # the others are looked at again, now that this one is there
            chosen[i] = best(chosen[:i] + chosen[i + 1 :])
        sets.append(tuple(h * k for k in sorted(chosen)))
    return sets


def periods(solver: Solver, shape: Shape, count: int) -> list[float]:
    """Return the periods of the `count` strongest lines in what the model misses; three swings at least."""
    rest = solver.rest(shape)[2]
    size = 4 * len(rest)
    power = np.abs(np.fft.rfft(rest, size)) ** 2
    power[: 3 * 4] = power[-size // 8 :] = 0.0
    out: list[float] = []
    while len(out) < count and np.max(power) > 0.0:
        k = int(np.argmax(power))
        out.append(size * solver.problem.interval / k)
        power[max(0, k - 8) : k + 9] = 0.0
    return out


def starts(solver: Solver, shape: Shape, effect: Effect, known: Mapping[str, Values]) -> list[Part]:
    """Return the parts worth trying for one effect: what it proposes, else all combinations of start values and
    choices of its parameters, with each measured column."""
    problem, sensor = solver.problem, effect.stage == Stage.SENSOR
    if effect.fitting.propose:
        entering = predict(problem, shape, solver.solve(shape)[0]) if sensor else moved_output(problem, shape.parts)
        values = list(effect.fitting.propose(Clues(entering, problem.measurement, problem.used, problem.interval,
            shape.lag, problem.duration, known, partial(step_times, solver, shape), partial(periods, solver, shape))))
    else:
        axes = {q.name: q.choices or q.start or (q.neutral,) for q in effect.parameters if not q.many}
        values = [dict(zip(axes, combination, strict=True)) for combination in product(*axes.values())]
    return [Part(effect, v, name) for name in (problem.columns if effect.column else [""]) for v in values]


def candidate(judge: Judge, base: Fit, effect: Effect, *, known: Mapping[str, Fit] | None = None, must: bool = False
              ) -> Fit | None:
    """Return the most likely fit of `base` with `effect` added, None when the data offer no start for it; known: fits
    with other effects added, by name. must: search also where a look-alike gains nothing."""
    problem, known, valleys = judge.problem, known or {}, jumpy(effect)
    values = {name: next(part.values for part in fitted.shape.parts if part.effect.name == name)
              for name, fitted in known.items()}
    ground, noises = base.shape, [base.noise]
    if valleys:
        # a look-alike with smooth slopes shows cheaply where to look, and whether to look at all
        likes = [known[name] for name in effect.fitting.siblings if name in known]
        like = min(likes, key=lambda f: f.deviance, default=base)
        if likes and base.deviance - like.deviance < WORTH_A_LOOK and not must:
            return None
        ground, noises = replace(ground, lag=like.shape.lag, delay=like.shape.delay), [like.noise]
    elif not effect.fitting.linear and base.noise.ratio > LOOSE:
        # a noise that hides little as well: with hardly any random load, the fit must follow PV at all periods
        noises.append(replace(base.noise, ratio=LOOSE))
    trials: list[Fit] = []
    for solver in (Solver(problem, noise) for noise in noises):
        shapes = scan(solver, ground, starts(solver, ground, effect, values), KEEP_JUMPY if valleys else 1)
        if valleys:
            random = np.random.default_rng(problem.seed)
            shapes = sorted((wander(solver, shape, random, FIRST_WANDERINGS) for shape in shapes), key=solver.rss)
            shapes = [wander(solver, shape, random, WANDERINGS) for shape in shapes[:KEEP_WANDERING]]
        for shape in shapes:
            # loads are solved for: only the process has to move a little with them
            lower = descend(solver, shape, rounds=1 if effect.fitting.linear else 3)
            shape = lower if plausible(problem, lower) else shape
            gained = solver.white.samples * np.log(solver.rss(ground) / solver.rss(shape))
            noise = base.noise if gained < LITTLE else refit_noise(solver, shape, base.noise)
            trials.append(finished(problem, shape, noise))
    trials.sort(key=judge.score)
    hopeful = [trial for trial in trials if plausible(problem, trial.shape, linear_values(trial))]
    if hopeful and not valleys and judge.score(hopeful[0]) > judge.score(base) + HOPELESS:
        return hopeful[0]
    ways = hopeful or trials
    found = [fit(problem, way.shape, way.noise, before=way.deviance) for way in ways[:2]
             if judge.score(way) < judge.score(ways[0]) + BEHIND]
    # slopes may end where the effect is another; how well it does where it is itself must be known all the same
    told = [f for f in found if plausible(problem, f.shape, linear_values(f))] or (hopeful if valleys else [])
    return min(told, key=judge.score, default=None)


def plausible(problem: Problem, shape: Shape, values: Sequence[Values] = ()) -> bool:
    """True when every effect of a shape calls its values plausible for what OP did about each event; values: those
    solved for included, where they are known."""
    reach = max(int(ANSWERED * max(shape.lag, problem.settings.Ti or 0.0) / problem.interval), 60)

    def travel(time: float) -> float:
        at = int(time / problem.interval)
        moved = float(np.ptp(problem.output[max(at - reach // 10, 0) : at + reach]))
        return moved if moved > 1e-6 else np.inf

    both = zip(shape.parts, values or [part.values for part in shape.parts], strict=True)
    return all(part.effect.fitting.plausible is None or part.effect.fitting.plausible(v, travel) for part, v in both)


def scan(solver: Solver, shape: Shape, parts: list[Part], keep: int) -> list[Shape]:
    """Return the best `keep` starts, by the whitened sum of squares, of each kind (switches, column, lengths)."""
    alone = any(part.is_linear or jumpy(part.effect) for part in parts)
    trials = [(part, replace(shape, lag=share * shape.lag).with_part(part))
              for share in ((1.0,) if alone else LAG_SHARES) for part in parts]
    found: dict[object, list[Shape]] = {}
    for place in np.argsort([solver.rss(trial) for _, trial in trials], kind="stable").tolist():
        part, trial = trials[place]
        picks = tuple((q.name, part.values.get(q.name)) for q in part.effect.parameters if q.choices)
        kind = part.column, picks, tuple((k, np.size(v)) for k, v in part.values.items())
        found.setdefault(kind, []).append(trial)
    return [shape for shapes in found.values() for shape in shapes[:keep]]


def wander(solver: Solver, shape: Shape, random: np.random.Generator, trials: int) -> Shape:
    """Return the best of many random trials around a shape, with a reach that grows on success and shrinks else."""
    free = free_numbers(solver.problem, shape)
    numbers = get(shape, free)
    own = np.array([f.place >= 0 and jumpy(shape.parts[f.place].effect) for f in free])
    both = zip(free, numbers, strict=True)
    reach = np.array([0.3 if f.nuisance else 0.08 * max(abs(x), 4.0 * f.step) for f, x in both])
    best, scale = solver.rss(shape), 1.0
    for _ in range(trials):
        pick = random.random(len(free)) < np.where(own, 0.6, 0.15)
        trial = put(shape, free, numbers + scale * reach * random.standard_normal(len(free)) * pick)
        rss = solver.rss(trial) if plausible(solver.problem, trial) else np.inf
        if rss < best:
            best, shape, numbers = rss, trial, get(trial, free)
            scale = min(scale * 1.5, 2.0)
        else:
            scale = max(scale * 0.97, 0.003)
    return shape


def table(judge: Judge, base: Fit, effects: Iterable[Effect]) -> dict[str, Fit]:
    """Return the best fit with each effect added that is not in the model yet, by the effect's name."""
    out: dict[str, Fit] = {}
    for effect in sorted(effects, key=jumpy):
        if not effect.fitted or effect.name in base.shape.names or effect.fitting.bounds is not None:
            continue
        like = [part.effect for part in base.shape.parts if effect.name in part.effect.fitting.siblings]
        if any(jumpy(other) or jumpy(effect) for other in like):
            # one valve has one friction; `search.in_place` sees whether the look-alike does better
            continue
        if jumpy(effect) and out:
            # a search with many valleys is dear: only where its smooth look-alike is among the good ones
            gains = {name: base.deviance - fitted.deviance for name, fitted in out.items()}
            like_gain = max((gains.get(name, 0.0) for name in effect.fitting.siblings), default=0.0)
            if like_gain < HOPEFUL * max(gains.values()):
                continue
        if (found := candidate(judge, base, effect, known=out)) is not None:
            out[effect.name] = found
    return out


def recorders(problem: Problem, base: Fit, effects: Sequence[Effect]) -> list[Part]:
    """Return the recorder effects that the recorded values show, the coarsest setting of each first proposed."""
    solver = Solver(problem, base.noise)
    return [part for effect in effects if effect.fitted and effect.fitting.bounds is not None
            for part in starts(solver, base.shape, effect, {})[:1]]
