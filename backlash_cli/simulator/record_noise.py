"""How much a recorded loop is shaken: measurement noise and the size of its load, for a simulation like the record."""

from __future__ import annotations

import numpy as np

from ..record import FloatArray, Record, SampleState
from .controller import Controller

SMALLEST_LOAD, LARGEST_LOAD = 1.5, 0.2  # dead bands; span of output


def white_deviation(values: FloatArray, index: FloatArray) -> float:
    """Return the standard deviation of white noise on a slow signal (samples,), robust against steps and spikes.

    From third differences over samples in a row, whose variance is 20 times that of the noise; slow motion, trends
    and curvature cancel.
    """
    in_a_row = index[3:] - index[:-3] == 3
    third = np.abs(np.diff(values, 3)[in_a_row])
    third = third[np.isfinite(third)]
    if not len(third):
        return 0.0
    size = 1.4826 * float(np.median(third))
    if size == 0.0:
        # coarse rounding: most samples repeat, and the noise shows in the steps of the others
        size = float(np.sqrt(np.mean(np.sort(third)[: max(1, int(0.98 * len(third)))] ** 2)))
    return size / float(np.sqrt(20.0))


def noise_density(record: Record, controller: Controller) -> float:
    """Return the density [span^2 s] of the measurement noise, in the sense of the effect `measurement_noise`.

    A controller that samples faster than the historian sees less of the noise than the recorded PV tells. OP shows
    how much arrives; but OP is often rounded, which looks like noise. The smaller of the two is right.
    """
    good = record.state == SampleState.GOOD
    index = record.index[good].astype(np.float64)
    density = white_deviation(record.measurement[good], index) ** 2 * record.interval
    if record.output is not None:
        arrived = white_deviation(record.output[good], index)
        density = min(density, arrived**2 / output_variance(controller, record.interval))
    return density


def output_variance(controller: Controller, interval: float) -> float:
    """Return what `white_deviation` squared sees of the output for white measurement noise of density 1 [1/s].

    Third differences over `interval` [s] of noise with the spectrum K^2 (1 + w^2 Td^2) / (1 + w^2 Tf^2)^2, of which
    they pass (2 sin(w h/2))^6; divided by 20, as for white noise.
    """
    tf, td = controller.filter_time, controller.Td
    omega = np.linspace(0.0, 40.0 / min(tf, 3.0 * interval), 40_000)
    spectrum = controller.K**2 * (1.0 + (omega * td) ** 2) / (1.0 + (omega * tf) ** 2) ** 2
    return float(np.trapezoid(spectrum * (2.0 * np.sin(0.5 * omega * interval)) ** 6, omega) / (20.0 * np.pi))


def typical_load(record: Record, d: float) -> float:
    """Return the size of a load step that makes OP move as far as in the record [span of output]."""
    smallest = SMALLEST_LOAD * d
    if record.output is None:
        return float(np.clip(2.0 * smallest, None, LARGEST_LOAD))
    low, high = np.nanpercentile(record.output[record.usable], [10.0, 90.0])
    return float(max(min(0.5 * (high - low), LARGEST_LOAD), smallest))
