"""Regression of the control law on window sums: settings, their scatter, and the choice of the filter time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..record import FloatArray, IntArray

PROPORTIONAL, INTEGRAL, SETPOINT, DERIVATIVE = 1, 2, 3, 4
FINEST_STEP = 2.0  # from one filter time of the first search to the next
AROUND = 8  # filter times tried around the best, twice
GROUPS = 20  # at most so many leave-one-out groups of windows for the scatter


@dataclass(frozen=True)
class LawForm:
    """What a fit assumes: its terms, shift [rows] and phase (see law_sums), window and settling time [rows]."""

    terms: tuple[int, ...]
    window: int
    settle: int
    shift: int = 0
    phase: float = 0.0


@dataclass(frozen=True)
class LawFit:
    """One fit of u = K(-yf - Td dyf/dt + b ysp) + K/Ti integral(ysp - yf), with one offset per window.

    values: (terms,) coefficients of `form.terms`. residuals: (windows,) sum of squares left in each window.
    unexplained: share of the output's variance that is left. filter_time: Tf [s]. weights: (windows,) of the fit;
    sums: (windows, 5, 5) sums of products it rests on, see law_sums.
    """

    form: LawForm
    values: FloatArray
    residuals: FloatArray
    unexplained: float
    filter_time: float
    weights: FloatArray
    sums: FloatArray

    @cached_property
    def scatter(self) -> FloatArray:
        """(groups, terms) coefficients with one group of consecutive windows left out each time (jackknife)."""
        groups, pick = min(GROUPS, len(self.sums)), np.array(self.form.terms)
        weighted = self.weights[:, None, None] * self.sums
        by_group = np.add.reduceat(weighted, np.arange(groups) * len(weighted) // groups, axis=0)
        rest = by_group.sum(0) - by_group
        gram, right = rest[:, pick[:, None], pick], rest[:, pick, 0]
        scale = np.sqrt(np.maximum(np.einsum("gii->gi", gram), 1e-300))
        gram = gram / (scale[:, :, None] * scale[:, None, :]) + 1e-12 * np.eye(len(pick))
        return np.asarray(np.linalg.solve(gram, (right / scale)[..., None])[..., 0] / scale)

    @cached_property
    def attenuation(self) -> float:
        """Partial r2 of the P part: by so much noise in PV could have lowered K at most (direct over reverse fit)."""
        pick, total = np.array(self.form.terms), np.tensordot(self.weights, self.sums, 1)
        scale = np.sqrt(np.diag(total))[pick]
        inverse = np.linalg.inv(total[pick[:, None], pick] / np.outer(scale, scale))
        own = (self.values[0] * scale[0]) ** 2 / inverse[0, 0]
        return float(own / (own + self.weights @ self.residuals))

    @cached_property
    def one_frequency(self) -> float:
        """Share of the derivative that the other terms explain; near 1 for a single sine.

        A filter cannot be told from integral action there.
        """
        pick, total = np.array(self.form.terms), np.tensordot(self.weights, self.sums, 1)
        own = total[DERIVATIVE, DERIVATIVE]
        if own <= 0 or DERIVATIVE in pick:
            return 0.0
        with_others = total[DERIVATIVE, pick]
        return float(with_others @ np.linalg.solve(total[pick[:, None], pick], with_others) / own)

    @property
    def gain(self) -> float:
        return float(self.values[0])

    @property
    def ratio(self) -> float:
        """K / Ti [1/s]."""
        return float(self.values[1])

    @property
    def reset_time(self) -> float:
        """Ti [s]; nan where gain and reset have different signs."""
        return self.gain / self.ratio if self.gain * self.ratio > 0 else float("nan")

    def better_than(self, other: LawFit) -> float:
        """How many standard errors this fit's residuals lie below the other's, window by window (paired)."""
        from .law_solve import standard_errors

        return float(standard_errors(self.residuals, other.residuals))


@dataclass(frozen=True)
class LawRows:
    """Setpoint, measurement and output (3, rows) on a grid of `interval` seconds; a jump of `index` is a gap.

    known: sums of products made so far, for many fits rest on the same.
    """

    index: IntArray
    signals: FloatArray
    interval: float
    known: dict[tuple[float, ...], FloatArray] = field(default_factory=dict, repr=False, compare=False)


def fit_law(rows: LawRows, form: LawForm, filter_time: float = 0.0) -> LawFit | None:
    """Fit the control law by least squares with robust window weights; None where the data do not determine it."""
    return fit_sums(law_sums(rows, form, filter_time), form, filter_time)


def law_sums(rows: LawRows, form: LawForm, filter_time: float, more: Sequence[float] = ()) -> FloatArray:
    """Return (windows, 5, 5) sums of products of all terms, of the windows in which the output moved.

    more: filter times that will be asked for as well; several at once cost little more than one.
    """
    from .law_sums import LANES, window_sums

    of = (form.shift, form.phase, form.window, form.settle)
    if (filter_time, *of) not in rows.known:
        missing = [filter_time, *(t for t in more if t != filter_time and (t, *of) not in rows.known)][:LANES]
        found = window_sums(rows.signals, rows.index, rows.interval, np.array(missing, dtype=np.float64), *of)
        for t, sums in zip(missing, found[:, found[0, :, 0, 0] > 0], strict=True):
            rows.known[(t, *of)] = np.ascontiguousarray(sums)  # one order, so that the fit is compiled once
    return rows.known[(filter_time, *of)]


def fit_sums(sums: FloatArray, form: LawForm, filter_time: float) -> LawFit | None:
    """Fit the terms of `form` to window sums by least squares with robust window weights."""
    from .law_solve import weighted_fit

    if len(sums) == 0:
        return None
    apart, values, left, weights, unexplained = weighted_fit(sums, np.array(form.terms))
    return LawFit(form, values, left, unexplained, filter_time, weights, sums) if apart else None


def search_filter(
    rows: LawRows, form: LawForm, longest: float, *, step: float = 2.0, near: float | None = None
) -> list[LawFit]:
    """Fits over a geometric grid of filter times 0 .. `longest` [s], or a finer one around `near`; best first."""
    shortest = 0.25 * rows.interval
    fits: list[LawFit] = []
    if near is None:
        steps = np.arange(int(np.log(max(longest / shortest, 1.0)) / np.log(FINEST_STEP)) + 1)
        grid = [0.0, *(shortest * FINEST_STEP**steps).tolist()]
        every = round(np.log(step) / np.log(FINEST_STEP))
        fits = _fits(rows, form, [0.0, *grid[1::every]], grid)
    elif near > 0.0:
        apart = step ** (2.0 / (AROUND + 1))
        fits = _fits(rows, form, [near * apart ** (k - (AROUND - 1) / 2) for k in range(AROUND)])
        if fits:
            best = min(fits, key=lambda fit: fit.unexplained).filter_time
            closer = apart ** (2.0 / (AROUND + 1))
            fits += _fits(rows, form, [best * closer ** (k - (AROUND - 1) / 2) for k in range(AROUND)])
    return sorted(fits, key=lambda fit: fit.unexplained)


def _fits(rows: LawRows, form: LawForm, times: list[float], more: Sequence[float] = ()) -> list[LawFit]:
    fits = [fit_sums(law_sums(rows, form, t, more or times), form, t) for t in times]
    return [fit for fit in fits if fit is not None]


def settle_filter(rows: LawRows, form: LawForm, share: float) -> list[LawFit]:
    """The fit whose filter time is `share` of the Ti it gives (the smallest such), then neighbours for the interval."""
    filter_time = 0.0
    fits: list[LawFit | None] = []
    for _ in range(8):
        fits = [fit_law(rows, form, filter_time)]
        if fits[0] is None or not np.isfinite(fits[0].reset_time):
            return []
        filter_time = share * fits[0].reset_time
    fits += [fit_law(rows, form, t) for t in (0.0, 2.0 * filter_time)]
    return [fit for fit in fits if fit is not None and np.isfinite(fit.reset_time)]
