"""Samples of a normalised record and what they are good for: holes filled, every one with its state, and the tally."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..record import Note, SampleState
from .scaling import Normalised
from .states import AT_LIMIT, BEYOND, implausible, saturated, short_holes

Still = Callable[[NDArray[np.float64]], NDArray[np.bool_] | None]


@dataclass
class Counts:
    """How many samples of a record are what."""

    wild: int = 0
    filled: int = 0
    frozen: int = 0
    saturated: int = 0
    missing: int = 0
    setpoint: int = 0
    output: int = 0
    manual: int = 0

    def notes(self, samples: int) -> list[Note]:
        """Say what is wrong with measurement and output, of so many samples."""
        found = []
        if self.wild > 0.5 * samples:
            text = f"{100 * self.wild / samples:.0f} % of the measurement lies far outside pv_range: check it"
            found.append(Note("outside_range", text))
        elif self.wild:
            what = "samples of PV far outside the range (spikes) were rejected"
            found.append(_counted("implausible", self.wild, what))
        if self.filled:
            found.append(_counted("filled", self.filled, "samples in short holes were interpolated"))
        why = "repeat one number for too long (PV constant or frozen)"
        return [*found, *_marked("frozen", self.frozen, samples, why),
                *_marked("saturated", self.saturated, samples, "have the output at its limit"),
                *_marked("missing", self.missing, samples, "have no measurement")]

    def companion_notes(self, samples: int) -> list[Note]:
        """Say where setpoint or output are missing."""
        return [*_marked("setpoint_missing", self.setpoint, samples, "have no setpoint"),
                *_marked("output_missing", self.output, samples, "have no output")]

    def manual_notes(self, samples: int) -> list[Note]:
        """Say how long the controller was not in automatic."""
        return _marked("manual", self.manual, samples, "are not in automatic")


class Samples:
    """Samples of one loop on its grid, all (samples,). index: grid numbers. sp, pv, op: None where not recorded.

    interpolated: the measurement was not recorded there. manual: not in automatic. bridge: longest hole in samples that
    is filled. still: tells where the measurement stands still for too long.
    After it is made, holes of `measurement` are filled, `state` says what each sample is, `count` how many are what.
    """

    def __init__(
        self, index: NDArray[np.int64], sp: Normalised | None, pv: Normalised, op: Normalised | None,
        interpolated: NDArray[np.bool_] | None, manual: NDArray[np.bool_] | None, bridge: int, still: Still,
    ) -> None:
        self.index = index
        self.setpoint = np.full(len(index), np.nan) if sp is None else sp.values
        self.output = None if op is None else op.values
        self.state = np.zeros(len(index), np.uint8)
        self._marks: dict[str, NDArray[np.bool_]] = {}
        self.measurement = self._measured(pv, op, interpolated, bridge, still)
        if sp is not None and not sp.complete:
            self._mark("setpoint", ~np.isfinite(sp.values), SampleState.MISSING)
        if op is not None and not op.complete:
            self._mark("output", ~np.isfinite(op.values), SampleState.MISSING)
        if manual is not None:
            there = (self.state != SampleState.MISSING) & (self.state != SampleState.IMPLAUSIBLE)
            self._mark("manual", manual & there, SampleState.MANUAL)

    def count(self, counts: Counts, first: int = 0, last: int | None = None) -> Counts:
        """Add to the counts what the samples first..last-1 are."""
        for name, where in self._marks.items():
            setattr(counts, name, getattr(counts, name) + int(np.count_nonzero(where[first:last])))
        return counts

    def _measured(
        self, pv: Normalised, op: Normalised | None, interpolated: NDArray[np.bool_] | None, bridge: int, still: Still
    ) -> NDArray[np.float64]:
        y = pv.values
        near = pv.complete and pv.low >= -BEYOND and pv.high <= 1.0 + BEYOND
        wild = None if near else implausible(y)
        if wild is not None:
            y = np.where(wild, np.nan, y)
            self._marks["wild"] = wild
        lost = not pv.complete or wild is not None
        if lost:
            y, filled = short_holes(y, self.index, bridge)
            self._mark("filled", filled, SampleState.FILLED)
        if interpolated is not None:
            self.state[interpolated] = SampleState.FILLED
        frozen = still(y)
        if frozen is not None:
            self._mark("frozen", frozen, SampleState.FROZEN)
        if op is not None and not (op.complete and op.low > AT_LIMIT and op.high < 1.0 - AT_LIMIT):
            limit = saturated(op.values)
            if limit is not None:
                self._mark("saturated", limit, SampleState.SATURATED)
        if lost:
            missing = ~np.isfinite(y)
            if wild is not None:
                self.state[missing & wild] = SampleState.IMPLAUSIBLE
                missing &= ~wild
            self._mark("missing", missing, SampleState.MISSING)
        return y

    def _mark(self, what: str, where: NDArray[np.bool_], value: SampleState) -> None:
        self.state[where] = value
        self._marks[what] = where


def _counted(code: str, count: int, what: str) -> Note:
    return Note(code, f"{count} {what}", {"samples": float(count)})


def _marked(code: str, count: int, samples: int, what: str) -> list[Note]:
    if not count:
        return []
    return [Note(code, f"{count} of {samples} samples {what}; not used", {"samples": float(count)})]
