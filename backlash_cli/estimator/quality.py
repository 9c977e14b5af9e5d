"""How good the record of one loop is for the verdict: sampling, gaps, repeats, rounding, compression, manual, motion.

    data_quality(record, Ti) -> Quality

`Quality.notes` says what each finding means for the verdict; a note's `values["effect"]` is "info", "limits" (the
verdict is at most "suspected" on this evidence alone) or "blocks" ("cannot tell" for this reason). Shares are of all
grid points between the first and the last sample. Codes and their effect:

    no_usable_data        blocks   no usable sample
    sampling_too_coarse   info     fewer than 2 samples per Ti: the published rule needs more, PV against OP does not
    measurement_constant  blocks   PV is the same number throughout
    output_constant       blocks   OP is the same number throughout
    sampling_coarse       info     fewer than 5 samples per Ti: less shows
    compressed_held       limits   PV is stored by exception (deviation in values) and held; blocks when too rare for Ti
    compressed_linear     limits   PV is interpolated between stored values; blocks when too rare for Ti
    scanned_slowly        limits   PV is recorded less often than exported; blocks when too rare for Ti
    output_compressed     info     the same for OP, which can be rebuilt from SP, PV, K and Ti
    output_rounded        info     dead bands below 2.5 rounding steps of OP cannot be seen in OP
    measurement_rounded   info     PV is rounded more coarsely than its noise
    little_usable         info     less than half of the record can be used (manual, saturated, missing, frozen)
    interpolated          limits   more than a fifth of the samples were interpolated over holes by the reader
    manual, saturated, missing_samples, gaps, frozen, spikes, filled     info
    little_motion         info     OP covers so little that a dead band of more than the value named stays unseen
    setpoint_moves        info     the setpoint moves at most samples (cascade or ramp)
    no_output             info     no OP column
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..record import FloatArray, IntArray, Note, Record, SampleState
from .recording import Storage, fast_noise, reversals, stored_as
from .survey import Survey, measured

FEWEST_PER_TI = 2.0  # below, half periods are invisible (h > Ti/2)
FEWEST_STORED = 1.0  # stored values per Ti, the same for a compressed signal, on average
FEW_PER_TI = 5.0  # below, simulated loops without dead band are called three to five times as often
ROUNDING_SEEN = 2.5  # steps of OP a dead band has to span, from loops simulated with OP rounded to 0.1 and 0.5 %
MOTION_NEEDED = 1.5  # range of OP over the dead band to be seen
LITTLE_MOTION = 0.03  # an OP range that leaves dead bands above 2 % unseen deserves a word
NOTABLE = 0.01  # shares below one per cent are not worth a line
HALF = 0.5
MOSTLY_OWN = 0.2  # the same share as for compression seen in the values themselves
MANY = 8  # block means per Ti on which reversals of the output are counted


@dataclass(frozen=True)
class Quality:
    """Numbers about one record; signals normalised like the record, times in seconds, shares 0..1.

    samples_per_Ti: None when Ti is not known. gaps: holes in time of more than one sample, longest_gap [s].
    pv, op: how the recorder stored the signals (op None without output). setpoint_moves: share of samples at which
    the setpoint differs from the one before. measurement_range, output_range: largest less smallest usable value.
    output_reversals_per_hour: turns by more than noise and rounding, None where they were not counted.
    """

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
    measurement_range: float
    output_range: float | None
    output_reversals_per_hour: float | None

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """What the numbers mean for the verdict, the heaviest first."""
        return quality_notes(self)

    @property
    def effect(self) -> str:
        """The strongest effect of all notes: "info", "limits" or "blocks"."""
        order = ("info", "limits", "blocks")
        return max((str(note.values.get("effect", "info")) for note in self.notes), key=order.index, default="info")


def data_quality(record: Record, Ti: float | None = None) -> Quality:
    """Judge the record of one loop; `Ti` [s] is the controller's integral time, when known."""
    survey = Survey()
    survey.update(record)
    Ti = Ti if Ti is not None else record.settings.Ti
    quality = quality_of(survey, record, Ti)
    if quality.op is None:
        return quality
    return replace(quality, output_reversals_per_hour=_turns(*measured(record)[2:], quality.op, record.interval, Ti))


