"""Does PV follow OP, or OP through a dead band of width d? The likelihood of both, scanned over d.

For every d the measured PV is explained by the valve position play(OP, d) through the same kind of process, with a
load that wanders and steps and with measurement noise (see `whitening`). Three numbers shape that model: the lag of
the process, how fast the load wanders against the noise, and how smoothly. They are fitted without a dead band and
again with one, so that neither has the better noise model. Evidence is the difference of the log-likelihoods [nats].
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray
from . import whitening as core
from .load_steps import load_steps

STEP_LIMIT = 4.0  # a load step must stand out this much under every d: one false one in 16,000 rows
STEP_PASSES = 5
SPREAD = (0.35, 0.8, 1.0)  # first steps of the search: ln lag, ln ratio, logit phi
LOWEST = np.array([-1.0, -16.0, -4.0])
HIGHEST = np.array([3.5, 8.0, 6.0])
DROP = 3.0  # nats from the top to the ends of the likelihood interval


@dataclass(frozen=True, eq=False)
class Rows:
    """Block means, centred: y (rows,) PV, x (1 + widths, rows) OP (first) and OP through each dead band of `widths`
    (ascending). first (rows,): True where a stretch begins. lag: typical lag of the process in rows (Ti / 4).
    line (columns, rows): shapes that a periodic load may have."""

    y: FloatArray
    x: FloatArray
    widths: FloatArray
    first: NDArray[np.bool_]
    lag: float
    line: FloatArray = field(default_factory=lambda: np.empty((0, 0)))


@dataclass(frozen=True)
class Evidence:
    """Result: width `d` with `interval`, evidence `gain` [nats] and profile over the widths.

    half: best evidence for half a dead band (mean of OP and play): a true one beats it. mirror: best evidence for
    the opposite of a dead band (2 OP - play), a sham effect that only errors of the linear model can support.
    error_reduction: share of the variance of the one-step prediction that d removes. noise: deviation of the
    measurement noise per row. steps: load steps found. gain_to_pv: static gain of the fitted process.
    """

    d: float
    interval: tuple[float, float]
    gain: float
    half: float
    mirror: float
    error_reduction: float
    noise: float
    steps: int
    rows: int
    responds: float
    gain_to_pv: float
    profile: tuple[tuple[float, float], ...] = field(default=())


class Fitter:
    """The likelihood of one loop's rows for given shape numbers p = (ln lag, ln ratio, logit phi)."""

    def __init__(self, rows: Rows) -> None:
        self.r = rows
        n = len(rows.y)
        self.shock = np.zeros(n)
        starts = np.flatnonzero(rows.first)
        counted = np.ones(n, dtype=bool)
        for s in starts:
            counted[s : s + core.WARM_UP] = False
        self.counted = np.flatnonzero(counted)
        jumps = np.abs(np.diff(rows.y))[~rows.first[1:]]
        self.ridge = max(float(np.median(jumps)) / 0.6745 / np.sqrt(2.0), 1e-6) ** 2
        self.calls = 0

    def run(self, p: FloatArray, x: FloatArray, *, residuals: bool = False) -> Any:
        """Log-likelihood, noise variance, responses, residuals of each row of x; and what the filter was."""
        a = 1.0 - np.exp(-1.0 / np.exp(p[0]))
        phi = 1.0 / (1.0 + np.exp(-p[2]))
        G, S = core.gains(a, np.exp(p[1]), phi, self.shock, self.r.first)
        self.calls += len(x)
        return (*core.regress(self.r.y, x, G, S, a, phi, self.r.first, self.counted, self.ridge,
                               self.r.line, residuals),
                (G, S, a, phi))

    def ll(self, p: FloatArray, x: FloatArray) -> FloatArray:
        """Log-likelihood (candidates,)."""
        result: FloatArray = self.run(p, x)[0]
        return result

    def climb(self, x: FloatArray, p: FloatArray, rounds: int) -> tuple[FloatArray, float]:
        """Maximise over p from a start, one number after the other with halving steps, for one valve position x."""
        one = x[None, :]
        best = float(self.ll(p, one)[0])
        step = np.array(SPREAD)
        for _ in range(rounds):
            for i in range(len(p)):
                for sign in (1.0, -1.0):
                    moved = False
                    while True:
                        trial = p.copy()
                        trial[i] += sign * step[i]
                        if trial[i] < LOWEST[i] or trial[i] > HIGHEST[i]:
                            break
                        value = float(self.ll(trial, one)[0])
                        if value <= best + 0.2:
                            break
                        p, best, moved = trial, value, True
                    if moved:
                        break
            step = step / 2.0
        return p, best

    def best_of(self, starts: list[FloatArray], x: FloatArray) -> tuple[float, int, FloatArray]:
        """Best log-likelihood over starts and candidates: its value, the candidate, the start."""
        found = []
        for p in starts:
            values = self.ll(p, x)
            j = int(np.argmax(values))
            found.append((float(values[j]), j, p))
        return max(found, key=lambda f: f[0])

    def add_load_steps(self, p: FloatArray, x: FloatArray) -> bool:
        """Allow for load steps that stand out under every candidate x; False when there are none left."""
        _, noise, _, residuals, (G, S, a, phi) = self.run(p, x, residuals=True)
        statistic = np.full(len(self.r.y), np.inf)
        size = np.full(len(self.r.y), np.inf)
        for r, s2 in zip(residuals, noise, strict=True):
            t, step = load_steps(r / np.sqrt(s2), G, S, a, phi, self.r.first)
            statistic = np.minimum(statistic, np.abs(t))
            size = np.minimum(size, step * step)
        statistic[: core.WARM_UP - 4] = 0.0
        top = statistic.copy()
        for shift in (1, 2):
            top[shift:] = np.maximum(top[shift:], statistic[:-shift])
            top[:-shift] = np.maximum(top[:-shift], statistic[shift:])
        hit = (statistic > STEP_LIMIT) & (statistic >= top)
        self.shock = self.shock + np.where(hit, size, 0.0)
        return bool(hit.any())


