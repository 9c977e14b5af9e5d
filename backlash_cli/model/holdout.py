"""The error of a fit: on samples it did not see, and less what the recorder may have rounded away.

Blocks are left out in turn, everything refitted on the others. Where OP answers to the load (`Problem.by_load`), PV is
predicted a short time ahead, from OP and from the load as the model's error had shown it; elsewhere from OP alone.

Effects of the recorder say how far a recorded value may be off. A fit through rounded values guesses by the model what
PV was before, and fits again: expectation and maximisation (Dempster, Laird and Rubin, J. Royal Statistical Society B
39, 1977). Given the model, the true PV is normal about the prediction, cut off where it would be rounded otherwise."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np

from ..record import BoolArray, FloatArray, Frozen, hold
from .fit import Fit, Solver, descend, finished, predicted_by, raw_error, rms
from .noise import Noise
from .pipeline import Part
from .problem import FEWEST_SAMPLES, Problem

# a block lasts many process lags, so that a random load on both sides tells nothing about its middle
FOLDS, FEWEST_BLOCKS, MOST_BLOCKS, LAGS_PER_BLOCK = 4, 12, 24, 15.0
ROUNDS = 20  # each closes a part of the distance; so many where the step is as wide as what is looked for
SURE = 2.2  # quantile of Student's t with 11 degrees of freedom that chance exceeds once in 40


class Tested(Frozen, eq=False):
    """A fit with its errors: in the fit (rmse) and on samples it did not see (rmse_holdout; of each sample: unseen
    (samples,), nan where nothing was left out), recorder allowed for."""

    fit: Fit
    rmse: float
    rmse_holdout: float
    unseen: FloatArray

    def surely_worse(self, other: Self) -> bool:
        """True when samples that neither has seen are predicted worse than by `other`: a t-test of the squared errors,
        block by block, as a load that passes in one of them tells little."""
        more = self.unseen**2 - other.unseen**2
        blocks = [float(np.mean(block)) for block in np.array_split(more[np.isfinite(more)], FEWEST_BLOCKS)]
        return float(np.mean(blocks)) > SURE * float(np.std(blocks, ddof=1)) / np.sqrt(FEWEST_BLOCKS)


def folds(problem: Problem, lag: float) -> list[BoolArray]:
    """Return for each fold which grid points are left out, (samples,) each: every fourth block of equal counts but the
    first, which shows how the record began."""
    count = np.cumsum(problem.used)
    blocks = int(np.clip(problem.duration / (LAGS_PER_BLOCK * lag), FEWEST_BLOCKS, MOST_BLOCKS))
    block = np.minimum((count * blocks) // (count[-1] + 1), blocks - 1)
    return [(block % FOLDS == fold) & (block > 0) for fold in range(FOLDS)]


def tested(problem: Problem, fitted: Fit, recorders: tuple[Part, ...] = (), *, rounds: int = 2) -> Tested:
    """Return the errors of a fit; searched numbers start from the whole record's and are refined on each fold."""
    seen = fitted_problem(problem, recorders)
    unseen = np.full(problem.samples, np.nan)
    for left_out in folds(problem, problem.settings.Ti or fitted.shape.lag):
        solver = Solver(replace(seen, used=seen.used & ~left_out), fitted.noise)
        shape = descend(solver, fitted.shape, rounds=rounds)
        there = replace(fitted, shape=shape, coefficients=solver.solve(shape)[0])
        new = left_out & problem.used
        unseen[new] = distance(problem, recorders, predicted_by(seen, there))[new]
    error = distance(problem, recorders, predicted_by(seen, fitted))[problem.used]
    return Tested(fitted, rms(error), rms(unseen[np.isfinite(unseen)]), unseen)


def better(problem: Problem, fitted: Fit, recorders: tuple[Part, ...] = ()) -> Tested:
    """Return the likeliest fit, or that of the smallest error where it predicts unseen samples better by 3 %; not in a
    loop driven by its load, where a wrong model has the smallest error."""
    likely = tested(problem, fitted, recorders)
    if problem.by_load:
        return likely
    seen, noise = fitted_problem(problem, recorders), Noise(1e-3, fitted.noise.slow, fitted.noise.fast)
    shape = descend(Solver(seen, noise), fitted.shape, rounds=6)
    plain = tested(problem, finished(seen, shape, noise), recorders)
    return plain if plain.rmse_holdout < 0.97 * likely.rmse_holdout else likely


