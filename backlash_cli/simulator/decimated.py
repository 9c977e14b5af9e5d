"""A record made ready for a fit: valve position and measurement in block means, through lags, delay and filters."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.signal import lfilter

from ..errors import LoopError
from ..kernels import play
from ..record import FloatArray, Record, SampleState

FEWEST = 300  # decimated samples
SHORTEST_PIECE = 24  # decimated samples between two gaps: two integral times
PER_INTEGRAL_TIME = 12.0  # decimated samples in one Ti


@dataclass(frozen=True, eq=False)
class Decimated:
    """Valve position x and measurement y (samples,) in means over `interval` seconds; starts: where pieces begin."""

    x: FloatArray
    y: FloatArray
    interval: float
    starts: tuple[int, ...]

    @property
    def pieces(self) -> list[slice]:
        """The stretches without a gap."""
        return [slice(a, b) for a, b in pairwise((*self.starts, len(self.x)))]


def decimated(record: Record, d: float) -> Decimated:
    """Return block means of valve position and measurement, about twelve per integral time, gaps cut out."""
    K, Ti = record.settings.K, record.settings.Ti
    if not K or not Ti:
        raise LoopError("K and Ti are not known", where=record.loop, remedy="give them in loops.toml")
    if record.output is None:
        raise LoopError("no controller output (OP) to fit a process to", where=record.loop, code="no_output",
                        remedy="export OP too, or give the process with --process K=..,T=..,L=..")
    known = np.isfinite(record.measurement) & np.isfinite(record.output)
    known &= (record.state != SampleState.MISSING) & (record.state != SampleState.IMPLAUSIBLE)
    per = max(1, round(Ti / (PER_INTEGRAL_TIME * record.interval)))
    index, output, measurement = record.index[known], record.output[known], record.measurement[known]
    cuts = np.flatnonzero(np.diff(index) != 1) + 1
    xs, ys, starts, total = [np.empty(0)], [np.empty(0)], [], 0
    for u, y in zip(np.split(output, cuts), np.split(measurement, cuts), strict=True):
        blocks = len(u) // per
        if blocks >= SHORTEST_PIECE:
            x = play(np.ascontiguousarray(u), d, float(u[0]))
            xs.append(x[: blocks * per].reshape(blocks, per).mean(axis=1))
            ys.append(y[: blocks * per].reshape(blocks, per).mean(axis=1))
            starts.append(total)
            total += blocks
    if total < FEWEST:
        raise LoopError(f"the record is too short to fit a process: {total * per * record.interval:.3g} s without "
                        f"gaps, {FEWEST * per * record.interval:.3g} s are needed", where=record.loop,
                        remedy="export a longer period, or give the process with --process K=..,T=..,L=..",
                        code="insufficient_data")
    x, y = np.concatenate(xs), np.concatenate(ys)
    if np.ptp(x) <= 1e-9:
        raise LoopError("the output never crosses the dead band", where=record.loop, code="constant_signal",
                        remedy="export a period with setpoint changes or load upsets, or give the process")
    return Decimated(x, y, per * record.interval, tuple(starts))


def whitened(data: Decimated, values: FloatArray, whitening: FloatArray) -> FloatArray:
    """Return changes from block to block, zero across gaps, through the whitening filter."""
    change = np.diff(values, prepend=values[0])
    change[list(data.starts)] = 0.0
    return np.asarray(lfilter(whitening, [1.0], change))


def lagged(data: Decimated, lag: float, second: float) -> FloatArray:
    """Return the valve position through one or two lags [s] (samples,); each piece starts at rest.

    The means of blocks are taken as joined by straight lines: first-order hold, exact (Astrom and Wittenmark,
    Computer-Controlled Systems, section 2.8).
    """
    out = data.x.copy()
    for time in (lag, second):
        if time > 0.0:
            ratio = time / data.interval
            a = np.exp(-1.0 / ratio)
            for piece in data.pieces:
                x = out[piece] - data.x[piece.start]
                b = [1.0 - ratio * (1.0 - a), ratio * (1.0 - a) - a]
                out[piece] = data.x[piece.start] + lfilter(b, [1.0, -a], x)
    return out


def late(data: Decimated, values: FloatArray, delay: float) -> FloatArray:
    """Return values that rest at zero before each piece, `delay` seconds later, between blocks interpolated."""
    whole, part = divmod(delay / data.interval, 1.0)
    shift, out = int(whole), np.zeros_like(values)
    for piece in data.pieces:
        x = np.concatenate([np.zeros(shift + 1), values[piece]])
        n = piece.stop - piece.start
        out[piece] = (1.0 - part) * x[1 : n + 1] + part * x[:n]
    return out