def quality_of(survey: Survey, record: Record, Ti: float | None = None) -> Quality:
    """Return what a survey of a whole record and its last samples show; `Ti` [s] is the time scale for sampling.

    Shares, ranges and gaps count every sample; storage and noise come from an even sample of stretches. Values that
    the reader put in are not the recorder's, and say nothing about it.
    """
    interval, samples, counts = record.interval, survey.samples, survey.states.tolist()
    points = survey.last - survey.first + 1 if samples else 0
    share = [count / max(points, 1) for count in counts]
    index, values, output_index, outputs = measured(record)
    op = stored_as(output_index, outputs) if len(output_index) else None
    return Quality(
        samples=samples,
        interval=interval,
        duration=points * interval,
        samples_per_Ti=Ti / interval if Ti else None,
        missing_share=1.0 - samples / max(points, 1) + share[SampleState.MISSING] if points else 1.0,
        gaps=survey.gaps,
        longest_gap=max(survey.longest - 1, 0) * interval,
        usable_share=survey.used / max(points, 1),
        filled_share=share[SampleState.FILLED],
        manual_share=share[SampleState.MANUAL],
        saturated_share=share[SampleState.SATURATED],
        frozen_share=share[SampleState.FROZEN],
        implausible_share=share[SampleState.IMPLAUSIBLE],
        pv=stored_as(index, values) if len(index) else Storage("samples", 0.0, 1.0, 0.0, 0.0, 0.0),
        op=op,
        setpoint_moves=survey.moves / max(survey.used, 1),
        measurement_range=survey.ranges[0],
        output_range=survey.ranges[1] if op is not None else None,
        output_reversals_per_hour=None,
    )


def _turns(index: IntArray, outputs: FloatArray, op: Storage, interval: float, Ti: float | None) -> float:
    """Reversals per hour of the output, averaged over Ti / MANY, by more than what noise and rounding make."""
    size = max(round(Ti / MANY / interval), 1) if Ti else 1
    group = index // size
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    means = np.add.reduceat(outputs, starts) / np.diff(np.append(starts, len(group)))
    noise = fast_noise(group[starts], means)
    hours = len(index) * interval / 3600.0
    return reversals(means, max(3.0 * noise, 1.5 * op.step, 1e-4)) / hours


def quality_notes(quality: Quality) -> tuple[Note, ...]:
    """Return the findings that matter, the heaviest first."""
    if quality.usable_share <= 0.0:
        message = "no sample of this loop can be used (manual, missing, saturated or frozen throughout)"
        return (_note("no_usable_data", message, "blocks"),)
    if quality.measurement_range == 0.0:
        return (_note("measurement_constant", "PV is the same number throughout: the signal is dead", "blocks"),)
    notes = [*_sampling(quality), *_storage(quality), *_shares(quality), *_motion(quality)]
    order = ("blocks", "limits", "info")
    return tuple(sorted(notes, key=lambda note: order.index(str(note.values["effect"]))))


def _note(code: str, message: str, effect: str, **values: float) -> Note:
    return Note(code, message, {"effect": effect, **values})


def _sampling(quality: Quality) -> Iterator[Note]:
    per_Ti = quality.samples_per_Ti
    if per_Ti is None or per_Ti >= FEW_PER_TI:
        return
    if per_Ti < FEWEST_PER_TI:
        message = f"only {per_Ti:.2g} samples per Ti, too few for half periods: export this loop at a shorter interval"
        yield _note("sampling_too_coarse", message, "info", samples_per_Ti=per_Ti)
    else:
        message = f"only {per_Ti:.2g} samples per Ti: dead bands read low, healthy loops are called more often"
        yield _note("sampling_coarse", message, "info", samples_per_Ti=per_Ti)


def _storage(quality: Quality) -> Iterator[Note]:
    pv, op = quality.pv, quality.op
    between = pv.run * quality.interval
    # Compression stores more where the signal moves, so its average may be rarer than a fixed scan.
    fewest = FEWEST_PER_TI if pv.kind == "held" and pv.deviation == 0.0 else FEWEST_STORED
    rare = quality.samples_per_Ti is not None and pv.run * fewest > quality.samples_per_Ti
    remedy = "switch compression off for this tag, or export raw values"
    if pv.kind == "held" and pv.deviation > 0.0:
        message = (
            f"PV is stored by exception: {_percent(pv.share)} of the samples repeat the last value until it has "
            f"changed by about {_percent(pv.deviation)} of span; {remedy}"
        )
        yield _note("compressed_held", message, "blocks" if rare else "limits", share=pv.share, deviation=pv.deviation)
    elif pv.kind == "held":
        message = f"PV is recorded every {between:.3g} s only and repeated in between; {remedy}"
        yield _note("scanned_slowly", message, "blocks" if rare else "limits", share=pv.share, every_s=between)
    elif pv.kind == "linear":
        message = (
            f"PV is interpolated: {_percent(pv.share)} of the samples lie on straight lines of {pv.run:.3g} samples "
            f"between stored values; {remedy}"
        )
        yield _note("compressed_linear", message, "blocks" if rare else "limits", share=pv.share, run=pv.run)
    if pv.kind == "samples" and pv.step > 2.0 * pv.noise and pv.step > 0.0:
        message = f"PV is rounded to steps of {_percent(pv.step)} of span, more than its noise"
        yield _note("measurement_rounded", message, "info", step=pv.step)
    if op is not None:
        yield from _output_storage(op)


