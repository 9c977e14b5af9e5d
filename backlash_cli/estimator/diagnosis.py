"""Where a record oscillates: does it look like stiction, aggressive tuning, somebody else's oscillation, or backlash?

    diagnose(record) -> Diagnosis               with_oscillation(report, record) -> the report with what that adds

What decides (docs/settings.md has it in words): does the setpoint swing with the same period? Is PV's mean cycle that
of OP through a gap, of OP itself, or of neither, a sine or not, and does its second half repeat the first upside down,
as a gap or a sticking valve makes it (see wave)? And how much of the autocorrelation is left five periods on: noise in
a badly damped loop forgets its phase, a source does not.

The limits without a source were chosen on 1200 simulated loops; `python -m tests.benchmarks.diagnosis_benchmark` plays
fresh ones. The mean cycle needs neither setpoint nor settings, and few samples per Ti. So a valve that makes its loop
cycle is suspected also where K and Ti are not to be had, or the record is too coarse or too short against Ti."""

from dataclasses import replace

import numpy as np

from ..record import FloatArray, Frozen, Note, Record
from ..results import NOTHING_SAID, LoopReport, Verdict
from ..words import noted, said
from . import wave
from .identify import at_mean

INTEGRATOR = 1.0  # first lag over period from which no levelling off shows within a cycle
LEVELS_OFF = 0.4  # and below which it does; between the two nothing can be said
LEAST_HEIGHT = 0.45  # autocorrelation one period on: below, nothing repeats (0.5: Miao and Seborg 1999)
LEAST_PERIOD, FINEST = 8.0, 128.0  # samples per period: at least, and as many as are enough
LONGEST = 1 << 16  # samples that are looked at, the last ones
EVIDENCE = 10.0  # likelihood ratio 2 ln L of a gap; simulated sines from outside stay below 8
EXPLAINED = 4.0  # squared error of the harmonics in units of their scatter that counts as explained
ROUGHLY = 15.0  # by a gap: no process is quite what the model says
GONE = 0.4  # share of the misfit that a gap may leave
GONE_LEVEL = 0.6  # the same where the process levels off; an integrator is imitated by what the model leaves out
LASTING, CLOCKWORK = 0.8, 0.9  # autocorrelation five periods on; the same for a cycle that is no sine
FORGETS = 0.6  # share of the first peak of the autocorrelation that is left five periods on, near a stability limit
NEARLY_SINE, SINE = 0.055, 0.04  # harmonics over the fundamental; noise through a resonance makes no more in ten cycles
FOLLOWS = 0.5  # swing of the setpoint over that of PV
PROPORTIONAL = 20.0  # degrees of lag by integral action in a cycle that does not need it; stick-slip has above 27
NOT_TESTED = {"missing_settings", "no_setpoint", "sampling_too_coarse", "short_record"}
# kinds of oscillation that put the valve under suspicion, with the confidence that it is right to do so: simulated
# cycles called stiction come from a valve in all of 165 loops; of the other only one recording is known
VALVE = {"stiction": 0.9, "tight_nonlinear": 0.5}


class Diagnosis(Frozen):
    """What an oscillation looks like. kind: none, stiction, backlash_integrating, tight_nonlinear, aggressive_tuning,
    external, setpoint or unclear. period [s]. d: gap that fits the mean cycle [span], if any. grounds: the numbers it
    rests on. statement: the finding in words, with what the paper's number then means."""

    kind: str
    period: float | None
    grounds: dict[str, float]
    statement: str
    d: float | None = None

    @property
    def note(self) -> Note:
        """The finding as a note for a report."""
        return Note(f"looks_like_{self.kind}", self.statement, self.grounds)


def repeats(record: Record) -> bool:
    """Say whether the control error repeats itself one period on: else noise, or a load, moves it to and fro."""
    signals = _longest_stretch(record)
    return _period(signals[0] - signals[1])[1] >= LEAST_HEIGHT


