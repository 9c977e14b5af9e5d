"""Where a record oscillates: does it look like stiction, aggressive tuning, somebody else's oscillation, or backlash?

    diagnose(record) -> Diagnosis

Tests, each a vote with its number and the limits of its source:

    curve_fit    triangle against sine in OP and in PV between zero crossings. He, Wang, Pottmann, Qin, Ind. Eng. Chem.
                 Res. 46 (2007) 4549: index above 0.6 stiction, below 0.4 none. OP of a sticking self-regulating loop
                 is triangular (the integral part ramps while the valve stands still), PV of an integrating one.
    shape        square against sine in the error. Haegglund, Control Eng. Practice 19 (2011) 1046: positive stiction.
    correlation  zero crossings of the cross-correlation of OP and PV. Horch, Control Eng. Practice 7 (1999) 1221:
                 asymmetry above 2/3 (odd) stiction, below 1/3 (even) not; self-regulating loops only. It also reads odd
                 for any oscillation slow against Ti, so alone it never decides for stiction.
    mean_cycle   is PV's mean cycle that of OP through a gap? (see mean_cycle; limits from simulated loops)
    setpoint     does the setpoint swing with the same period?
    persistence  autocorrelation five periods on: noise in a badly damped loop forgets its phase, a source does not.

With stiction in the loop the number of the paper's estimator is backlash plus the stiction band.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..record import FloatArray, Note, Record
from .mean_cycle import CycleTest, compare_mean_cycle
from .wave import (
    Wave,
    autocorrelation,
    detrended,
    find_period,
    moving_mean,
    regularity,
    sine_misfit,
    square_misfit,
    triangle_misfit,
    wave,
)

LEAST_HEIGHT = 0.5  # autocorrelation one period on: below, nothing repeats (Miao and Seborg 1999)
REGULAR_HEIGHT = 0.25  # or this, when the autocorrelation crosses zero at regular intervals (Thornhill et al. 2003)
LEAST_PERIOD = 8.0  # samples
FINEST = 128.0  # samples per period that are enough
EVIDENCE = 10.0  # likelihood ratio 2 ln L of a gap; simulated sines from outside stay below 8
MISFIT = 1.5  # squared error of the harmonics in units of their scatter that needs an explanation
SUM_OF_BOTH = (
    "the size given by eq. (15) is backlash plus stiction band: both stop the valve until OP has moved that far, and "
    "this estimate cannot tell one from the other"
)
WORDS = {
    "none": "the loop does not oscillate regularly",
    "stiction": "looks like stiction: the valve sticks and slips",
    "backlash_integrating": "looks like backlash or sticking in an integrating loop, which cycles with integral action",
    "aggressive_tuning": "looks like a loop close to its stability limit: the controller is tuned too hard",
    "external": "looks like an oscillation from outside the loop (or a controller exactly at its stability limit)",
    "setpoint": "follows an oscillating setpoint: the source is the master loop or further up",
    "unclear": "oscillates, and the tests do not agree why",
}


@dataclass(frozen=True)
class Vote:
    """One test: its number, what it speaks for ("stiction", "not stiction", ...; "" for nothing), and its limits."""

    test: str
    value: float
    speaks_for: str
    limits: str


@dataclass(frozen=True)
class Diagnosis:
    """What an oscillation looks like. kind: a key of WORDS. period [s]. d: gap that fits the mean cycle [span], if any.

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
    """Say what the oscillation of a loop looks like, from its longest stretch without gaps."""
    setpoint, measurement, output = _longest_stretch(record)
    error = setpoint - measurement
    period, height = find_period(moving_mean(error - error.mean(), 3)) if len(error) > 3 * LEAST_PERIOD else (0.0, 0.0)
    repeats = height >= LEAST_HEIGHT or (height >= REGULAR_HEIGHT and regularity(detrended(error, period)) > 1.0)
    if period < LEAST_PERIOD or not repeats:
        return Diagnosis("none", None, (), WORDS["none"])
    size = max(int(period / FINEST), 1)
    setpoint, measurement, error = (_means(x, size) for x in (setpoint, measurement, error))
    output = None if output is None else _means(output, size)
    scaled = period / size
    of_error = wave(error, scaled, height)
    if of_error is None:
        return Diagnosis("none", None, (), WORDS["none"])
    of_output = wave(output, scaled, height) if output is not None and np.ptp(output) > 0 else None
    cycle = compare_mean_cycle(measurement, output, scaled) if of_output is not None and output is not None else None
    votes = _votes(of_error, of_output, cycle)
    if of_output is not None and output is not None and np.ptp(setpoint) == 0.0:
        votes.append(_correlation(measurement, output, scaled))
    votes.append(_setpoint(setpoint, measurement, scaled))
    kind = _decide({vote.test: vote.speaks_for for vote in votes}, cycle)
    statement = WORDS[kind]
    if kind in ("stiction", "backlash_integrating", "unclear"):
        statement = f"{statement}; {SUM_OF_BOTH}"
    gap = cycle.d if cycle is not None and kind in ("stiction", "backlash_integrating") and cycle.left < 1.0 else None
    return Diagnosis(kind, period * record.interval, tuple(votes), statement, gap)


