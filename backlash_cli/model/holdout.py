"""The error on samples that a fit did not see: blocks left out in turn, everything refitted on the others.

Where OP answers to the load (`Problem.by_load`), PV is predicted a short time ahead: from OP, and from the load that
the model's error had shown until then. Elsewhere it is predicted from OP alone, however long the record.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray
from .fit import Fit, Solver, descend, finished, predicted_by
from .noise import Noise
from .pipeline import Part
from .problem import Problem
from .recorder import distance, fitted_problem

# each fold leaves out every fourth block; the first block always stays, as it shows how the record began. A block
# lasts many process lags, so that a random load on both sides tells nothing about its middle
FEWEST_BLOCKS, MOST_BLOCKS, LAGS_PER_BLOCK = 12, 24, 15.0
FOLDS = 4
LAGS_AFTER_HOLE = 4.0
# quantile of Student's t with 11 degrees of freedom that chance exceeds once in 40
SURE = 2.2


@dataclass(frozen=True, eq=False)
class Tested:
    """A fit with its errors: in the fit (rmse) and on samples it did not see (rmse_holdout), recorder allowed for.

    unseen: (samples,) the latter, nan where nothing was left out.
    """

    fit: Fit
    rmse: float
    rmse_holdout: float
    unseen: FloatArray

    def surely_worse(self, other: Tested) -> bool:
        """True when samples that neither has seen are predicted worse than by `other`: a t-test of the squared errors,
        block by block, as a load that passes in one of them tells little."""
        more = self.unseen**2 - other.unseen**2
        blocks = [float(np.mean(block)) for block in np.array_split(more[np.isfinite(more)], FEWEST_BLOCKS)]
        return float(np.mean(blocks)) > SURE * float(np.std(blocks, ddof=1)) / np.sqrt(FEWEST_BLOCKS)


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
    seen = fitted_problem(problem, recorders)
    unseen = np.full(problem.samples, np.nan)
    for left_out in folds(problem, problem.settings.Ti or fitted.shape.lag):
        solver = Solver(seen.masked(~left_out), fitted.noise)
        shape = descend(solver, fitted.shape, rounds=rounds) if rounds else fitted.shape
        there = replace(fitted, shape=shape, coefficients=solver.solve(shape)[0])
        new = left_out & problem.used
        unseen[new] = distance(problem, recorders, predicted_by(problem, there, seen))[new]
    error = distance(problem, recorders, predicted_by(problem, fitted, seen))[problem.used]
    rmse, holdout = (float(np.sqrt(e @ e / max(e.size, 1))) for e in (error, unseen[np.isfinite(unseen)]))
    return Tested(fitted, rmse, holdout, unseen)


def better(problem: Problem, fitted: Fit, recorders: tuple[Part, ...] = ()) -> Tested:
    """Return the likeliest fit, or that of the smallest error itself where it predicts unseen samples better by 3 %.

    In a loop driven by its load the smallest error is that of a wrong model, so that the fit stays as it is.
    """
    def make() -> Tested:
        likely = tested(problem, fitted, recorders)
        if problem.by_load:
            return likely
        seen, noise = fitted_problem(problem, recorders), Noise(1e-3, fitted.noise.slow, fitted.noise.fast)
        shape = descend(Solver(seen, noise), fitted.shape, rounds=6)
        plain = tested(problem, finished(seen, shape, noise), recorders)
        return plain if plain.rmse_holdout < 0.97 * likely.rmse_holdout else likely

    found: Tested = problem.memory.of((problem, fitted, *(part.key for part in recorders)), make)
    return found
