"""Where a record oscillates: does it look like stiction, aggressive tuning, somebody else's oscillation, or backlash?

    diagnose(record) -> Diagnosis               with_oscillation(report, record) -> the report with what that adds

Each test is a vote, with its number and the limits of its source (docs/settings.md says what decides):

    curve_fit    triangle against sine in OP and in PV between zero crossings. He, Wang, Pottmann, Qin, Ind. Eng. Chem.
                 Res. 46 (2007) 4549. OP of a sticking self-regulating loop is triangular, PV of an integrating one.
    shape        square against sine in the error. Haegglund, Control Eng. Practice 19 (2011) 1046.
    mean_cycle   is PV's mean cycle that of OP through a gap, of OP itself, or of neither? (see wave)
    symmetry     does the second half of a cycle repeat the first upside down? A gap or a sticking valve makes it so.
    persistence  autocorrelation five periods on: noise in a badly damped loop forgets its phase, a source does not.
    correlation  zero crossings of the cross-correlation of OP and PV, in self-regulating loops. Horch, Control Eng.
                 Practice 7 (1999) 1221. Odd for any oscillation slow against Ti as well, so it never decides.
    setpoint     does the setpoint swing with the same period?

The limits without a source were chosen on 1200 simulated loops; `python -m tests.benchmarks.diagnosis_benchmark` plays
fresh ones. The mean cycle needs neither setpoint nor settings, and few samples per Ti. So a valve that makes its loop
cycle is suspected also where K and Ti are not to be had, or the record is too coarse or too short against Ti.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import correlate

from ..record import FloatArray, Note, Record
from ..results import NOTHING_SAID, LoopReport, Verdict
from ..words import noted, said
from . import wave
from .identify import at_mean

INTEGRATOR = 1.0  # first lag over period from which no levelling off shows within a cycle
LEVELS_OFF = 0.4  # and below which it does; between the two nothing can be said
LEAST_HEIGHT = 0.5  # autocorrelation one period on: below, nothing repeats (Miao and Seborg 1999)
REGULAR_HEIGHT = 0.25  # or this, when the autocorrelation crosses zero at regular intervals (Thornhill et al. 2003)
LEAST_PERIOD = 8.0  # samples
FINEST = 128.0  # samples per period that are enough
FIRST_TRY = 1 << 14  # samples
ENOUGH_PERIODS = 40.0  # in the part that is looked at
EVIDENCE = 10.0  # likelihood ratio 2 ln L of a gap; simulated sines from outside stay below 8
EXPLAINED = 4.0  # squared error of the harmonics in units of their scatter that counts as explained
ROUGHLY = 15.0  # allowed where OP is triangular besides, or the gap leaves next to nothing
GONE = 0.4  # share of the misfit that a gap may leave
NEARLY_GONE = 0.3
GONE_LEVEL = 0.6  # the same where the process levels off; an integrator is imitated by what the model leaves out
LASTING = 0.8  # autocorrelation five periods on
CLOCKWORK = 0.9  # the same for a cycle that is no sine
FORGETS = 0.6  # share of the first peak of the autocorrelation that is left five periods on, near a stability limit
NEARLY_SINE = 0.04  # harmonics over the fundamental; noise through a resonance makes no more in ten cycles
PROPORTIONAL = 20.0  # degrees of lag by integral action in a cycle that does not need it; stick-slip has above 27
KINDS = ("none", "stiction", "backlash_integrating", "tight_nonlinear", "aggressive_tuning", "external", "setpoint",
         "unclear")
NOT_TESTED = {"missing_settings", "no_setpoint", "sampling_too_coarse", "short_record"}
# kinds of oscillation that put the valve under suspicion, with the confidence that it is right to do so: simulated
# cycles called stiction come from a valve in all of 165 loops; of the other only one recording is known
VALVE = {"stiction": 0.9, "tight_nonlinear": 0.5}


@dataclass(frozen=True)
class Vote:
    """One test: its number, what it speaks for ("stiction", "not stiction", ...; "" for nothing), and its limits."""

    test: str
    value: float
    speaks_for: str
    limits: str


@dataclass(frozen=True)
class Diagnosis:
    """What an oscillation looks like. kind: as in `KINDS`. period [s]. d: gap that fits the mean cycle [span], if any.

    votes: every test that could be made. statement: the finding in words, with what the paper's number then means.
    """

    kind: str
    period: float | None
    votes: tuple[Vote, ...]
    statement: str
    d: float | None = None

    @property
    def note(self) -> Note:
        """The finding as a note for a report."""
        return Note(f"looks_like_{self.kind}", self.statement, {vote.test: vote.value for vote in self.votes})


def diagnose(record: Record) -> Diagnosis:
    """Say what the oscillation of a loop looks like, from the end of its longest stretch without gaps."""
    signals = _longest_stretch(record)
    found, height, last = _oscillation(signals[0] - signals[1])
    size = max(int(found / FINEST), 1)
    period, part = found / size, signals[:, last]
    setpoint, measurement, output = part[:, : part.shape[1] // size * size].reshape(3, -1, size).mean(2)
    error = setpoint - measurement
    of_error = wave.mean_half_period(error, period) if found else None
    if of_error is None:
        return Diagnosis("none", None, (), said("none"))
    of_output = wave.mean_half_period(output, period) if np.ptp(output) > 0 else None
    votes, cycle = [_curve_fit("curve_fit_pv", of_error)], None
    sine, square, _ = wave.misfits(of_error)
    index, lasting = (sine - square) / (sine + square), wave.sustained(error, period, height)
    if of_output is not None:
        votes.append(_curve_fit("curve_fit_op", of_output))
        cycle = wave.compare_mean_cycle(measurement, output, period, record.settings.K or 0.0)
    votes.append(_vote("shape", index, "stiction" if index > 0 else "not stiction"))
    if cycle is not None:
        votes += [_vote("mean_cycle", cycle.left, _cycle_speaks(cycle, votes[1].speaks_for == "stiction")),
                  _vote("symmetry", float(cycle.symmetric), "" if cycle.symmetric else "not stiction")]
    votes.append(_vote("persistence", lasting, "external" if lasting > LASTING else ""))
    if of_output is not None and np.ptp(setpoint) == 0.0:
        votes.append(_correlation(measurement, output, period))
    votes.append(_setpoint(setpoint, measurement, period))
    kind = _decide({vote.test: vote.speaks_for for vote in votes}, height, lasting, cycle)
    of_valve = kind in ("stiction", "backlash_integrating")
    statement = said("sum_of_both", looks=said(kind)) if of_valve or kind == "unclear" else said(kind)
    gap = cycle.d if cycle is not None and of_valve and cycle.left < 1.0 else None
    return Diagnosis(kind, found * record.interval, tuple(votes), statement, gap)


def _oscillation(error: FloatArray) -> tuple[float, float, slice]:
    """Period [samples] and height of the autocorrelation there, 0 where nothing repeats, and the samples they are from:
    ever longer parts from the end are tried until one holds enough periods."""
    length, n = FIRST_TRY, len(error)
    while n > 3 * LEAST_PERIOD:
        last = slice(max(n - length, 0), n)
        part = error[last]
        period, height = wave.find_period(wave.moving_mean(part - part.mean(), 3))
        repeats = height >= LEAST_HEIGHT or (height >= REGULAR_HEIGHT
                                             and wave.regularity(wave.detrended(part, period)) > 1.0)
        if length >= n or (repeats and LEAST_PERIOD <= period <= length / ENOUGH_PERIODS):
            return (period, height, last) if repeats and period >= LEAST_PERIOD else (0.0, 0.0, last)
        length *= 8
    return 0.0, 0.0, slice(0, n)


def _decide(says: dict[str, str], height: float, lasting: float, cycle: wave.CycleTest | None) -> str:
    """From votes to one word: a source that is seen first, then the valve, then the shape of what is left."""
    if says["setpoint"] == "setpoint":
        return "setpoint"
    if cycle is not None and says["mean_cycle"] == "gap" and says["symmetry"] != "not stiction":
        return ("backlash_integrating" if cycle.first_lag > INTEGRATOR else
                "stiction" if cycle.first_lag < LEVELS_OFF else "unclear")
    if says["curve_fit_pv"] == says.get("curve_fit_op", "not stiction") == "not stiction":
        if says["persistence"] == "external":
            return "external"
        resonance = lasting < FORGETS * height and height > LEAST_HEIGHT
        sine = cycle is not None and cycle.harmonics < NEARLY_SINE
        return "aggressive_tuning" if resonance and sine else "unclear"
    if cycle is not None and says["mean_cycle"] == "neither":
        if cycle.integral_phase < PROPORTIONAL and lasting > LASTING:
            return "tight_nonlinear"
        return "external" if lasting > CLOCKWORK and height > CLOCKWORK else "unclear"
    return "unclear"


def _cycle_speaks(cycle: wave.CycleTest, triangular: bool) -> str:
    gone = GONE_LEVEL if cycle.first_lag < LEVELS_OFF else GONE
    enough = ROUGHLY if triangular or cycle.left < NEARLY_GONE else EXPLAINED
    if cycle.evidence > EVIDENCE and cycle.left < gone and cycle.unexplained < enough:
        return "gap"
    if cycle.unexplained > EXPLAINED and cycle.left > GONE:
        return "neither"
    return "no gap" if cycle.misfit < EXPLAINED and cycle.evidence < EVIDENCE else ""


def _curve_fit(test: str, half_period: FloatArray) -> Vote:
    sine, _, triangle = wave.misfits(half_period)
    index = sine / (sine + triangle) if sine + triangle > 0 else 0.5
    speaks = "stiction" if index > 0.6 else "not stiction" if index < 0.4 else ""
    return Vote(test, index, speaks, said("vote:curve_fit"))


def _vote(test: str, value: float, speaks_for: str) -> Vote:
    return Vote(test, value, speaks_for, said(f"vote:{test}", gone=GONE, level=GONE_LEVEL, lasting=LASTING))


def _correlation(measurement: FloatArray, output: FloatArray, period: float) -> Vote:
    pv, op, now = wave.detrended(measurement, period), wave.detrended(output, period), len(output) - 1
    both = correlate(pv, op, method="fft")
    sides = (side[: round(period) + 1] for side in (both[now:], both[now::-1]))
    right, left = (float((*wave.crossings(side, 0.0)[0], len(side))[0]) for side in sides)
    asymmetry = abs(left - right) / (left + right)
    speaks = "stiction" if asymmetry > 2 / 3 else "not stiction" if asymmetry < 1 / 3 else ""
    return _vote("correlation", asymmetry, speaks)


def _setpoint(setpoint: FloatArray, measurement: FloatArray, period: float) -> Vote:
    """Swing of the setpoint at the period, over that of PV."""
    turn = np.exp(-2j * np.pi * np.arange(len(setpoint)) / period)
    swing, of_measurement = (float(abs(np.sum(wave.detrended(x, period) * turn))) for x in (setpoint, measurement))
    share = swing / of_measurement if of_measurement > 0 and np.ptp(setpoint) > 0.0 else 0.0
    return _vote("setpoint", share, "setpoint" if share > 0.5 else "")


def _longest_stretch(record: Record) -> FloatArray:
    """Setpoint, measurement and output (3, samples) of the longest stretch without gap; OP is 0 if not recorded."""
    output = np.zeros(len(record)) if record.output is None else record.output
    signals = np.array([record.setpoint, record.measurement, output])
    use = np.flatnonzero(record.usable & np.isfinite(signals).all(0))
    return signals[:, max(np.split(use, np.flatnonzero(np.diff(record.index[use]) != 1) + 1), key=len)]


def with_oscillation(report: LoopReport, record: Record) -> LoopReport:
    """Return the report with what an oscillation of the record looks like, and the verdict that follows from it."""
    codes = {reason.code for reason in report.reasons}
    seen, untested = "oscillation" in codes, report.verdict in NOTHING_SAID and bool(codes & NOT_TESTED)
    blind = not np.isfinite(record.setpoint).any()
    whole = at_mean(record) if blind and (seen or untested) else record
    if whole is None or not (seen or untested):
        return report
    found = diagnose(whole)
    note = found.note
    if untested and found.kind == "none":
        return report
    if blind:  # a setpoint that switches to and fro makes cycles that cannot be told from a sticking valve's
        note = replace(note, message=f"{note.message}; or the setpoint, which was not recorded, swings")
    repeats = () if seen else (noted("oscillation:seen", {"period_s": found.period or 0.0}),)
    valve = report.verdict in (Verdict.OSCILLATING, *NOTHING_SAID) and not blind and found.kind in VALVE
    if valve or untested:
        return replace(report, verdict=Verdict.SUSPECTED if valve else Verdict.OSCILLATING,
                       reasons=(note, *repeats, *report.reasons) if valve else (*repeats, note, *report.reasons),
                       confidence=VALVE[found.kind] if valve else 0.5)
    return replace(report, reasons=(*report.reasons, note))
