"""What the recorder did to a signal: rounding, holding, interpolating; each a pure function of a few thousand rows.

Rows come with the grid number of each sample; only neighbours on the grid are compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..record import FloatArray, IntArray

LATTICE = 0.02  # how far from a whole number of steps a difference may lie
EXACT = 1e-9  # of the signal's range: rounding of numbers, not of a recorder
VISIBLE = 1e-4  # of the signal's range: smaller changes are those of a signal that has settled, not of a recorder
LEAST_RUN = 4  # samples on one straight line that are no accident
LEAST_KINKS = 5


@dataclass(frozen=True)
class Storage:
    """How a signal was stored. kind: "samples", "held" (by exception, or a slower scan), "linear" (interpolated).

    share: of the samples that are not measurements of their own. run: samples per stored value, on average.
    deviation: smallest change that was stored (exception deviation), 0 when not seen. step: rounding step, 0 if none.
    noise: standard deviation of the fast noise, from second differences.
    """

    kind: str
    share: float
    run: float
    deviation: float
    step: float
    noise: float


def rounding_step(values: FloatArray) -> float:
    """Return the step of the lattice that all values lie on, 0 when they lie on none (in the signal's unit).

    >>> round(rounding_step(np.array([0.1, 0.3, 0.4, 0.2, 0.7, 0.2, 0.8, 0.5])), 9)
    0.1
    """
    levels = np.unique(values)
    if len(levels) < 2:
        return 0.0
    gaps = np.diff(levels)
    gaps = gaps[gaps > EXACT * (levels[-1] - levels[0])]
    smallest = float(gaps.min())
    for parts in (1, 2, 3, 5):
        steps = gaps * (parts / smallest)
        if np.all(np.abs(steps - np.round(steps)) <= np.minimum(LATTICE * np.sqrt(np.maximum(steps, 1.0)), 0.2)):
            # A lattice is a finding only where levels recur: a few scattered values always fit some lattice.
            recurring = len(levels) <= 0.7 * len(values) or np.median(steps) <= 2.0
            return float(smallest / parts) if recurring else 0.0
    return 0.0


def fast_noise(index: IntArray, values: FloatArray) -> float:
    """Return the standard deviation of white noise on a slow signal: 1.4826 MAD of second differences / sqrt 6."""
    bend = _bends(index, values)
    return float(1.4826 * np.median(np.abs(bend)) / np.sqrt(6.0)) if len(bend) else 0.0


def stored_as(index: IntArray, values: FloatArray) -> Storage:
    """Tell measurements from values that a historian held or interpolated between stored ones."""
    step = rounding_step(values)
    noise = fast_noise(index, values)
    plain = Storage("samples", 0.0, 1.0, 0.0, step, noise)
    if len(values) < 3 * LEAST_RUN or np.ptp(values) == 0.0:
        return plain
    neighbour = np.diff(index) == 1
    change = np.abs(np.diff(values))[neighbour]
    moved = change > EXACT * np.ptp(values)
    if not len(change):
        return plain
    held = 1.0 - float(moved.mean())
    if held > 0.2 and moved.sum() >= LEAST_KINKS:
        smallest = float(np.quantile(change[moved], 0.01))
        run = 1.0 / max(1.0 - held, 1e-9)
        # Without a deviation jumps thin out towards zero: one in a hundred of a normal law is below 2 % of the median.
        jump = float(np.median(change[moved]))
        if smallest > max(2.5 * step, VISIBLE * np.ptp(values), 0.1 * jump):
            return Storage("held", held, run, smallest, step, noise)
        if step == 0.0 and held > 0.4:
            return Storage("held", held, run, 0.0, step, noise)
    linear, run, deviation = _straight_runs(index, values, step)
    if linear > 0.2:
        return Storage("linear", linear, run, deviation, step, noise)
    return plain


def _bends(index: IntArray, values: FloatArray) -> FloatArray:
    together = index[2:] - index[:-2] == 2
    return np.asarray((values[2:] - 2.0 * values[1:-1] + values[:-2])[together])


def _straight_runs(index: IntArray, values: FloatArray, step: float) -> tuple[float, float, float]:
    """Share of samples inside exact straight lines that rise or fall, their mean length, and the usual change on one.

    A rounded ramp is straight to a step as well; interpolation shows by kinks far larger than that between the lines.
    """
    together = index[2:] - index[:-2] == 2
    bend = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2])
    tolerance = max(1.05 * step, EXACT * float(np.ptp(values)))
    straight = together & (bend <= tolerance) & (np.abs(values[2:] - values[:-2]) > 0.0)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], straight.astype(np.int8), [0]])))
    first, last = edges[::2], edges[1::2]  # runs of centres first + 1 .. last
    rise = np.abs(values[np.minimum(last + 1, len(values) - 1)] - values[first])
    real = (last - first >= LEAST_RUN - 2) & (rise > max(4.0 * step, VISIBLE * float(np.ptp(values))))
    kinks = np.sum(together & (bend > 5.0 * tolerance))
    between = np.sum(together & (bend > tolerance) & (bend <= 5.0 * tolerance))
    if real.sum() < LEAST_KINKS or kinks < LEAST_KINKS or between > 0.3 * min(straight.sum(), kinks):
        return 0.0, 1.0, 0.0
    inside = float(np.sum((last - first)[real])) / len(values)
    return inside, float(np.mean((last - first + 1)[real])), float(np.quantile(rise[real], 0.1))


def reversals(values: FloatArray, threshold: float) -> int:
    """Return how often the signal turned round by more than `threshold` (zigzag count)."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(values))) != 0) + 1
    points = np.concatenate([values[:1], values[turns], values[-1:]])
    count, direction = 0, 0
    high = low = float(points[0])
    for value in points.tolist():
        if direction >= 0 and value > high:
            high = value
        if direction <= 0 and value < low:
            low = value
        if direction >= 0 and high - value > threshold:
            count += direction > 0
            direction, low = -1, value
        elif direction <= 0 and value - low > threshold:
            count += direction < 0
            direction, high = 1, value
    return count
