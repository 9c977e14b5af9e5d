"""Controller settings read from the record itself: which K, Ti and Td make this output from these signals?

The ideal PID of the paper (2) is linear in K, K/Ti, K Td and the setpoint weight once the measurement filter (3)
is known. It is fitted in its level form, with one offset per window of about ten Ti, so that a recorder's rounding
is averaged out and slow changes from outside do not matter; the filter time is searched for. What the record cannot
settle (filter, scan rate of the controller) widens the intervals.

A record without setpoint: integral action holds the mean of PV at it. With that level in its place a PI or PID
controller of a loop whose setpoint never moved explains the recorded output almost to the last digit; where the
setpoint moved, it does not, and nothing is assumed."""

from dataclasses import replace
from math import isfinite

import numpy as np
import scipy

from ..record import FloatArray, Frozen, LoopSettings, Note, Record, SampleState
from ..words import noted
from .control_law import DERIVATIVE, INTEGRAL, PROPORTIONAL, SETPOINT, LawFit, LawForm, LawRows, fit_law, search_filter
from .survey import LEVELS, MOSTLY_OWN, ROWS, SLOWER, rows, with_all_signals

LEAST_ROWS = 60
WINDOW = 10.0  # Ti per window: long enough for K/Ti, short enough for drift that is not the controller's
FIRST_WINDOW, MIN_WINDOW = 200, 20  # rows: before Ti is known, and at least
LONGEST_FILTER = 0.3  # Tf / Ti: the tool's own default is 0.1, Td/5 is below
SLOWEST = 64.0  # rows per Ti above which the next slower picture serves as well
UNCLEAR_FILTER = 0.2  # Tf / Ti
LEAST_EXPLAINED = 0.5  # below, the output is not made by this control law
SURELY_EXPLAINED = 0.9  # below, a gain that may be zero is a fit by chance (two drifting signals)
ONE_FREQUENCY = 0.92  # single sines are above, 98 % of other simulated loops below 0.93
FILTER_SHARE = 0.1  # Tf / Ti assumed there: the tool's own default
EXACT = 1e-5  # share unexplained below which nothing is left to add
NEAR, NEARER = 2, 5  # rounds of the search for the filter time: to 40 % and to 4 %
CLEARLY = 4.0  # standard errors by which a richer form must be better
PLAUSIBLE = 2.0  # standard errors by which a fit may be worse than the best and still count
NOISE_UNSEEN = 0.125  # h / Ti above which the record misses what the controller saw between samples
WIDE = 2.0  # ratio of the ends of an interval that is worth a note
COARSEST = 1.0  # rows per Ti below which the P part is not seen any more
DIGITS = 6  # of identified settings
PROVEN = 0.98  # share of OP explained by a constant setpoint; with a moving one 0.975 at most in 23 loops
AT_ONE_FREQUENCY = noted("one_frequency")


class Identified(Frozen):
    """A value read from the data, with its 95 % interval."""

    value: float
    ci95: tuple[float, float]


class Identification(Frozen):
    """Settings read from the data: K [output span / measurement span of this record], Ti and Td [s], ratio K/Ti [1/s].

    b: weight of the setpoint in the P part, None when the setpoint stands still. Td is 0 unless the data show it.
    Tf: measurement filter [s] (3) that fits best. r2: share of the output's motion that is explained.
    interval: [s] of the rows used. form: "ideal PI" or "ideal PID". notes: what limits the result
    (gain_uncertain, sampling_too_coarse, interpolated, one_frequency)."""

    K: Identified
    Ti: Identified
    Td: Identified
    ratio: Identified
    b: Identified | None
    Tf: float
    r2: float
    interval: float
    form: str
    notes: tuple[Note, ...] = ()

    @property
    def separate(self) -> bool:
        """Whether K and Ti are each known to a factor of two or so, and not only their quotient."""
        return not self.notes or all(note.code == "one_frequency" for note in self.notes)

    def settings(self, base: LoopSettings) -> LoopSettings:
        """Return `base` with the values it lacks filled in from the data, rounded and named as identified."""
        missing = {n: getattr(self, n).value for n in ("K", "Ti") if getattr(base, n) is None}
        if missing and base.Td == 0.0 and self.Td.value > 0.0:
            missing["Td"] = self.Td.value
        return base.with_values("identified", **{n: float(f"{value:.{DIGITS}g}") for n, value in missing.items()})


def identify(record: Record) -> Identification | Note:
    """Read K, Ti, Td and setpoint weight of the controller from setpoint, measurement and output of one loop.

    A Note says why they cannot be read: no_output, output_constant, too_short, one_frequency, not_this_controller,
    proportional_part_unseen, integral_part_unseen."""
    if record.output is None or not np.isfinite(record.output).any():
        return noted("no_output:settings")
    use = with_all_signals(record)
    if use.any() and not np.ptp(record.output[use]):
        return noted("output_constant:settings")
    if (finest := law_rows(record, 0)) is None:
        return noted("too_short", rows=LEAST_ROWS)
    found = _found(record, finest)
    share = float(np.mean(record.state[use] == SampleState.FILLED))
    if isinstance(found, Note) or share <= MOSTLY_OWN:
        return found
    return replace(found, notes=(*found.notes, noted("interpolated:settings", {"share": share})))


