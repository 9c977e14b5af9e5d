"""Controller settings read from the record itself: which K, Ti and Td make this output from these signals?

The ideal PID of the paper (2) is linear in K, K/Ti, K Td and the setpoint weight once the measurement filter (3)
is known. It is fitted in its level form, with one offset per window of about ten Ti, so that a recorder's rounding
is averaged out and slow changes from outside do not matter; the filter time is searched for. What the record cannot
settle (filter, scan rate of the controller) widens the intervals.

    identify(record) -> Identification | Note          IdentifyScanner(interval).update(block) ... finish()

A Note says why the settings cannot be read: no_output, output_constant, too_short, not_this_controller,
proportional_part_unseen.
An Identification may carry notes: gain_uncertain, sampling_too_coarse, interpolated, one_frequency; `separate` is
False where only K/Ti is to be relied on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..record import Note, Record, SampleState
from .stretches import StretchSample

if TYPE_CHECKING:
    from .identification import Identification

LEVELS = 5  # ever slower pictures of the record that are kept
SLOWER = 4  # rows of one picture in a row of the next: 1, 4, 16, 64, 256 samples
LEAST_ROWS = 60
MOSTLY_OWN = 0.2  # share of interpolated samples that leaves the P part visible


def identify(record: Record) -> Identification | Note:
    """Read K, Ti, Td and setpoint weight of the controller from setpoint, measurement and output of one loop."""
    scanner = IdentifyScanner(record.interval)
    scanner.update(record)
    return scanner.finish()


class IdentifyScanner:
    """The same block by block, in bounded memory; the result does not depend on where the record is cut."""

    def __init__(self, interval: float) -> None:
        self._interval = interval
        self._levels = [StretchSample(SLOWER if level else 1, 3) for level in range(LEVELS)]
        self._output_seen = False
        self._low, self._high = np.inf, -np.inf
        self._used = self._filled = 0

    def update(self, block: Record) -> None:
        """Take in the next block of the loop; only usable samples count."""
        if block.output is None:
            return
        use = block.usable & np.isfinite(block.setpoint + block.measurement + block.output)
        used = int(np.count_nonzero(use))
        self._output_seen = self._output_seen or used > 0 or bool(np.isfinite(block.output).any())
        if not used:
            return
        self._used += used
        self._filled += int(np.count_nonzero(use & (block.state == SampleState.FILLED)))
        values = np.column_stack([block.setpoint, block.measurement, block.output])
        index = block.index
        if used < len(use):
            index, values = index[use], values[use]
        self._low, self._high = min(self._low, values[:, 2].min()), max(self._high, values[:, 2].max())
        for level in self._levels:
            index, values = level.update(index, values)

    def finish(self) -> Identification | Note:
        """Return the settings, or a Note that says why they cannot be read."""
        from .control_law import LawRows
        from .law_search import find_settings

        if not self._output_seen:
            return Note("no_output", "the record has no controller output, so K and Ti cannot be read from it")
        if self._low == self._high:
            return Note("output_constant", "the controller output never moves, so K and Ti cannot be read from it")
        levels = []
        for number, level in enumerate(self._levels):
            index, values = level.rows()
            if len(index) >= LEAST_ROWS:
                levels.append(LawRows(index, values, self._interval * SLOWER**number))
        if not levels:
            return Note(
                "too_short", f"fewer than {LEAST_ROWS} usable samples with output: K and Ti cannot be read from them"
            )
        found = find_settings(levels, self._interval)
        if isinstance(found, Note) or self._filled <= MOSTLY_OWN * self._used:
            return found
        share = self._filled / self._used
        message = f"{100 * share:.0f} % of the samples are interpolated: only K/Ti is known"
        return replace(found, notes=(*found.notes, Note("interpolated", message, {"share": share})))
