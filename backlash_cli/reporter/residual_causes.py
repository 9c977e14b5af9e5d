"""What an error depends on: its mean and size against each thing that a missing effect would follow.

Play and stiction show in the time since OP turned, a curved or stopped valve in the level of OP, a slow actuator in
the speed of OP, loads in the time of the record, swings from outside in one frequency.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray
from ..results import Series

BINS = 12
FEWEST = 8  # samples in a bin that is drawn


@dataclass(frozen=True, eq=False)
class Curve:
    """Mean and root mean square of a residual [PV span] in bins of something; x: (bins,) centre of each bin.

    model: whose residual. part: which part of the record, "" for all of it.
    """

    model: str
    part: str
    x: FloatArray
    mean: FloatArray
    rms: FloatArray


@dataclass(frozen=True, eq=False)
class Cause:
    """One diagram: the curves of each model, what x is, and what to look for. show: "mean", "rms" or "spectrum"."""

    title: str
    x_label: str
    note: str
    curves: tuple[Curve, ...]
    show: str = "mean"


def causes(series: Series, residuals: Mapping[str, FloatArray]) -> list[Cause]:
    """Return the diagrams of residuals, model name -> (samples,) with nan where a sample does not count."""
    h = float(np.median(np.diff(series.time))) if len(series.time) > 1 else 1.0
    since, upward = since_reversal(series.output)
    early = (since >= 0) & (since < np.quantile(since[since >= 0], 0.9) if np.any(since >= 0) else False)
    speed = np.abs(smooth_speed(series.output, h))
    clock = (series.time - series.time[0]) / 3600.0

    def cause(title: str, x_label: str, show: str, note: str, make: Callable[[str, FloatArray], list[Curve]]) -> Cause:
        curves = (curve for name, residual in residuals.items() for curve in make(name, residual) if len(curve.x))
        return Cause(title, x_label, note, tuple(curves), show)

    found = [
        cause("Time since OP turned", "time since OP turned [s]", "mean",
              "Play or stiction: of opposite sign after turns up and down, largest soon after the turn.",
              lambda n, r: [binned(n, since * h, r, early & (upward == up), part=f"OP turned {word}", even=True)
                            for up, word in ((1, "up"), (-1, "down"))]),
        cause("Level of OP", "OP [% of span]", "mean", "A curved valve bends this line; a stop tilts one of its ends.",
              lambda n, r: [binned(n, 100 * series.output, r)]),
        cause("Speed of OP", "|dOP/dt| [% of span per s]", "rms",
              "A slow actuator: the error grows with the speed of OP.", lambda n, r: [binned(n, 100 * speed, r)]),
        cause("Time of the record", "time [h]", "mean", "Load steps make jumps here, a drifting load a slope.",
              lambda n, r: [binned(n, clock, r, even=True, bins=3 * BINS)]),
        cause("Period", "period [s]", "spectrum", "A peak is a swing from outside; noise alone is level.",
              lambda n, r: [spectrum(n, r, h)]),
    ]
    return [one for one in found if one.curves]


def binned(
    model: str, x: FloatArray, residual: FloatArray, where: NDArray[np.bool_] | bool = True, *, part: str = "",
    even: bool = False, bins: int = BINS,
) -> Curve:
    """Return mean and rms of a residual (samples,) in bins of x: of even width, or with evenly many samples."""
    from scipy.stats import binned_statistic

    chosen = where & np.isfinite(residual) & np.isfinite(x)
    xs, rs = x[chosen], residual[chosen]
    if len(xs) < 2 * FEWEST or np.ptp(xs) == 0.0:
        return _nothing(model)
    shares = np.linspace(0.0, 1.0, bins + 1)
    edges = xs.min() + shares * np.ptp(xs) if even else np.unique(np.quantile(xs, shares))
    means, _, place = binned_statistic(xs, [xs, rs, rs**2], "mean", bins=edges)
    center, mean, square = means[:, np.bincount(place - 1, minlength=len(edges) - 1) >= FEWEST]
    return Curve(model, part, center, mean, np.sqrt(square))


def _nothing(model: str) -> Curve:
    return Curve(model, "", np.empty(0), np.empty(0), np.empty(0))


def since_reversal(output: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return samples since OP last turned (-1 before the first turn) and where it goes since (1 up, -1 down).

    A turn counts when OP then goes on by more than its own noise and 2 % of its travel.
    """
    from scipy.signal import find_peaks

    third = np.diff(output, 3)
    noise = float(np.sqrt(np.nanmean(third**2) / 20.0)) if third.size else 0.0
    least = max(4.0 * noise, 0.02 * float(np.nanmax(output) - np.nanmin(output)), 1e-9)
    since, upward = np.full(len(output), -1.0), np.zeros(len(output), dtype=np.int64)
    known = np.flatnonzero(np.isfinite(output))
    whole = np.interp(np.arange(len(output)), known, output[known])
    found = {sign: find_peaks(-sign * whole, prominence=least, plateau_size=1)[1]["left_edges"] for sign in (1, -1)}
    turns = sorted((int(place), sign) for sign, places in found.items() for place in places)
    # of stops of the same height the first is the turn
    turns = [turn for before, turn in zip([(0, 0), *turns], turns, strict=False) if turn[1] != before[1]]
    for (first, sign), last in zip(turns, [*(place for place, _ in turns[1:]), len(output)], strict=False):
        since[first:last] = np.arange(last - first)
        upward[first:last] = sign
    return since, upward


def smooth_speed(output: FloatArray, h: float, reach: int = 5) -> FloatArray:
    """Return dOP/dt [span/s] (samples,) over `reach` samples to each side."""
    n = len(output)
    low, high = np.maximum(np.arange(n) - reach, 0), np.minimum(np.arange(n) + reach, n - 1)
    out: FloatArray = (output[high] - output[low]) / (np.maximum(high - low, 1) * h)
    return out


def spectrum(model: str, residual: FloatArray, h: float) -> Curve:
    """Return the size of a residual by period [s]: rms [PV span] in thirds of an octave; holes count as 0."""
    good = np.isfinite(residual)
    n = len(residual)
    if np.count_nonzero(good) < 64:
        return _nothing(model)
    values = np.where(good, residual - np.mean(residual[good]), 0.0)
    power = np.abs(np.fft.rfft(values)[1:]) ** 2 * 2.0 / (n * np.count_nonzero(good))
    period = n * h / np.arange(1, len(power) + 1)
    band = np.floor(3.0 * np.log2(period / (2.0 * h)) + 0.5).astype(np.int64)
    _, place, count = np.unique(band, return_inverse=True, return_counts=True)
    x = np.exp(np.bincount(place, np.log(period)) / count)
    return Curve(model, "", x, np.zeros(len(x)), np.sqrt(np.bincount(place, power)))
