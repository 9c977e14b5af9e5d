"""Wear that may bend: the level of the dead band and its slope, both free to change, seen through noisy nights.

A state-space local trend (A. C. Harvey, Forecasting, structural time series models and the Kalman filter, 1989,
section 2.3): level and slope go on from night to night, the slope or its change wanders, and each night measures the
level with the error of its own interval. Filter and smoother are those of statsmodels. How fast wear may bend is not
known: every way from a straight line to a trend that bends within a few nights is tried, and weighs as much as the
nights speak for it. Single nights that lie apart and lasting steps are told by the smoother's residuals (P. de Jong,
J. Penzer, Diagnosing shocks in time series, JASA 93 (1998) 796-806).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..record import FloatArray

ENOUGH = 5  # nights; fewer say nothing about a slope
LEAST = 4  # nights after a step (half as many before): two bad nights must not make one
MONTH = 30.0  # days over which the slope is told
TRUST = 30.0  # nights that the noise of the nights is sure of; it is known from neighbouring nights
WIDE = 10.0  # times its own error, that a night which lies apart may be off
APART = 0.03  # share of nights that lie apart, and of nights after which the level steps, before they are looked at
STEPS = 0.02
JUMP = 0.5  # usual size of a step, in usual levels
MAYBE = 2.0  # standard errors of a step that may have come; OPEN of these are kept in mind
OPEN = 4
PIECE = 240  # nights that are searched for shocks at a time
WIDER = 1.3  # of all intervals, because real wear follows none of these trends; from tests/benchmarks/wear.py
FAR = 3.0  # the same for the level, and its growth, before the first night


class Way(NamedTuple):
    """How a trend may bend: level (0), slope (1) or the change of the slope (2) wanders, within so many nights."""

    order: int
    within: float


LINE = Way(1, np.inf)
BELIEF = {LINE: 0.1, **dict.fromkeys((Way(0, b) for b in (16.0, 8.0, 4.0, 2.0)), 0.09),
          **dict.fromkeys((Way(1, b) for b in (64.0, 45.0, 32.0, 23.0, 16.0, 11.0, 8.0, 5.7, 4.0)), 0.02),
          Way(2, np.inf): 0.11, Way(2, 16.0): 0.10, Way(2, 8.0): 0.10, Way(2, 5.0): 0.05}  # before a look at the nights
STIFF = (LINE, Way(1, 32.0), Way(1, 16.0), Way(1, 11.0), Way(2, np.inf), Way(2, 16.0))


@dataclass(frozen=True, eq=False)
class Nights:
    """Sizes in time order, (nights,) arrays: days, dead band [span], its standard error [span]."""

    days: FloatArray
    size: FloatArray
    error: FloatArray

    def __len__(self) -> int:
        return len(self.days)

    def part(self, first: int, end: int) -> Nights:
        return Nights(self.days[first:end], self.size[first:end], self.error[first:end])


@dataclass(frozen=True)
class Shocks:
    """What no trend explains: positions of nights that lie apart, and of those whose level is a step from before."""

    apart: tuple[int, ...] = ()
    steps: tuple[int, ...] = ()

    def with_apart(self, k: int) -> Shocks:
        return Shocks(tuple(sorted({*self.apart, k})), self.steps)

    def with_step(self, k: int) -> Shocks:
        """A step may explain nights that seemed to lie apart: they are looked at again."""
        return Shocks((), tuple(sorted({*self.steps, k})))

    def belief(self) -> float:
        """Logarithm of the chance of such shocks, against that of none."""
        return len(self.apart) * float(np.log(APART)) + len(self.steps) * float(np.log(STEPS))


@dataclass(frozen=True, eq=False)
class Trend:
    """A dead band over the days of its nights and beyond; `reach` standard errors on both sides hold 95 %.

    days, level, error: at each night (nights,). slope, slope_error: mean over the last month [span/day]. end, spread:
    level, slope and curvature at the last night for each way to bend, (ways, 3), (ways, 3, 3); wander: variance that
    these gain per day (ways, 3); weight (ways,). steps: mean and mean square of steps per day. straight: how much the
    nights speak for a line.
    """

    days: FloatArray
    level: FloatArray
    error: FloatArray
    slope: float
    slope_error: float
    end: FloatArray
    spread: FloatArray
    wander: FloatArray
    weight: FloatArray
    reach: float
    shocks: Shocks
    steps: tuple[float, float] = (0.0, 0.0)
    straight: float = 1.0

    @property
    def risen(self) -> bool:
        """Whether the dead band is larger than at the first night for sure."""
        return bool(self.level[-1] - self.level[0] > self.reach * np.hypot(self.error[-1], self.error[0]))

    def ahead(self, days: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return level and standard error at days after the last night, (points,) each; steps go on as they came."""
        s = np.asarray(days, float)[:, None]
        h = np.concatenate([np.ones_like(s), s, 0.5 * s**2], axis=1)
        ways = h @ self.end.T
        variance = np.einsum("pi,wij,pj->pw", h, self.spread, h)
        variance += np.concatenate([s, s**3 / 3, s**5 / 20], axis=1) @ self.wander.T
        mean = ways @ self.weight
        error = np.sqrt((variance + (ways - mean[:, None]) ** 2) @ self.weight + self.steps[1] * s[:, 0])
        return mean + self.steps[0] * s[:, 0], error

    def reaches(self, limit: float) -> tuple[float, float, float]:
        """Return the day on which the level reaches `limit`, and the interval of that day; inf where it never does."""
        later = np.concatenate([np.arange(1.0, 61.0), np.geomspace(61.0, 1e6, 160)])
        mean, error = self.ahead(later)
        days = np.append(self.days, self.days[-1] + later)
        level, error = np.append(self.level, mean), np.append(self.error, error)
        k = len(self.days) - 1
        if level[k] >= limit:  # passed: back to the last night below
            while k > 0 and level[k - 1] >= limit:
                k -= 1
        else:
            k += _position(level[k:] >= limit)
        high, low = level + self.reach * error, level - self.reach * error
        below = np.flatnonzero(high[:k] < limit)
        first, last = int(below[-1]) + 1 if len(below) else 0, k + _position(low[k:] >= limit)
        early, value, late = (_crossing(days, y, i, limit) for y, i in ((high, first), (level, k), (low, last)))
        if first in self.shocks.steps or k in self.shocks.steps:  # the step itself may have come a night earlier
            early = min(early, float(days[first - 2]))
        if last in self.shocks.steps or k in self.shocks.steps:
            late = max(late, float(days[min(last + 1, len(days) - 1)]))
        return value, min(early, value), max(late, value)


