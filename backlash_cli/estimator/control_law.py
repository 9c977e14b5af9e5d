"""The law of the controller: fitted to window sums (settings, their scatter, the choice of the filter time), and what
output it makes where that was not recorded, or between records far apart.

The terms of the law (2) are -yf, the integral of (ysp - yf), ysp and -dyf/dt, behind the measurement filter (3). Each
window of the record has an offset of its own, so only products of what moves inside a window are summed; a fit then
costs a few numbers a window."""

from dataclasses import field
from functools import cached_property
from typing import Self

import numpy as np

from ..half_periods import DoubleLag, double_lag
from ..record import BoolArray, FloatArray, Frozen, IntArray, LoopSettings, Record

OWN, PROPORTIONAL, INTEGRAL, SETPOINT, DERIVATIVE = range(5)  # places in the sums; the output itself comes first
GROUPS = 20  # at most so many leave-one-out groups of windows for the scatter
ILL_CONDITIONED = 1e9  # ratio of the largest to the smallest eigenvalue from which the terms cannot be told apart
TURNS = 4  # of reweighting
FEWEST_WINDOWS = 6  # of which some may lose their weight
ROUNDING = 1e-6  # of residuals: smaller differences are none
RARE = 0.25  # of Ti from one record of OP to the next, on average; held in between it comes late from there on
LED, FEWEST_RECORDS = 0.3, 5  # of what OP changes from record to record the law may miss so much; told by so many


class LawForm(Frozen):
    """What a fit assumes: its terms; rows per window; rows left out after a gap, in which the filter settles (about
    5 Tf); shift [rows] by which the output answers late; phase, the share of the newest error that the integral has not
    yet taken in (0 for a controller that runs at the logged rate, 1/2 for one much faster)."""

    terms: tuple[int, ...]
    window: int
    settle: int
    shift: int = 0
    phase: float = 0.0


class LawFit(Frozen):
    """One fit of u = K(-yf - Td dyf/dt + b ysp) + K/Ti integral(ysp - yf), with one offset per window.

    values: (terms,) coefficients of `form.terms`. residuals: (windows,) sum of squares left in each window.
    unexplained: share of the output's variance that is left. filter_time: Tf [s]. weights: (windows,) of the fit;
    sums: (windows, 5, 5) sums of products it rests on, see `window_sums`."""

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
        gram, right = rest[:, pick[:, None], pick], rest[:, pick, OWN]
        scale = np.sqrt(np.maximum(np.einsum("gii->gi", gram), 1e-300))
        gram = gram / (scale[:, :, None] * scale[:, None, :]) + 1e-12 * np.eye(len(pick))
        return np.asarray(np.linalg.solve(gram, (right / scale)[..., None])[..., 0] / scale)

    @cached_property
    def one_frequency(self) -> float:
        """Share of the derivative that other terms explain; near 1 for one sine: filter and I part look alike."""
        terms, total = self.form.terms, np.tensordot(self.weights, self.sums, 1)
        own, with_others = total[DERIVATIVE, DERIVATIVE], total[DERIVATIVE, terms]
        if own <= 0 or DERIVATIVE in terms:
            return 0.0
        return float(with_others @ np.linalg.solve(total[np.ix_(terms, terms)], with_others) / own)

    @property
    def gain(self) -> float:
        return float(self.values[0])

    @property
    def reset_time(self) -> float:
        """Ti [s]; infinite where gain and reset have different signs."""
        return self.gain / float(self.values[1]) if self.gain * self.values[1] > 0 else np.inf

    def better_than(self, other: Self) -> float:
        """How many standard errors this fit's residuals lie below the other's, in logarithms, window by window."""
        by = np.log(other.residuals / self.residuals)
        mean, error = by.mean(), by.std() / max(len(by) - 1, 1) ** 0.5
        if abs(mean) < ROUNDING:  # forms that differ in phase only may explain exactly the same
            return 0.0
        return float(mean / error) if error > 0.0 else np.inf * float(mean)


