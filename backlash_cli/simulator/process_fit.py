"""A simple process model from a record: gain, one or two lags and dead time between valve position and measurement.

PV is predicted from OP behind its dead band, both in block means. In closed loop a plain least-squares fit of PV would
find the controller instead of the process, because loads move PV first and OP follows. So PV and prediction are
compared through the filter that makes the unexplained part white (prediction error method, consistent in closed loop;
Ljung, System Identification, 2nd ed., chapter 13), and large shocks count little (Huber weights).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import lfilter
from scipy.special import huber

from ..errors import LoopError
from ..kernels import play
from ..record import FloatArray, Record, SampleState
from ..results.compensation import ProcessModel

FEWEST = 300  # decimated samples
SHORTEST_PIECE = 24  # decimated samples between two gaps: two integral times
PER_INTEGRAL_TIME = 12.0  # decimated samples in one Ti
ORDER = 12  # of the whitening filter, in decimated samples: about one integral time
LAGS = np.geomspace(0.05, 40.0, 22)  # first lag, in integral times
SECOND = (0.0, 0.3, 1.0)  # second lag, as a share of the first
DELAYS = (0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0)  # dead time, in integral times
INTEGRATING = 0.8 * LAGS[-1]  # lag in integral times from which on only the ratio of gain to lag matters
SHORTEST = 0.3  # lag in decimated samples; shorter ones look alike
SHOCK = 2.5  # standard deviations beyond which a sample counts less
SHARES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  # of the dead band, tried with the fitted process
LEAST_EVIDENCE = 10.0  # fall of -2 log likelihood below which OP is not seen in PV at all


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


class Shape(NamedTuple):
    """First and second lag and dead time [s]."""

    lag: float
    second: float
    delay: float


@dataclass
class Fit:
    """The fit of one record. sign: of the gain; known_gain: the gain itself, None where the settings do not tell it.

    whitening: (ORDER + 1,) the filter behind which PV and prediction are compared.
    """

    data: Decimated
    Ti: float
    sign: float
    known_gain: float | None
    whitening: FloatArray

    def white(self, values: FloatArray) -> FloatArray:
        """Return changes from block to block (samples,), zero across gaps, through the whitening filter."""
        change = np.diff(values, prepend=values[0])
        change[list(self.data.starts)] = 0.0
        return np.asarray(lfilter(self.whitening, [1.0], change))

    def predicted(self, shape: Shape) -> FloatArray:
        """Return the whitened answer (samples,) of a process of this shape with gain 1."""
        return late(self.data, self.white(lagged(self.data, shape.lag, shape.second)), shape.delay)

    def gain_of(self, along: float, power: float) -> float:
        """Return the gain for <prediction, measurement> and <prediction, prediction>, 0 for the wrong sign."""
        if self.known_gain:
            return self.known_gain
        return along / max(power, 1e-300) if along * self.sign > 0.0 else 0.0

    def search(self) -> Shape:
        """Return the best shape of the grid; shocks count less, judged on what no model explains."""
        y = self.white(self.data.y)
        weight = shock_weights(y)
        best, most = Shape(self.Ti, 0.0, 0.0), 0.0
        for lag, share in product(LAGS * self.Ti, SECOND):
            if lag < SHORTEST * self.data.interval:
                continue
            prompt = self.white(lagged(self.data, lag, share * lag))
            for delay in np.multiply(DELAYS, self.Ti):
                g = weight * late(self.data, prompt, delay)
                along, power = float(g @ (weight * y)), float(g @ g)
                gain = self.gain_of(along, power)
                if (gained := gain * (2.0 * along - gain * power)) > most:
                    best, most = Shape(float(lag), float(share * lag), float(delay)), gained
        return best

    def match(self, shape: Shape) -> tuple[float, float]:
        """Return the evidence for one shape, a fall of -2 log likelihood, and its gain; robust against shocks."""
        y, g = self.white(self.data.y), self.predicted(shape)
        weight, gain = np.ones(len(y)), 0.0
        for _ in range(3):
            gain = self.gain_of(float(np.sum(weight * g * y)), float(np.sum(weight * g * g)))
            weight = shock_weights(y - gain * g)
        if gain == 0.0:
            return 0.0, 0.0
        scale = spread(y - gain * g)
        return float(2.0 * np.sum(huber(SHOCK, y / scale) - huber(SHOCK, (y - gain * g) / scale))), gain

    def whitened_by(self, shape: Shape) -> Fit:
        """Return the fit with the filter that whitens what a shape leaves: autoregression by weighted least squares."""
        as_it_is = replace(self, whitening=np.ones(1))
        rest = as_it_is.white(self.data.y) - self.match(shape)[1] * as_it_is.predicted(shape)
        rows, target = sliding_window_view(rest, ORDER)[:-1, ::-1], rest[ORDER:]
        weight = np.ones(len(target))
        for _ in range(2):
            root = np.sqrt(weight)
            a = np.linalg.lstsq(rows * root[:, None], target * root, rcond=None)[0]
            weight = shock_weights(target - rows @ a)
        return replace(self, whitening=np.concatenate([[1.0], -a]))

    def refine(self, start: Shape) -> Shape:
        """Return the best shape near a start."""
        from scipy.optimize import minimize

        def shape_of(p: FloatArray) -> Shape:
            second = start.lag * np.exp(p[1]) if start.second > 0.0 else 0.0
            lag = max(start.lag * np.exp(p[0]), SHORTEST * self.data.interval)
            return Shape(float(lag), float(second), float(max(p[2], 0.0) * self.data.interval))

        def cost(p: FloatArray) -> float:
            return -self.match(shape_of(p))[0]

        first = np.array([0.0, np.log(max(start.second, 1e-9) / start.lag), start.delay / self.data.interval])
        reach = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.7]])
        options: Any = {"initial_simplex": first + reach, "maxfev": 80, "xatol": 0.02, "fatol": 0.05}
        return shape_of(np.asarray(minimize(cost, first, method="Nelder-Mead", options=options).x))


def spread(values: FloatArray) -> float:
    """Return the standard deviation of the bulk of some values."""
    return 1.4826 * float(np.median(np.abs(values))) + 1e-12


def shock_weights(values: FloatArray) -> FloatArray:
    """Return Huber weights (samples,): 1 for ordinary values, less for shocks (Huber 1964)."""
    return np.minimum(1.0, SHOCK * spread(values) / np.maximum(np.abs(values), 1e-12))


def fit_process(record: Record, d: float, known_gain: float | None = None, *, integrating: bool = False
                ) -> ProcessModel:
    """Return the process that explains PV best from OP behind a dead band d [span].

    The record's settings must hold K and Ti. known_gain: static gain, when it is known. integrating: whether the answer
    may be an integrating process, of which only the ratio of gain to lag can be seen. Raises LoopError when OP is
    absent or rests, the record is too short, PV does not answer to OP, or the process integrates and may not.
    """
    data, K, Ti = decimated(record, d), float(record.settings.K or 1.0), float(record.settings.Ti or 1.0)
    fit = Fit(data, Ti, float(np.sign(K)), known_gain, np.concatenate([[1.0], np.zeros(ORDER)]))
    for _ in range(3):
        best = fit.search()
        fit = fit.whitened_by(best)
    best = fit.refine(best)
    evidence, gain = fit.match(best)
    if gain == 0.0 or evidence < LEAST_EVIDENCE:
        raise LoopError("the measurement does not answer to the output: no process can be fitted", where=record.loop,
                        remedy="give it with --process K=..,T=..,L=..", code="no_process")
    integrates = bool(best.lag >= INTEGRATING * Ti)
    if integrates and not integrating:
        raise LoopError(
            "the process looks integrating: only the ratio of gain to lag can be seen", where=record.loop,
            remedy="integrating loops with dead band oscillate; compensation is not advised. A process can be given "
            "with --process K=..,T=..,L=..", code="integrating",
        )
    lags = tuple(lag for lag in (0.0 if integrates else best.lag, best.second) if lag > 0.0)
    profile = tuple((share * d, replace(fit, data=decimated(record, share * d)).match(best)[0]) for share in SHARES)
    gain = gain / best.lag if integrates else gain
    return ProcessModel(gain, lags, best.delay, integrates, "fitted", evidence, profile)
