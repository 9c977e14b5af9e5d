"""What the recorder did to a signal: rounding, holding, interpolating; each a pure function of a few thousand rows.

Rows come with the grid number of each sample; only neighbours on the grid are compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from ..record import FloatArray, IntArray

LATTICE = 0.02  # share of a step that a difference may be off, growing with the square root of the number of steps,
LARGEST = 0.2  # up to this
RECUR = 0.7  # share of different values up to which levels recur
EXACT = 1e-9  # of the signal's range: rounding of numbers, not of a recorder
VISIBLE = 1e-4  # of the signal's range: smaller changes are those of a signal that has settled, not of a recorder
LEAST_RUN = 4  # samples on one straight line that are no accident
LEAST_KINKS = 5
LINEAR = 0.2  # share of the samples on straight lines above which a signal was interpolated


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

    A lattice is a finding only where levels recur, or where the typical difference is a step or two: a few scattered
    values always fit some lattice.

    >>> round(rounding_step(np.array([0.1, 0.3, 0.4, 0.2, 0.7, 0.2, 0.8, 0.5])), 9)
    0.1
    """
    gaps = np.diff(np.sort(values))
    levels = 1 + np.count_nonzero(gaps)
    gaps = gaps[gaps > EXACT * gaps.sum()]
    if not len(gaps):
        return 0.0
    for step in (gaps.min() / np.array([1.0, 2.0, 3.0, 5.0])).tolist():
        numbers = gaps / step
        allowed = np.minimum(LATTICE * np.sqrt(np.maximum(numbers, 1.0)), LARGEST)
        if np.all(np.abs(numbers - np.rint(numbers)) <= allowed):
            return step if levels <= RECUR * len(values) or np.median(gaps) <= 2.0 * step else 0.0
    return 0.0


def fast_noise(index: IntArray, values: FloatArray) -> float:
    """Return the standard deviation of white noise on a slow signal: 1.4826 MAD of second differences / sqrt 6."""
    bent = np.abs(np.diff(values, 2))[index[2:] - index[:-2] == 2]
    return 1.4826 * float(np.median(bent)) / 6.0**0.5 if len(bent) else 0.0


def reversals(values: FloatArray, threshold: float) -> int:
    """Return how often the signal turned round by `threshold` or more."""
    apart = np.linspace(0.0, EXACT, len(values))  # two summits of the same height would count as two
    return sum(len(find_peaks(side + apart, prominence=threshold)[0]) for side in (values, -values))


def stored_as(index: IntArray, values: FloatArray) -> Storage:
    """Tell measurements from values that a historian held or interpolated between stored ones."""
    if not len(values):
        return Storage("samples", 0.0, 1.0, 0.0, 0.0, 0.0)
    span, step, noise = float(np.ptp(values)), rounding_step(values), fast_noise(index, values)
    changes = np.abs(np.diff(values))[np.diff(index) == 1]
    if len(values) < 3 * LEAST_RUN or span == 0.0 or not len(changes):
        return Storage("samples", 0.0, 1.0, 0.0, step, noise)
    moved = changes[changes > EXACT * span]
    held = 1.0 - len(moved) / len(changes)
    if held > 0.2 and len(moved) >= LEAST_KINKS:
        smallest, run = float(np.quantile(moved, 0.01)), len(changes) / len(moved)
        # Without a deviation jumps thin out towards zero: one in a hundred of a normal law is below 2 % of the median.
        by_exception = smallest > max(2.5 * step, VISIBLE * span, 0.1 * float(np.median(moved)))
        if by_exception or (step == 0.0 and held > 0.4):
            return Storage("held", held, run, smallest if by_exception else 0.0, step, noise)
    linear, run, deviation = _straight_runs(index, values, step, span)
    if linear > LINEAR:
        return Storage("linear", linear, run, deviation, step, noise)
    return Storage("samples", 0.0, 1.0, 0.0, step, noise)


def _straight_runs(index: IntArray, values: FloatArray, step: float, span: float) -> tuple[float, float, float]:
    """Share of samples inside exact straight lines that rise or fall, their mean length, and the usual change on one.

    A rounded ramp is straight to a step as well; interpolation shows by kinks far larger than that between the lines.
    """
    tolerance = max(1.05 * step, EXACT * span)
    joined, bends = index[2:] - index[:-2] == 2, np.abs(np.diff(values, 2))
    straight = joined & (bends <= tolerance) & (values[2:] != values[:-2])
    if np.count_nonzero(straight) <= LINEAR * len(values):  # so few in most signals that no line need be looked for
        return 0.0, 1.0, 0.0
    kinks = np.count_nonzero(joined & (bends > 5.0 * tolerance))
    between = np.count_nonzero(joined & (bends > tolerance)) - kinks
    edges = np.flatnonzero(np.diff(np.concatenate([[False], straight, [False]])))
    first, after = edges[::2], edges[1::2]
    lengths, rises = after - first, np.abs(values[after + 1] - values[first])
    line = (lengths >= LEAST_RUN - 2) & (rises > max(4.0 * step, VISIBLE * span))
    if (np.count_nonzero(line) < LEAST_KINKS or kinks < LEAST_KINKS
            or between > 0.3 * min(np.count_nonzero(straight), kinks)):
        return 0.0, 1.0, 0.0
    return (float(lengths[line].sum()) / len(values), float(np.mean(lengths[line] + 1)),
            float(np.quantile(rises[line], 0.1)))
