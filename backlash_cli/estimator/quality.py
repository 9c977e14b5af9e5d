"""How good the record of one loop is for the verdict: sampling, gaps, repeats, rounding, compression, manual, motion.

    data_quality(record, Ti) -> Quality          quality_of(survey, Ti) -> Quality     after a Survey of all blocks

`Quality.notes` says what each finding means for the verdict; a note's `values["effect"]` is "info", "limits" (the
verdict is at most "suspected" on this evidence alone) or "blocks" ("cannot tell" for this reason). Codes: see
`quality_notes`. Shares are of all grid points between the first and the last sample.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..record import FloatArray, IntArray, Note, Record, SampleState
from .quality_notes import quality_notes
from .recording import Storage, fast_noise, reversals, stored_as
from .survey import MEASUREMENT, OUTPUT, Survey

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
    survey = Survey(record.interval, slower=False)
    survey.update(record)
    Ti = Ti if Ti is not None else record.settings.Ti
    quality = quality_of(survey, Ti)
    if quality.op is None:
        return quality
    return replace(quality, output_reversals_per_hour=_turns(*survey.measured()[2:], quality.op, record.interval, Ti))


def quality_of(survey: Survey, Ti: float | None = None) -> Quality:
    """Return what a survey of the whole record shows, reversals apart; `Ti` [s] is the time scale for sampling.

    Shares, ranges and gaps count every sample; storage and noise come from an even sample of stretches. Values that
    the reader put in are not the recorder's, and say nothing about it.
    """
    interval, samples, counts = survey.interval, survey.samples, survey.states.tolist()
    points = survey.last - survey.first + 1 if samples else 0
    share = [count / max(points, 1) for count in counts]
    index, measured, output_index, outputs = survey.measured()
    op = stored_as(output_index, outputs) if len(output_index) else None
    usable = counts[SampleState.GOOD] + counts[SampleState.FILLED]
    return Quality(
        samples=samples,
        interval=interval,
        duration=points * interval,
        samples_per_Ti=Ti / interval if Ti else None,
        missing_share=1.0 - samples / max(points, 1) + share[SampleState.MISSING] if points else 1.0,
        gaps=survey.gaps,
        longest_gap=max(survey.longest - 1, 0) * interval,
        usable_share=usable / max(points, 1),
        filled_share=share[SampleState.FILLED],
        manual_share=share[SampleState.MANUAL],
        saturated_share=share[SampleState.SATURATED],
        frozen_share=share[SampleState.FROZEN],
        implausible_share=share[SampleState.IMPLAUSIBLE],
        pv=stored_as(index, measured) if len(index) else Storage("samples", 0.0, 1.0, 0.0, 0.0, 0.0),
        op=op,
        setpoint_moves=survey.moves / max(usable, 1),
        measurement_range=survey.spread(MEASUREMENT),
        output_range=survey.spread(OUTPUT) if op is not None else None,
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
