"""The error on samples that a fit did not see: blocks left out in turn, everything refitted on the others.

Where OP answers to the load (`Problem.by_load`), PV is predicted a short time ahead: from OP, and from the load that
the model's error had shown until then. Elsewhere it is predicted from OP alone, however long the record.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray
from .fit import Fit, Solver, descend, finished, raw_error
from .noise import Noise, fitted_noise, known_load, whitener
from .pipeline import Part
from .problem import Problem
from .recorder import distance, fitted_problem

# each fold leaves out every fourth block; the first block always stays, as it shows how the record began. A block
# lasts many process lags, so that a random load on both sides tells nothing about its middle
FEWEST_BLOCKS, MOST_BLOCKS, LAGS_PER_BLOCK = 12, 24, 15.0
FOLDS = 4
LAGS_AFTER_HOLE = 4.0


@dataclass(frozen=True, eq=False)
class Tested:
    """A fit with its errors: in the fit (rmse) and on samples it did not see (rmse_holdout), recorder allowed for."""

    fit: Fit
    rmse: float
    rmse_holdout: float


def folds(problem: Problem, lag: float) -> list[NDArray[np.bool_]]:
    """Return for each fold which grid points are left out, (samples,) each; the blocks hold equal counts of samples.

    What follows a hole in OP is never left out: nothing outside tells what OP did there.
    """
    count = np.cumsum(problem.used)
    blocks = int(np.clip(problem.duration / (LAGS_PER_BLOCK * lag), FEWEST_BLOCKS, MOST_BLOCKS))
    block = np.minimum((count * blocks) // (count[-1] + 1), blocks - 1)
    known = np.ones(problem.samples, dtype=bool)
    for hole in problem.holes:
        known[hole.first : hole.last + int(((problem.delay or 0.0) + LAGS_AFTER_HOLE * lag) / problem.interval)] = False
    return [(block % FOLDS == fold) & (block > 0) & known for fold in range(FOLDS)]


def tested(problem: Problem, fitted: Fit, recorders: tuple[Part, ...] = (), *, rounds: int = 2) -> Tested:
    """Return the errors of a fit; searched numbers start from the whole record's and are refined on each fold."""
    seen, everywhere = fitted_problem(problem, recorders), replace(problem, used=np.ones_like(problem.used))
    squares, count = 0.0, 0
    for left_out in folds(problem, problem.settings.Ti or fitted.shape.lag):
        part = seen.masked(~left_out)
        solver = Solver(part, whitener(fitted.noise, part.used, part.interval))
        shape = descend(solver, fitted.shape, rounds=rounds) if rounds else fitted.shape
        coefficients = solver.solve(shape)[0]
        predicted = prediction(problem, everywhere, seen, replace(fitted, shape=shape, coefficients=coefficients))
        error = distance(problem, recorders, predicted)[left_out & problem.used]
        squares += float(error @ error)
        count += error.size
    error = distance(problem, recorders, prediction(problem, everywhere, seen, fitted))[problem.used]
    return Tested(fitted, float(np.sqrt(np.mean(error**2))), float(np.sqrt(squares / max(count, 1))))


def predicted_by(problem: Problem, fitted: Fit) -> FloatArray:
    """Return PV predicted by a fit on the whole grid, (samples,)."""
    return prediction(problem, replace(problem, used=np.ones_like(problem.used)), problem, fitted)


def prediction(problem: Problem, everywhere: Problem, seen: Problem, fitted: Fit) -> FloatArray:
    """Return PV predicted by a fit (samples,); `everywhere` is the problem with all samples used, `seen` as a fit sees
    it: the load is read from those samples only."""
    predicted = problem.measurement - raw_error(everywhere, fitted.shape, fitted.coefficients)
    return with_load(problem, seen.measurement, seen.used, predicted, fitted.noise)


def with_load(
    problem: Problem, measurement: FloatArray, used: NDArray[np.bool_], predicted: FloatArray, noise: Noise | None
) -> FloatArray:
    """Return a prediction from OP (samples,), with the load as known some time before where the loop is driven by it.

    noise: of the model; None: fitted to what the prediction misses.
    """
    if not problem.by_load:
        return predicted
    error, h = measurement - predicted, problem.interval
    return predicted + known_load(error, used, h, noise or fitted_noise(error, used, h), problem.ahead)


def least_squares(problem: Problem, fitted: Fit, recorders: tuple[Part, ...] = ()) -> Fit:
    """Return the fit with the smallest error itself, load or not: what a plain model can do at its best.

    In a loop driven by its load the smallest error is that of a wrong model, so that the fit stays as it is.
    """
    if problem.by_load:
        return fitted
    seen = fitted_problem(problem, recorders)
    noise = Noise(1e-3, fitted.noise.slow, fitted.noise.fast)
    shape = descend(Solver(seen, whitener(noise, seen.used, seen.interval)), fitted.shape, rounds=6)
    return finished(seen, shape, noise)


def better(problem: Problem, fitted: Fit, recorders: tuple[Part, ...] = (), *, rounds: int = 2) -> Tested:
    """Return the likeliest fit, or that of least squares where it predicts unseen samples clearly better (3 %)."""
    likely = tested(problem, fitted, recorders, rounds=rounds)
    if problem.by_load:
        return likely
    plain = tested(problem, least_squares(problem, fitted, recorders), recorders, rounds=rounds)
    return plain if plain.rmse_holdout < 0.97 * likely.rmse_holdout else likely
