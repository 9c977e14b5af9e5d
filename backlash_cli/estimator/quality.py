"""How good the record of one loop is for the verdict: sampling, gaps, repeats, rounding, compression, manual, motion.

    data_quality(record, Ti) -> Quality          QualityScanner(interval).update(block) ... finish(Ti)

`Quality.notes` says what each finding means for the verdict; a note's `values["effect"]` is "info", "limits" (the
verdict is at most "suspected" on this evidence alone) or "blocks" ("cannot tell" for this reason). Codes: see
`quality_notes`. Shares are of all grid points between the first and the last sample.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..record import IntArray, Note, Record, SampleState
from .recording import Storage, fast_noise, reversals, stored_as
from .stretches import StretchSample

MANY = 8  # block means per Ti on which reversals of the output are counted


@dataclass(frozen=True)
class Quality:
    """Numbers about one record; signals normalised like the record, times in seconds, shares 0..1.

    samples_per_Ti: None when Ti is not known. gaps: holes in time of more than one sample, longest_gap [s].
    pv, op: how the recorder stored the signals (op None without output). setpoint_moves: share of samples at which
    the setpoint differs from the one before. setpoint_range, output_range: largest less smallest usable value.
    output_reversals_per_hour: turns by more than noise and rounding.
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
    setpoint_range: float
    measurement_range: float
    output_range: float | None
    output_reversals_per_hour: float | None
    notes: tuple[Note, ...] = ()

    @property
    def effect(self) -> str:
        """The strongest effect of all notes: "info", "limits" or "blocks"."""
        order = ("info", "limits", "blocks")
        return max((str(note.values.get("effect", "info")) for note in self.notes), key=order.index, default="info")


def data_quality(record: Record, Ti: float | None = None) -> Quality:
    """Judge the record of one loop; `Ti` [s] is the controller's integral time, when known."""
    scanner = QualityScanner(record.interval)
    scanner.update(record)
    return scanner.finish(Ti if Ti is not None else record.settings.Ti)


class QualityScanner:
    """The same block by block in bounded memory, independent of the cut.

    Shares, ranges and gaps count every sample; storage, noise and reversals come from an even sample of stretches.
    """

    def __init__(self, interval: float) -> None:
        self._interval = interval
        self._states = np.zeros(len(SampleState), dtype=np.int64)
        self._first: int | None = None
        self._last = 0
        self._gaps = 0
        self._longest = 0
        self._last_setpoint = np.nan
        self._moves = 0
        self._low = np.full(3, np.inf)
        self._high = np.full(3, -np.inf)
        self._measured = StretchSample(1, 1)
        self._outputs = StretchSample(1, 1)

    def update(self, block: Record) -> None:
        """Take in the next block of the loop."""
        if not len(block):
            return
        index = block.index
        steps = np.diff(index if self._first is None else np.concatenate([[self._last], index]))
        self._gaps += int(np.sum(steps > 2))
        self._longest = max(self._longest, int(steps.max(initial=1)))
        self._first = int(index[0]) if self._first is None else self._first
        self._last = int(index[-1])
        self._states += np.bincount(block.state, minlength=len(SampleState))[: len(SampleState)]
        self._count_setpoint(block)
        output = np.full(len(index), np.nan) if block.output is None else block.output
        for column, values in enumerate((block.setpoint, block.measurement, output)):
            values = _only(values, block.usable)
            values = _only(values, np.isfinite(values))
            if len(values):
                self._low[column] = min(self._low[column], values.min())
                self._high[column] = max(self._high[column], values.max())
        # Values the loader put in are not the recorder's, and say nothing about it.
        own = (block.state == SampleState.GOOD) & np.isfinite(block.setpoint + block.measurement)
        self._measured.update(_only(index, own), _only(block.measurement, own)[:, None])
        if block.output is not None:
            own &= np.isfinite(output)
            self._outputs.update(_only(index, own), _only(output, own)[:, None])

    def _count_setpoint(self, block: Record) -> None:
        setpoint = _only(block.setpoint, block.usable)
        setpoint = _only(setpoint, np.isfinite(setpoint))
        if len(setpoint):
            self._moves += int(np.count_nonzero(setpoint[1:] != setpoint[:-1]))
            self._moves += bool(np.isfinite(self._last_setpoint) and setpoint[0] != self._last_setpoint)
            self._last_setpoint = float(setpoint[-1])

    def finish(self, Ti: float | None = None) -> Quality:
        """Return what was found; `Ti` [s] sets the time scale for sampling and compression."""
        from .quality_notes import quality_notes

        samples = int(self._states.sum())
        points = self._last - self._first + 1 if self._first is not None else 0
        share = self._states / max(points, 1)
        index, measured = self._measured.rows()
        output_index, outputs = self._outputs.rows()
        op = stored_as(output_index, outputs[:, 0]) if len(output_index) else None
        spread = np.where(self._high >= self._low, self._high - self._low, 0.0)
        usable = int(self._states[SampleState.GOOD] + self._states[SampleState.FILLED])
        quality = Quality(
            samples=samples,
            interval=self._interval,
            duration=points * self._interval,
            samples_per_Ti=Ti / self._interval if Ti else None,
            missing_share=float(1.0 - samples / max(points, 1) + share[SampleState.MISSING]) if points else 1.0,
            gaps=self._gaps,
            longest_gap=(self._longest - 1) * self._interval if self._longest > 1 else 0.0,
            usable_share=usable / max(points, 1),
            filled_share=float(share[SampleState.FILLED]),
            manual_share=float(share[SampleState.MANUAL]),
            saturated_share=float(share[SampleState.SATURATED]),
            frozen_share=float(share[SampleState.FROZEN]),
            implausible_share=float(share[SampleState.IMPLAUSIBLE]),
            pv=stored_as(index, measured[:, 0]) if len(index) else Storage("samples", 0.0, 1.0, 0.0, 0.0, 0.0),
            op=op,
            setpoint_moves=self._moves / max(usable, 1),
            setpoint_range=float(spread[0]),
            measurement_range=float(spread[1]),
            output_range=float(spread[2]) if op is not None else None,
            output_reversals_per_hour=self._turns(output_index, outputs, op, Ti) if op is not None else None,
        )
        return replace(quality, notes=quality_notes(quality))

    def _turns(self, index: IntArray, outputs: np.ndarray, op: Storage, Ti: float | None) -> float:
        """Reversals per hour of the output, averaged over Ti / MANY, by more than what noise and rounding make."""
        size = max(round(Ti / MANY / self._interval), 1) if Ti else 1
        group = index // size
        starts = np.flatnonzero(np.diff(group, prepend=-1))
        means = np.add.reduceat(outputs[:, 0], starts) / np.diff(np.append(starts, len(group)))
        noise = fast_noise(group[starts], means)
        hours = len(index) * self._interval / 3600.0
        return reversals(means, max(3.0 * noise, 1.5 * op.step, 1e-4)) / hours


def _only(values: np.ndarray, use: np.ndarray) -> np.ndarray:
    """The values to use; no copy where that is all of them, as in most blocks."""
    return values if use.all() else values[use]
