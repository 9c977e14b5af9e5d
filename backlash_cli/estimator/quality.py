"""How good the record of one loop is for the verdict: sampling, gaps, repeats, rounding, compression, manual, motion.

The `values["effect"]` of a note is what it means for the verdict: "info", "limits" (at most "suspected" on this
evidence alone) or "blocks" ("cannot tell" for this reason)."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property

import numpy as np

from ..record import FloatArray, Frozen, IntArray, Note, Record, SampleState, duration, quantile, runs
from ..words import noted
from .criteria import MOTION, OUTPUT_STEPS
from .survey import MOSTLY_OWN, Survey, measured

FEWEST_PER_TI = 2.0  # below, half periods are invisible (h > Ti/2)
FEWEST_STORED = 1.0  # stored values per Ti, the same for a compressed signal, on average
FEW_PER_TI = 5.0  # below, simulated loops without dead band are called three to five times as often
LITTLE_MOTION = 0.03  # an OP range that leaves dead bands above 2 % unseen deserves a word
NOTABLE = 0.01  # shares below one per cent are not worth a line
MANY = 8  # block means per Ti on which reversals of the output are counted
LATTICE = 0.02  # share of a step that a difference may be off, growing with the square root of the number of steps,
LARGEST = 0.2  # up to this
RECUR = 0.7  # share of different values up to which levels recur
ENOUGH = 4096  # values, evenly taken, show a lattice as well as all do
EXACT = 1e-9  # of the signal's range: rounding of numbers, not of a recorder
VISIBLE = 1e-4  # of the signal's range: smaller changes are those of a signal that has settled, not of a recorder
LEAST_RUN = 4  # samples on one straight line that are no accident
LEAST_KINKS = 5
LINEAR = 0.2  # share of the samples on straight lines above which a signal was interpolated


class Storage(Frozen):
    """How a signal was stored. kind: "samples", "held" (by exception, or a slower scan), "linear" (interpolated).

    share: of the samples that are not measurements of their own. run: samples per stored value, on average.
    deviation: smallest change that was stored (exception deviation), 0 when not seen. step: rounding step, 0 if none.
    noise: standard deviation of the fast noise, from second differences."""

    kind: str = "samples"
    share: float = 0.0
    run: float = 1.0
    deviation: float = 0.0
    step: float = 0.0
    noise: float = 0.0

    @property
    def error(self) -> float:
        """What recording leaves in means, at most: the first harmonic of rounding's sawtooth, of which noise leaves
        exp(-2 (pi noise / step)^2) (Widrow, Kollar 2008). Exceptions err as steps twice their size."""
        step = max(self.step, 2.0 * self.deviation * (self.kind == "held"))
        return step / np.pi * float(np.exp(-2.0 * (np.pi * self.noise / step) ** 2)) if step else 0.0


class Quality(Frozen):
    """Numbers about one record; signals normalised like the record, times in seconds, shares (0..1) of all grid points
    between the first and the last sample.

    samples_per_Ti: None when Ti is not known. gaps: holes in time of more than one sample. op: None without output.
    setpoint_moves: share of samples at which the setpoint differs from the one before. measurement_range, output_range:
    largest less smallest usable value. output_reversals_per_hour: turns by more than noise and rounding."""

    samples: int
    interval: float
    duration: float
    samples_per_Ti: float | None
    missing_share: float
    gaps: int
    longest_gap: float
    usable_share: float
    filled_share: float
    manual_share: float
    saturated_share: float
    frozen_share: float
    implausible_share: float
    pv: Storage
    op: Storage | None
    setpoint_moves: float
    measurement_outside: bool
    measurement_range: float
    output_range: float | None
    output_reversals_per_hour: float | None = None

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """What the numbers mean for the verdict, the heaviest first."""
        q, notes = self, list[Note]()

        def say(there: bool, name: str, effect: str = "info", /, **values: float) -> None:
            if there:
                notes.append(noted(name, {"effect": effect, **values}, longest=duration(q.longest_gap),
                                   s="s" * (q.gaps > 1)))

        say(q.usable_share <= 0.0, "no_usable_data", "blocks")
        say(not notes and q.measurement_range == 0.0, "measurement_constant", "blocks")
        say(q.measurement_outside, "measurement_outside", "blocks")
        if notes:
            return tuple(notes)
        per_Ti = np.inf if q.samples_per_Ti is None else q.samples_per_Ti
        say(per_Ti < FEWEST_PER_TI, "sampling_too_coarse", samples_per_Ti=per_Ti)
        say(FEWEST_PER_TI <= per_Ti < FEW_PER_TI, "sampling_coarse", samples_per_Ti=per_Ti)

        pv, op = q.pv, q.op
        scanned = pv.kind == "held" and pv.deviation == 0.0
        # Compression stores more where the signal moves, so its average may be rarer than a fixed scan.
        effect = "blocks" if pv.run * (FEWEST_PER_TI if scanned else FEWEST_STORED) > per_Ti else "limits"
        say(pv.kind == "held" and not scanned, "compressed_held", effect, share=pv.share, deviation=pv.deviation)
        say(scanned, "scanned_slowly", effect, share=pv.share, every_s=pv.run * q.interval)
        say(pv.kind == "linear", "compressed_linear", effect, share=pv.share, run=pv.run)
        say(pv.kind == "samples" and pv.step > 2.0 * pv.noise, "measurement_rounded", step=pv.step)
        if op is not None:
            say(op.kind != "samples", f"output_compressed:{op.kind}", share=op.share, deviation=op.deviation)
            say(op.step > 1e-4, "output_rounded", step=op.step, limit=OUTPUT_STEPS * op.step)

        say(q.usable_share < 0.5, "little_usable", share=q.usable_share)
        for name, share in {"manual": q.manual_share, "saturated": q.saturated_share,
                            "missing_samples": q.missing_share, "frozen": q.frozen_share,
                            "spikes": q.implausible_share}.items():
            say(share >= NOTABLE, name, share=share)
        effect = "blocks" if per_Ti * (1.0 - q.filled_share) < FEWEST_STORED else "limits"
        say(q.filled_share > MOSTLY_OWN, "interpolated", effect, share=q.filled_share)
        say(NOTABLE <= q.filled_share <= MOSTLY_OWN, "filled", share=q.filled_share)
        say(q.gaps > 0, "gaps", gaps=q.gaps, longest_s=q.longest_gap)

        moved = np.inf if q.output_range is None else q.output_range
        say(q.output_range is None, "no_output")
        say(moved == 0.0, "output_constant", "blocks")
        say(0.0 < moved < LITTLE_MOTION, "little_motion", range=moved, limit=moved / MOTION)
        say(q.setpoint_moves > 0.5, "setpoint_moves", share=q.setpoint_moves)
        return heaviest_first(notes)

    @property
    def known_noise(self) -> float:
        """Standard deviation of the fast noise on PV [span], 0 where a recorder's kinks would pass for it."""
        return self.pv.noise if self.pv.kind == "samples" and self.filled_share < MOSTLY_OWN else 0.0


