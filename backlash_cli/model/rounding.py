"""A fit through rounded values: what PV was before the recorder rounded it is guessed from the model, and fitted again.

Expectation and maximisation (Dempster, Laird and Rubin, J. Royal Statistical Society B 39, 1977): given the model, the
true PV of a sample is normal about the prediction, cut off where the recorder would have rounded to another value.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import ndtr

from ..record import FloatArray
from .fit import Fit, Solver, descend, finished, raw_error
from .holdout import predicted_by
from .noise import whitener
from .pipeline import Part
from .problem import Problem
from .recorder import limits

# each round closes a part of the distance; it takes that many when the step is as wide as what is looked for
ROUNDS = 20
ROOT_2_PI = math.sqrt(2.0 * math.pi)


def expected(mean: FloatArray, sd: float, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the mean of a normal quantity (samples,) of which is known that it lies between low and high.

    mean + sd (p(a) - p(b)) / (P(b) - P(a)) with a, b = the limits less the mean, over sd (Johnson, Kotz and
    Balakrishnan, Continuous Univariate Distributions 1, section 13.10.1); far out the nearer limit.
    """
    a, b = (low - mean) / sd, (high - mean) / sd
    inside = ndtr(b) - ndtr(a)
    off = (np.exp(-0.5 * a * a) - np.exp(-0.5 * b * b)) / (ROOT_2_PI * np.maximum(inside, 1e-9))
    return np.clip(mean + sd * np.where(inside > 1e-9, off, 0.0), low, high)


def rounded(problem: Problem, recorders: tuple[Part, ...]) -> bool:
    """True when the recorder left a whole interval for the true PV of samples that count.

    The likelihood of rounded values has its lowest point elsewhere than that of the true ones, so that it draws no
    profile about the numbers found here.
    """
    low, high = limits(problem, recorders)
    return bool(np.any(problem.used & (high > low)))


def through_rounding(problem: Problem, recorders: tuple[Part, ...], fitted: Fit) -> Fit:
    """Return the fit with its numbers refined for values that were rounded; the same where none were.

    The noise stays that of the recorded values, so that the intervals do not pretend that PV was known better.
    """
    if not rounded(problem, recorders):
        return fitted
    low, high = limits(problem, recorders)
    wide = problem.used & (high > low)
    step = float(np.mean((high - low)[wide]))
    now = fitted
    for _ in range(ROUNDS):
        mean = predicted_by(problem, now)
        error = (problem.measurement - mean)[problem.used]
        sd = math.sqrt(max(float(np.mean(error**2)) - step**2 / 12.0, problem.floor**2 / 12.0))
        guess = problem.with_measurement(expected(mean, sd, low, high), problem.used)
        shape = descend(Solver(guess, whitener(now.noise, guess.used, guess.interval)), now.shape, rounds=3)
        now = finished(guess, shape, now.noise)
    error_now = raw_error(problem, now.shape, now.coefficients)
    own = finished(problem, now.shape, fitted.noise)
    rmse = float(np.sqrt(np.mean(error_now[problem.used] ** 2)))
    return replace(
        own, coefficients=now.coefficients, error=np.where(problem.used, error_now, np.nan), rmse=rmse
    )
