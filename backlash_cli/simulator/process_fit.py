"""A simple process model from a record: gain, one or two lags and dead time between valve position and measurement.

PV is predicted from OP behind its dead band, both in block means. In closed loop a plain least-squares fit of PV would
find the controller instead of the process, because loads move PV first and OP follows. So PV and prediction are
compared through the filter that makes the unexplained part white (prediction error method, consistent in closed loop;
Ljung, System Identification, 2nd ed., chapter 13), and large shocks count little (Huber 1964)."""

from dataclasses import replace
from itertools import product
from typing import Any, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import lfilter
from scipy.special import huber

from ..effects.process import late
from ..errors import LoopError
from ..estimator.predictor import block_means, recording_of
from ..kernels import play
from ..record import BoolArray, FloatArray, Frozen, Record, SampleState
from ..words import explained
from .process import Process

FEWEST = 300  # blocks
PER_INTEGRAL_TIME = 12.0  # blocks in one Ti
ORDER = 12  # of the whitening filter, in blocks: about one integral time
LAGS = np.geomspace(0.05, 40.0, 22)  # first lag, in integral times
SECOND = (0.0, 0.5)  # second lag, as a share of the first
DELAYS = (0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0)  # dead time, in integral times
INTEGRATING = 0.8 * LAGS[-1]  # lag in integral times from which on only the ratio of gain to lag matters
SHORTEST = 0.3  # lag in blocks; shorter ones look alike
SHOCK = 2.5  # standard deviations beyond which a sample counts less
SHARES = np.linspace(0.0, 1.0, 11)  # of the dead band, tried with the fitted process
GIVE = "give the process with --process K=..,T=..,L=.."
LEAST_EVIDENCE = 10.0  # fall of -2 log likelihood below which OP is not seen in PV at all


class Fit(Frozen, eq=False):
    """Block means of valve position x and measurement y (blocks,) over `interval` [s], and how they are compared.

    joined: (blocks,) True where a block and the one before it were recorded. Ti [s], sign: of the gain. known_gain:
    None where the settings do not tell it. whitening: (ORDER + 1,) the filter behind which PV and prediction are
    compared. A shape is first lag, second lag and dead time [s]."""

    x: FloatArray
    y: FloatArray
    joined: BoolArray
    interval: float
    Ti: float
    sign: float
    known_gain: float | None
    whitening: FloatArray

    def white(self, values: FloatArray) -> FloatArray:
        """Return changes from block to block (blocks,), zero across gaps, through the whitening filter."""
        return np.asarray(lfilter(self.whitening, [1.0], np.diff(values, prepend=values[0]) * self.joined))

    def lagged(self, lag: float, second: float) -> FloatArray:
        """Return the valve position (blocks,) through one or two lags [s], at rest before; block means are joined by
        straight lines: first-order hold (Astrom and Wittenmark, Computer-Controlled Systems, section 2.8)."""
        out = self.x - self.x[0]
        for ratio in (time / self.interval for time in (lag, second) if time > 0.0):
            a = np.exp(-1.0 / ratio)
            out = lfilter([1.0 - ratio * (1.0 - a), ratio * (1.0 - a) - a], [1.0, -a], out)
        return np.asarray(out)

    def gain_of(self, along: float, power: float) -> float:
        """Return the gain for <prediction, measurement> and <prediction, prediction>, 0 for the wrong sign."""
        if self.known_gain:
            return self.known_gain
        return along / max(power, 1e-300) if along * self.sign > 0.0 else 0.0

    def search(self) -> FloatArray:
        """Return the best shape of the grid; shocks count less, judged on what no model explains."""
        y = self.white(self.y)
        weight = shock_weights(y)
        found = [(0.0, (self.Ti, 0.0, 0.0))]
        for lag, share in product(LAGS[LAGS * self.Ti >= SHORTEST * self.interval] * self.Ti, SECOND):
            prompt = self.white(self.lagged(lag, share * lag))
            for delay in np.multiply(DELAYS, self.Ti):
                g = weight * late(prompt, delay / self.interval)
                along, power = float(g @ (weight * y)), float(g @ g)
                gain = self.gain_of(along, power)
                found.append((gain * (2.0 * along - gain * power), (lag, share * lag, delay)))
        return np.array(max(found, key=lambda one: one[0])[1])

    def match(self, shape: FloatArray) -> tuple[float, float, FloatArray]:
        """Return the evidence for a shape, a fall of -2 log likelihood, its gain, both robust, and what it leaves."""
        y, g = self.white(self.y), late(self.white(self.lagged(*shape[:2])), shape[2] / self.interval)
        weight, gain = np.ones(len(y)), 0.0
        for _ in range(3):
            gain = self.gain_of(float(np.sum(weight * g * y)), float(np.sum(weight * g * g)))
            weight = shock_weights(y - gain * g)
        scale = spread(y - gain * g)
        return float(2.0 * np.sum(huber(SHOCK, y / scale) - huber(SHOCK, (y - gain * g) / scale))), gain, y - gain * g

    def whitened_by(self, shape: FloatArray) -> Self:
        """Return the fit with the filter that whitens what a shape leaves: autoregression by weighted least squares."""
        left = replace(self, whitening=np.ones(1)).match(shape)[2]
        rows, target = sliding_window_view(left, ORDER)[:-1, ::-1], left[ORDER:]
        root = np.ones(len(target))
        for _ in range(2):
            a = np.linalg.lstsq(rows * root[:, None], target * root, rcond=None)[0]
            root = np.sqrt(shock_weights(target - rows @ a))
        return replace(self, whitening=np.append(1.0, -a))

    def refine(self, start: FloatArray) -> FloatArray:
        """Return the best shape near a start."""
        from scipy.optimize import minimize

        unit = np.array([start[0], start[1], self.interval])

        def shape_of(p: FloatArray) -> FloatArray:
            return np.maximum(unit * np.append(np.exp(p[:2]), p[2]), [SHORTEST * self.interval, 0.0, 0.0])

        def cost(p: FloatArray) -> float:
            return -self.match(shape_of(p))[0]

        first = np.array([0.0, 0.0, start[2] / self.interval])
        reach = np.vstack([np.zeros(3), np.diag([0.2, 0.2, 0.7])])
        options: Any = {"initial_simplex": first + reach, "maxfev": 80, "xatol": 0.02, "fatol": 0.05}
        return shape_of(np.asarray(minimize(cost, first, method="Nelder-Mead", options=options).x))


