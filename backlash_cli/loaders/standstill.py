"""Where a long measurement is frozen: what `frozen` finds in a whole one, from going through it some times."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .ranks import Stream, StreamValues
from .states import FROZEN_RUN, LEAST_CHANGES, OPPOSED, QUIET_SHARE, RESOLVED, Repeats

Stretch = tuple[int, int]  # first sample, and the one after the last


def still_stretches(repeats: Repeats, measured: Stream) -> list[Stretch]:
    """Return the frozen stretches of a measurement. repeats: counted in all of it. measured: gives it anew."""
    if repeats.samples < 2 * LEAST_CHANGES:
        return []
    limit = repeats.longest_by_chance()
    found = [(start, start + length) for start, length in repeats.long if length >= limit]
    if found and not _noisy(measured, found):
        limit = max(limit, QUIET_SHARE * repeats.samples)
        found = [(start, end) for start, end in found if end - start >= limit]
    return [(start, end + 1) for start, end in found]


def flags(stretches: list[Stretch], first: int, values: NDArray[np.float64]) -> NDArray[np.bool_] | None:
    """Return (samples,) True in the stretches; None where there are none. values: those from sample `first` on."""
    samples = len(values)
    here = [(start, end) for start, end in stretches if end > first and start < first + samples]
    if not here:
        return None
    out = np.zeros(samples, bool)
    for start, end in here:
        out[max(start - first, 0) : end - first] = True
    return out


def _noisy(measured: Stream, stretches: list[Stretch]) -> bool:
    """As `states.noisy`, of changes outside the stretches."""
    count, power, product = 0, 0.0, 0.0
    for a, b in _changes(measured, stretches):
        count += len(a)
        power += float(a @ a + b @ b) / 2.0
        product += float(a @ b)
    if count < FROZEN_RUN or not power > 0 or product / power >= OPPOSED:
        return False
    sizes = StreamValues(lambda: (np.abs(a[a != 0]) for a, _ in _changes(measured, stretches)))
    least, middle = sizes.quantiles([0.01, 0.5])
    return middle >= RESOLVED * least


def _changes(measured: Stream, stretches: list[Stretch]) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Yield neighbouring changes, both of numbers and outside the stretches."""
    last, first = np.zeros(0), 0
    for part in measured():
        values = np.concatenate([last, part])
        changes = np.diff(values)
        keep = np.isfinite(changes)
        inside = flags(stretches, first, changes)
        if inside is not None:
            keep &= ~inside
        both = keep[1:] & keep[:-1]
        yield changes[:-1][both], changes[1:][both]
        first += max(len(values) - 2, 0)
        last = values[-2:]