def _position(found: Any) -> int:
    """Return the first position that is True, or the length."""
    return int(np.argmax(found)) if np.any(found) else len(found)


def _crossing(days: FloatArray, y: FloatArray, k: int, limit: float) -> float:
    """Return when y reaches `limit` between points k - 1 and k."""
    if k >= len(days):
        return np.inf
    if k == 0 or y[k] == y[k - 1]:
        return float(days[k])
    return float(days[k - 1] + (days[k] - days[k - 1]) * np.clip((limit - y[k - 1]) / (y[k] - y[k - 1]), 0.0, 1.0))


def wandering(nights: Nights, way: Way) -> FloatArray:
    """Return the variance that level, slope and curvature gain per day, (3, nights): within `way.within` nights they
    move the level by as much as one night's error."""
    gain = np.zeros((3, len(nights)))
    step = max(float(np.median(np.diff(nights.days))), 1e-3)
    gain[way.order] = nights.error**2 / (way.within ** (2 * way.order + 2) * step ** (2 * way.order + 1))
    return gain


def smoothed(nights: Nights, way: Way, shocks: Shocks) -> Any:
    """Return the result of statsmodels' Kalman smoother; state: level, slope, curvature, level a month before."""
    from statsmodels.tsa.statespace.kalman_smoother import KalmanSmoother

    n, d = len(nights), np.diff(nights.days, append=nights.days[-1] + 1.0)
    usual, span = float(np.median(nights.size)), max(float(nights.days[-1] - nights.days[0]), 1.0)
    level, slope, curve = wandering(nights, way)
    cov, transition, error = np.zeros((4, 4, n)), np.zeros((4, 4, n)), nights.error.copy()
    cov[:3, :3] = (
        slope * np.array([[d**3 / 3, d**2 / 2, 0 * d], [d**2 / 2, d, 0 * d], [0 * d, 0 * d, 0 * d]])
        + curve * np.array([[d**5 / 20, d**4 / 8, d**3 / 6], [d**4 / 8, d**3 / 3, d**2 / 2], [d**3 / 6, d**2 / 2, d]]))
    cov[0, 0] += level * d
    cov[0, 0, [k - 1 for k in shocks.steps]] += (JUMP * usual) ** 2
    error[list(shocks.apart)] *= WIDE
    transition[range(4), range(4)] = 1.0
    transition[0, 1] = transition[1, 2] = d
    transition[0, 2] = 0.5 * d**2
    transition[3, :, month_before(nights.days)] = (1.0, 0.0, 0.0, 0.0)
    model = KalmanSmoother(k_endog=1, k_states=4, k_posdef=4)
    model.bind(nights.size[:, None].copy())
    model["design"], model["selection"] = np.eye(4)[:1], np.eye(4)
    model["transition"], model["state_cov"], model["obs_cov"] = transition, cov, error[None, None] ** 2
    before = FAR * usual * np.array([1.0, 1.0 / span, 4.0 * (way.order == 2) / span**2, 1.0])
    model.initialize_known(np.array([usual, 0.0, 0.0, usual]), np.diag(before**2))
    return model.smooth()


