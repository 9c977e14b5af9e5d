"""Does PV follow OP, or OP through a dead band of width d? The likelihood of both, scanned over d.

For every d the measured PV is explained by the valve position play(OP, d) through the same kind of process, with a
load that wanders and steps and with measurement noise (see `whitening`). Three numbers shape that model: the lag of
the process, how fast the load wanders against the noise, and how smoothly. They are fitted without a dead band and
again with one, so that neither has the better noise model. Evidence is the difference of the log-likelihoods [nats].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray
from . import likelihood
from . import whitening as core
from .load_steps import load_steps, step_information
from .profile import between, likelihood_interval, peak

STEP_LIMIT = 4.0  # a load step must stand out this much under every d: one false one in 16,000 rows
STEP_PASSES = 5
CLOSE = 40.0  # nats by which a dead band may lie behind before the search is not refined any further
FINE = 9  # widths tried between the neighbours of the best


@dataclass(frozen=True, eq=False)
class Rows:
    """Block means, centred: y (rows,) PV, x (1 + widths, rows) OP (first) and OP through each dead band of `widths`
    (ascending). first (rows,): True where a stretch begins. lag: typical lag of the process in rows (Ti / 4).
    line (columns, rows): shapes that a periodic load may have. at (rows,): row numbers, where there are holes.
    stem (4, rows): what is known of where the stem stood, see `decimate.BlockMeans`."""

    y: FloatArray
    x: FloatArray
    widths: FloatArray
    first: NDArray[np.bool_]
    lag: float
    line: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    at: IntArray | None = None
    stem: FloatArray | None = None


@dataclass(frozen=True)
class Evidence:
    """Result: width `d` with `interval`, evidence `gain` [nats] and profile over the widths.

    half: best evidence for half a dead band (mean of OP and play): a true one beats it. mirror: best evidence for
    the opposite of a dead band (2 OP - play), a sham effect that only errors of the linear model can support.
    error_reduction: share of the variance of the one-step prediction that d removes. noise: deviation of the
    measurement noise per row. steps: load steps found. gain_to_pv: static gain of the fitted process. level:
    log-likelihood of the best model. half_period [rows]: of a load that switches to and fro; 0 for none. shape: the
    three numbers of the model with a dead band. shock (rows,): variances of the load steps.
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
    level: float = 0.0
    half_period: float = 0.0
    shape: tuple[float, ...] = ()
    shock: FloatArray = field(default_factory=lambda: np.empty(0), compare=False)