def _output_storage(op: Storage) -> Iterator[Note]:
    if op.kind != "samples":
        how = "held between changes" if op.kind == "held" else "interpolated between stored values"
        message = f"OP is {how} ({_percent(op.share)} of the samples); it can be rebuilt from SP, PV, K and Ti"
        yield _note("output_compressed", message, "info", share=op.share, deviation=op.deviation)
    if op.step > 1e-4:
        smallest = ROUNDING_SEEN * op.step
        message = f"OP is rounded to {_percent(op.step)}: dead bands below {_percent(smallest)} cannot be seen in it"
        yield _note("output_rounded", message, "info", step=op.step, limit=smallest)


def _shares(quality: Quality) -> Iterator[Note]:
    if quality.usable_share < HALF:
        message = f"only {_percent(quality.usable_share)} of the record can be used"
        yield _note("little_usable", message, "info", share=quality.usable_share)
    for code, share, words in (
        ("manual", quality.manual_share, "of the time not in automatic; left out, a test of the valve apart"),
        ("saturated", quality.saturated_share, "of the time OP was at its limit; left out"),
        ("missing_samples", quality.missing_share, "of the samples are missing or bad"),
        ("frozen", quality.frozen_share, "of the time PV stood still at one number; left out"),
        ("spikes", quality.implausible_share, "of the samples are far outside the span; left out"),
    ):
        if share >= NOTABLE:
            yield _note(code, f"{_percent(share)} {words}", "info", share=share)
    if quality.filled_share > MOSTLY_OWN:
        message = f"{_percent(quality.filled_share)} of the samples were not recorded but interpolated"
        yield _note("interpolated", message, "limits", share=quality.filled_share)
    elif quality.filled_share >= NOTABLE:
        message = f"{_percent(quality.filled_share)} of the samples were interpolated over short holes"
        yield _note("filled", message, "info", share=quality.filled_share)
    if quality.gaps:
        holes = "1 gap" if quality.gaps == 1 else f"{quality.gaps} gaps"
        message = f"{holes} in time, the longest {_length(quality.longest_gap)}; no half period crosses one"
        yield _note("gaps", message, "info", gaps=quality.gaps, longest_s=quality.longest_gap)


def _motion(quality: Quality) -> Iterator[Note]:
    if quality.output_range is None:
        yield _note("no_output", "no OP column: OP is rebuilt from SP, PV, K and Ti, which then must be right", "info")
    elif quality.output_range == 0.0:
        yield _note("output_constant", "OP is the same number throughout: the controller does not act", "blocks")
    elif quality.output_range < LITTLE_MOTION:
        limit = quality.output_range / MOTION_NEEDED
        message = (
            f"OP moves over {_percent(quality.output_range)} only: a dead band above {_percent(limit)} stays unseen; "
            "a longer record or a setpoint bump of twice the suspected dead band would show it"
        )
        yield _note("little_motion", message, "info", range=quality.output_range, limit=limit)
    if quality.setpoint_moves > HALF:
        message = "the setpoint moves all the time (cascade or ramp): half periods follow it as well as the valve"
        yield _note("setpoint_moves", message, "info", share=quality.setpoint_moves)


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def _length(seconds: float) -> str:
    """A length of time in its two largest units.

    >>> [_length(x) for x in (45.5, 300.0, 12_000.0, 187_200.0)]
    ['45.5 s', '5 min', '3 h 20 min', '2 d 4 h']
    """
    if seconds < 60.0:
        return f"{seconds:.3g} s"
    units = ((86_400, "d", 3600, "h"), (3600, "h", 60, "min"), (60, "min", 1, "s"))
    size, name, smaller, its_name = next(unit for unit in units if seconds >= unit[0])
    whole, rest = divmod(round(seconds / smaller), size // smaller)
    return f"{whole} {name} {rest} {its_name}" if rest else f"{whole} {name}"
