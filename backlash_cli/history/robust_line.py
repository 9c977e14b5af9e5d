"""A straight line through nights that outliers cannot bend: Theil-Sen, with weights and nights that give only a bound.

P. K. Sen, Estimates of the regression coefficient based on Kendall's tau, JASA 63 (1968) 1379-1389 (slope and its
distribution-free interval); M. G. Akritas, S. A. Murphy, M. P. LaValley, JASA 90 (1995) 170-177 (bounds).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..record import FloatArray

Z95 = 1.959963984540054
ENOUGH = 5  # fewer points have no 95 % interval: with four, all in order has probability 2/24


@dataclass(frozen=True)
class Line:
    """value(t) = level + slope (t - centre), with 95 % intervals; `slope_ci` is None with fewer than five points."""

    centre: float
    level: float
    level_ci: tuple[float, float]
    slope: float
    slope_ci: tuple[float, float] | None

    def at(self, t: float) -> float:
        return self.level + self.slope * (t - self.centre)

    def interval_at(self, t: float) -> tuple[float, float]:
        """Interval of the line's value at t: level and slope are nearly independent about the centre."""
        below, above = (self.level - self.level_ci[0]), (self.level_ci[1] - self.level)
        if self.slope_ci is None or t == self.centre:
            return self.at(t) - below, self.at(t) + above
        low, high = sorted(abs(t - self.centre) * abs(edge - self.slope) for edge in self.slope_ci)
        reach = high if low != high else low
        return self.at(t) - float(np.hypot(below, reach)), self.at(t) + float(np.hypot(above, reach))

    def reaches(self, limit: float) -> tuple[float, float, float] | None:
        """Return when the line reaches `limit`, with the interval (Fieller's), None where it does not rise for sure."""
        if self.slope_ci is None or self.slope_ci[0] <= 0:
            return None
        far = limit - self.level
        spread = max(self.level - self.level_ci[0], self.level_ci[1] - self.level)
        ends: list[float] = []
        for edge in self.slope_ci:
            room = self.slope**2 - (self.slope - edge) ** 2
            if room <= 0:  # the slope may be more than doubled: the early end is where the steep edge meets the limit
                ends.append((far - np.sign(far) * spread) / edge)
                continue
            root = np.sqrt(max((self.slope * far) ** 2 - room * (far**2 - spread**2), 0.0))
            ends += [(self.slope * far - root) / room, (self.slope * far + root) / room]
        value = far / self.slope
        return self.centre + value, self.centre + float(min(*ends, value)), self.centre + float(max(*ends, value))


def robust_line(t: FloatArray, low: FloatArray, high: FloatArray, weight: FloatArray) -> Line:
    """Return the line through points at times t (points,) whose values lie in [low, high], with weights.

    A measured point has low = high. The slope is the weighted median of the slopes between all pairs; a pair with a
    bound has a range of slopes and counts half at either end, so that it pulls only where the order is certain.
    Raises ValueError for no points.
    """
    if not len(t):
        raise ValueError("a line needs at least one point")
    i, j = np.triu_indices(len(t), 1)
    dt = t[j] - t[i]
    i, j, dt = i[dt != 0], j[dt != 0], dt[dt != 0]
    centre = float(np.average(t, weights=weight))
    slope, slope_ci = 0.0, None
    if len(i):
        edges = np.concatenate([(low[j] - high[i]) / dt, (high[j] - low[i]) / dt])
        pair = np.tile(0.5 * weight[i] * weight[j], 2)
        deviation = np.sqrt(kendall_variance(t, weight))
        reach = Z95 * deviation if len(t) >= ENOUGH else np.inf
        slope, first, last = weighted_quantiles(edges, pair, reach)
        if np.isfinite(first) and np.isfinite(last):
            slope_ci = (first, last)
    rest = slope * (t - centre)
    values = np.concatenate([low - rest, high - rest])
    level, first, last = weighted_quantiles(values, 0.5 * np.tile(weight, 2), Z95 * np.sqrt((weight**2).sum()))
    if not np.isfinite(first):
        first, last = float(values.min()), float(values.max())
    return Line(centre, level, (first, last), slope, slope_ci)


def kendall_variance(t: FloatArray, weight: FloatArray) -> float:
    """Return the variance of sum over pairs of w_i w_j sign(y_j - y_i) sign(t_j - t_i) when y knows nothing of t.

    Hajek's projection: (sum_k c_k^2 + sum over pairs a_ij^2) / 3, a_ij = w_i w_j sign(t_j - t_i), c_k the sum of row
    k of a. With equal weights it is n (n - 1) (2 n + 5) / 18.
    """
    a = np.sign(t[:, None] - t[None, :]) * np.outer(weight, weight)
    return float(((a.sum(axis=1) ** 2).sum() + (np.triu(a) ** 2).sum()) / 3.0)


def weighted_quantiles(values: FloatArray, weight: FloatArray, reach: float) -> tuple[float, float, float]:
    """Return the weighted median and the values where the weights on both sides differ by `reach`, else +-inf."""
    order = np.argsort(values, kind="stable")
    v, total = values[order], weight[order].cumsum()
    whole = float(total[-1])
    k = int(np.searchsorted(total, 0.5 * whole * (1 - 1e-12)))
    middle = v[k]
    if abs(total[k] - 0.5 * whole) <= 1e-9 * whole and k + 1 < len(v):
        middle = 0.5 * (v[k] + v[k + 1])
    low = high = np.inf
    if reach < whole:
        low = v[int(np.searchsorted(total, 0.5 * (whole - reach) * (1 - 1e-12)))]
        high = v[min(int(np.searchsorted(total, 0.5 * (whole + reach) * (1 - 1e-12))), len(v) - 1)]
        return float(middle), float(low), float(high)
    return float(middle), -np.inf, np.inf
