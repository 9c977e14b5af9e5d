"""How much a recorded loop is shaken: measurement noise and the size of its load, for a simulation like the record."""

from __future__ import annotations

import numpy as np

from ..record import FloatArray, Record, SampleState
from .compensation import noise_gains
from .controller import Controller

SMALLEST_LOAD, LARGEST_LOAD = 1.5, 0.2  # dead bands; span of output


def white_deviation(values: FloatArray, index: FloatArray) -> float:
    """Return the standard deviation of white noise on a slow signal (samples,), robust against steps and spikes.

    From third differences over samples in a row, whose variance is 20 times that of the noise; slow motion, trends
    and curvature cancel.
    """
    third = np.diff(values, 3)[np.diff(index, 3) == 0]
    third = third[np.isfinite(third)]
    if not len(third):
        return 0.0
    return 1.4826 * float(np.median(np.abs(third))) / float(np.sqrt(20.0))


def noise_density(record: Record, controller: Controller) -> float:
    """Return the density [span^2 s] of the measurement noise, in the sense of the effect `measurement_noise`.

    Between samples that are further apart than the controller's filter time noise cannot be told from what the
    controller never sees; there OP shows how much of it arrives.
    """
    good = record.state == SampleState.GOOD
    index = record.index[good].astype(np.float64)
    density = white_deviation(record.measurement[good], index) ** 2 * record.interval
    if record.output is not None and record.interval >= controller.filter_time:
        arrived = white_deviation(record.output[good], index)
        density = min(density, (arrived / noise_gains(controller)[1]) ** 2)
    return density


def typical_load(record: Record, d: float) -> float:
    """Return the size of a load step that makes OP move as far as in the record [span of output]."""
    smallest = SMALLEST_LOAD * d
    if record.output is None:
        return float(np.clip(2.0 * smallest, None, LARGEST_LOAD))
    low, high = np.nanpercentile(record.output[record.usable], [10.0, 90.0])
    return float(max(min(0.5 * (high - low), LARGEST_LOAD), smallest))
