"""The published rule: from duration, area and peak of a half period to its dead-band estimate, and the two gates.

T. Haegglund, Automatic on-line estimation of backlash in control loops, J. Process Control 17 (2007) 489-499. Each
equation is written once, for numbers as for arrays over half periods.
"""

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..record import FloatArray

Numbers = TypeVar("Numbers", float, FloatArray)

SLOW_ENOUGH = 5.0  # gate dt >= 5 Ti: the signals are slow, the valve moves through statics
SHAPE_LIMIT = 2.0  # gate e_max < 2 dy: a half period flattened by the dead band, not a load disturbance

# Why a half period is refused, as it is named in reports; inside, its place here.
WHY = ("ok", "shape", "too_short", "incomplete", "not_positive")
OK, SHAPE, TOO_SHORT, INCOMPLETE, NOT_POSITIVE = range(len(WHY))


def mean_error(area: ArrayLike, duration: ArrayLike) -> FloatArray:
    """Return dy, the mean of |e| over a half period (12). area [span s], duration [s] -> [span]."""
    length = np.asarray(duration, dtype=np.float64)
    return np.asarray(np.where(length > 0.0, area / np.where(length > 0.0, length, 1.0), 0.0))


def output_change(dy: Numbers, duration: Numbers, K: float, Ti: float) -> Numbers:
    """Return du = K/Ti dy dt (11): how far the integral part moved the output [output span]."""
    return abs(K) / Ti * dy * duration


def dead_band(dy: Numbers, duration: Numbers, K: float, Ti: float, Kp: float) -> Numbers:
    """Return the dead-band estimate d = (K dt/Ti - 1/Kp) dy of a half period (15) [output span].

    >>> round(dead_band(0.01, 20.0, K=1.2, Ti=2.2, Kp=1.0), 12)  # (10.909 - 1) * 0.01
    0.099090909091
    """
    return output_change(dy, duration, K, Ti) - dy / abs(Kp)


def gate(duration: ArrayLike, dy: ArrayLike, e_max: ArrayLike, complete: ArrayLike, d: ArrayLike,
         Ti: float) -> NDArray[np.uint8]:
    """Return why each half period is refused, as its place in WHY; OK if it is not.

    duration [s], dy and e_max [span], complete, d [output span]: (half_periods,).
    """
    reasons = [~np.asarray(complete), np.asarray(duration) < SLOW_ENOUGH * Ti,
               np.asarray(e_max) >= SHAPE_LIMIT * np.asarray(dy), np.asarray(d) <= 0.0]
    return np.select(reasons, [INCOMPLETE, TOO_SHORT, SHAPE, NOT_POSITIVE], OK).astype(np.uint8)