def spread(values: FloatArray) -> float:
    """Return the standard deviation of the bulk of some values."""
    return 1.4826 * float(np.median(np.abs(values))) + 1e-12


def shock_weights(values: FloatArray) -> FloatArray:
    """Return Huber weights (blocks,): 1 for ordinary values, less for shocks."""
    return np.minimum(1.0, SHOCK * spread(values) / np.maximum(np.abs(values), 1e-12))


def fit_process(record: Record, d: float, known_gain: float | None = None, *, integrating: bool = False) -> Process:
    """Return the process that explains PV best from OP behind a dead band d [span].

    The record's settings must hold K and Ti. known_gain: static gain, when it is known. integrating: whether the answer
    may be an integrating process, of which only the ratio of gain to lag can be seen. Raises LoopError when OP is
    absent or rests, the record is too short, PV does not answer to OP, or the process integrates and may not."""
    K, Ti = record.settings.K or 1.0, record.settings.Ti or 1.0
    if record.output is None:
        raise LoopError(**explained("fit_no_output", give=GIVE), where=record.loop)
    good = np.isfinite(record.measurement) & np.isfinite(record.output)
    good &= (record.state != SampleState.MISSING) & (record.state != SampleState.IMPLAUSIBLE)
    per = max(1, round(Ti / (PER_INTEGRAL_TIME * record.interval)))
    if np.count_nonzero(good) < FEWEST * per:
        usable, needed = np.count_nonzero(good) * record.interval, FEWEST * per * record.interval
        raise LoopError(**explained("fit_too_short", usable=usable, needed=needed, give=GIVE), where=record.loop)
    grid = recording_of(record.index, record.output, record.measurement, good)
    whole = block_means(grid.usable.astype(float), per) == 1.0
    joined = whole & np.append(False, whole[:-1])

    def stem(d: float) -> FloatArray:
        return block_means(play(grid.output, d, float(grid.output[0])), per)

    fit = Fit(stem(d), block_means(grid.measurement, per), joined, per * record.interval, Ti, np.sign(K), known_gain,
              np.eye(1, ORDER + 1)[0])
    if np.ptp(fit.x) <= 1e-9:
        raise LoopError(**explained("fit_uncrossed"), where=record.loop)
    for _ in range(3):
        best = fit.search()
        fit = fit.whitened_by(best)
    integrates = bool(best[0] >= INTEGRATING * Ti)
    best = fit.refine(best)
    evidence, gain, _ = fit.match(best)
    if gain == 0.0 or evidence < LEAST_EVIDENCE:
        raise LoopError(**explained("no_process", give=GIVE), where=record.loop)
    lag, second, delay = best.tolist()
    if integrates and not integrating:
        raise LoopError(**explained("fit_integrating", give=GIVE), where=record.loop)
    lags = tuple(time for time in (0.0 if integrates else lag, second) if time > 0.0)
    profile = tuple((share * d, replace(fit, x=stem(share * d)).match(best)[0]) for share in SHARES.tolist())
    return Process(gain / lag if integrates else gain, lags, delay, integrates, source="fitted", evidence=evidence,
                   profile=profile)