def heaviest_first(notes: Iterable[Note]) -> tuple[Note, ...]:
    """Return notes on the data in the order of what they mean for the verdict."""
    return tuple(sorted(notes, key=lambda note: ("blocks", "limits", "info").index(str(note.values["effect"]))))


def data_quality(record: Record, Ti: float | None = None, survey: Survey | None = None) -> Quality:
    """Judge the record of one loop. Ti: the controller's integral time [s], where it is not that of the settings.

    survey: of all samples, where the record holds the last ones only. Shares, ranges and gaps count every sample;
    storage and noise come from an even sample of stretches, values that the reader put in left out."""
    if survey is None:
        survey = Survey()
        survey.update(record)
    Ti, interval = record.settings.Ti if Ti is None else Ti, record.interval
    points = survey.last - survey.first + 1 if survey.samples else 0
    share = (survey.states / max(points, 1)).tolist()
    index, values, output_index, outputs = measured(record)
    op = stored_as(output_index, outputs) if len(output_index) else None
    of_measurement, of_output = np.fmax(survey.highest - survey.lowest, 0.0).tolist()
    return Quality(survey.samples, interval, duration=points * interval, samples_per_Ti=Ti / interval if Ti else None,
        missing_share=1.0 - survey.samples / max(points, 1) + share[SampleState.MISSING] if points else 1.0,
        gaps=survey.gaps, longest_gap=(survey.longest - 1) * interval, usable_share=survey.used / max(points, 1),
        filled_share=share[SampleState.FILLED], manual_share=share[SampleState.MANUAL],
        saturated_share=share[SampleState.SATURATED], frozen_share=share[SampleState.FROZEN],
        implausible_share=share[SampleState.IMPLAUSIBLE], pv=stored_as(index, values), op=op,
        setpoint_moves=survey.moves / max(survey.used, 1), measurement_range=of_measurement,
        measurement_outside=bool(survey.used and (survey.lowest[0] > 1.0 or survey.highest[0] < 0.0)),
        output_range=of_output if op is not None else None)


def with_reversals(quality: Quality, record: Record, Ti: float | None) -> Quality:
    """Return it with how often OP, averaged over Ti / MANY, turns by more than noise and rounding make."""
    from ..kernels import gap_crossings
    if quality.op is None:
        return quality
    index, outputs = measured(record)[2:]
    group = index // (max(round(Ti / MANY / record.interval), 1) if Ti else 1)
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    means = np.add.reduceat(outputs, starts) / np.diff(starts, append=len(group))
    turns = gap_crossings(means, max(3.0 * fast_noise(group[starts], means), 1.5 * quality.op.step, 1e-4))
    return replace(quality, output_reversals_per_hour=turns / (len(index) * record.interval / 3600.0))


