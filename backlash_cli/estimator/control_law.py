"""Regression of the control law on window sums: settings, their scatter, and the choice of the filter time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..record import FloatArray, IntArray

PROPORTIONAL, INTEGRAL, SETPOINT, DERIVATIVE = 1, 2, 3, 4
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
        difference = np.log(other.residuals / self.residuals)
        error = float(np.std(difference)) / np.sqrt(max(len(difference) - 1, 1))
        mean = float(difference.mean())
        return mean / error if error > 0 else float(np.inf * mean) if mean else 0.0


@dataclass(frozen=True)
class LawRows:
    """Rows of (setpoint, measurement, output) on a grid of `interval` seconds; a jump of `index` is a gap."""

    index: IntArray
    signals: FloatArray
    interval: float


def fit_law(rows: LawRows, form: LawForm, filter_time: float = 0.0) -> LawFit | None:
    """Fit the control law by least squares with robust window weights; None where the data do not determine it."""
    return fit_sums(law_sums(rows, form, filter_time), form, filter_time)


def law_sums(rows: LawRows, form: LawForm, filter_time: float) -> FloatArray:
    """Return (windows, 5, 5) sums of products of all terms, of the windows in which the output moved."""
    from .law_sums import window_sums

    sums = window_sums(
        rows.signals, rows.index, rows.interval, float(filter_time), form.shift, form.phase, form.window, form.settle
    )[0]
    return np.asarray(sums[sums[:, 0, 0] > 0])


def fit_sums(sums: FloatArray, form: LawForm, filter_time: float) -> LawFit | None:
    """Fit the terms of `form` to window sums.

    A window in which something else moved the output (a limit, feedforward, an operator) leaves much more than
    the others and loses its weight (Cauchy weights on the window residuals).
    """
    if len(sums) == 0:
        return None
    output = sums[:, 0, 0]
    pick = np.array(form.terms)
    gram, right = sums[:, pick[:, None], pick], sums[:, pick, 0]
    scale = np.sqrt(np.maximum(np.einsum("wii->i", gram), 1e-300))
    gram, right = gram / np.outer(scale, scale), right / scale
    flat = gram.reshape(len(gram), -1)
    weights = np.ones(len(sums))
    if np.linalg.cond(gram.sum(0)) > 1e9:
        return None
    for _ in range(4):
        normal = (weights @ flat).reshape(gram.shape[1:])
        values = np.linalg.solve(normal, weights @ right)
        left = output - 2.0 * right @ values + (gram @ values) @ values
        left = np.maximum(left, 1e-12 * output)
        if len(sums) < 6:
            break
        ordered = np.sort(left)
        middle = 0.5 * (ordered[(len(left) - 1) // 2] + ordered[len(left) // 2])
        weights = 2.0 / (1.0 + left / middle)
    unexplained = float((weights @ left) / (weights @ output))
    return LawFit(form, values / scale, left, unexplained, filter_time, weights, sums)


def search_filter(
    rows: LawRows, form: LawForm, longest: float, *, step: float = 2.0, near: float | None = None
) -> list[LawFit]:
    """Fits over a geometric grid of filter times 0 .. `longest` [s], or golden sections around `near`; best first."""
    shortest = 0.25 * rows.interval
    fits: dict[float, LawFit] = {}

    def left_over(filter_time: float) -> float:
        if filter_time not in fits:
            fit = fit_law(rows, form, filter_time)
            if fit is None:
                return float("inf")
            fits[filter_time] = fit
        return fits[filter_time].unexplained

    if near is None:
        steps = int(np.log(max(longest / shortest, 1.0)) / np.log(step))
        for filter_time in [0.0, *(shortest * step ** np.arange(steps + 1)).tolist()]:
            left_over(filter_time)
    elif near > 0.0:
        golden = (np.sqrt(5.0) - 1.0) / 2.0
        low, high = near / step, near * step
        a, b = high * (low / high) ** golden, low * (high / low) ** golden
        for _ in range(6):
            if left_over(a) < left_over(b):
                high, b = b, a
                a = high * (low / high) ** golden
            else:
                low, a = a, b
                b = low * (high / low) ** golden
    return sorted(fits.values(), key=lambda fit: fit.unexplained)


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