def _period(error: FloatArray) -> tuple[float, float]:
    """Period of a control error [samples], and its autocorrelation one period on."""
    return wave.find_period(wave.moving_mean(error, 3)) if len(error) > 3 * LEAST_PERIOD else (0.0, 0.0)


def diagnose(record: Record) -> Diagnosis:
    """Say what the oscillation of a loop looks like, from the end of its longest stretch without gaps."""
    signals = _longest_stretch(record)
    error = signals[0] - signals[1]
    found, height = _period(error)
    if height < LEAST_HEIGHT or found < LEAST_PERIOD:
        return Diagnosis("none", None, {}, said("none"))
    size = max(int(found / FINEST), 1)
    period = found / size
    setpoint, measurement, output = signals[:, : len(error) // size * size].reshape(3, -1, size).mean(2)
    turn = np.exp(-2j * np.pi * np.arange(len(setpoint)) / period)
    moved, swung = (float(abs(np.sum((x - wave.moving_mean(x, period)) * turn))) for x in (setpoint, measurement))
    swing = moved / swung if swung > 0.0 and np.ptp(setpoint) > 0.0 else 0.0  # of the setpoint at the period, over PV's
    if swing > FOLLOWS:
        return Diagnosis("setpoint", found * record.interval, {"setpoint": swing}, said("setpoint"))
    cycle = wave.mean_cycle(measurement, output, period, record.settings.K or 0.0)
    if cycle is None:
        return Diagnosis("none", None, {}, said("none"))
    lasting = wave.sustained(setpoint - measurement, period, height)
    kind = _kind(cycle, height, lasting)
    of_valve = kind in ("stiction", "backlash_integrating")
    statement = said("sum_of_both", looks=said(kind)) if of_valve or kind == "unclear" else said(kind)
    grounds = {"mean_cycle": cycle.left, "symmetry": float(cycle.symmetric), "harmonics": cycle.harmonics,
               "persistence": lasting, "setpoint": swing}
    return Diagnosis(kind, found * record.interval, grounds, statement,
                     cycle.d if of_valve and cycle.left < 1.0 else None)


def _kind(cycle: wave.MeanCycle, height: float, lasting: float) -> str:
    """From numbers to one word: the valve first, then the shape of what is left."""
    gone = GONE_LEVEL if cycle.first_lag < LEVELS_OFF else GONE
    if cycle.symmetric and cycle.evidence > EVIDENCE and cycle.left < gone and cycle.unexplained < ROUGHLY:
        return ("backlash_integrating" if cycle.first_lag > INTEGRATOR else
                "stiction" if cycle.first_lag < LEVELS_OFF else "unclear")
    if cycle.harmonics < NEARLY_SINE and lasting > LASTING:
        return "external"
    if cycle.harmonics < SINE and lasting < FORGETS * height:
        return "aggressive_tuning"
    if cycle.unexplained > EXPLAINED and cycle.left > GONE:  # neither OP nor OP through a gap makes it
        if cycle.integral_phase < PROPORTIONAL and lasting > LASTING:
            return "tight_nonlinear"
        return "external" if lasting > CLOCKWORK and height > CLOCKWORK else "unclear"
    return "unclear"


def _longest_stretch(record: Record) -> FloatArray:
    """Setpoint, measurement and output (3, samples) at the end of the longest stretch without gap; no OP is 0."""
    output = np.zeros(len(record)) if record.output is None else record.output
    signals = np.array([record.setpoint, record.measurement, output])
    use = np.flatnonzero(record.usable & np.isfinite(signals).all(0))
    return signals[:, max(np.split(use, np.flatnonzero(np.diff(record.index[use]) != 1) + 1), key=len)[-LONGEST:]]


def with_oscillation(report: LoopReport, record: Record) -> LoopReport:
    """Return the report with what an oscillation of the record looks like, and the verdict that follows from it."""
    codes = {reason.code for reason in report.reasons}
    seen, untested = "oscillation" in codes, report.verdict in NOTHING_SAID and bool(codes & NOT_TESTED)
    blind = (seen or untested) and not np.isfinite(record.setpoint).any()
    whole = at_mean(record) if blind else record
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