class LawRows(Frozen):
    """Setpoint, measurement and output (3, rows) on a grid of `interval` seconds; a jump of `index` is a gap.

    known: sums of products made so far, for many fits rest on the same."""

    index: IntArray
    signals: FloatArray
    interval: float
    known: dict[tuple[float, ...], FloatArray] = field(default_factory=dict, repr=False, compare=False)


def window_sums(rows: LawRows, form: LawForm, filter_time: float) -> FloatArray:
    """Return the sums (windows, 5, 5) of products of output and terms, each less its mean over the window.

    filter_time: Tf [s] of the measurement filter (3). Windows never span a gap, the filter starts anew after one, and
    windows in which the output stood still are left out, as are those that are less than half full."""
    window, settle, h = form.window, form.settle, rows.interval
    setpoint, measured, output = rows.signals
    firsts = np.flatnonzero(np.diff(rows.index, prepend=rows.index[0] - 2) != 1)
    lengths = np.diff(firsts, append=len(rows.index))
    if form.shift:
        since = np.arange(len(rows.index)) - np.repeat(firsts, lengths)
        late = np.arange(len(rows.index)) - np.where(since >= form.shift, form.shift, 0)
        setpoint, measured = setpoint[late], measured[late]
    long = 2 * (lengths - settle) >= window
    decay = np.exp(-h / filter_time) if filter_time > 0.0 else 0.0
    twice = DoubleLag(np.array([(1.0 - decay) ** 2, 0.0, 0.0]), np.array([1.0, -2.0 * decay, decay**2]))
    smooth, _ = twice.run(measured, twice.settled(measured[0]), firsts[1:])
    error, slope = setpoint - smooth, np.diff(smooth, prepend=0.0) / h
    slope[firsts] = 0.0
    terms = np.column_stack([output, -smooth, h * (np.cumsum(error) - form.phase * error), setpoint, -slope])

    windows = -(-(lengths[long] - settle) // window)  # of each stretch, the last one partly filled
    starts = np.repeat(firsts[long] + settle - window * (np.cumsum(windows) - windows), windows)
    starts += window * np.arange(len(starts))
    counts = np.minimum(np.repeat((firsts + lengths)[long], windows) - starts, window)
    starts, counts = starts[2 * counts >= window], counts[2 * counts >= window]
    places = starts[:, None] + np.where(np.arange(window) < counts[:, None], np.arange(window), 0)
    x = terms.take(places, axis=0)
    x -= x[:, :1]  # what stands still is nothing, to the last digit, and so is what lies beyond a window
    total = np.ones(window) @ x
    sums = x.transpose(0, 2, 1) @ x - total[:, :, None] * total[:, None, :] / counts[:, None, None]
    return np.asarray(sums[sums[:, OWN, OWN] > 0])


def fit_law(rows: LawRows, form: LawForm, filter_time: float = 0.0) -> LawFit | None:
    """Fit the control law by least squares; None where the data do not determine it. A window in which something else
    moved the output leaves much more than the others and loses its weight (Cauchy weights)."""
    of = (filter_time, form.shift, form.phase, form.window, form.settle)
    if of not in rows.known:
        rows.known[of] = window_sums(rows, form, filter_time)
    sums = rows.known[of]
    if not len(sums):
        return None
    pick = np.array(form.terms)
    own, right, gram = sums[:, OWN, OWN], sums[:, pick, OWN], sums[:, pick[:, None], pick]
    scale = np.sqrt(np.maximum(np.diag(gram.sum(0)), 1e-300))
    right, gram = right / scale, gram / np.outer(scale, scale)
    if not np.linalg.cond(gram.sum(0)) <= ILL_CONDITIONED:
        return None
    weights = np.ones(len(sums))
    for _ in range(TURNS):
        values = np.linalg.solve(np.tensordot(weights, gram, 1), weights @ right)
        left = np.maximum(own - 2.0 * right @ values + (gram @ values) @ values, 1e-12 * own)
        if len(sums) < FEWEST_WINDOWS:
            break
        weights = 2.0 / (1.0 + left / np.median(left))
    return LawFit(form, values / scale, left, float(weights @ left / (weights @ own)), filter_time, weights, sums)


def search_filter(rows: LawRows, form: LawForm, longest: float, rounds: int = 0) -> list[LawFit]:
    """Fits, best first, without filter and with times of a grid up to `longest` [s], `rounds` times refined."""
    shortest, step = 0.25 * rows.interval, 4.0
    fits: list[LawFit] = []
    count = int(np.log(max(longest / shortest, 1.0)) / np.log(step)) + 1
    times = [0.0, *(shortest * step ** np.arange(count)).tolist()]
    for _ in range(rounds + 1):
        fits += [fit for t in times if (fit := fit_law(rows, form, t)) is not None]
        fits.sort(key=lambda fit: fit.unexplained)
        step **= 0.5
        times = [fits[0].filter_time / step, fits[0].filter_time * step] if fits and fits[0].filter_time else []
    return fits


def output_made(record: Record, settings: LoopSettings) -> tuple[FloatArray | None, str]:
    """Return OP (samples,) as the controller made it, None where it is not to be had, and whence it comes.

    recorded: as it stands there. completed: from record to record on the course of the law, what that misses spread
    evenly, where a historian kept few values and the law, with the weight of the setpoint that fits best, leads from
    one to the next. rebuilt: none was recorded. Without K and Ti there is only what was recorded."""
    output, known = record.output, record.usable & np.isfinite(record.measurement) & np.isfinite(record.setpoint)
    if not (settings.K and settings.Ti):
        return output, "recorded"
    if output is None:
        return rebuilt_output(record, settings, known), "rebuilt"
    at = np.flatnonzero(known & np.isfinite(output))
    own = at[np.diff(output[at], prepend=np.nan) != 0.0]
    if FEWEST_RECORDS <= len(own) <= len(at) / max(RARE * settings.Ti / record.interval, 2.0):
        law = rebuilt_output(record, settings, known)
        missed, moves = output[own] - law[own], np.diff(record.setpoint[own])
        weight = np.diff(missed) @ moves / max(moves @ moves, 1e-300)  # of the setpoint in the proportional part
        law, missed = law + weight * record.setpoint, missed - weight * record.setpoint[own]
        if np.std(np.diff(missed)) <= LED * np.std(np.diff(output[own])):
            return np.where(known, law + np.interp(np.arange(len(law)), own, missed), output), "completed"
    return output, "recorded"


def rebuilt_output(record: Record, settings: LoopSettings, usable: BoolArray) -> FloatArray:
    """Return u = K (-yf + 1/Ti integral(ysp - yf) - Td dyf/dt), but for a constant, (samples,); nan where not usable.

    A digital controller acts at once on the PV that it reads, and the two are recorded together. The constant is
    unknown and does not matter to a dead band. After a hole in the record the integral goes on from where it was.
    Source: Haegglund (2007), eqs 2 and 3. K and Ti must be known."""
    assert settings.K and settings.Ti
    out, at = np.full(len(record), np.nan), np.flatnonzero(usable)
    if len(at):
        y = record.measurement[at]
        lag = double_lag(settings.filter_time or 0.0, record.interval)
        # what it makes of each sample until the next one comes; a sample late, OP would be off by five times as much
        yf = lag.run(np.append(y, y[-1]), lag.settled(float(y[0])))[0][1 if settings.filter_time else 0 :][: len(y)]
        integral = np.cumsum(record.setpoint[at] - yf) * record.interval / settings.Ti
        out[at] = settings.K * (integral - yf - settings.Td * np.diff(yf, prepend=y[0]) / record.interval)
    return out
