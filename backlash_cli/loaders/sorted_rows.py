"""Signals of a long record whose stamps do not rise, brought into time order through a temporary file.

What `ordered` does with stamps in memory: unreadable and far-off ones are left out, a clock that was set back is moved
on, rows out of order are sorted, repeated ones dropped. The notes are the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..record import Note
from . import pieces as flow
from .order import OUTLIER_SHARE, far_off, outliers, set_back, sorted_note, sunday_night, unreadable
from .pieces import NotInPieces, in_step
from .ranks import StreamValues
from .repeats import repeated
from .row_streams import Rows, Stream, by_parts, by_time, each_once, repeats_of, whole_stamps
from .series import LazyAxis
from .signal_pieces import PieceSignal, is_bad
from .steps import StepTally
from .store import ColumnStore, Room
from .times import DAY, NAT, Times


def arranged(signals: dict[str, PieceSignal]) -> tuple[dict[str, PieceSignal], tuple[Note, ...]]:
    """Return signals by role with rising stamps, the measurement ("pv") first; and what is to be said of its stamps.

    Signals that stand in the same rows stay together; the first of them tells repeated rows from others. Raises
    NotInPieces where they have to be seen as a whole.
    """
    groups: list[list[str]] = []
    for role, signal in signals.items():
        own = next((group for group in groups if signal.beside(signals[group[0]])), None)
        groups.append([role]) if own is None else own.append(role)
    found: dict[str, PieceSignal] = {}
    said: tuple[Note, ...] = ()
    for group in groups:
        rising, notes = _rising([signals[role] for role in group])
        found.update(zip(group, rising, strict=True))
        said = notes if group[0] == "pv" else said
    return {role: found[role] for role in signals}, said


def _rising(signals: Sequence[PieceSignal]) -> tuple[Sequence[PieceSignal], tuple[Note, ...]]:
    rows = _Kept(signals)
    notes = [*rows.notes]
    if rows.strictly and not notes:
        return signals, ()
    stream: Stream = rows.stream
    low, high, count = rows.ends()
    if count < 2 or low == high:
        raise NotInPieces
    back, before_after, at_part = rows.steps_back(max(3, count // 2000))
    if back:
        in_order = partial(by_time, by_parts(stream, count))
        moved = None
        if len(before_after) == back and not at_part:
            moved = _clock_set_back(rows, before_after, in_order)
        if moved is None:
            notes.append(sorted_note(back))
            stream = in_order
        else:
            stream, more = moved
            notes += more
    stream = partial(whole_stamps, stream)
    again, conflicts, differing = repeats_of(stream)
    if again:
        if differing > 0.5:
            raise NotInPieces
        notes.append(repeated(again, conflicts))
        stream = partial(each_once, stream)
    kept = ColumnStore(Room(0))
    for piece in stream():
        kept.add(np.stack([piece[0].view(np.float64), *piece[1:]]))
    first = signals[0].axes[0]
    axis = LazyAxis(lambda: Times(kept.column(0).view(np.int64), first.absolute, first.zoned), first.zoned, first.where,
                    lambda: (part.view(np.int64) for part in kept.parts(0)), 0, first.absolute,
                    tuple(note for one in signals[0].axes for note in one.notes))
    return [replace(signal, axes=(axis,), values=partial(kept.parts, 1 + slot), spoilt=spoilt)
            for slot, (signal, spoilt) in enumerate(zip(signals, rows.spoilt, strict=True))], tuple(notes)


class _Kept:
    """Rows of signals in file order whose stamps count. notes: on those that do not. strictly: all do, and they rise.

    spoilt: of each signal, whether a cell is no good measurement, in rows that do not count too.
    """

    def __init__(self, signals: Sequence[PieceSignal]) -> None:
        self.signals, self.notes = signals, list[Note]()
        self.spoilt = [any(is_bad(values).any() for values in signal.values()) for signal in signals]
        rows, missing, first = 0, 0, -1
        tally_low, tally_high, last = np.iinfo(np.int64).max, NAT, NAT
        self.strictly = True
        for stamps in signals[0].stamps():
            unknown = np.flatnonzero(stamps == NAT)
            first = rows + int(unknown[0]) if len(unknown) and first < 0 else first
            rows, missing = rows + len(stamps), missing + len(unknown)
            known = stamps if not len(unknown) else stamps[stamps != NAT]
            if not len(known):
                continue
            self.strictly &= known[0] > last and not np.any(np.diff(known) <= 0)
            last = int(known[-1])
            tally_low, tally_high = min(tally_low, int(known.min())), max(tally_high, int(known.max()))
        if missing:
            axes = signals[0].axes
            self.notes.append(unreadable(missing, first, axes[0].first_line if len(axes) == 1 else 0))
        self._low, self._high, self._known = tally_low, tally_high, rows - missing
        self._drop_outliers()

    def _drop_outliers(self) -> None:
        if self._known < 20 or self._high - self._low <= 2 * DAY:
            return
        values = StreamValues(lambda: (stamps.astype(np.float64) for stamps in self._stamps()))
        low, middle, high = values.quantiles([0.05, 0.5, 0.95])
        reach = far_off(low, high)
        shown, count = np.zeros(0, np.int64), 0
        for stamps in self._stamps():
            far = stamps[np.abs(stamps.astype(np.float64) - middle) > reach]
            shown, count = np.concatenate([shown, far])[:3], count + len(far)
        if not 0 < count <= max(3, OUTLIER_SHARE * self._known):
            return
        self.notes.append(outliers(count, shown))
        self._low, self._high = int(np.ceil(middle - reach)), int(np.floor(middle + reach))
        self._known -= count

    def _stamps(self) -> Iterator[NDArray[np.int64]]:
        return (stamps[self._counts(stamps)] for stamps in self.signals[0].stamps())

    def _counts(self, stamps: NDArray[np.int64]) -> NDArray[np.bool_]:
        return (stamps != NAT) & (stamps >= self._low) & (stamps <= self._high)

    def stream(self) -> Iterator[Rows]:
        """Yield the rows that count, some at a time."""
        for rows in in_step([self.signals[0].stamps(), *(signal.values() for signal in self.signals)]):
            keep = self._counts(rows[0])
            yield rows if keep.all() else tuple(part[keep] for part in rows)

    def ends(self) -> tuple[int, int, int]:
        """Return (earliest stamp, latest stamp, rows)."""
        known = [(int(stamps.min()), int(stamps.max())) for stamps in self._stamps() if len(stamps)]
        return min(a for a, _ in known), max(b for _, b in known), self._known

    def steps_back(self, most: int) -> tuple[int, list[tuple[int, int, int]], bool]:
        """Return (number of steps back, (row, stamp before, stamp after) of each unless there are more than `most`,
        whether one lies between two files)."""
        axes = self.signals[0].axes
        ends = set(np.cumsum([sum(map(len, flow.stamp_parts(axis))) for axis in axes[:-1]]).tolist())
        found: list[tuple[int, int, int]] = []
        count, row, at_part, last, rows = 0, 0, False, NAT, 0
        for stamps in self.signals[0].stamps():
            places = np.flatnonzero(self._counts(stamps))
            known = stamps[places]
            fell = np.flatnonzero(np.diff(known, prepend=last if rows else known[:1]) < 0)
            count += len(fell)
            if len(found) + len(fell) <= most:
                before = np.concatenate([[last], known[:-1]])
                found += [(rows + int(i), int(before[i]), int(known[i])) for i in fell]
                at_part = at_part or bool(ends & set((row + places[fell]).tolist()))
            row, rows = row + len(stamps), rows + len(known)
            last = int(known[-1]) if len(known) else last
        return count, found, at_part


def _clock_set_back(
    rows: _Kept, steps: list[tuple[int, int, int]], in_order: Stream
) -> tuple[Stream, list[Note]] | None:
    """Return the rows with stamps moved on after steps back of a clock, None where the rows are simply not in order."""
    tally = StepTally()
    for stamps, *_ in rows.stream():
        tally.add(stamps)
    counted = tally.steps()
    forward = counted.values > 0
    step = int(replace(counted, values=counted.values[forward], counts=counted.counts[forward]).median
               ) if forward.any() else 0
    _, _, differing = repeats_of(partial(whole_stamps, in_order))
    one = len(steps) == 1 and sunday_night(steps[0][1], steps[0][2], step)
    if not (differing >= 0.5 or one):
        return None
    before, after = (np.array([each[k] for each in steps], np.int64) for k in (1, 2))
    lost, notes = set_back(before, after, step)
    begins = np.array([row for row, _, _ in steps])
    later = np.concatenate([[0], np.cumsum(np.rint(lost).astype(np.int64))])

    def moved() -> Iterator[Rows]:
        first = 0
        for stamps, *values in rows.stream():
            place = np.searchsorted(begins, np.arange(first, first + len(stamps)), side="right")
            yield stamps + later[place], *values
            first += len(stamps)

    last = NAT
    for stamps, *_ in moved():
        if len(stamps) and (stamps[0] < last or np.any(np.diff(stamps) < 0)):
            return None
        last = int(stamps[-1]) if len(stamps) else last
    return moved, notes
