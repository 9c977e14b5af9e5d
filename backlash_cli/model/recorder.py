"""Effects of the recorder: they do not move the process, they say how far a recorded value may be off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..effects import Effect
from ..record import FloatArray
from .candidates import starts
from .clues import Clue
from .fit import Fit
from .noise import whitener
from .pipeline import Part
from .problem import FEWEST_SAMPLES, Problem, hold


def recorders(problem: Problem, base: Fit, effects: Sequence[Effect]) -> list[Part]:
    """Return the recorder effects that the recorded values show, the coarsest setting of each first proposed."""
    out = []
    for effect in effects:
        if effect.fitted and effect.fitting.bounds is not None:
            clue = Clue(problem, base.shape, whitener(base.noise, problem.used, problem.interval), {})
            out += starts(effect, clue, problem.columns)[:1]
    return out


def fitted_problem(problem: Problem, parts: Sequence[Part]) -> Problem:
    """Return the problem as a fit should see it: where the recorder repeats old values, only what it just kept."""
    low, high = limits(problem, parts)
    exact = problem.used & (high - low <= 0.0)
    wide = problem.used & (high - low > 0.0)
    if np.count_nonzero(exact) >= FEWEST_SAMPLES and np.any(wide):
        return problem.masked(exact)
    return problem


def only_reports(problem: Problem, parts: Sequence[Part]) -> bool:
    """True when old values are repeated, so that PV is known only where an exception test let it through."""
    low, high = limits(problem, parts)
    wide = problem.used & (high > low)
    return bool(np.any(wide)) and not np.all(wide[problem.used])


def recorded_floor(problem: Problem, parts: Sequence[Part], base: Fit) -> float:
    """Return the noise floor of what a recorder left: repeats hide the noise, a step of q stands for q / sqrt(12).

    Where old values repeat, the reports themselves are exact, so that the plain model's error there is a limit, too.
    """
    low, high = limits(problem, parts)
    wide = problem.used & (high > low)
    if not np.any(wide):
        return problem.floor
    step = float(np.mean((high - low)[wide])) / np.sqrt(12.0)
    return max(problem.floor, step if np.all(wide[problem.used]) else min(0.5 * step, base.rmse))


def limits(problem: Problem, parts: Sequence[Part]) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest true PV of each sample, (samples,) each; equal where nothing was rounded."""
    low = high = problem.measurement
    for part in parts:
        if part.effect.fitting.bounds is not None:
            # a value that was not recorded must not look like one that was just kept
            held = np.where(problem.used, problem.measurement, np.nan)
            filled = hold(held)
            a, b = part.effect.fitting.bounds(filled, part.effect.pack(part.values))
            low, high = np.minimum(low, a), np.maximum(high, b)
    return low, high


def distance(problem: Problem, parts: Sequence[Part], predicted: FloatArray) -> FloatArray:
    """Return measured minus predicted PV (samples,), less what the recorder may have rounded away."""
    low, high = limits(problem, parts)
    nearest = np.clip(predicted, low, high)
    return np.where(problem.used, nearest - predicted, 0.0)
