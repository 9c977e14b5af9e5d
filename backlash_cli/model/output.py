"""What OP tells by itself: who moves it, the setpoint and the operator or the load, and in which steps it was recorded.

A model that predicts PV from OP alone can be judged by its error only where OP moved for another reason than PV. Where
the loop answers to its load, OP is a mirror of that load: there a wrong model with a small gain has the smaller error
(Ljung, System Identification, section 13.4: output error is biased in closed loop, prediction errors are not).

The controller moved the valve by OP as it was, the historian may have kept it rounded. Where the record stays at one
level for a while and then at the next, OP crossed the middle between them at that time; between such times it went on
evenly, and where it turned it came on average as far as the level. Whether the valve got the rounded OP or the one
before rounding is not known beforehand: a search tries both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray
from .response import delayed_lag

LAGS = 7  # shapes of the answer of OP to a setpoint move: lags from one sample to a quarter of the record
# shares above this: the record shows what OP does to PV, and the error of the prediction from OP alone is the measure
MOSTLY = 0.5
# a load-driven loop is predicted this share of Ti ahead: well before OP can answer to what came meanwhile
AHEAD = 0.5
# without Ti: until PV has moved by this many times its noise, but not longer than a part of the record
VISIBLE, PART = 2.0, 50.0


def moved_from_outside(
    output: FloatArray, setpoint: FloatArray, manual: NDArray[np.bool_], used: NDArray[np.bool_], h: float
) -> float:
    """Return the share of the variance of OP, 0..1, that setpoint moves or a hand on the output explain.

    All arrays (samples,); h: interval [s]. The answer of OP to the setpoint is fitted as a sum of lags.
    """
    y = output[used]
    spread = float(np.var(y))
    if spread <= 0.0:
        return 0.0
    columns = [np.ones_like(output)]
    if np.ptp(setpoint[used]) > 0.0:
        taus = np.geomspace(h, max(0.25 * h * len(output), 2.0 * h), LAGS)
        columns += [setpoint, *(delayed_lag(setpoint, h, tau, 0.0) for tau in taus)]
    by_hand = manual & used
    if np.count_nonzero(by_hand) > 1 and np.ptp(output[by_hand]) > 0.0:
        columns += [by_hand.astype(np.float64), np.where(by_hand, output - np.mean(output[by_hand]), 0.0)]
    X = np.column_stack(columns)[used]
    X -= X.mean(axis=0)
    X /= np.maximum(X.std(axis=0), 1e-12)
    A = X.T @ X + 1e-6 * len(y) * np.eye(X.shape[1])
    rest = y - y.mean() - X @ np.linalg.solve(A, X.T @ (y - y.mean()))
    return float(np.clip(1.0 - np.var(rest) / spread, 0.0, 1.0))


def trust(share: float) -> float:
    """Return how much the error of the prediction from OP alone tells, 0..1, for a share moved from outside.

    As in a Wiener filter: 1 / (1 + (load / signal)^2), with the variances of OP as load and signal.
    """
    return share**2 / (share**2 + (1.0 - share) ** 2)


def horizon(recorded: FloatArray, floor: float, h: float, Ti: float | None) -> int:
    """Return how many samples ahead a load-driven loop is predicted; recorded: (samples,) PV, nan in holes."""
    most = max(int(len(recorded) / PART), 1)
    if Ti:
        return int(np.clip(round(AHEAD * Ti / h), 1, most))
    m = 1
    while m < most:
        move = recorded[m:] - recorded[:-m]
        if np.nanmean(move**2) >= 2.0 * (VISIBLE * floor) ** 2:
            break
        m = max(m + 1, int(1.25 * m))
    return min(m, most)


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
