"""Effects of the recorder: they do not move the process, they say how far a recorded value may be off.

A fit through rounded values guesses what PV was before the recorder rounded it from the model, and fits again:
expectation and maximisation (Dempster, Laird and Rubin, J. Royal Statistical Society B 39, 1977). Given the model, the
true PV of a sample is normal about the prediction, cut off where the recorder would have rounded to another value.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray
from .fit import Fit, Solver, descend, finished, predicted_by, raw_error
from .pipeline import Part
from .problem import FEWEST_SAMPLES, Problem, hold

# each round closes a part of the distance; it takes that many when the step is as wide as what is looked for
ROUNDS = 20
ROOT_2_PI = math.sqrt(2.0 * math.pi)


def limits(problem: Problem, parts: Sequence[Part]) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest true PV of each sample, (samples,) each; equal where nothing was rounded."""
    low = high = problem.measurement
    for part in parts:
        if part.effect.fitting.bounds is not None:
            # a value that was not recorded must not look like one that was just kept
            held = hold(np.where(problem.used, problem.measurement, np.nan))
            a, b = part.effect.fitting.bounds(held, part.effect.pack(part.values))
            low, high = np.minimum(low, a), np.maximum(high, b)
    return low, high


def off(problem: Problem, parts: Sequence[Part]) -> tuple[NDArray[np.bool_], float]:
    """Return for which samples (samples,) the recorder left a whole interval, and how wide it is on average [span]."""
    low, high = limits(problem, parts)
    wide = problem.used & (high > low)
    return wide, float(np.mean((high - low)[wide])) if np.any(wide) else 0.0


def fitted_problem(problem: Problem, parts: Sequence[Part]) -> Problem:
    """Return the problem as a fit should see it: where the recorder repeats old values, only what it just kept."""
    wide, _ = off(problem, parts)
    exact = problem.used & ~wide
    return problem.masked(exact) if np.any(wide) and np.count_nonzero(exact) >= FEWEST_SAMPLES else problem


def only_reports(problem: Problem, parts: Sequence[Part]) -> bool:
    """True when old values are repeated, so that PV is known only where an exception test let it through."""
    wide, _ = off(problem, parts)
    return bool(np.any(wide)) and not np.all(wide[problem.used])


def recorded_floor(problem: Problem, parts: Sequence[Part], base: Fit) -> float:
    """Return the noise floor of what a recorder left: repeats hide the noise, a step of q stands for q / sqrt(12).

    Where old values repeat, the reports themselves are exact, so that the plain model's error there is a limit, too.
    """
    step = off(problem, parts)[1] / math.sqrt(12.0)
    return max(problem.floor, min(0.5 * step, base.rmse) if only_reports(problem, parts) else step)


def distance(problem: Problem, parts: Sequence[Part], predicted: FloatArray) -> FloatArray:
    """Return measured minus predicted PV (samples,), less what the recorder may have rounded away."""
    low, high = limits(problem, parts)
    return np.where(problem.used, np.clip(predicted, low, high) - predicted, 0.0)


def expected(mean: FloatArray, sd: float, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the mean of a normal quantity (samples,) of which is known that it lies between low and high.

    mean + sd (p(a) - p(b)) / (P(b) - P(a)) with a, b = the limits less the mean, over sd (Johnson, Kotz and
    Balakrishnan, Continuous Univariate Distributions 1, section 13.10.1); far out the nearer limit.
    """
    from scipy.special import ndtr  # few recordings were rounded

    a, b = (low - mean) / sd, (high - mean) / sd
    inside = ndtr(b) - ndtr(a)
    away = (np.exp(-0.5 * a * a) - np.exp(-0.5 * b * b)) / (ROOT_2_PI * np.maximum(inside, 1e-9))
    return np.clip(mean + sd * np.where(inside > 1e-9, away, 0.0), low, high)


def rounded(problem: Problem, parts: Sequence[Part]) -> bool:
    """True when the recorder left a whole interval for the true PV of samples that count.

    The likelihood of rounded values has its lowest point elsewhere than that of the true ones, so that it draws no
    profile about the numbers found here.
    """
    return bool(np.any(off(problem, parts)[0]))


def through_rounding(problem: Problem, parts: Sequence[Part], fitted: Fit) -> Fit:
    """Return the fit with its numbers refined for values that were rounded; the same where none were.

    The noise stays that of the recorded values, so that the intervals do not pretend that PV was known better.
    """
    if not rounded(problem, parts):
        return fitted
    low, high = limits(problem, parts)
    _, step = off(problem, parts)
    now = fitted
    for _ in range(ROUNDS):
        mean = predicted_by(problem, now)
        error = (problem.measurement - mean)[problem.used]
        sd = math.sqrt(max(float(np.mean(error**2)) - step**2 / 12.0, problem.floor**2 / 12.0))
        guess = problem.with_measurement(expected(mean, sd, low, high), problem.used)
        now = finished(guess, descend(Solver(guess, now.noise), now.shape, rounds=3), now.noise)
    error = raw_error(problem, now.shape, now.coefficients)
    own = finished(problem, now.shape, fitted.noise)
    rmse = float(np.sqrt(np.mean(error[problem.used] ** 2)))
    return replace(own, coefficients=now.coefficients, error=np.where(problem.used, error, np.nan), rmse=rmse)
