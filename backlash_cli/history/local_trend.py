"""Wear that may bend: the level of the dead band and its growth, both free to change, seen through noisy nights.

A structural time series (A. C. Harvey, Forecasting, structural time series models and the Kalman filter, 1989, section
2.3) written as what it is, a Gaussian process (C. E. Rasmussen, C. K. I. Williams, Gaussian processes for machine
learning, 2006, equations 2.25-2.30): a straight line or a curve, a walk of the level, of the slope or of its change,
and lasting steps, each of unknown size; a night measures the level with the error of its own interval. How wear bends
is not known: every way of BELIEF is tried, and weighs as much as the nights speak for it. Single nights that lie apart
and steps are told by the residuals (P. de Jong, J. Penzer, Diagnosing shocks in time series, JASA 93 (1998) 796-806).
"""

from collections.abc import Iterable
from dataclasses import replace
from math import factorial, inf
from typing import NamedTuple, Self

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.special import expit, ndtr, softmax

from ..record import BoolArray, FloatArray, Frozen
from ..results.history import DAY

BoolArray = BoolArray
ENOUGH = 5  # nights; fewer say nothing about a slope
LEAST = 4  # nights after a step (half as many before): two bad nights must not make one
MONTH = 30.0  # days over which the slope is told
TRUST = 30.0  # nights that the noise of the nights is sure of; it is known from neighbouring nights
WIDE = 10.0  # times its own error, that a night which lies apart may be off
APART, STEPS = 0.03, 0.02  # share of nights that lie apart, and after which the level steps, before a look at them
DOUBT = 0.5  # of that, for a step that single nights speak for and the search has not found
JUMP = 0.5  # usual size of a step, in usual levels
MAYBE = 2.0  # standard errors of a step that may have come; OPEN of these are kept in mind
OPEN = 4
REFUSED = 6  # shocks that a bend explains as well, after which no more are looked for
PIECE = 240  # nights that are searched for shocks at a time
SAID = 0.75  # of the evidence counts between ways to bend, since none is the true one: P. Grünwald, T. van Ommen,
# Inconsistency of Bayesian inference for misspecified linear models, Bayesian Analysis 12 (2017) 1069-1103
WIDER = 1.5  # of all intervals, because real wear follows none of these trends; from tests/benchmarks/wear.py
FAR = 3.0  # the same for the level, and its growth, before the first night
LATER = np.concatenate([np.arange(0.0, 61.0), np.geomspace(64.0, 1e6, 100)])  # days after the last night


class Way(NamedTuple):
    """How a trend may bend. A walk: level (0), slope (1) or the change of the slope (2) wanders within so many nights.

    rate: of the growth, times by which it multiplies from the first night to the last (e-folds; negative where it
    slows down; inf: a straight growth that becomes another one at once). at: where an S-shaped growth is fastest, or
    where that is, in parts of the same time."""

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
        elif r == inf:
            beside = [u, _growth(u, r, c + 0.075) - _growth(u, r, c - 0.075)]
        elif r and c == inf:
            beside = [_growth(u, r + 0.75, c) - _growth(u, r - 0.75, c)]
        elif r:
            beside = [_growth(u, 1.4 * r, c) - _growth(u, r / 1.4, c), _growth(u, r, c + 0.1) - _growth(u, r, c - 0.1)]
        return np.column_stack([_growth(u, r, c), *beside])


def _growth(u: FloatArray, rate: float, at: float) -> FloatArray:
    """Return a growth from 0 at u = 0 to 1 at u = 1: straight, exponential, S-shaped (logistic), or begun late."""
    if rate == 0.0:
        return u
    if rate == inf:
        return np.maximum(u - at, 0.0) / (1.0 - at)
    if at == inf:
        return np.asarray(np.expm1(np.minimum(rate * u, 200.0)) / np.expm1(rate))
    first, last, now = (expit(rate * (x - at)) for x in (0.0, 1.0, u))
    return np.asarray((now - first) / (last - first))


LINE = Way()
CURVES = (*(Way(1, 32.0, r) for r in (-4.5, -3.0, -1.5, 1.5, 3.0)),
          *(Way(1, 32.0, r, c) for c in (0.2, 0.5, 0.8) for r in (6.0, 12.0)),
          *(Way(1, 32.0, inf, c) for c in (0.2, 0.35, 0.5, 0.65, 0.8)))
