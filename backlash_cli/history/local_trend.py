"""Wear that may bend: the level of the dead band and its growth, both free to change, seen through noisy nights.

A structural time series (A. C. Harvey, Forecasting, structural time series models and the Kalman filter, 1989, section
2.3) written as what it is, a Gaussian process (C. E. Rasmussen, C. K. I. Williams, Gaussian processes for machine
learning, 2006, equations 2.25-2.30): a straight line or a curve, a walk of the level, of the slope or of its change,
and lasting steps, each of unknown size; a night measures the level with the error of its own interval. How wear bends
is not known: every way of BELIEF is tried, and weighs as much as the nights speak for it. Single nights that lie apart
and steps are told by the residuals (P. de Jong, J. Penzer, Diagnosing shocks in time series, JASA 93 (1998) 796-806).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import factorial, inf
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.special import expit, ndtr

from ..record import FloatArray

ENOUGH = 5  # nights; fewer say nothing about a slope
LEAST = 4  # nights after a step (half as many before): two bad nights must not make one
MONTH = 30.0  # days over which the slope is told
TRUST = 30.0  # nights that the noise of the nights is sure of; it is known from neighbouring nights
WIDE = 10.0  # times its own error, that a night which lies apart may be off
APART = 0.03  # share of nights that lie apart, and of nights after which the level steps, before they are looked at
STEPS = 0.02
DOUBT = 0.5  # of that, for a step that single nights speak for and the search has not found
JUMP = 0.5  # usual size of a step, in usual levels
MAYBE = 2.0  # standard errors of a step that may have come; OPEN of these are kept in mind
OPEN = 4
REFUSED = 6  # shocks that a bend explains as well, after which no more are looked for
PIECE = 240  # nights that are searched for shocks at a time
WIDER = 1.5  # of all intervals, because real wear follows none of these trends; from tests/benchmarks/wear.py
FAR = 3.0  # the same for the level, and its growth, before the first night
LATER = np.concatenate([np.arange(0.0, 61.0), np.geomspace(64.0, 1e6, 100)])  # days after the last night


class Way(NamedTuple):
    """How a trend may bend. A walk: level (0), slope (1) or the change of the slope (2) wanders within so many nights.

    rate: of the growth, times by which it multiplies from the first night to the last (e-folds; negative where it
    slows down). at: where an S-shaped growth is fastest, in parts of the same time.
    """

    order: int = 1
    within: float = inf
    rate: float = 0.0
    at: float = inf

    def shapes(self, u: FloatArray) -> FloatArray:
        """Return the growth at times u since the first night (1 at the last), (points,), and beside it what it changes
        by where the curve is a little sharper or later: (points, 1 to 3)."""
        r, c = self.rate, self.at
        beside = []
        if self.order == 2:
            beside = [2.0 * u**2]
        elif r and c == inf:
            beside = [_growth(u, r + 0.75, c) - _growth(u, r - 0.75, c)]
        elif r:
            beside = [_growth(u, 1.4 * r, c) - _growth(u, r / 1.4, c), _growth(u, r, c + 0.1) - _growth(u, r, c - 0.1)]
        return np.column_stack([_growth(u, r, c), *beside])


def _growth(u: FloatArray, rate: float, at: float) -> FloatArray:
    """Return a growth from 0 at u = 0 to 1 at u = 1: straight, exponential or S-shaped (logistic)."""
    if rate == 0.0:
        return u
    if at == inf:
        return np.asarray(np.expm1(np.minimum(rate * u, 200.0)) / np.expm1(rate))
    first, last, now = (expit(rate * (x - at)) for x in (0.0, 1.0, u))
    return np.asarray((now - first) / (last - first))


LINE = Way()
CURVES = (*(Way(1, 32.0, r) for r in (-4.5, -3.0, -1.5, 1.5, 3.0)),
          *(Way(1, 32.0, r, c) for c in (0.2, 0.5, 0.8) for r in (6.0, 12.0)))
BELIEF = {LINE: 0.1, **dict.fromkeys(CURVES, 0.03), **dict.fromkeys((Way(0, b) for b in (16.0, 8.0, 4.0, 2.0)), 0.07),
          **dict.fromkeys((Way(1, b) for b in (64.0, 32.0, 16.0, 8.0, 4.0, 2.5)), 0.025),
          **dict.fromkeys((Way(2, b) for b in (inf, 16.0, 8.0, 5.0, 3.2)), 0.05)}  # before a look at the nights
STIFF = (LINE, Way(1, 32.0), Way(1, 16.0), Way(1, 11.0), Way(2), Way(2, 16.0), *CURVES)


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

    def belief(self) -> float:
        """Logarithm of the chance of such shocks, against that of none."""
        return len(self.apart) * float(np.log(APART)) + len(self.steps) * float(np.log(STEPS))


def unknowns(nights: Nights, way: Way, days: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what a unit of each unknown does to the level at `days` (days, unknowns), and their variance beforehand.

    Unknowns: level and growth of the curve, how sharp it is, and the walk from night to night and day to day.
    """
    k, usual = way.order, float(np.median(nights.size))
    shapes = way.shapes((days - nights.days[0]) / max(float(np.ptp(nights.days)), 1.0))
    columns = np.column_stack([np.ones(len(days)), shapes])
    prior = np.full(columns.shape[1], (FAR * usual) ** 2)
    if way.within == inf:
        return columns, prior
    edges = np.append(nights.days, np.unique(days[days > nights.days[-1]]))
    since = days[:, None] - 0.5 * (edges[1:] + edges[:-1])
    walk = np.where(since > 0.0, since, 0.0) ** k / factorial(k) * (since > 0.0)
    step = max(float(np.median(np.diff(nights.days))), 1e-3)
    # within so many nights it moves the level by as much as one night's error
    gain = np.interp(edges[:-1], nights.days, nights.error) ** 2 / (way.within ** (2 * k + 2) * step ** (2 * k + 1))
    return np.column_stack([columns, walk]), np.append(prior, gain * np.diff(edges))