def _decide(says: dict[str, str], cycle: CycleTest | None) -> str:
    """From votes to one word: a source that is seen first, then the valve, then the shape of what is left."""
    if says["setpoint"] == "setpoint":
        return "setpoint"
    gap = says.get("mean_cycle") == "gap"
    if says.get("curve_fit_op") == "stiction" or (says["curve_fit_pv"] == "stiction" and gap):
        return "stiction"
    if gap and cycle is not None:
        return "backlash_integrating" if cycle.integrating else "stiction"
    if says.get("mean_cycle") == "no gap" and says["curve_fit_pv"] == "stiction":
        return "external"
    smooth = says["curve_fit_pv"] == "not stiction" and says.get("curve_fit_op", "not stiction") == "not stiction"
    if smooth:
        return "external" if says["persistence"] == "external" else "aggressive_tuning"
    return "unclear"


def _votes(error: Wave, output: Wave | None, cycle: CycleTest | None) -> list[Vote]:
    votes = [_curve_fit("curve_fit_pv", error)]
    if output is not None:
        votes.append(_curve_fit("curve_fit_op", output))
    sine, square = sine_misfit(error.half_period), square_misfit(error.half_period)
    index = (sine - square) / (sine + square)
    votes.append(Vote("shape", index, "stiction" if index > 0 else "not stiction", "stiction above 0"))
    if cycle is not None:
        seen = cycle.evidence > EVIDENCE and cycle.left < 0.4
        refuted = cycle.misfit > MISFIT and cycle.left > 0.8
        speaks = "gap" if seen else "no gap" if refuted else ""
        limits = "share of the misfit a gap leaves: gap below 0.4, no gap above 0.8, where there is a misfit"
        votes.append(Vote("mean_cycle", cycle.left, speaks, limits))
    lasting = "external" if error.sustained > 0.8 else ""
    votes.append(Vote("persistence", error.sustained, lasting, "from outside above 0.8"))
    return votes


def _curve_fit(test: str, of: Wave) -> Vote:
    sine, triangle = sine_misfit(of.half_period), triangle_misfit(of.half_period)
    index = sine / (sine + triangle) if sine + triangle > 0 else 0.5
    speaks = "stiction" if index > 0.6 else "not stiction" if index < 0.4 else ""
    return Vote(test, index, speaks, "stiction above 0.6, none below 0.4")


def _correlation(measurement: FloatArray, output: FloatArray, period: float) -> Vote:
    reach = round(period)
    pv, op = detrended(measurement, period), detrended(output, period)
    right = _first_crossing(autocorrelation(op, pv)[: reach + 1])
    left = _first_crossing(autocorrelation(pv, op)[: reach + 1])
    asymmetry = abs(left - right) / (left + right)
    speaks = "stiction" if asymmetry > 2 / 3 else "not stiction" if asymmetry < 1 / 3 else ""
    return Vote("correlation", asymmetry, speaks, "odd above 2/3, even below 1/3")


def _first_crossing(values: FloatArray) -> float:
    at = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))
    if not len(at):
        return float(len(values))
    k = int(at[0])
    return k + float(values[k] / (values[k] - values[k + 1]))


def _setpoint(setpoint: FloatArray, measurement: FloatArray, period: float) -> Vote:
    """Swing of the setpoint at the period, over that of PV."""
    turn = np.exp(-2j * np.pi * np.arange(len(setpoint)) / period)
    of_setpoint = abs(np.sum(detrended(setpoint, period) * turn))
    of_measurement = abs(np.sum(detrended(measurement, period) * turn))
    share = float(of_setpoint / of_measurement) if of_measurement > 0 else 0.0
    return Vote("setpoint", share, "setpoint" if share > 0.5 else "", "setpoint above 0.5 of the swing of PV")


def _longest_stretch(record: Record) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    use = record.usable & np.isfinite(record.setpoint + record.measurement)
    if record.output is not None:
        use &= np.isfinite(record.output)
    joined = np.concatenate([[False], use[1:] & use[:-1] & (np.diff(record.index) == 1), [False]])
    edges = np.flatnonzero(np.diff(joined.astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    if not len(starts):
        empty = np.empty(0)
        return empty, empty, None
    k = int(np.argmax(ends - starts))
    part = slice(int(starts[k]), int(ends[k]) + 1)
    return record.setpoint[part], record.measurement[part], None if record.output is None else record.output[part]


def _means(values: FloatArray, size: int) -> FloatArray:
    n = len(values) // size * size
    return np.asarray(values[:n].reshape(-1, size).mean(1))
