"""The error on samples that a fit did not see: blocks left out in turn, everything refitted on the others.

Where OP answers to the load (`Problem.by_load`), PV is predicted a short time ahead: from OP, and from the load that
the model's error had shown until then. Elsewhere it is predicted from OP alone, however long the record.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .fit import Fit, Solver, descend, finished, predicted_by, rms
from .noise import Noise
from .pipeline import Part
from .problem import Problem
from .recorder import distance, fitted_problem

# a block lasts many process lags, so that a random load on both sides tells nothing about its middle
FOLDS, FEWEST_BLOCKS, MOST_BLOCKS, LAGS_PER_BLOCK = 4, 12, 24, 15.0


@dataclass(frozen=True, eq=False)
class Tested:
    """A fit with its errors: in the fit (rmse) and on samples it did not see (rmse_holdout), recorder allowed for."""

    fit: Fit
    rmse: float
    rmse_holdout: float


def folds(problem: Problem, lag: float) -> list[NDArray[np.bool_]]:
    """Return for each fold which grid points are left out, (samples,) each: every fourth block of equal counts but the
    first, which shows how the record began."""
    count = np.cumsum(problem.used)
    blocks = int(np.clip(problem.duration / (LAGS_PER_BLOCK * lag), FEWEST_BLOCKS, MOST_BLOCKS))
    block = np.minimum((count * blocks) // (count[-1] + 1), blocks - 1)
    return [(block % FOLDS == fold) & (block > 0) for fold in range(FOLDS)]


def tested(problem: Problem, fitted: Fit, recorders: tuple[Part, ...] = (), *, rounds: int = 2) -> Tested:
    """Return the errors of a fit; searched numbers start from the whole record's and are refined on each fold."""
    seen = fitted_problem(problem, recorders)
    unseen = []
    for left_out in folds(problem, problem.settings.Ti or fitted.shape.lag):
        solver = Solver(seen.masked(~left_out), fitted.noise)
        shape = descend(solver, fitted.shape, rounds=rounds) if rounds else fitted.shape
        there = replace(fitted, shape=shape, coefficients=solver.solve(shape)[0])
        unseen.append(distance(problem, recorders, predicted_by(problem, there, seen))[left_out & problem.used])
    error = distance(problem, recorders, predicted_by(problem, fitted, seen))[problem.used]
    return Tested(fitted, rms(error), rms(np.concatenate(unseen)))


def better(problem: Problem, fitted: Fit, recorders: tuple[Part, ...] = ()) -> Tested:
    """Return the likeliest fit, or that of the smallest error where it predicts unseen samples better by 3 %; not in a
    loop driven by its load, where a wrong model has the smallest error."""

    def make() -> Tested:
        likely = tested(problem, fitted, recorders)
        if problem.by_load:
            return likely
        seen, noise = fitted_problem(problem, recorders), Noise(1e-3, fitted.noise.slow, fitted.noise.fast)
        shape = descend(Solver(seen, noise), fitted.shape, rounds=6)
        plain = tested(problem, finished(seen, shape, noise), recorders)
        return plain if plain.rmse_holdout < 0.97 * likely.rmse_holdout else likely

    return problem.memory.of((problem, fitted, *(part.key for part in recorders)), make)