def weigh(rows: Rows) -> Evidence:
    """Return the evidence for a dead band in `rows` (at least one width)."""
    fit = Fitter(rows)
    x, n = rows.x, len(rows.widths)
    lag = np.log(rows.lag)
    starts = [np.array([lag + np.log(share), ratio, smooth])
              for share in (0.6, 1.4) for ratio, smooth in ((-11.0, -2.0), (-5.0, -2.0), (0.0, -1.0))]
    coarse = np.arange(1, n + 1, 2)
    _, _, p0 = fit.best_of(starts, x[:1])
    p0, f0 = fit.climb(x[0], p0, 2)
    _, j, p1 = fit.best_of([*starts, p0], x[coarse])
    j = int(coarse[j])
    p1, f1 = fit.climb(x[j], p1, 2)
    for _ in range(STEP_PASSES):
        some = np.unique([0, j, *range(0, n + 1, 2)])
        if not fit.add_load_steps(p1 if f1 > f0 else p0, x[some]):
            break
        p0, f0 = fit.climb(x[0], p0, 1)
        _, j, p1 = fit.best_of([p1, p0], x[1:])
        j += 1
        p1, f1 = fit.climb(x[j], p1, 1)
    _, _, p = fit.best_of(starts, x[:1])
    p0, f0 = max(fit.climb(x[0], p, 2), fit.climb(x[0], p0, 2), key=lambda c: c[1])
    _, j, p1 = fit.best_of([*starts, p0, p1], x[1:])
    for _ in range(3):
        j += 1
        p1, f1 = fit.climb(x[j], p1, 2)
        values = fit.ll(p1, x[1:])
        if int(np.argmax(values)) == j - 1:
            break
        j = int(np.argmax(values))
    j = int(np.argmax(values)) + 1
    p0, f0 = max((p0, f0), fit.climb(x[0], p1, 2), key=lambda c: c[1])
    return _summary(fit, p0, f0, p1, j, values)


def between(rows: Rows, d: float) -> FloatArray:
    """Valve position (rows,) for a width between two of the grid, by linear interpolation."""
    i = int(np.clip(np.searchsorted(rows.widths, d), 1, len(rows.widths) - 1))
    low, high = rows.widths[i - 1], rows.widths[i]
    share = (d - low) / (high - low)
    mixed: FloatArray = (1.0 - share) * rows.x[i] + share * rows.x[i + 1]
    return mixed


def _summary(fit: Fitter, p0: FloatArray, f0: float, p1: FloatArray, j: int, values: FloatArray) -> Evidence:
    rows = fit.r
    widths = rows.widths
    if len(widths) > 1:
        fine = np.linspace(widths[max(j - 2, 0)], widths[min(j, len(widths) - 1)], 11)
        extra = fit.ll(p1, np.array([between(rows, d) for d in fine]))
    else:
        fine, extra = widths, values
    d, top = _peak(fine, extra)
    grid = np.concatenate([widths, fine])
    level = np.concatenate([values, extra])
    order = np.argsort(grid, kind="stable")
    interval = _likelihood_interval(grid[order], level[order], top)
    linear, hysteresis = rows.x[:1], rows.x[1:]
    half = float(np.max(fit.ll(p1, 0.5 * (linear + hysteresis)))) - f0
    mirror = float(np.max(fit.ll(p0, 2.0 * linear - hysteresis))) - f0
    at = between(rows, d) if len(widths) > 1 else rows.x[1]
    ll, noise, b, residual, (_, S, _, _) = fit.run(p1, at[None, :], residuals=True)
    _, _, _, without, (_, S0, _, _) = fit.run(p0, linear, residuals=True)
    nothing = float(fit.ll(p1, np.zeros_like(linear))[0])
    k = fit.counted
    reduction = 1.0 - float(np.median(residual[0, k] ** 2 * S[k]) / np.median(without[0, k] ** 2 * S0[k]))
    return Evidence(
        d, interval, max(top, float(ll[0])) - f0, half, mirror, reduction, float(np.sqrt(noise[0])),
        int(np.count_nonzero(fit.shock)), len(k), float(ll[0]) - nothing, float(b[0].sum()),
        tuple((float(w), float(v - f0)) for w, v in zip(grid[order], level[order], strict=True)),
    )


def _peak(d: FloatArray, values: FloatArray) -> tuple[float, float]:
    i = int(np.argmax(values))
    if 0 < i < len(d) - 1:
        left, mid, right = values[i - 1 : i + 2]
        bend = left - 2.0 * mid + right
        if bend < 0:
            shift = float(np.clip(0.5 * (left - right) / bend, -1.0, 1.0))
            return float(d[i] + shift * (d[1] - d[0])), float(mid)
    return float(d[i]), float(values[i])


def _likelihood_interval(d: FloatArray, values: FloatArray, top: float) -> tuple[float, float]:
    level = top - DROP
    inside = np.flatnonzero(values > level)
    first, last = int(inside[0]), int(inside[-1])

    def crossing(a: int, b: int) -> float:
        return float(d[a] + (level - values[a]) / (values[b] - values[a]) * (d[b] - d[a]))

    low = crossing(first - 1, first) if first > 0 else 0.0
    high = crossing(last + 1, last) if last < len(d) - 1 else float(d[-1]) * 1.22
    return low, high
