"""What a historian does to signals before they are exported: rounding, exception reporting, straight lines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..record import FloatArray
from .applied import Applied


@dataclass(frozen=True)
class Recorder:
    """An effect between the loop and the export.

    signals: which of SP, PV, OP it treats. lines: the historian joins the values at which the recorded signal
    changed by straight lines instead of holding them.
    """

    applied: Applied
    signals: tuple[str, ...] = ("PV", "OP")
    lines: bool = False


def recorded(
    signals: Mapping[str, FloatArray], recorders: tuple[Recorder, ...], interval: float
) -> dict[str, FloatArray]:
    """Send the recorded signals, name -> (samples,), through the recorders in order."""
    result = dict(signals)
    for recorder in recorders:
        for name in recorder.signals:
            original = result[name]
            kept = recorder.applied.effect.apply(original, recorder.applied.p, interval)
            result[name] = draw_lines(original, kept) if recorder.lines else kept
    return result


def draw_lines(original: FloatArray, held: FloatArray) -> FloatArray:
    """Join the samples that were reported by straight lines, as a historian interpolates.

    original, held: (samples,) before and after exception reporting. A sample was reported when the held value moved;
    the sample before it is reported too, as exception reporting does, so that a hold does not become a ramp.
    """
    if held.size == 0:
        return held.copy()
    moved = np.flatnonzero(np.diff(held) != 0.0) + 1
    points = np.unique(np.concatenate([[0], moved - 1, moved, [held.size - 1]]))
    return np.interp(np.arange(held.size), points, original[points])