def month_before(days: FloatArray) -> int:
    """Return the position of the night a month before the last, or of the first."""
    return min(int(np.argmin(np.abs(days - (days[-1] - MONTH)))), len(days) - 2)


def evidence(result: Any) -> tuple[float, float]:
    """Return log likelihood with the noise's scale integrated out (inverse gamma about 1), and that scale's mean."""
    v, f = result.forecasts_error[0], result.forecasts_error_cov[0, 0]
    total = TRUST + float((v**2 / f).sum())
    n = TRUST + len(v)
    return -0.5 * float(np.log(f).sum()) - 0.5 * n * float(np.log(total / TRUST)), total / n


def fit(nights: Nights, shocks: Shocks, ways: Iterable[Way] = tuple(BELIEF)) -> Trend:
    """Return the trend through the nights, averaged over the ways to bend, and over steps that may just have come."""
    ways = tuple(ways)
    n = len(nights)
    tried = [(shocks, way, smoothed(nights, way, shocks)) for way in ways]
    best = max(tried, key=lambda t: evidence(t[2])[0])
    for k in _maybe_steps(nights, shocks, best[2]):
        other = Shocks(tuple(j for j in shocks.apart if not k <= j < k + LEAST), tuple(sorted((*shocks.steps, k))))
        tried += [(other, way, smoothed(nights, way, other)) for way in ways]
    known = [evidence(result) for _, _, result in tried]
    scale = np.array([s for _, s in known])
    score = np.array([e + s.belief() + np.log(BELIEF[w]) for (e, _), (s, w, _) in zip(known, tried, strict=True)])
    weight = np.exp(score - score.max())
    weight /= weight.sum()
    results = [result for _, _, result in tried]
    level, error = _pooled(np.array([r.smoothed_state[0] for r in results]),
                           np.array([r.smoothed_state_cov[0, 0] for r in results]) * scale[:, None], weight)
    last = np.array([r.smoothed_state[:, -1] for r in results])
    cov = np.array([r.smoothed_state_cov[:, :, -1] for r in results]) * scale[:, None, None]
    span = float(nights.days[-1] - nights.days[month_before(nights.days)]) or 1.0
    slope, slope_error = _pooled((last[:, 0] - last[:, 3]) / span,
                                 (cov[:, 0, 0] - 2 * cov[:, 0, 3] + cov[:, 3, 3]) / span**2, weight)
    wander = np.array([wandering(nights, way)[:, -1] for _, way, _ in tried]) * scale[:, None]
    jumps = np.array([level[k] - level[k - 1] for k in shocks.steps])
    days = max(float(nights.days[-1] - nights.days[0]), 1.0)
    from scipy.stats import t as student

    return Trend(nights.days, level, error, float(slope), float(slope_error), last[:, :3], cov[:, :3, :3], wander,
                 weight, WIDER * float(student.ppf(0.975, TRUST + n - 2)), shocks,
                 (float(jumps.sum()) / days, float((jumps**2).sum()) / days),
                 float(sum(x for x, (_, way, _) in zip(weight, tried, strict=True) if way == LINE)))


def _maybe_steps(nights: Nights, shocks: Shocks, result: Any) -> list[int]:
    """Return the positions of steps that may be: the likeliest, and those of the last nights where these lie apart."""
    n = len(nights)
    size = _steps(result)
    size[[0, *shocks.steps]] = 0.0
    likely = [int(k) for k in np.argsort(-size)[:OPEN] if size[k] > MAYBE]
    return list(dict.fromkeys([*likely, *(k for k in shocks.apart if k > n - LEAST)])) if n >= ENOUGH else []