def counted(first: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which rows (rows,) count: not those in which the filter settles, where a stretch begins (`first`)."""
    rows = np.arange(len(first))
    counts: NDArray[np.bool_] = rows - np.maximum.accumulate(np.where(first, rows, 0)) >= core.WARM_UP
    return counts


class Fitter:
    """The likelihood of one loop's rows for given shape numbers p = (ln lag, ln ratio, logit phi)."""

    def __init__(self, rows: Rows) -> None:
        self.r = rows
        n = len(rows.y)
        self.shock = np.zeros(n)
        self.counted = counted(rows.first)
        jumps = np.abs(np.diff(rows.y))[~rows.first[1:]]
        self.ridge = max(float(np.median(jumps)) / 0.6745 / np.sqrt(2.0), 1e-6) ** 2
        self.G, self.S = np.empty((n, 4)), np.empty(n)
        self.R = np.empty((2, n), dtype=np.float32)
        self._room = (np.zeros((core.CHUNK, core.LANES), dtype=np.float32),
                      np.empty((core.USED, n), dtype=np.float32))

    def pair(self, p: FloatArray, xa: FloatArray, xb: FloatArray | None = None) -> Any:
        """Log-likelihoods (2,), noise variances (2,) and responses (2, lags) of two valve positions (rows,).

        Residuals are left in `R`, gains and variances of the filter in `G` and `S`.
        """
        return likelihood.pair(p, xa, xa if xb is None else xb, xb is not None, self.r.y, self.r.line, self.r.first,
                               self.counted, self.ridge, self.shock, self.G, self.S, *self._room, self.R)

    def climb(self, p: FloatArray, which: int, j: int, rounds: int = 1, share: float = 1.0) -> FloatArray:
        """Best p and log-likelihood (2, 4) of OP and of width j, on the way up for one of them."""
        best: FloatArray = likelihood.climb(
            p, which, rounds, share, self.r.x[0], self.r.x[j], self.r.y, self.r.line, self.r.first, self.counted,
            self.ridge, self.shock, self.G[:0], self.S, *self._room, self.R)
        return best

    def ll(self, p: FloatArray, x: FloatArray, which: Sequence[int] | IntArray | None = None) -> FloatArray:
        """Log-likelihood of each valve position in x (positions, rows), or of those in `which`."""
        chosen = np.arange(len(x)) if which is None else np.asarray(which, dtype=np.int64)
        found: FloatArray = likelihood.several(p, x, chosen, self.r.y, self.r.line, self.r.first, self.counted,
                                               self.ridge, self.shock, self.G[:0], self.S, *self._room, self.R)
        return found

    def add_load_steps(self, p: FloatArray, some: Sequence[int]) -> bool:
        """Allow for load steps that stand out under every width of `some`; False when there are none left."""
        a, phi = 1.0 - np.exp(-1.0 / np.exp(p[0])), 1.0 / (1.0 + np.exp(-p[2]))
        statistic = np.full(len(self.r.y), np.inf)
        size = np.full(len(self.r.y), np.inf)
        information = None
        for i in range(0, len(some), 2):
            two = some[i : i + 2]
            noise = self.pair(p, *(self.r.x[j] for j in two))[1]
            if information is None:
                information = step_information(self.G, self.S, a, phi, self.r.first)
            for c in range(len(two)):
                t, step = load_steps(self.R[c] / np.sqrt(noise[c]), information, self.G, self.S, a, phi, self.r.first)
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


@dataclass
class State:
    """Where a search stands: best p and log-likelihood without a dead band (p0, f0), and with width j (p1, f1)."""

    p0: FloatArray
    f0: float
    p1: FloatArray
    f1: float
    j: int


def weigh(rows: Rows) -> Evidence:
    """Return the evidence for a dead band in `rows` (at least two widths)."""
    fit, coarse, starts = Fitter(rows), _coarse(rows), _starts(rows)
    s = _searched(fit, starts, coarse)
    close = s.f1 - s.f0 > -CLOSE
    return _summary(fit, _final(fit, s, starts, coarse) if close else s, close)


def excluding(rows: Rows, least: float) -> Evidence | None:
    """Return the evidence in `rows` where every width lies behind none by `least` [nats], None where one does not.

    Where PV does not answer to OP by as much, nothing is excluded.
    """
    fit = Fitter(rows)
    s = _searched(fit, _starts(rows), _coarse(rows))
    if s.f1 - s.f0 > -least:
        return None
    found = _summary(fit, s, False)
    return found if max(v for _, v in found.profile) < -least < least < found.responds else None


def _coarse(rows: Rows) -> list[int]:
    n = len(rows.widths)
    return list(range(min(2, n), n + 1, 3))


def _starts(rows: Rows) -> list[FloatArray]:
    lag = np.log(rows.lag)
    return [np.array([lag + np.log(share), ratio, smooth])
            for share in (0.6, 1.4) for ratio, smooth in ((-11.0, -2.0), (-5.0, -2.0), (0.0, -1.0))]


def _searched(fit: Fitter, starts: list[FloatArray], coarse: list[int]) -> State:
    """The best models with and without a dead band, beside the load steps that neither explains."""
    n = len(fit.r.widths)
    s = _start(fit, starts, coarse)
    for _ in range(STEP_PASSES):
        some = sorted({0, s.j, *(int(np.clip(s.j + k, 1, n)) for k in (-6, -2, 2, 6))})
        if not fit.add_load_steps(s.p1 if s.f1 > s.f0 else s.p0, some):
            break
        s = _again(fit, s, coarse)
    return s


def _better(a: FloatArray, p: FloatArray, f: float) -> tuple[FloatArray, float]:
    return (a[:3], float(a[3])) if a[3] > f else (p, f)


def _start(fit: Fitter, starts: list[FloatArray], coarse: list[int]) -> State:
    x = fit.r.x
    middle = coarse[len(coarse) // 2]
    found = [fit.pair(p, x[0], x[middle])[0] for p in starts]
    p0 = starts[int(np.argmax([f[0] for f in found]))]
    best = fit.climb(p0, 0, middle, 2)
    p0, f0 = best[0, :3], float(best[0, 3])
    values = fit.ll(p0, x, coarse)
    j = coarse[int(np.argmax(values))]
    best = fit.climb(p0, 1, j)
    p0, f0 = _better(best[0], p0, f0)
    return State(p0, f0, best[1, :3], float(best[1, 3]), j)


def _again(fit: Fitter, s: State, coarse: list[int]) -> State:
    x = fit.r.x
    p = s.p1 if s.f1 > s.f0 else s.p0
    near = sorted({*coarse, *(int(np.clip(s.j + k, 1, len(x) - 1)) for k in (-1, 0, 1))})
    values = fit.ll(p, x, near)
    j = near[int(np.argmax(values))]
    which = int(values.max() > fit.ll(p, x, [0])[0])
    best = fit.climb(p, which, j)
    other = fit.climb(best[which, :3], 1 - which, j)
    best = np.where(other[:, 3:] > best[:, 3:], other, best)
    return State(best[0, :3], float(best[0, 3]), best[1, :3], float(best[1, 3]), j)


def _final(fit: Fitter, s: State, starts: list[FloatArray], coarse: list[int]) -> State:
    x = fit.r.x
    best = fit.climb(s.p0, 0, s.j)
    p0, f0 = best[0, :3], float(best[0, 3])
    p1, f1 = best[1, :3], float(best[1, 3])
    found = [fit.pair(p, x[0], x[s.j])[0] for p in starts]
    for c in range(2):
        k = int(np.argmax([f[c] for f in found]))
        if found[k][c] > (f0, f1)[c] - 5.0:
            best = fit.climb(starts[k], c, s.j)
            p0, f0 = _better(best[0], p0, f0)
            p1, f1 = _better(best[1], p1, f1)
    j = s.j
    for _ in range(3):
        near = sorted({*coarse, *(int(np.clip(j + k, 1, len(x) - 1)) for k in (-2, -1, 0, 1, 2))})
        values = fit.ll(p1, x, near)
        k = near[int(np.argmax(values))]
        if k == j:
            break
        j = k
        best = fit.climb(p1, 1, j, share=0.5)
        p0, f0 = _better(best[0], p0, f0)
        p1, f1 = best[1, :3], float(best[1, 3])
    best = fit.climb(p1, 1, j, share=0.5)
    p0, f0 = _better(best[0], p0, f0)
    p1, f1 = _better(best[1], p1, f1)
    best = fit.climb(p0, 0, j, share=0.5)
    p0, f0 = _better(best[0], p0, f0)
    return State(p0, f0, p1, f1, j)


def _summary(fit: Fitter, s: State, close: bool) -> Evidence:
    rows, p0, p1, f0 = fit.r, s.p0, s.p1, s.f0
    widths = rows.widths
    some = np.unique(np.clip([*range(0, len(widths), 2), len(widths) - 1, s.j - 3, s.j - 2, s.j - 1, s.j, s.j + 1], 0,
                             len(widths) - 1))
    values = fit.ll(p1, rows.x, 1 + some)
    grid, level = widths[some], values
    top, d = float(values.max()), float(grid[int(np.argmax(values))])
    if close:
        i = int(np.argmax(values))
        fine = np.linspace(grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)], FINE)
        extra = fit.ll(p1, np.stack([between(rows.x, rows.widths, w) for w in fine]))
        d, top = peak(fine, extra)
        inner = (fine > grid[max(i - 1, 0)]) & (fine < grid[min(i + 1, len(grid) - 1)]) & ~np.isin(fine, grid)
        grid, level = np.concatenate([grid, fine[inner]]), np.concatenate([level, extra[inner]])
        order = np.argsort(grid, kind="stable")
        grid, level = grid[order], level[order]
    top = max(top, float(level.max()))
    interval = likelihood_interval(grid, level, top)
    linear = rows.x[0]
    sham = 1 + (some if close else some[::3])
    half = float(np.max(fit.ll(p1, 0.5 * (linear + rows.x[sham])))) - f0
    mirror = float(np.max(fit.ll(p0, 2.0 * linear - rows.x[sham]))) - f0
    at = between(rows.x, rows.widths, d)
    k = fit.counted
    fit.pair(p0, linear)
    without = float(np.median(fit.R[0, k] ** 2 * fit.S[k]))
    ll, noise, b = fit.pair(p1, at, np.zeros_like(at))
    reduction = 1.0 - float(np.median(fit.R[0, k] ** 2 * fit.S[k])) / without
    return Evidence(
        d, interval, max(top, float(ll[0])) - f0, half, mirror, reduction, float(np.sqrt(noise[0])),
        int(np.count_nonzero(fit.shock)), int(k.sum()), float(ll[0] - ll[1]), float(b[0].sum()),
        tuple((float(w), float(v - f0)) for w, v in zip(grid, level, strict=True)), max(top, f0),
        shape=tuple(p1.tolist()), shock=fit.shock,
    )