def rounding_step(values: FloatArray) -> float:
    """Return the step of the lattice that all values lie on, 0 when they lie on none (in the signal's unit).

    A lattice is a finding only where levels recur, or where the typical difference is a step or two: a few scattered
    values always fit some lattice.

    >>> round(rounding_step(np.array([0.1, 0.3, 0.4, 0.2, 0.7, 0.2, 0.8, 0.5])), 9)
    0.1"""
    gaps = np.diff(np.sort(values[:: 1 + len(values) // ENOUGH]))
    samples, levels = 1 + len(gaps), 1 + np.count_nonzero(gaps)
    gaps = gaps[gaps > EXACT * gaps.sum()]
    if not len(gaps):
        return 0.0
    for step in (gaps.min() / np.array([1.0, 2.0, 3.0, 5.0])).tolist():
        numbers = gaps / step
        if np.all((numbers - np.rint(numbers)) ** 2 <= np.minimum(LATTICE**2 * numbers, LARGEST**2)):
            return step if levels <= RECUR * samples or np.mean(gaps <= 2.0 * step) >= 0.5 else 0.0
    return 0.0


def fast_noise(index: IntArray, values: FloatArray) -> float:
    """Return the standard deviation of white noise on a slow signal: 1.4826 MAD of second differences / sqrt 6."""
    bent = np.abs(np.diff(values, 2))[index[2:] - index[:-2] == 2]
    return 1.4826 * quantile(bent, 0.5) / 6.0**0.5 if len(bent) else 0.0


def stored_as(index: IntArray, values: FloatArray) -> Storage:
    """Tell measurements (rows,) from values that a historian held or interpolated between stored ones; index: (rows,)
    their grid numbers, as only neighbours on the grid are compared."""
    if not len(values):
        return Storage()
    span, step, noise = float(np.ptp(values)), rounding_step(values), fast_noise(index, values)
    joined = np.diff(index) == 1
    changes, after = np.abs(np.diff(values))[joined], index[1:][joined]
    if len(values) < 3 * LEAST_RUN or span == 0.0 or not len(changes):
        return Storage(step=step, noise=noise)
    moved = changes[changes > EXACT * span]
    held = 1.0 - len(moved) / len(changes)
    if held > 0.2 and len(moved) >= LEAST_KINKS:
        every = np.gcd.reduce(np.diff(after[changes > EXACT * span])) if len(moved) >= 4 * LEAST_KINKS else 1
        smallest, run = quantile(moved, 0.01), float(every) if every > 1 else len(changes) / len(moved)
        # Without a deviation jumps thin out towards zero: one in a hundred of a normal law is below 2 % of the median.
        by_exception = smallest > max(2.5 * step, VISIBLE * span, 0.1 * quantile(moved, 0.5))
        if by_exception or every > 1 or (step == 0.0 and held > 0.4):  # every: measured at each fifth sample only
            return Storage("held", held, run, smallest if by_exception else 0.0, step, noise)
    linear, run, deviation = _straight_runs(index, values, step, span)
    if linear > LINEAR:
        return Storage("linear", linear, run, deviation, step, noise)
    return Storage(step=step, noise=noise)


def _straight_runs(index: IntArray, values: FloatArray, step: float, span: float) -> tuple[float, float, float]:
    """Share of samples inside exact straight lines that rise or fall, their mean length, and the usual change on one.
    A rounded ramp is straight to a step as well; interpolation shows by kinks far larger than that."""
    tolerance = max(1.05 * step, EXACT * span)
    joined, bends = index[2:] - index[:-2] == 2, np.abs(np.diff(values, 2))
    straight = joined & (bends <= tolerance) & (values[2:] != values[:-2])
    if np.count_nonzero(straight) <= LINEAR * len(values):  # so few in most signals that no line need be looked for
        return 0.0, 1.0, 0.0
    kinks = np.count_nonzero(joined & (bends > 5.0 * tolerance))
    between = np.count_nonzero(joined & (bends > tolerance)) - kinks
    first, after = runs(straight)
    lengths, rises = after - first, np.abs(values[after + 1] - values[first])
    line = (lengths >= LEAST_RUN - 2) & (rises > max(4.0 * step, VISIBLE * span))
    if min(line.sum(), kinks) < LEAST_KINKS or between > 0.3 * min(straight.sum(), kinks):
        return 0.0, 1.0, 0.0
    return (float(lengths[line].sum()) / len(values), float(np.mean(lengths[line] + 1)), quantile(rises[line], 0.1))
