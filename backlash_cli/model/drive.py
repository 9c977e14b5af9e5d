"""Who moves OP: the setpoint and the operator, or the load through PV and the controller?

A model that predicts PV from OP alone can be judged by its error only where OP moved for another reason than PV. Where
the loop answers to its load, OP is a mirror of that load: there a wrong model with a small gain has the smaller error
(Ljung, System Identification, section 13.4: output error is biased in closed loop, prediction errors are not).
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