BELIEF = {LINE: 0.1, **dict.fromkeys(CURVES, 0.03), **dict.fromkeys((Way(0, b) for b in (16.0, 8.0, 4.0, 2.0)), 0.07),
          **dict.fromkeys((Way(1, b) for b in (64.0, 32.0, 16.0, 8.0, 4.0, 2.5)), 0.025),
          **dict.fromkeys((Way(2, b) for b in (inf, 16.0, 8.0, 5.0, 3.2)), 0.05)}  # before a look at the nights
SMOOTH = [way for way in BELIEF if way.order]  # bend, but do not jump
STIFF = (LINE, Way(1, 32.0), Way(1, 16.0), Way(1, 8.0), Way(2), Way(2, 16.0), *CURVES)  # do not follow a step


class Nights(Frozen, eq=False):
    """Sizes in time order, (nights,) arrays: days, dead band [span], its standard error [span]; and what no trend
    explains: whether a night lies apart, and whether its level is a step from before."""

    days: FloatArray
    size: FloatArray
    error: FloatArray
    apart: BoolArray
    steps: BoolArray

    def __len__(self) -> int:
        return len(self.days)

    def part(self, first: int, end: int) -> Self:
        """Return some of them."""
        return type(self)(*(column[first:end] for column in vars(self).values()))

    @property
    def spread(self) -> FloatArray:
        """Standard error of each night, as it counts."""
        return np.where(self.apart, WIDE, 1.0) * self.error

    def unknowns(self, way: Way, days: FloatArray) -> FloatArray:
        """Return what each unknown, as large as it usually is, does to the level at `days`, (days, unknowns): level and
        growth of the curve, how sharp it is, steps, and the walk from night to night and day to day."""
        k, usual = way.order, float(np.median(self.size))
        shapes = way.shapes((days - self.days[0]) / max(float(np.ptp(self.days)), 1.0))
        columns = np.column_stack([FAR * usual * np.ones(len(days)), FAR * usual * shapes,
                                   JUMP * usual * (days[:, None] >= self.days[self.steps])])
        if way.within == inf:
            return columns
        edges = np.append(self.days, np.unique(days[days > self.days[-1]]))
        since = days[:, None] - 0.5 * (edges[1:] + edges[:-1])
        walk = np.where(since > 0.0, since**k / factorial(k), 0.0)
        step = max(float(np.median(np.diff(self.days))), 1e-3)
        # within so many nights it moves the level by as much as one night's error
        gain = np.interp(edges[:-1], self.days, self.error) ** 2 / (way.within ** (2 * k + 2) * step ** (2 * k + 1))
        return np.column_stack([columns, np.sqrt(gain * np.diff(edges)) * walk])