@lru_cache(maxsize=64)
def covariance(nights: Nights, way: Way) -> FloatArray:
    """Return the covariance of the true levels at the nights, (nights, nights), before any is measured."""
    columns, prior = unknowns(nights, way, nights.days)
    return np.asarray((columns * prior) @ columns.T)


class Fit:
    """One way to bend through the nights, with the shocks given.

    evidence: log likelihood with the scale of the noise integrated out (inverse gamma about 1); scale: mean of that.
    """

    def __init__(self, nights: Nights, way: Way, shocks: Shocks) -> None:
        self.nights, self.way, self.jumps = nights, way, nights.days[list(shocks.steps)]
        self.usual, stepped = float(np.median(nights.size)), (nights.days[:, None] >= self.jumps).astype(float)
        error = nights.error.copy()
        error[list(shocks.apart)] *= WIDE
        whole = covariance(nights, way) + (JUMP * self.usual) ** 2 * (stepped @ stepped.T) + np.diag(error**2)
        self.root = cho_factor(whole, lower=True, check_finite=False)
        off = nights.size - self.usual
        self.pull = cho_solve(self.root, off, check_finite=False)
        total, n = TRUST + float(off @ self.pull), TRUST + len(nights)
        logdet = 2.0 * float(np.log(np.diag(self.root[0])).sum())
        self.evidence, self.scale = -0.5 * logdet - 0.5 * n * float(np.log(total / TRUST)), total / n

    def foreseen(self, days: FloatArray, month: float) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard error of the level at `days`, the nights' and later ones, and, last, of the slope
        over the `month` before the last night: (days + 1,) each."""
        n, last = len(days), self.nights.days[-1]
        asked = np.concatenate([days, [last, last - month], self.nights.days])
        columns, prior = unknowns(self.nights, self.way, asked)
        columns = np.column_stack([columns, asked[:, None] >= self.jumps])
        prior = np.append(prior, np.full(len(self.jumps), (JUMP * self.usual) ** 2))
        known = columns[n + 2 :]
        columns = np.vstack([columns[:n], (columns[n] - columns[n + 1]) / month])
        cross = (columns * prior) @ known.T
        told = solve_triangular(self.root[0], cross.T, lower=True)
        mean, variance = cross @ self.pull, columns**2 @ prior - (told**2).sum(axis=0)
        mean[:-1] += self.usual
        return mean, np.sqrt(self.scale * np.maximum(variance, 0.0))

    def shocks(self) -> tuple[FloatArray, FloatArray]:
        """Return how far each night lies apart, and the step before each, in standard errors, as if the only shock."""
        inverse = cho_solve(self.root, np.eye(len(self.nights)))
        after = inverse[::-1, ::-1].cumsum(0).cumsum(1)[::-1, ::-1]
        step = np.abs(self.pull[::-1].cumsum()[::-1]) / np.sqrt(np.maximum(np.diag(after), 1e-300))
        return np.abs(self.pull) / np.sqrt(np.diag(inverse)), np.append(0.0, step[1:])


@dataclass(frozen=True, eq=False)
class Trend:
    """A dead band over the days of its nights and beyond, (points,) each: days, level, low and high end of its 95 %
    interval. nights: so many of the points. slope: mean over the last month [span/day], and its interval. straight: how
    much the nights speak for a line."""

    days: FloatArray
    level: FloatArray
    low: FloatArray
    high: FloatArray
    nights: int
    slope: tuple[float, float, float]
    shocks: Shocks
    straight: float

    def at(self, days: FloatArray | float) -> FloatArray:
        """Return level and both ends of its interval at days, (3, points)."""
        return np.array([np.interp(days, self.days, y) for y in (self.level, self.low, self.high)])

    def reaches(self, limit: float) -> tuple[float, float, float]:
        """Return the day on which the level reaches `limit`, and the interval of that day; inf where it never does."""
        value, early, late = (self._crossing(y, limit) for y in (self.level, self.high, self.low))
        night = float(np.median(np.diff(self.days[: self.nights])))  # when in it that was, no night knows
        return value, min(early, value) - night, max(late, value) + night

    def _crossing(self, y: FloatArray, limit: float) -> float:
        """Return the day from which y is above the limit: since when it is, or else when first it will be."""
        n = self.nights
        if y[n - 1] >= limit:
            k = n - int(np.argmax(np.append(y[:n][::-1] < limit, True)))
        else:
            k = n + int(np.argmax(np.append(y[n:] >= limit, True)))
        if k in (0, len(y)):
            return float(self.days[0]) if k == 0 else inf
        return float(np.interp(limit, y[k - 1 : k + 1], self.days[k - 1 : k + 1]))


def fit(nights: Nights, shocks: Shocks, ways: Iterable[Way] = tuple(BELIEF)) -> Trend:
    """Return the trend through the nights: all ways to bend, and steps that may just have come, by their evidence."""
    ways, (data, given) = tuple(ways), _thinned(nights, shocks)
    tried = [(given.belief(), Fit(data, way, given)) for way in ways]
    for k in _maybe_steps(data, given, max((f for _, f in tried), key=lambda f: f.evidence)):
        other = Shocks(tuple(j for j in given.apart if not k <= j < k + LEAST), tuple(sorted((*given.steps, k))))
        tried += [(other.belief() + float(np.log(DOUBT)), Fit(data, way, other)) for way in ways]
    score = np.array([belief + f.evidence + np.log(BELIEF[f.way]) for belief, f in tried])
    weight = np.exp(score - score.max())
    weight /= weight.sum()
    straight = float(sum(w for w, (_, f) in zip(weight, tried, strict=True) if f.way == LINE))
    days, last = np.append(nights.days, nights.days[-1] + LATER[1:]), nights.days[-1:]
    month = max(min(MONTH, float(last[0] - nights.days[0])), 1e-9)
    speaking = [k for k in np.argsort(-weight) if weight[k] > 1e-4]
    mean, error = (np.array(x) for x in zip(*(tried[k][1].foreseen(days, month) for k in speaking), strict=True))
    # steps go on as they came
    places = list(given.steps)
    level = weight[speaking] @ mean[:, :-1]
    at = np.searchsorted(nights.days, data.days[places])
    jumps, later = level[at] - level[at - 1], np.maximum(days - last, 0.0) / max(float(np.ptp(nights.days)), 1.0)
    mean[:, :-1] += jumps.sum() * later
    error[:, :-1] = np.sqrt(error[:, :-1] ** 2 + (jumps**2).sum() * later)
    found = _quantiles(mean, np.maximum(WIDER * error, 1e-12), weight[speaking])
    level, low, high = found[:, :-1]
    slope = found[:, -1]
    return Trend(days, level, low, high, len(nights), (float(slope[0]), float(slope[1]), float(slope[2])), shocks,
                 straight)


def _quantiles(mean: FloatArray, error: FloatArray, weight: FloatArray) -> FloatArray:
    """Return median, 2.5 % and 97.5 % point of a mixture of normal distributions (ways, points), by bisection."""
    share = np.array([0.5, 0.025, 0.975])[:, None] * weight.sum()
    low, high = (np.tile(end, (3, 1)) for end in ((mean - 3.0 * error).min(axis=0), (mean + 3.0 * error).max(axis=0)))
    for _ in range(50):
        middle = 0.5 * (low + high)
        above = np.einsum("w,wsp->sp", weight, ndtr((middle - mean[:, None]) / error[:, None])) > share
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return middle


def _thinned(nights: Nights, shocks: Shocks) -> tuple[Nights, Shocks]:
    """Return long histories with their older half in groups of nights, none of them over a step."""
    n, half = len(nights), PIECE // 2
    if n <= PIECE:
        return nights, shocks
    error = nights.error.copy()
    error[list(shocks.apart)] *= WIDE
    group = np.concatenate([np.arange(n - half) * half // (n - half), half + np.arange(half)])
    starts = np.union1d(np.flatnonzero(np.diff(group, prepend=-1)), shocks.steps).astype(int)
    weight = np.add.reduceat(error**-2, starts)
    days, size = (np.add.reduceat(x * error**-2, starts) / weight for x in (nights.days, nights.size))
    return Nights(days, size, weight**-0.5), Shocks((), tuple(np.searchsorted(starts, shocks.steps).tolist()))


def _maybe_steps(nights: Nights, shocks: Shocks, found: Fit) -> list[int]:
    """Return the positions of steps that may be: the likeliest, and those of the last nights where these lie apart."""
    size = found.shocks()[1]
    size[[0, *shocks.steps]] = 0.0
    likely = [int(k) for k in np.argsort(-size)[:OPEN] if size[k] > MAYBE]
    late = (k for k in shocks.apart if k > len(nights) - LEAST)
    return list(dict.fromkeys([*likely, *late])) if len(nights) >= ENOUGH else []


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
    n, shocks, best = len(nights), Shocks(), _best(nights, Shocks())
    refused: set[tuple[bool, int]] = set()
    while n >= 2 * LEAST and len(refused) < REFUSED:
        # gain in log likelihood, less what a size that is not known costs, less the rareness of such shocks
        apart, step = (0.5 * z**2 for z in max((Fit(nights, way, shocks) for way in STIFF),
                                               key=lambda f: f.evidence).shocks())
        apart += np.log(APART / WIDE)
        step += np.log(STEPS * np.median(nights.error) / (JUMP * np.median(nights.size)))
        apart[[*shocks.apart, *(k for stepped, k in refused if not stepped)]] = -1.0
        room = {k for a, b in pairwise([0, *shocks.steps, n]) for k in range(a + LEAST // 2, b - LEAST + 1)}
        step[[k for k in range(n) if (True, k) in refused or k not in room]] = -1.0
        if max(apart.max(), step.max()) <= 0.0:
            break
        if stepped := bool(step.max() >= apart.max()):
            k = _place(nights.size, int(np.argmax(step)), [k for k in range(n) if step[k] >= 0.0])
            more = Shocks(shocks.apart, tuple(sorted({*shocks.steps, k})))
        else:
            k = int(np.argmax(apart))
            more = Shocks(tuple(sorted({*shocks.apart, k})), shocks.steps)
        if (with_it := _best(nights, more)) <= best:  # a fast bend explains it as well
            refused.add((stepped, k))
            continue
        shocks, best = more, with_it
        if stepped:  # it may explain nights that seemed to lie apart: they are looked at again
            shocks = Shocks((), more.steps)
            best = _best(nights, shocks)
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
    return max(Fit(nights, w, shocks).evidence + float(np.log(BELIEF[w])) for w in BELIEF if w.order) + shocks.belief()