def limits(problem: Problem, parts: Sequence[Part]) -> tuple[FloatArray, FloatArray, BoolArray, float]:
    """Return the lowest and highest true PV, where they differ, (samples,) each, and by how much on average [span]."""
    low = high = problem.measurement
    for part in parts:
        if part.effect.fitting.bounds is not None:
            # a value that was not recorded must not look like one that was just kept
            held = hold(np.where(problem.used, problem.measurement, np.nan))
            a, b = part.effect.fitting.bounds(held, part.effect.pack(part.values))
            low, high = np.minimum(low, a), np.maximum(high, b)
    wide = problem.used & (high > low)
    return low, high, wide, float(np.mean((high - low)[wide])) if np.any(wide) else 0.0


def fitted_problem(problem: Problem, parts: Sequence[Part]) -> Problem:
    """Return the problem as a fit should see it: where the recorder repeats old values, only what it just kept."""
    wide = limits(problem, parts)[2]
    exact = problem.used & ~wide
    return replace(problem, used=exact) if np.any(wide) and np.count_nonzero(exact) >= FEWEST_SAMPLES else problem


def only_reports(problem: Problem, parts: Sequence[Part]) -> bool:
    """True when old values are repeated, so that PV is known only where an exception test let it through."""
    wide = limits(problem, parts)[2]
    return bool(np.any(wide)) and not np.all(wide[problem.used])


def recorded_floor(problem: Problem, parts: Sequence[Part], base: Fit) -> float:
    """Return the noise floor of what a recorder left: a step of q stands for q / sqrt(12). Where old values repeat, the
    reports themselves are exact, so that the plain model's error there is a limit, too."""
    step = limits(problem, parts)[3] / math.sqrt(12.0)
    return max(problem.floor, min(0.5 * step, base.rmse) if only_reports(problem, parts) else step)


def distance(problem: Problem, parts: Sequence[Part], predicted: FloatArray) -> FloatArray:
    """Return measured minus predicted PV (samples,), less what the recorder may have rounded away."""
    low, high, _, _ = limits(problem, parts)
    return np.where(problem.used, np.clip(predicted, low, high) - predicted, 0.0)


def expected(mean: FloatArray, sd: float, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the mean of a normal quantity (samples,) that lies between low and high, far out the nearer limit: mean +
    sd (p(a) - p(b)) / (P(b) - P(a)) with a, b = the limits less the mean, over sd (Johnson, Kotz and Balakrishnan,
    Continuous Univariate Distributions 1, section 13.10.1)."""
    from scipy.special import ndtr  # few recordings were rounded
    a, b = (low - mean) / sd, (high - mean) / sd
    inside = ndtr(b) - ndtr(a)
    away = (np.exp(-0.5 * a * a) - np.exp(-0.5 * b * b)) / (math.sqrt(2.0 * math.pi) * np.maximum(inside, 1e-9))
    return np.clip(mean + sd * np.where(inside > 1e-9, away, 0.0), low, high)


def through_rounding(problem: Problem, parts: Sequence[Part], fitted: Fit) -> Fit:
    """Return the fit with its numbers refined for values that were rounded; the same where none were. The noise stays
    that of the recorded values, so that the intervals do not pretend that PV was known better."""
    low, high, wide, step = limits(problem, parts)
    if not wide.any():
        return fitted
    now = fitted
    for _ in range(ROUNDS):
        mean = predicted_by(problem, now)
        error = (problem.measurement - mean)[problem.used]
        sd = math.sqrt(max(float(np.mean(error**2)) - step**2 / 12.0, problem.floor**2 / 12.0))
        guess = replace(problem, measurement=np.where(problem.used, expected(mean, sd, low, high), 0.0))
        now = finished(guess, descend(Solver(guess, now.noise), now.shape, rounds=3), now.noise)
    own = finished(problem, now.shape, fitted.noise)
    rmse = rms(raw_error(problem, now.shape, now.coefficients)[problem.used])
    return replace(own, coefficients=now.coefficients, rmse=rmse)