def _pooled(values: FloatArray, variances: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard error of a mixture, over the first axis."""
    mean = weight @ values
    return mean, np.sqrt(weight @ (variances + (values - mean) ** 2))


def _steps(result: Any) -> FloatArray:
    """Return the step before each night in standard errors, (nights,), as if it were the only shock."""
    r, n = result.scaled_smoothed_estimator[0], result.scaled_smoothed_estimator_cov[0, 0]
    return np.append(0.0, np.abs(r / np.sqrt(np.maximum(n, 1e-300)))[:-1])


def _apart(result: Any) -> FloatArray:
    """Return how far each night lies apart, in standard errors (nights,), as if it were the only shock."""
    noise = result.obs_cov[0, 0] - result.smoothed_measurement_disturbance_cov[0, 0]
    return np.abs(result.smoothed_measurement_disturbance[0]) / np.sqrt(np.maximum(noise, 1e-300))


def find_shocks(nights: Nights) -> Shocks:
    """Return nights that lie apart and steps; long histories are searched piece by piece, with their surroundings."""
    apart: list[int] = []
    steps: list[int] = []
    for first in range(0, max(len(nights) - PIECE // 2, 1), PIECE // 2):
        end = min(first + PIECE, len(nights))
        found = _shocks_of(nights.part(first, end))
        low = first + PIECE // 4 if first else 0
        high = first + 3 * PIECE // 4 if end < len(nights) else end
        apart += [first + k for k in found.apart if low <= first + k < high]
        steps += [first + k for k in found.steps if low <= first + k < high]
    return Shocks(tuple(apart), tuple(steps))


def _shocks_of(nights: Nights) -> Shocks:
    """Return the shocks of one piece, the clearest first, until nothing is left that a trend cannot explain."""
    n, shocks = len(nights), Shocks()
    refused: set[int] = set()
    for _ in range(2 * n if n >= 2 * LEAST else 0):
        result = max((smoothed(nights, way, shocks) for way in STIFF), key=lambda r: evidence(r)[0])
        # gain in log likelihood, less what a size that is not known costs, less the rareness of such shocks
        apart = 0.5 * _apart(result) ** 2 + np.log(APART / WIDE)
        step = 0.5 * _steps(result) ** 2 + np.log(STEPS * np.median(nights.error) / (JUMP * np.median(nights.size)))
        apart[list(shocks.apart)] = step[[k for k in range(n) if k in refused or not _room(k, n, shocks.steps)]] = -1.0
        if max(apart.max(), step.max()) <= 0.0:
            break
        if apart.max() > step.max():
            shocks = shocks.with_apart(int(np.argmax(apart)))
            continue
        k = _place(nights.size, int(np.argmax(step)), [k for k in range(n) if step[k] >= 0.0])
        more = Shocks(shocks.apart, tuple(sorted({*shocks.steps, k})))
        if _best(nights, more) > _best(nights, shocks):  # a trend that bends fast does not explain it as well
            shocks = shocks.with_step(k)
        else:
            refused.add(k)
    return shocks


def _place(size: FloatArray, k: int, allowed: list[int]) -> int:
    """Return the cut near k with the sharpest step: a trend that goes on fast after it would place it late."""
    def sharpness(cut: int) -> float:
        before, after = size[max(cut - LEAST, 0) : cut], size[cut : cut + LEAST]
        high, low = np.median(before), np.median(after)
        return float(abs(high - low) - np.abs(before - high).mean() - np.abs(after - low).mean())

    return max((cut for cut in allowed if abs(cut - k) <= 2 * LEAST), key=lambda cut: (sharpness(cut), -abs(cut - k)))


def _best(nights: Nights, shocks: Shocks) -> float:
    """Return how well trends that bend, but do not jump, explain the nights."""
    ways = (w for w in BELIEF if w.order)
    return max(evidence(smoothed(nights, w, shocks))[0] + float(np.log(BELIEF[w])) for w in ways) + shocks.belief()


def _room(k: int, n: int, steps: tuple[int, ...]) -> bool:
    """Whether there are enough nights on both sides of a step before night k."""
    before, after = max((s for s in steps if s <= k), default=0), min((s for s in steps if s > k), default=n)
    return k - before >= LEAST // 2 and after - k >= LEAST