class Fit:
    """One way to bend through the nights.

    evidence: log likelihood with the scale of the noise integrated out (inverse gamma about 1); scale: mean of that.
    prior: belief in the way and its shocks; score: both."""

    def __init__(self, nights: Nights, way: Way) -> None:
        self.nights, self.way, self.usual = nights, way, float(np.median(nights.size))
        columns = nights.unknowns(way, nights.days)
        self.root = cho_factor(columns @ columns.T + np.diag(nights.spread**2), lower=True, check_finite=False)
        off = nights.size - self.usual
        self.pull = cho_solve(self.root, off, check_finite=False)
        total, n = TRUST + float(off @ self.pull), TRUST + len(nights)
        logdet = 2.0 * float(np.log(np.diag(self.root[0])).sum())
        self.evidence, self.scale = -0.5 * logdet - 0.5 * n * float(np.log(total / TRUST)), total / n
        rare = nights.apart.sum() * np.log(APART) + nights.steps.sum() * np.log(STEPS)
        self.prior = float(np.log(BELIEF[way]) + rare)
        self.score = self.evidence + self.prior

    def foreseen(self, days: FloatArray, month: float) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard error of the level at `days`, the nights' and later ones, and, last, of the slope
        over the `month` before the last night: (days + 1,) each."""
        n, last = len(days), self.nights.days[-1]
        columns = self.nights.unknowns(self.way, np.concatenate([days, [last, last - month], self.nights.days]))
        asked = np.vstack([columns[:n], (columns[n] - columns[n + 1]) / month])
        cross = asked @ columns[n + 2 :].T
        told = solve_triangular(self.root[0], cross.T, lower=True)
        mean, variance = cross @ self.pull, (asked**2).sum(axis=1) - (told**2).sum(axis=0)
        mean[:-1] += self.usual
        return mean, np.sqrt(self.scale * np.maximum(variance, 0.0))

    def shocks(self) -> tuple[FloatArray, FloatArray]:
        """Return the step before each night, and how far it lies apart, in standard errors, as if the only shock."""
        inverse = cho_solve(self.root, np.eye(len(self.nights)))
        after = inverse[::-1, ::-1].cumsum(0).cumsum(1)[::-1, ::-1]
        step = np.abs(self.pull[::-1].cumsum()[::-1]) / np.sqrt(np.maximum(np.diag(after), 1e-300))
        return np.append(0.0, step[1:]), np.abs(self.pull) / np.sqrt(np.diag(inverse))


class Trend(Frozen, eq=False):
    """The dead band of `nights` and beyond, over days, (points,) each: level, low and high end of its 95 % interval.
    slope: mean over the last month [span/day], and its interval. straight: how much the nights speak for a line."""

    nights: Nights
    days: FloatArray
    level: FloatArray
    low: FloatArray
    high: FloatArray
    slope: tuple[float, ...]
    straight: float

    def at(self, days: FloatArray | float) -> FloatArray:
        """Return level and both ends of its interval at days, (3, points)."""
        return np.array([np.interp(days, self.days, y) for y in (self.level, self.low, self.high)])

    def path(self, days: FloatArray) -> tuple[tuple[float, ...], ...]:
        """Return (epoch seconds, level, low, high) at days."""
        return tuple(zip((days * DAY).tolist(), *self.at(days).tolist(), strict=True))

    def reaches(self, limit: float) -> tuple[float, float, float]:
        """Return the day on which the level reaches `limit`, and the interval of that day; inf where it never does."""
        value, early, late = (self._crossing(y, limit) for y in (self.level, self.high, self.low))
        night = float(np.median(np.diff(self.nights.days)))  # when in it that was, no night knows
        return value, min(early, value) - night, max(late, value) + night

    def _crossing(self, y: FloatArray, limit: float) -> float:
        """Return the day from which y is above the limit: since when it is, or else when first it will be."""
        above, n = y >= limit, len(self.nights)
        above[:n] = np.logical_and.accumulate(above[:n][::-1])[::-1]
        k = int(np.argmax(np.append(above, True)))
        if k in (0, len(y)):
            return float(self.days[0]) if k == 0 else inf
        return float(np.interp(limit, y[k - 1 : k + 1], self.days[k - 1 : k + 1]))


def fit(nights: Nights, ways: Iterable[Way] = tuple(BELIEF)) -> Trend:
    """Return the trend through the nights: all ways to bend, and steps that may just have come, by their evidence."""
    ways, data = tuple(ways), _thinned(nights)
    tried = [Fit(data, way) for way in ways]
    score = [SAID * f.evidence + f.prior for f in tried]
    # steps that may be: the likeliest, and those of the last nights where these lie apart
    size = max(tried, key=lambda f: f.evidence).shocks()[0] * ~data.steps
    likely = [k for k in np.argsort(-size)[:OPEN] if size[k] > MAYBE]
    for k in dict.fromkeys([*likely, *(k for k in np.flatnonzero(data.apart) if k > len(data) - LEAST)]):
        after = np.arange(len(data)) - k
        other = replace(data, apart=data.apart & ((after < 0) | (after >= LEAST)), steps=data.steps | (after == 0))
        tried += (doubtful := [Fit(other, way) for way in ways])
        score += [SAID * f.evidence + f.prior + float(np.log(DOUBT)) for f in doubtful]
    weight = softmax(score)
    straight = float(sum(w for w, f in zip(weight, tried, strict=True) if f.way == LINE))
    days, last = np.append(nights.days, nights.days[-1] + LATER[1:]), nights.days[-1:]
    month = max(min(MONTH, float(last[0] - nights.days[0])), 1e-9)
    speaking = [k for k in np.argsort(-weight) if weight[k] > 1e-4]
    mean, error = (np.array(x) for x in zip(*(tried[k].foreseen(days, month) for k in speaking), strict=True))
    level = weight[speaking] @ mean[:, :-1]  # steps go on as they came
    at = np.searchsorted(nights.days, data.days[data.steps])
    jumps, later = level[at] - level[at - 1], np.maximum(days - last, 0.0) / max(float(np.ptp(nights.days)), 1.0)
    mean[:, :-1] += jumps.sum() * later
    error[:, :-1] = np.sqrt(error[:, :-1] ** 2 + (jumps**2).sum() * later)
    found = _quantiles(mean, np.maximum(WIDER * error, 1e-12), weight[speaking])
    return Trend(nights, days, found[0, :-1], found[1, :-1], found[2, :-1], tuple(found[:, -1].tolist()), straight)


def _quantiles(mean: FloatArray, error: FloatArray, weight: FloatArray) -> FloatArray:
    """Return median, 2.5 % and 97.5 % point of a mixture of normal distributions (ways, points), by bisection."""
    share = np.array([0.5, 0.025, 0.975])[:, None] * weight.sum()
    low, high = (np.tile(end, (3, 1)) for end in ((mean - 3.0 * error).min(axis=0), (mean + 3.0 * error).max(axis=0)))
    for _ in range(50):
        middle = 0.5 * (low + high)
        above = np.einsum("w,wsp->sp", weight, ndtr((middle - mean[:, None]) / error[:, None])) > share
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return middle


def _thinned(nights: Nights) -> Nights:
    """Return long histories with their older half in groups of nights, none of them over a step."""
    n, half = len(nights), PIECE // 2
    if n <= PIECE:
        return nights
    group = np.concatenate([np.arange(n - half) * half // (n - half), half + np.arange(half)])
    starts = np.flatnonzero((np.diff(group, prepend=-1) > 0) | nights.steps)
    weight = np.add.reduceat(nights.spread**-2, starts)
    days, size = (np.add.reduceat(x * nights.spread**-2, starts) / weight for x in (nights.days, nights.size))
    return Nights(days, size, weight**-0.5, np.zeros(len(starts), bool), nights.steps[starts])


def find_shocks(nights: Nights) -> Nights:
    """Return the nights with those that lie apart and steps marked; long histories are searched in pieces that
    overlap, each night where it lies farthest from the ends."""
    apart, steps = np.zeros((2, len(nights)), bool)
    for first in range(0, max(len(nights) - PIECE // 2, 1), PIECE // 2):
        found, skipped = _with_shocks(nights.part(first, first + PIECE)), PIECE // 4 * (first > 0)
        apart[first + skipped : first + PIECE] = found.apart[skipped:]
        steps[first + skipped : first + PIECE] = found.steps[skipped:]
    return replace(nights, apart=apart, steps=steps)


def _with_shocks(nights: Nights) -> Nights:
    """Mark the shocks of one piece, the clearest first, until nothing is left that a trend cannot explain."""
    at, refused = np.arange(len(nights)), np.zeros((2, len(nights)), bool)
    # log of the rareness of such shocks, and what a size that is not known costs
    of_step = STEPS * float(np.median(nights.error)) / (JUMP * float(np.median(nights.size)))
    cost = np.log(np.array([[of_step], [APART / WIDE]]))
    fits = [Fit(nights, way) for way in SMOOTH]
    while len(nights) >= 2 * LEAST and refused.sum() < REFUSED:
        found = max((f for f in fits if f.way in STIFF), key=lambda f: f.evidence)
        edges = np.array([0, *np.flatnonzero(nights.steps), len(nights)])
        place = np.searchsorted(edges, at, "right")
        narrow = (at - edges[place - 1] < LEAST // 2) | (edges[place] - at < LEAST)
        # gain in log likelihood
        gain = np.where(refused | np.array([narrow, nights.apart]), -1.0, 0.5 * np.square(found.shocks()) + cost)
        if gain.max() <= 0.0:
            break
        kind, k = divmod(int(gain.argmax()), len(nights))
        if kind == 0:
            k = _place(nights.size, k, np.flatnonzero(gain[0] >= 0.0).tolist())
        more = replace(nights, steps=nights.steps | ((at == k) & (kind == 0)),
                       apart=nights.apart | ((at == k) & (kind == 1)))
        with_it = [Fit(more, way) for way in SMOOTH]
        if max(f.score for f in with_it) > max(f.score for f in fits):
            nights, fits = more, with_it
        else:  # a fast bend explains it as well
            refused[kind, k] = True
    return nights


def _place(size: FloatArray, k: int, allowed: list[int]) -> int:
    """Return the cut near k with the sharpest step: a trend that goes on fast after it would place it late."""
    def sharpness(cut: int) -> float:
        before, after = size[max(cut - LEAST, 0) : cut], size[cut : cut + LEAST]
        high, low = np.median(before), np.median(after)
        return float(abs(high - low) - np.abs(before - high).mean() - np.abs(after - low).mean())

    return max((cut for cut in allowed if abs(cut - k) <= 2 * LEAST), key=lambda cut: (sharpness(cut), -abs(cut - k)))
