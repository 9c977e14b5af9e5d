"""OP that was recorded in steps: where it may have been between them.

The controller moved the valve by OP as it was, the historian kept it rounded. Where the record stays at one level for a
while and then at the next, OP crossed the middle between them at that time; between such times it went on evenly, and
where it turned it came on average as far as the level. Whether the valve got the rounded OP or the one before rounding
is not known beforehand: a search tries both.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..record import FloatArray

if TYPE_CHECKING:
    from .problem import Problem

# fewer moves than this tell nothing about a step; a record of which fewer rows repeat is not rounded coarsely
FEWEST_MOVES, REPEATS = 50, 0.3
# moves of this many steps at once are jumps of OP, no crossings
JUMP = 1.5


def step_of(output: FloatArray) -> float:
    """Return the step in which OP (samples,) was recorded, 0 when it was not recorded in coarse steps."""
    move = np.abs(np.diff(output))
    moved = move[move > 1e-9]
    if moved.size < FEWEST_MOVES or moved.size > (1.0 - REPEATS) * move.size:
        return 0.0
    step = float(np.quantile(moved, 0.1))
    off = np.abs(moved / step - np.rint(moved / step))
    levels = np.unique(np.rint(output / step)).size
    # an operator's moves are few and large; rounding leaves mostly moves of one step
    usual = float(np.mean(moved < JUMP * step))
    return step if np.mean(off < 0.05) > 0.9 and usual > 0.5 and levels < 0.5 * moved.size else 0.0


def between_steps(output: FloatArray, step: float) -> FloatArray:
    """Return OP (samples,) as it may have been before it was rounded to `step`."""
    at = np.flatnonzero(np.abs(np.diff(output)) > 1e-9) + 1
    first, last = np.concatenate([[0], at]), np.concatenate([at, [len(output)]]) - 1
    level = output[first]
    size = np.diff(level)
    nodes: list[tuple[float, float]] = [(0.0, float(level[0]))]
    for i, (a, b) in enumerate(zip(first, last, strict=True)):
        before, after = (size[i - 1] if i else 0.0), (size[i] if i < len(size) else 0.0)
        if i and abs(before) > JUMP * step:
            nodes.append((float(a), float(level[i])))
        if before * after <= 0.0 and b > a:
            nodes.append((0.5 * (a + b), float(level[i])))
        if after == 0.0:
            continue
        if abs(after) > JUMP * step:
            nodes.append((float(b), float(level[i])))
        else:
            nodes.append((b + 0.5, float(level[i] + 0.5 * after)))
    nodes.append((float(len(output) - 1), float(level[-1])))
    where, value = np.array(nodes).T
    order = np.argsort(where, kind="stable")
    return np.interp(np.arange(len(output), dtype=np.float64), where[order], value[order])


def finer(problem: Problem) -> Problem | None:
    """Return the problem with OP as it may have been before rounding, None when OP was not rounded coarsely."""
    if not problem.output_step:
        return None
    return replace(problem, output=between_steps(problem.output, problem.output_step), memory={}, moved={}, others={})
