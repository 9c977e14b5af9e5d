"""What the recorder did to a signal: rounding, holding, interpolating; each a pure function of a few thousand rows.

Rows come with the grid number of each sample; only neighbours on the grid are compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..record import FloatArray, IntArray
from .recording_loops import bends, changes, differences, lattice, reversals, straight_runs

LATTICE = 0.02  # how far from a whole number of steps a difference may lie
EXACT = 1e-9  # of the signal's range: rounding of numbers, not of a recorder
VISIBLE = 1e-4  # of the signal's range: smaller changes are those of a signal that has settled, not of a recorder
LEAST_RUN = 4  # samples on one straight line that are no accident
LEAST_KINKS = 5
LINEAR = 0.2  # share of the samples on straight lines above which a signal was interpolated


__all__ = ["Storage", "fast_noise", "reversals", "rounding_step", "stored_as"]


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
    return _lattice(np.sort(values))


def _lattice(ordered: FloatArray) -> float:
    """The same from the values in order."""
    if len(ordered) < 2 or ordered[0] == ordered[-1]:
        return 0.0
    return float(lattice(ordered, EXACT * float(ordered[-1] - ordered[0]), LATTICE))


def fast_noise(index: IntArray, values: FloatArray) -> float:
    """Return the standard deviation of white noise on a slow signal: 1.4826 MAD of second differences / sqrt 6."""
    return _noise(bends(index, values))


def _noise(bent: FloatArray) -> float:
    """The same from the sizes of the second differences."""
    return 1.4826 * _median(bent) / 6.0**0.5


def _median(values: FloatArray) -> float:
    """Middle of the values, 0 where there are none."""
    n = len(values)
    if not n:
        return 0.0
    parted = np.partition(values, n // 2)  # a fifth of the time of numpy's median
    above = parted[n // 2]
    return float(0.5 * ((above if n % 2 else np.maximum.reduce(parted[: n // 2])) + above))


def stored_as(index: IntArray, values: FloatArray) -> Storage:
    """Tell measurements from values that a historian held or interpolated between stored ones."""
    ordered = np.sort(values)
    span = float(ordered[-1] - ordered[0])
    step = _lattice(ordered)
    bent, neighbours, moves = differences(index, values, EXACT * span)
    noise = _noise(bent)
    plain = Storage("samples", 0.0, 1.0, 0.0, step, noise)
    if len(values) < 3 * LEAST_RUN or span == 0.0 or not neighbours:
        return plain
    held = 1.0 - moves / neighbours
    if held > 0.2 and moves >= LEAST_KINKS:
        moved = changes(index, values, EXACT * span)
        smallest = float(np.quantile(moved, 0.01))
        run = 1.0 / max(1.0 - held, 1e-9)
        # Without a deviation jumps thin out towards zero: one in a hundred of a normal law is below 2 % of the median.
        if smallest > max(2.5 * step, VISIBLE * span, 0.1 * _median(moved)):
            return Storage("held", held, run, smallest, step, noise)
        if step == 0.0 and held > 0.4:
            return Storage("held", held, run, 0.0, step, noise)
    # most signals have so few samples on straight lines that no line needs to be looked for
    if np.count_nonzero(bent <= _straight(step, span)) <= LINEAR * len(values):
        return plain
    linear, run, deviation = _straight_runs(index, values, step, span)
    if linear > LINEAR:
        return Storage("linear", linear, run, deviation, step, noise)
    return plain


def _straight(step: float, span: float) -> float:
    """Largest bend of a line that is straight but for rounding."""
    return max(1.05 * step, EXACT * span)


def _straight_runs(index: IntArray, values: FloatArray, step: float, span: float) -> tuple[float, float, float]:
    """Share of samples inside exact straight lines that rise or fall, their mean length, and the usual change on one.

    A rounded ramp is straight to a step as well; interpolation shows by kinks far larger than that between the lines.
    """
    tolerance = _straight(step, span)
    straight, kinks, between, rises, lengths = straight_runs(index, values, tolerance, LEAST_RUN - 2,
                                                             max(4.0 * step, VISIBLE * span))
    if len(rises) < LEAST_KINKS or kinks < LEAST_KINKS or between > 0.3 * min(straight, kinks):
        return 0.0, 1.0, 0.0
    return float(lengths.sum()) / len(values), float(np.mean(lengths + 1)), float(np.quantile(rises, 0.1))
