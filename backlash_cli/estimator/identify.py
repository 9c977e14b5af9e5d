"""Controller settings read from the record itself: which K, Ti and Td make this output from these signals?

The ideal PID of the paper (2) is linear in K, K/Ti, K Td and the setpoint weight once the measurement filter (3)
is known. It is fitted in its level form, with one offset per window of about ten Ti, so that a recorder's rounding
is averaged out and slow changes from outside do not matter; the filter time is searched for. What the record cannot
settle (filter, scan rate of the controller) widens the intervals.

    identify(record) -> Identification | Note         with_constant_setpoint(record) -> the record, where SP stood still

A Note says why the settings cannot be read: no_output, output_constant, too_short, not_this_controller,
proportional_part_unseen.
An Identification may carry notes: gain_uncertain, sampling_too_coarse, interpolated, one_frequency; `separate` is
False where only K/Ti is to be relied on.

A record without setpoint: integral action holds the mean of PV at it. With that level in its place a PI or PID
controller of a loop whose setpoint never moved explains the recorded output almost to the last digit; where the
setpoint moved, it does not, and nothing is assumed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from ..record import FloatArray, LoopSettings, Note, Record, SampleState
from .control_law import (
    DERIVATIVE,
    INTEGRAL,
    PROPORTIONAL,
    SETPOINT,
    LawFit,
    LawForm,
    LawRows,
    search_filter,
    settle_filter,
)
from .survey import LEVELS, ROWS, SLOWER, rows, with_all_signals

LEAST_ROWS = 60
MOSTLY_OWN = 0.2  # share of interpolated samples that leaves the P part visible
WINDOW = 10.0  # Ti per window: long enough for K/Ti, short enough for drift that is not the controller's
FIRST_WINDOW = 200  # rows, before Ti is known
MIN_WINDOW = 20  # rows
LONGEST_FILTER = 0.3  # Tf / Ti: the tool's own default is 0.1, Td/5 is below
UNSETTLED = 3.0  # longest Tf, in samples, below which the newest sample matters
SLOWEST = 64.0  # rows per Ti above which the next slower picture serves as well
UNCLEAR_FILTER = 0.2  # Tf / Ti
LEAST_EXPLAINED = 0.5  # below, the output is not made by this control law
SURELY_EXPLAINED = 0.9  # below, a gain that may be zero is a fit by chance (two drifting signals)
ONE_FREQUENCY = 0.92  # single sines are above, 98 % of other simulated loops below 0.93
FILTER_SHARE = 0.1  # Tf / Ti assumed there: the tool's own default
EXACT = 1e-5  # share unexplained below which nothing is left to add
CLEARLY = 4.0  # standard errors by which a richer form must be better
PLAUSIBLE = 2.0  # standard errors by which a fit may be worse than the best and still count
NOISE_UNSEEN = 0.125  # h / Ti above which the record misses what the controller saw between samples
WIDE = 2.0  # ratio of the ends of an interval that is worth a note
COARSEST = 1.0  # rows per Ti below which the P part is not seen any more
T95 = (np.inf, np.inf, 12.71, 4.30, 3.18, 2.78, 2.57, 2.45, 2.36, 2.31, 2.26, 2.23, 2.2, 2.18, 2.16, 2.14, 2.13, 2.12)
DIGITS = 6  # of identified settings
PROVEN = 0.98  # share of OP explained by a constant setpoint; with a moving one 0.975 at most in 23 loops
AT_ONE_FREQUENCY = Note("one_frequency", "the loop moves at one frequency only: K and Ti can only be told apart by "
                        "assuming the measurement filter (Ti/10)")


@dataclass(frozen=True)
class Identified:
    """A value read from the data, with its 95 % interval."""

    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Identification:
    """Settings read from the data: K [output span / measurement span of this record], Ti and Td [s], ratio K/Ti [1/s].

    b: weight of the setpoint in the P part, None when the setpoint stands still. Td is 0 unless the data show it.
    Tf: measurement filter [s] (3) that fits best. r2: share of the output's motion that is explained.
    n: rows of data used, `interval` seconds apart. form: "ideal PI" or "ideal PID". notes: what limits the result.
    """

    K: Identified
    Ti: Identified
    Td: Identified
    ratio: Identified
    b: Identified | None
    Tf: float
    r2: float
    n: int
    interval: float
    form: str
    notes: tuple[Note, ...] = ()

    @property
    def separate(self) -> bool:
        """Whether K and Ti are each known to a factor of two or so, and not only their quotient."""
        return not self.notes or all(note.code == "one_frequency" for note in self.notes)

    def settings(self, base: LoopSettings) -> LoopSettings:
        """Return `base` with the values it lacks filled in from the data and named as identified.

        Rounded to what can be known, so that the last digits of a sum do not go into everything that follows.
        """
        missing = {n: getattr(self, n).value for n in ("K", "Ti") if getattr(base, n) is None}
        if missing and base.Td == 0.0 and self.Td.value > 0.0:
            missing["Td"] = self.Td.value
        return base.with_values("identified", **{n: float(f"{value:.{DIGITS}g}") for n, value in missing.items()})


def identify(record: Record) -> Identification | Note:
    """Read K, Ti, Td and setpoint weight of the controller from setpoint, measurement and output of one loop.

    A Note says why they cannot be read.
    """
    if record.output is None or not np.isfinite(record.output).any():
        return Note("no_output", "the record has no controller output, so K and Ti cannot be read from it")
    use = with_all_signals(record)
    if use.any() and not np.ptp(record.output[use]):
        return Note("output_constant", "the controller output never moves, so K and Ti cannot be read from it")
    finest = law_rows(record, 0)
    if finest is None:
        return Note("too_short", f"fewer than {LEAST_ROWS} usable samples with setpoint, PV and output: K and Ti "
                    "cannot be read from them")
    found = _found(record, finest)
    share = float(np.mean(record.state[use] == SampleState.FILLED))
    if isinstance(found, Note) or share <= MOSTLY_OWN:
        return found
    message = f"{100 * share:.0f} % of the samples are interpolated: only K/Ti is known"
    return replace(found, notes=(*found.notes, Note("interpolated", message, {"share": share})))


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
    if not averaged:
        phases = (0.25, 0.0, 0.5) if longest < UNSETTLED * record.interval else (0.0,)
        ways = [*(replace(form, phase=phase) for phase in phases), replace(form, phase=0.0, shift=1)]
    fits = _most_plausible([search_filter(rows, way, longest) for way in ways])
    if not fits:
        return _refused(0.0)
    resolved = averaged or rows.interval < NOISE_UNSEEN * fits[0].reset_time
    if resolved and fits[0].unexplained > EXACT:
        pid = search_filter(rows, replace(fits[0].form, terms=(*form.terms, DERIVATIVE)), longest)
        if pid and derivative_is_real(pid[0], fits[0]):
            fits = pid
    if fits[0].one_frequency > ONE_FREQUENCY:
        fits = settle_filter(rows, replace(form, shift=0), FILTER_SHARE)
        return summarise(rows, fits, averaged, (AT_ONE_FREQUENCY,)) if fits else AT_ONE_FREQUENCY
    refined = search_filter(rows, fits[0].form, longest, near=fits[0].filter_time)
    fits = [*refined, *fits]
    best = fits[0]
    if not isfinite(best.reset_time) or best.unexplained > 1.0 - LEAST_EXPLAINED:
        return _refused(1.0 - best.unexplained)
    # A filter as slow as the controller itself cannot be told from integral action: no fit is excluded then.
    unclear = best.filter_time > UNCLEAR_FILTER * best.reset_time
    result = summarise(rows, [fit for fit in fits if unclear or best.better_than(fit) <= PLAUSIBLE], averaged)
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
        fits: list[LawFit] = []
        for terms in ((PROPORTIONAL, INTEGRAL, SETPOINT), (PROPORTIONAL, INTEGRAL)):
            # without a setpoint that moves inside a window its weight cannot be told
            if not fits and (SETPOINT not in terms or np.ptp(rows.signals[0]) > 0):
                form = LawForm(terms, window, settle, 0, phase)
                fits = search_filter(rows, form, longest, step=4.0)
        if not fits:
            return _refused(0.0)
        before, explained = Ti, 1.0 - fits[0].unexplained
        Ti = fits[0].reset_time
        slower = None if Ti <= SLOWEST * h else law_rows(record, level + 1)
        if slower is not None:
            rows, level = slower, level + 1
            Ti = Ti if isfinite(Ti) else FIRST_WINDOW / WINDOW * rows.interval
        elif not isfinite(Ti):
            return _refused(explained)
        elif 0.8 < Ti / before < 1.25:
            break
    return rows, form, longest


def window_of(wanted: float, rows: int) -> int:
    """Return the rows of a window, `wanted` where a record of so many rows holds six of them."""
    return int(np.clip(wanted, MIN_WINDOW, max(min(ROWS, rows // 6), MIN_WINDOW)))


def _most_plausible(searches: list[list[LawFit]]) -> list[LawFit]:
    """Fits of the first assumption in the list, unless another is better beyond chance; with all that fit as well.

    Which sample the integral has taken in and whether the output is logged a sample late matter at coarse rates only.
    """
    searches = [fits for fits in searches if fits and isfinite(fits[0].reset_time)]
    if not searches:
        return []
    lead = min(searches, key=lambda fits: fits[0].unexplained)
    chosen = next(fits for fits in searches if lead[0].better_than(fits[0]) <= PLAUSIBLE or fits is lead)
    others = [fits for fits in searches if fits is not chosen and fits[0].better_than(chosen[0]) > -PLAUSIBLE]
    return chosen + [fit for fits in others for fit in fits]


def derivative_is_real(pid: LawFit, pi: LawFit) -> bool:
    """A first-order filter looks like a D part with Td = Tf; a real one is longer, and clearly better."""
    Td = pid.values[pid.form.terms.index(DERIVATIVE)] / pid.gain
    return Td > max(2.0 * pid.filter_time, 0.02 * pid.reset_time) and pid.better_than(pi) > CLEARLY


def _refused(explained: float, *, by_chance: bool = False) -> Note:
    if explained > LEAST_EXPLAINED and not by_chance:
        code, message = "proportional_part_unseen", (
            "the output follows the sum of the control error, but no P part shows: the data are compressed, "
            "interpolated or too coarse, so K and Ti cannot be read from them")
    else:
        code, message = "not_this_controller", (
            f"a PI or PID controller of these signals explains {100 * max(explained, 0.0):.0f} % of the output's "
            "motion: other signals, manual operation, limits or feedforward move it, or the columns do not belong "
            "together")
    return Note(code, message, {"r2": explained})


def summarise(rows: LawRows, fits: list[LawFit], averaged: bool, notes: tuple[Note, ...] = ()) -> Identification:
    """Values of the first fit; intervals from its scatter, from the other fits, and from what sampling hides."""
    best, terms = fits[0], fits[0].form.terms
    # Not in the scatter: which part of the newest error the output already contains, and at coarse rates the
    # noise between the samples, which the controller saw and the record did not.
    coarse = 0.0 if averaged else rows.interval / best.reset_time
    systematic = 0.01 + 0.1 * coarse
    attenuation = best.attenuation if coarse > NOISE_UNSEEN else 1.0

    def interval_of(quantity: Callable[[FloatArray], FloatArray], blur: float, stretch: float = 1.0) -> Identified:
        low, high = np.inf, -np.inf
        for fit in fits:
            with np.errstate(divide="ignore", invalid="ignore"):
                value, scatter = float(quantity(fit.values)), quantity(fit.scatter)
                groups = len(scatter)
                error = float(np.sqrt((groups - 1) / groups * np.sum((scatter - scatter.mean()) ** 2)))
            reach = T95[min(groups, len(T95) - 1)] * error + blur * abs(value)
            if not np.isfinite(reach):  # a part of the record without any integral action: nothing is known
                return Identified(float(quantity(best.values)), (-np.inf, np.inf))
            low = min(low, value - reach, value * stretch - reach)
            high = max(high, value + reach, value * stretch + reach)
        return Identified(float(quantity(best.values)), (low, high))

    def over_gain(term: int) -> Identified:
        return interval_of(lambda v: v[..., terms.index(term)] / v[..., 0], systematic)

    has_d = DERIVATIVE in terms
    gain = interval_of(lambda v: v[..., 0], systematic + 0.15 * coarse, 1.0 / attenuation)
    ends = sorted(abs(x) for x in gain.ci95)
    if gain.ci95[0] * gain.ci95[1] <= 0 or ends[1] > WIDE * ends[0]:
        message = f"K is known to {gain.ci95[0]:.3g}..{gain.ci95[1]:.3g} only (Ti likewise); K/Ti is known better"
        notes = (*notes, Note("gain_uncertain", message, {"low": gain.ci95[0], "high": gain.ci95[1]}))
    if coarse > 1.0 / COARSEST:
        message = (f"the samples are {rows.interval:g} s apart and Ti is about {best.reset_time:.2g} s: too few to "
                   "tell K and Ti apart; only K/Ti is known")
        notes = (*notes, Note("sampling_too_coarse", message, {"interval": rows.interval, "Ti": best.reset_time}))
    return Identification(
        K=gain,
        Ti=interval_of(lambda v: v[..., 0] / v[..., 1], systematic + 0.15 * coarse, 1.0 / attenuation),
        Td=over_gain(DERIVATIVE) if has_d else Identified(0.0, (0.0, 0.0)),
        ratio=interval_of(lambda v: v[..., 1], systematic),
        b=over_gain(SETPOINT) if SETPOINT in terms and coarse < NOISE_UNSEEN else None,
        Tf=best.filter_time, r2=1.0 - best.unexplained, n=len(rows.index), interval=rows.interval,
        form="ideal PID" if has_d else "ideal PI", notes=notes)


def with_constant_setpoint(record: Record) -> Record:
    """Return the record with a constant setpoint where none was recorded and the output shows that it stood still."""
    held = None if np.isfinite(record.setpoint).any() else at_mean(record)
    found = None if held is None else identify(held)
    if held is None or not isinstance(found, Identification) or found.r2 < PROVEN:
        return record
    level, (low, high) = float(held.setpoint[0]), record.settings.pv_range
    note = Note(
        "assumed_setpoint", "no setpoint (SP) in the data; it is taken as constant at the mean of PV, "
        f"{low + level * (high - low):.4g}: with that a controller of K = {found.K.value:.3g} and Ti = "
        f"{found.Ti.value:.3g} s explains {100.0 * found.r2:.2f} % of the output's motion",
        {"setpoint": level, "r2": found.r2})
    return replace(held, notes=(*(n for n in record.notes if n.code != "no_setpoint"), note))


def at_mean(record: Record) -> Record | None:
    """Return the record with the mean of PV as its setpoint, None with too few usable samples."""
    use = record.usable & np.isfinite(record.measurement)
    if record.output is not None:
        use &= np.isfinite(record.output)
    if np.count_nonzero(use) < LEAST_ROWS:
        return None
    return replace(record, setpoint=np.full(len(record), float(record.measurement[use].mean())))