def law_rows(record: Record, level: int) -> LawRows | None:
    """Return one picture of the record, None where it has too few rows, or there is none so slow."""
    if level >= LEVELS:
        return None
    index, values = rows(record, level)
    return LawRows(index, values, record.interval * SLOWER**level) if len(index) >= LEAST_ROWS else None


def _found(record: Record, finest: LawRows) -> Identification | Note:
    """Find K, Ti and Td from pictures of the record, of which this is the finest."""
    time_scale = _time_scale(record, finest)
    if isinstance(time_scale, Note):
        return time_scale
    rows, form, longest = time_scale
    averaged = rows is not finest
    ways = [form]
    if not averaged:  # which sample the integral has taken in, and whether the output is logged a sample late
        phases = (0.25, 0.0, 0.5) if form.phase else (0.0,)
        ways = [*(replace(form, phase=phase) for phase in phases), replace(form, phase=0.0, shift=1)]
    fits = [fit for way in ways for fit in search_filter(rows, way, longest, NEAR) if isfinite(fit.reset_time)]
    if not fits:
        return _refused(0.0)
    # that of the first way in the list, unless another is better beyond chance
    lead = min(fits, key=lambda fit: fit.unexplained)
    best = next(fit for fit in fits if lead.better_than(fit) <= PLAUSIBLE)
    if (averaged or rows.interval < NOISE_UNSEEN * best.reset_time) and best.unexplained > EXACT:
        pid = search_filter(rows, replace(best.form, terms=(*form.terms, DERIVATIVE)), longest, NEAR)
        # a first-order filter looks like a D part with Td = Tf; a real one is longer, and clearly better
        Td = pid[0].values[pid[0].form.terms.index(DERIVATIVE)] / pid[0].gain if pid else 0.0
        if pid and Td > max(2.0 * pid[0].filter_time, 0.02 * pid[0].reset_time) and pid[0].better_than(best) > CLEARLY:
            fits, best = pid, pid[0]
    alike = best.one_frequency > ONE_FREQUENCY
    if alike:  # with the filter that the tool assumes; with none, and one twice as slow, for the intervals
        way, Tf = replace(form, shift=0), 0.0
        for _ in range(8):
            fit = fit_law(rows, way, Tf)
            if fit is None or not isfinite(fit.reset_time):
                return AT_ONE_FREQUENCY
            Tf = FILTER_SHARE * fit.reset_time
        fits = [f for f in (fit, fit_law(rows, way), fit_law(rows, way, 2.0 * Tf)) if f and isfinite(f.reset_time)]
    else:
        fits = [*search_filter(rows, best.form, longest, NEARER), *fits]
    best = fits[0]
    if not isfinite(best.reset_time) or best.unexplained > 1.0 - LEAST_EXPLAINED:
        return _refused(1.0 - best.unexplained)
    # A filter as slow as the controller itself cannot be told from integral action: no fit is excluded then.
    unclear = alike or best.filter_time > UNCLEAR_FILTER * best.reset_time
    fits = [fit for fit in fits if unclear or best.better_than(fit) <= PLAUSIBLE]
    result = summarise(rows, fits, averaged, (AT_ONE_FREQUENCY,) if alike else ())
    by_chance = result.K.ci95[0] < 0.0 < result.K.ci95[1] and result.r2 < SURELY_EXPLAINED
    return _refused(result.r2, by_chance=True) if by_chance else result


def _time_scale(record: Record, rows: LawRows) -> tuple[LawRows, LawForm, float] | Note:
    """Find the picture of the record in which Ti is SLOWEST rows at most, the form of the fit, and the longest Tf."""
    level, Ti, explained = 0, FIRST_WINDOW / WINDOW * rows.interval, 0.0
    for _ in range(8):
        h = rows.interval
        window = window_of(WINDOW * Ti / h, len(rows.index))
        longest = min(LONGEST_FILTER * Ti, 0.1 * window * h)
        settle, phase = min(int(np.ceil(5.0 * longest / h)) + 1, window), 0.5 if level else 0.25 * (Ti < 10.0 * h)
        # without a setpoint that moves inside a window its weight cannot be told
        forms = [LawForm(terms, window, settle, 0, phase)
                 for terms in ((PROPORTIONAL, INTEGRAL, SETPOINT), (PROPORTIONAL, INTEGRAL))]
        fits = search_filter(rows, forms[0], longest) or search_filter(rows, forms[1], longest)
        if not fits:
            return _refused(0.0)
        before, explained = Ti, 1.0 - fits[0].unexplained
        Ti = fits[0].reset_time
        slower = None if Ti <= SLOWEST * h else law_rows(record, level + 1)
        if slower is not None:
            rows, level = slower, level + 1
            Ti = Ti if isfinite(Ti) else FIRST_WINDOW / WINDOW * rows.interval
        elif Ti > len(rows.index) * h:
            return _refused(explained, unseen="integral_part_unseen", interval=record.interval)
        elif 0.8 < Ti / before < 1.25:
            break
    return rows, fits[0].form, longest


