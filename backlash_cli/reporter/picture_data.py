"""Numbers that the pictures draw: names of units, and the two flanks of a valve with play."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..record import FloatArray, Record

Flank = tuple[FloatArray, FloatArray, str]
FOLLOWS = 0.8  # share of PV's variance that the valve has to explain before flanks are drawn


@dataclass(frozen=True)
class GapLines:
    """Where PV settles while the valve rises and falls: (OP, PV, words) of each flank, normalised."""

    rising: Flank
    falling: Flank


def per_unit(span: tuple[float, float]) -> str:
    """Words for an axis: per cent of span where no engineering range is known.

    >>> per_unit((0.0, 1.0)), per_unit((0.0, 100.0)), per_unit((0.0, 900.0))
    ('% of span', '%', 'span 0–900')
    """
    if span == (0.0, 1.0):
        return "% of span"
    if span == (0.0, 100.0):
        return "%"
    return f"span {span[0]:g}–{span[1]:g}"


def means(values: FloatArray, points: int) -> FloatArray:
    """Means over equal pieces, `points` at most: what is left when fast noise is of no interest."""
    size = max(1, len(values) // points)
    whole = len(values) // size * size
    return np.asarray(values[:whole].reshape(-1, size).mean(axis=1))


def known_part(record: Record) -> Record:
    """The record from its first to its last measurement that is a number."""
    known = np.flatnonzero(np.isfinite(record.measurement))
    return record.slice(int(known[0]), int(known[-1]) + 1) if len(known) else record


def middle_part(record: Record) -> slice:
    """A tenth of the record around its middle, 200 samples at least: to look at where no half period stands out."""
    reach = max(len(record) // 20, 100)
    middle = len(record) // 2
    return slice(max(middle - reach, 0), middle + reach)


def gap_lines(near: Record, size: float) -> GapLines | None:
    """Return the flanks PV = gain (OP -+ d/2) + offset of a short stretch, None where PV does not follow the valve.

    The valve position is OP through a gap of `size`; PV is compared with it at the delay that suits best.
    """
    from ..kernels import play

    if near.output is None or len(near) < 20:
        return None
    good = np.isfinite(near.output) & np.isfinite(near.measurement)
    op, pv = near.output[good], near.measurement[good]
    if len(op) < 20 or np.ptp(op) <= size or np.ptp(pv) == 0.0:
        return None
    valve = play(op, size, float(op[0]))
    best, gain, offset = 0.0, 0.0, 0.0
    for delay in range(0, len(op) // 8, max(1, len(op) // 200)):
        x, y = valve[: len(op) - delay], pv[delay:]
        if np.ptp(x) == 0.0:
            continue
        r = float(np.corrcoef(x, y)[0, 1])
        if r * r > best:
            best, gain = r * r, r * float(np.std(y) / np.std(x))
            offset = float(np.mean(y) - gain * np.mean(x))
    if best < FOLLOWS:
        return None
    ends = np.array([op.min(), op.max()])
    return GapLines(
        (ends, gain * (ends - size / 2) + offset, "valve opening"),
        (ends, gain * (ends + size / 2) + offset, "valve closing"),
    )
