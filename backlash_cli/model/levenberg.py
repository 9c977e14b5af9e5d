"""The one optimiser of the models: damped Gauss-Newton steps downhill in a sum of squares."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from ..record import FloatArray

State = TypeVar("State")
Local = tuple[FloatArray, FloatArray, Callable[[FloatArray], State]]
# damping after a step that was better, and after one that was not; steps tried from one place
LESS, MORE, TRIES = 0.2, 8.0, 4


def downhill(state: State, squares: Callable[[State], float], local: Callable[[State], Local[State]], samples: int,
             rounds: int, tolerance: float, damping: float = 1e-2) -> State:
    """Return a state of fewer squares, by at most `rounds` steps, until the deviance gains less than `tolerance`.

    squares: sum over `samples` errors; the deviance is samples times its logarithm. local: of a state half the Hessian
    (numbers, numbers) and gradient (numbers,) of the squares, and the state that is moved by (numbers,).
    Source: Levenberg (1944), Marquardt (1963), damping scaled by the diagonal.
    """
    least = squares(state)
    for _ in range(rounds):
        A, g, moved = local(state)
        diagonal = np.maximum(np.diag(A), 1e-12 * max(float(np.max(np.diag(A))), 1e-300))
        gained = 0.0
        for _try in range(TRIES):
            trial = moved(np.asarray(-np.linalg.solve(A + np.diag(damping * diagonal), g), dtype=np.float64))
            found = squares(trial)
            if found < least:
                gained = samples * float(np.log(least / found))
                state, least, damping = trial, found, max(damping * LESS, 1e-6)
                break
            damping = min(damping * MORE, 1e6)
        if gained < tolerance:
            break
    return state
