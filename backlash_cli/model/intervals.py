"""The numbers of a fit with their 95 % intervals, from the slopes of the whitened error."""

from collections.abc import Callable
from functools import partial
from math import hypot

import numpy as np

from ..effects import Effect, Parameter, Stage
from ..effects.fitting import Values
from ..effects.process import DEAD_TIME, SECOND_LAG
from ..results import FittedEffect, FittedParameter
from ..results.explain import Interval
from .fit import DELAY_TRUST, Fit, Solver, fit, free_numbers, linear_values, slopes
from .locate import turning_points
from .pipeline import Part, as_tuple
from .problem import LAGS_PER_STRETCH, MOST_STRETCHES, Problem

NORMAL_95 = 1.96
MODEL_ERROR = 0.015  # the process is never exactly lag and dead time, however little noise there is
HALVINGS = 1.5  # a controller up to three times as fast as the historian (tests/benchmarks/hidden_strangers.py)
# a second lag, as a share of the first, from which its fit starts; gain in deviance that shows it (chi-squared of one)
MORE_LAG, SHOWS = 0.15, 3.84
Place = tuple[int, str, int]


def half_widths(problem: Problem, fitted: Fit) -> dict[Place, float]:
    """Return how far each number may be off with 95 %, by the place of its part (-1: the process), its name and item.

    Two covariances are taken, and of each number the larger deviation: that of a whitened rest which is white, and
    that of the sums of slope times rest over stretches, which holds for a rest of any colour (White 1980; Newey and
    West 1987). Profiles of the likelihood, which cost some fits each, hold the truth no more often
    (tests/benchmarks/interval_coverage.py: 0.96 of 735 intervals, these 0.95)."""
    solver, shape = Solver(problem, fitted.noise), fitted.shape
    free = free_numbers(problem, shape)
    _, rss, rest = solver.rest(shape)
    X = np.column_stack([-slopes(solver, shape, free), -solver.columns(shape)])
    G = X.T @ X
    scale = 1.0 / np.sqrt(np.maximum(np.diag(G), 1e-30))
    # a number without any slope gets a huge, but finite, deviation
    H = np.linalg.inv(G * np.outer(scale, scale) + 1e-9 * np.eye(len(G))) * np.outer(scale, scale)
    variance = np.maximum(np.diag(H) * rss / max(solver.white.samples, 1), 1e-300)
    length = max(int(LAGS_PER_STRETCH * shape.lag / problem.interval), len(rest) // MOST_STRETCHES, 1)
    sums = np.add.reduceat(X * rest[:, None], np.arange(0, len(rest), length), axis=0)
    if len(sums) > 2 * len(G):
        # as many stretches are used up as numbers are fitted
        variance = np.maximum(variance, np.diag(H @ (sums.T @ sums) @ H) * len(sums) / (len(sums) - len(G)))
    wide = NORMAL_95 * np.sqrt(variance)
    keys = [*((f.place, f.name, 0) for f in free), (-1, "Kp", 0), (-1, "offset", 0)]
    solved = iter((wide[len(keys) + 1 :] / abs(fitted.gain)).tolist())
    out = {(-1, "delay", 0): DELAY_TRUST * (problem.delay or 0.0)} | dict(zip(keys, wide.tolist(), strict=False))
    for place, part in enumerate(shape.parts):
        for name in part.effect.fitting.linear:
            for item in range(len(as_tuple(part.values[name]))):
                own = [next(solved) for _ in range(2 if part.effect.fitting.phase else 1)]
                out[place, name, item] = float(np.sqrt(np.mean(np.square(own))))
    return out


def of_another_lag(problem: Problem, fitted: Fit, wide: dict[Place, float]) -> dict[Place, float]:
    """Return half widths that hold what each number of an effect would be behind one more lag, where PV shows one.

    What a model takes for dead time may be that lag: a swing was larger then, and part of a gap was the lag."""
    shape, out = fitted.shape, dict(wide)
    if any(part.effect.fitting.on_loads for part in shape.parts):
        return out
    slower = fit(problem, shape.with_part(Part(SECOND_LAG, {"tau2": MORE_LAG * shape.lag})), fitted.noise)
    if slower.deviance < fitted.deviance - SHOWS:
        wider, before, after = half_widths(problem, slower), linear_values(fitted), linear_values(slower)
        for place, name, item in (key for key in wide if key[0] >= 0):
            there = slower.shape.names.index(shape.names[place])
            apart = as_tuple(after[there][name])[item] - as_tuple(before[place][name])[item]
            out[place, name, item] = max(wide[place, name, item], abs(apart) + wider.get((there, name, item), 0.0))
    return out


def unseen_travel(problem: Problem, effect: Effect, q: Parameter, value: float) -> float:
    """Return by how much a gap may be wider than OP as recorded says: OP turned between the stored samples.

    A gap is crossed from the highest to the lowest OP, and a controller that works faster than the historian stores
    goes beyond both. What storing half of the samples would cut off the peaks tells what storing these has cut off."""
    if effect.stage != Stage.VALVE or q.unit != "span" or q.nuisance or not np.isfinite(q.neutral) or value <= 0.0:
        return 0.0
    u = problem.output
    low, high = (np.array([k for k in at if 0 < k < len(u) - 1], dtype=int) for at in turning_points(u, value))
    cut = [*(u[high] - np.maximum(u[high - 1], u[high + 1])), *(np.minimum(u[low - 1], u[low + 1]) - u[low])]
    return HALVINGS * float(np.mean(np.maximum(cut, 0.0))) if cut else 0.0


def fitted_effects(problem: Problem, fitted: Fit, recorders: tuple[Part, ...] = (), *, closely: bool = True
                   ) -> list[FittedEffect]:
    """Return the effects of a fit, in the order a signal meets them, with values, units and 95 % intervals.

    The process is simpler in the model than it is, and what a valve does with OP shows in PV no better than OP was
    recorded, to half a step either way and half a sample. The time of an event and the period of a swing are told by
    the clock. Of a dead time beside the settings' only the sum is known. closely: see what another lag changes."""
    wide, values = half_widths(problem, fitted), linear_values(fitted)
    wide = of_another_lag(problem, fitted, wide) if closely else wide

    def interval(place: int, q: Parameter, item: int, value: float) -> Interval | None:
        effect, off = fitted.shape.parts[place].effect, wide.get((place, q.name, item), np.nan)
        if not np.isfinite([value, off]).all():
            return None
        if q.name not in effect.fitting.dear:
            in_valve = effect.stage == Stage.VALVE and q.unit == "span"
            off = hypot(off, MODEL_ERROR * value, 0.5 * problem.output_step * in_valve,
                        0.5 * problem.interval * (q.unit == "s"), wide[-1, "delay", 0] * (effect is DEAD_TIME))
        return max(value - off, q.low), min(value + off + unseen_travel(problem, effect, q, value), q.high)

    found = [described(part, values[i], partial(interval, i)) for i, part in enumerate(fitted.shape.parts)]
    return [*found, *(described(part, part.values) for part in recorders)]


def described(part: Part, values: Values, interval: Callable[[Parameter, int, float], Interval | None] = lambda *_: None
              ) -> FittedEffect:
    """Return an effect with numbers and units; interval: of one value of a parameter, none by default."""
    e, parameters = part.effect, {}
    for q in e.parameters:
        if q.name not in values or (q.nuisance and q.many and not values[q.name]):
            continue
        numbers = as_tuple(values[q.name])
        intervals = [interval(q, item, number) for item, number in enumerate(numbers)]
        ci = None if None in intervals or not intervals else tuple(intervals) if q.many else intervals[0]
        level = e.stage == Stage.VALVE and q.unit == "span" and not np.isfinite(q.neutral)
        parameters[q.name] = FittedParameter(numbers if q.many else numbers[0], q.unit, ci,  # type: ignore[arg-type]
                                             q.meaning, q.nuisance, level)
    return FittedEffect(e.name, parameters, part.column, e.sentence, e.fitting.meaning, str(e.stage))


def process_parameters(problem: Problem, fitted: Fit) -> dict[str, FittedParameter]:
    """Return Kp, tau, theta (where it is part of the model) and offset with their intervals."""
    wide, lag, delay = half_widths(problem, fitted), fitted.shape.lag, fitted.shape.delay
    # a gain that is 1 % off turns PV about its mean, which moves what it would be at no output
    turned = fitted.gain * float(np.mean(problem.output[problem.used]))
    out = {}
    for name, key, value, size, unit, meaning in (
        ("Kp", "Kp", fitted.gain, fitted.gain, "1", "static gain, PV span per OP span"),
        ("tau", "lag", lag, lag, "s", "time constant"),
        ("offset", "offset", float(fitted.coefficients[1]), turned, "PV span", "PV at no output"),
        ("theta", "delay", delay, delay, "s", "dead time of the settings, refined")):
        if (-1, key, 0) in wide and (key != "delay" or problem.delay is not None):
            off = hypot(wide[-1, key, 0], MODEL_ERROR * size, 0.5 * problem.interval * (unit == "s"))
            out[name] = FittedParameter(value, unit, (value - off, value + off) if np.isfinite(off) else None, meaning)
    return out
