"""The published rule: from duration, area and peak of a half period to its dead-band estimate, and the two gates.

T. Haegglund, Automatic on-line estimation of backlash in control loops, J. Process Control 17 (2007) 489-499. Each
equation is written once, for numbers as they are and inside the compiled loop over all half periods of a record.
"""

from __future__ import annotations

import numba
import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from ..record import FloatArray

SLOW_ENOUGH = 5.0  # gate dt >= 5 Ti: the signals are slow, the valve moves through statics
SHAPE_LIMIT = 2.0  # gate e_max < 2 dy: a half period flattened by the dead band, not a load disturbance

# Why a half period is refused, as it is named in reports; inside, its place here.
WHY = ("ok", "shape", "too_short", "incomplete", "not_positive", "setpoint_move", "below_noise")
OK, SHAPE, TOO_SHORT, INCOMPLETE, NOT_POSITIVE, SETPOINT_MOVE, BELOW_NOISE = range(len(WHY))


@register_jitable
def mean_error(area: float, duration: float) -> float:
    """Return dy, the mean of |e| over a half period (12). area [span s], duration [s] -> [span]."""
    return area / duration if duration > 0.0 else 0.0


@register_jitable
def output_change(dy: float, duration: float, K: float, Ti: float) -> float:
    """Return du = K/Ti dy dt (11): how far the integral part moved the output [output span]."""
    return abs(K) / Ti * dy * duration


@register_jitable
def dead_band(dy: float, duration: float, K: float, Ti: float, Kp: float) -> float:
    """Return the dead-band estimate d = (K dt/Ti - 1/Kp) dy of a half period (15) [output span].

    >>> round(dead_band(0.01, 20.0, K=1.2, Ti=2.2, Kp=1.0), 12)  # (10.909 - 1) * 0.01
    0.099090909091
    """
    return output_change(dy, duration, K, Ti) - dy / abs(Kp)


@register_jitable
def gate(duration: float, dy: float, e_max: float, complete: bool, Ti: float) -> int:
    """Return why a half period is refused, as its place in WHY; OK if it is not."""
    if not complete:
        return INCOMPLETE
    if duration < SLOW_ENOUGH * Ti:
        return TOO_SHORT
    return SHAPE if e_max >= SHAPE_LIMIT * dy else OK


@numba.njit(cache=True, nogil=True, error_model="numpy")
def judged(begin: FloatArray, end: FloatArray, area: FloatArray, e_max: FloatArray, complete: NDArray[np.bool_],
           interval: float, K: float, Ti: float, Kp: float) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Apply the rule to all half periods, positions in samples (see Segments).

    Returns begin [s], duration [s], dy and d of each (4, half_periods), and its place in WHY.
    """
    found, refused = np.empty((4, len(begin))), np.empty(len(begin), np.uint8)
    for k in range(len(begin)):
        duration = (end[k] - begin[k]) * interval
        dy = mean_error(area[k] * interval, duration)
        d = dead_band(dy, duration, K, Ti, Kp)
        why = gate(duration, dy, e_max[k], complete[k], Ti)
        found[0, k], found[1, k], found[2, k], found[3, k] = begin[k] * interval, duration, dy, d
        refused[k] = NOT_POSITIVE if why == OK and d <= 0.0 else why
    return found, refused