def window_of(wanted: float, rows: int) -> int:
    """Return the rows of a window, `wanted` where a record of so many rows holds six of them."""
    return int(np.clip(wanted, MIN_WINDOW, max(min(ROWS, rows // 6), MIN_WINDOW)))


def _refused(share: float, by_chance: bool = False, unseen: str = "proportional_part_unseen", **more: float) -> Note:
    code = unseen if share > LEAST_EXPLAINED and not by_chance else "not_this_controller"
    return noted(code, {"r2": share, **more}, explained=max(share, 0.0))


def summarise(rows: LawRows, fits: list[LawFit], averaged: bool, notes: tuple[Note, ...]) -> Identification:
    """Values of the first fit; intervals from its scatter, from the other fits, and from what sampling hides."""
    best, terms = fits[0], fits[0].form.terms
    # not in the scatter: which part of the newest error the output already contains, and noise between the samples
    coarse = 0.0 if averaged else rows.interval / best.reset_time
    blur = 0.01 + 0.1 * coarse + 0.5 * coarse * np.array([1.0, 1.0, 0.0, 0.0, 0.0])

    def quantities(v: FloatArray) -> FloatArray:
        """K, Ti, K/Ti, Td and b of coefficients (..., terms)."""
        others = [v[..., terms.index(term)] / v[..., 0] if term in terms else 0.0 * v[..., 0]
                  for term in (DERIVATIVE, SETPOINT)]
        return np.stack([v[..., 0], v[..., 0] / v[..., 1], v[..., 1], *others], axis=-1)

    ends = []
    with np.errstate(divide="ignore", invalid="ignore"):
        for fit in fits:
            value, scatter = quantities(fit.values), quantities(fit.scatter)
            groups = len(scatter)
            error = np.sqrt((groups - 1) / groups * np.sum((scatter - scatter.mean(0)) ** 2, axis=0))
            reach = scipy.special.stdtrit(groups - 1, 0.975) * error + blur * np.abs(value)
            # a part of the record without any integral action: nothing is known
            reach = np.where(np.isfinite(reach), reach, np.inf)
            ends += [value - reach, value + reach]
    K, Ti, ratio, Td, b = (Identified(value, (low, high)) for value, low, high in zip(
        quantities(best.values).tolist(), np.min(ends, axis=0).tolist(), np.max(ends, axis=0).tolist(), strict=True))
    low, high = sorted(abs(x) for x in K.ci95)
    if K.ci95[0] * K.ci95[1] <= 0 or high > WIDE * low:
        notes = (*notes, noted("gain_uncertain", {"low": K.ci95[0], "high": K.ci95[1]}))
    if coarse > 1.0 / COARSEST:
        values = {"interval": rows.interval, "Ti": best.reset_time}
        notes = (*notes, noted("sampling_too_coarse:settings", values))
    return Identification(K, Ti, Td, ratio, b if SETPOINT in terms and coarse < NOISE_UNSEEN else None,
                          best.filter_time, 1.0 - best.unexplained, rows.interval,
                          "ideal PID" if DERIVATIVE in terms else "ideal PI", notes)


def with_constant_setpoint(record: Record) -> Record:
    """Return the record with a constant setpoint where none was recorded and the output shows that it stood still."""
    held = None if np.isfinite(record.setpoint).any() else at_mean(record)
    found = None if held is None else identify(held)
    if held is None or not isinstance(found, Identification) or found.r2 < PROVEN:
        return record
    level, (low, high) = float(held.setpoint[0]), record.settings.pv_range
    note = noted("assumed_setpoint", {"setpoint": level, "r2": found.r2}, level=low + level * (high - low),
                 K=found.K.value, Ti=found.Ti.value)
    return replace(held, notes=(*(n for n in record.notes if n.code != "no_setpoint"), note))


def at_mean(record: Record) -> Record | None:
    """Return the record with the mean of PV as its setpoint, None with too few usable samples."""
    use = record.usable & np.isfinite(record.measurement)
    use &= record.output is None or np.isfinite(record.output)
    if np.count_nonzero(use) < LEAST_ROWS:
        return None
    return replace(record, setpoint=np.full(len(record), float(record.measurement[use].mean())))
