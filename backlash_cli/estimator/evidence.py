"""Does PV follow OP, or OP through a dead band of width d? The likelihood of both, scanned over d.

For every d the measured PV is explained by the valve position play(OP, d) through the same kind of process, with a
load that wanders and steps and with measurement noise (see `whitening`). Three numbers shape that model: the lag of
the process, how fast the load wanders against the noise, and how smoothly. They are fitted without a dead band and
again with one (see `best_models`), so that neither has the better noise model. Evidence is the difference of the
log-likelihoods [nats].
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..record import FloatArray
from .best_models import PER_STEP, Models, around, best_of_two, final_models
from .fitter import Fitter
from .profile import between, likelihood_interval, peak
from .rows import Rows

FINE = 3  # widths tried between the best and each of its neighbours
HALVES = (0, 1, 2, 3, 4, 6)  # half a dead band of so many widths more may look like the best: half of d to 1.7 d
MIRRORS = (0, 1)


@dataclass(frozen=True)
class Evidence:
    """Result: width `d` with `interval`, evidence `gain` [nats] and profile over the widths.

    half: best evidence for half a dead band (mean of OP and play): a true one beats it. mirror: best evidence for
    the opposite of a dead band (2 OP - play), a sham effect that only errors of the linear model can support.
    error_reduction: share of the variance of the one-step prediction that d removes. noise: deviation of the
    measurement noise per row. steps: load steps found. gain_to_pv: static gain of the fitted process. level:
    log-likelihood of the best model. half_period [rows]: of a load that switches to and fro; 0 for none. shape: the
    three numbers of the model with a dead band; shape_without: of the one without. shock (rows,): variances of the
    load steps.
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
    shape_without: tuple[float, ...] = ()
    shock: FloatArray = field(default_factory=lambda: np.empty(0), compare=False)

    @property
    def worth(self) -> float:
        """Log-likelihood of the best model less the price of its load steps [nats]."""
        return self.level - PER_STEP * self.steps


def weigh(rows: Rows) -> Evidence:
    """Return the evidence for a dead band in `rows` (at least two widths)."""
    fit = Fitter(rows)
    return weighed(fit, best_of_two(fit))


def weighed(fit: Fitter, m: Models) -> Evidence:
    """Return the evidence in the rows of `fit`, of which `m` are about the best models."""
    rows = fit.r
    m, some, level = final_models(fit, m)
    p0, p1, f0 = m.best[0, :3], m.best[1, :3], float(m.best[0, 3])
    grid = rows.widths[np.array(some) - 1]
    i = int(np.argmax(level))
    if not m.hopeless:
        grid, level = _refined(fit, p1, grid, level, i)
    d, top = peak(grid, level)
    half, mirror = _shams(fit, p0, p1, some[i])
    at = between(rows.x, rows.widths, d)
    k = fit.counted
    fit.pair(p0, rows.x[0])
    without = float(np.median(fit.R[0, k] ** 2 * fit.S[k]))
    ll, noise, b = fit.pair(p1, at, np.zeros_like(at))
    reduction = 1.0 - float(np.median(fit.R[0, k] ** 2 * fit.S[k])) / without
    return Evidence(
        d, likelihood_interval(grid, level, top), max(top, float(ll[0])) - f0, half - f0, mirror - f0, reduction,
        float(np.sqrt(noise[0])), int(np.count_nonzero(fit.shock)), int(k.sum()), float(ll[0] - ll[1]),
        float(b[0].sum()), tuple((float(w), float(v - f0)) for w, v in zip(grid, level, strict=True)), max(top, f0),
        shape=tuple(p1.tolist()), shape_without=tuple(p0.tolist()), shock=fit.shock,
    )


def _refined(fit: Fitter, p: FloatArray, grid: FloatArray, level: FloatArray, i: int) -> tuple[FloatArray, FloatArray]:
    """Widths and their log-likelihood with some more of them beside number i."""
    sides = [np.linspace(grid[i], grid[k], FINE + 2)[1:-1] for k in (i - 1, i + 1) if 0 <= k < len(grid)]
    fine = np.concatenate(sides)
    x = fit.r.x
    grid = np.concatenate([grid, fine])
    level = np.concatenate([level, fit.ll(p, np.array([between(x, fit.r.widths, w) for w in fine]))])
    order = np.argsort(grid)
    return grid[order], level[order]


def _shams(fit: Fitter, p0: FloatArray, p1: FloatArray, j: int) -> tuple[float, float]:
    """Best log-likelihood of half a dead band and of the opposite of one, about as wide as width j."""
    x = fit.r.x
    halves, mirrors = around(fit.r, j, HALVES), around(fit.r, j, MIRRORS)
    half = fit.ll(p1, 0.5 * (x[0] + x[halves]))
    mirror = fit.ll(p0, 2.0 * x[0] - x[mirrors])
    return float(half.max()), float(mirror.max())
