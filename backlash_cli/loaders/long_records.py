"""Records longer than memory should hold, made piece by piece: the same samples, states and notes as `build_record`.

What concerns the record as a whole (its grid, spans, frozen stretches, notes) is found out first, by going through the
loop some times. Only stamps out of order and columns that are in memory anyway leave it to `build_record`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..record import Note, Record
from .clean import NO_OUTPUT, no_measurement, refuse_missing, without_setpoint
from .even import LONG
from .frame import MODE_EMPTY, mode_before
from .long_frames import LongFrames, long_frames
from .loop_settings import Settings, settings_of
from .pieces import MARGIN, NotInPieces, Piece, in_blocks, length, with_margins
from .ranks import StreamValues
from .recipes import Recipe
from .samples import Counts, Samples
from .scaling import Spans, normalised, spans_of
from .standstill import Stretch, flags, still_stretches
from .states import Repeats
from .times import SECOND


@dataclass(frozen=True)
class LongRecord:
    """A record that is read anew by every call of `blocks`. notes: of the whole record."""

    recipe: Recipe
    signals: LongSignals
    spans: Spans
    still: list[Stretch]
    notes: tuple[Note, ...]

    def blocks(self, size: int) -> Iterator[Record]:
        """Yield the record in blocks of `size` samples."""
        plan = self.signals.frames.plan
        for piece in in_blocks(self._pieces(), size):
            yield Record(self.recipe.loop, plan.start / 1e6, plan.step / SECOND, piece["index"], piece["sp"],
                         piece["pv"], piece.get("op"), piece["state"], self.spans.settings, {}, self.notes)

    def _pieces(self) -> Iterator[Piece]:
        for samples, first, last in self.signals.marked(self.spans, self.still):
            piece: Piece = {"index": samples.index, "sp": samples.setpoint, "pv": samples.measurement,
                            "state": samples.state}
            if samples.output is not None:
                piece["op"] = samples.output
            yield {name: values[first:last] for name, values in piece.items()}


def long_record(recipe: Recipe) -> LongRecord | None:
    """Return the record of a loop as one that is read piece by piece, None where it should be read whole.

    Raises BacklashError where the loop cannot be read.
    """
    if recipe.rows <= LONG or recipe.series.extra:
        return None
    refuse_missing(recipe.series)
    settings = settings_of(recipe.values)
    try:
        frames = long_frames(recipe.series, settings, recipe.options)
    except (NotInPieces, OverflowError):
        return None
    signals = LongSignals.of(frames, settings)
    ranges = settings.pv_range, settings.op_range
    spans = spans_of(settings, signals.values("pv", "sp") if ranges[0] is None else NONE,
                     (signals.values("op") if ranges[1] is None else NONE) if signals.output else None)
    counts, repeats = Counts(), Repeats()
    for samples, first, last in signals.marked(spans, []):
        samples.count(counts, first, last)
        repeats.add(samples.measurement[first:last])
    still = still_stretches(repeats, lambda: signals.measured(spans))
    counts.frozen = sum(end - start for start, end in still)
    return LongRecord(recipe, signals, spans, still, (*recipe.notes, *signals.notes(recipe, spans, counts)))


NONE = StreamValues(lambda: iter(()))  # values that nobody asks for


@dataclass
class LongSignals:
    """The signals of a long loop, and what was seen in going through them. output: OP holds a number somewhere.

    recorded: samples at which a row stands. unknown: samples without a mode. first_mode: the first one known.
    """

    frames: LongFrames
    settings: Settings
    samples: int = 0
    recorded: int = 0
    unknown: int = 0
    first_mode: float | None = None
    output: bool = False

    @staticmethod
    def of(frames: LongFrames, settings: Settings) -> LongSignals:
        """Go through the signals once. Raises LoopError when the measurement holds no number."""
        found = LongSignals(frames, settings)
        measured = False
        for piece in frames.pieces():
            found.samples += length(piece)
            measured = measured or bool(np.isfinite(piece["pv"]).any())
            found.output = found.output or ("op" in piece and bool(np.isfinite(piece["op"]).any()))
            found.recorded += int(np.count_nonzero(piece["recorded"])) if "recorded" in piece else length(piece)
            if "mode" in piece:
                known = piece["mode"][~np.isnan(piece["mode"])]
                found.unknown += length(piece) - len(known)
                found.first_mode = float(known[0]) if found.first_mode is None and len(known) else found.first_mode
        if not measured:
            raise no_measurement()
        return found

    def values(self, *roles: str) -> StreamValues:
        """Return all finite values of some signals, as recorded."""
        held, frames = self.settings.constant_setpoint, self.frames.only(roles)

        def stream() -> Iterator[NDArray[np.float64]]:
            for piece in frames.pieces():
                for role in roles:
                    if role in piece:
                        yield piece[role]
                    elif role == "sp" and held is not None:
                        yield np.full(length(piece), held)

        return StreamValues(stream)

    def measured(self, spans: Spans) -> Iterator[NDArray[np.float64]]:
        """Yield the normalised measurement, short holes filled."""
        return (samples.measurement[first:last] for samples, first, last in self.marked(spans, []))

    def marked(self, spans: Spans, still: list[Stretch]) -> Iterator[tuple[Samples, int, int]]:
        """Yield (samples, first, last): of each, samples first..last-1 are new."""
        begin = 0
        before = mode_before(self.first_mode, self.unknown)[0]
        held = self.settings.constant_setpoint
        for piece, first, last in with_margins(self.frames.pieces(), MARGIN):
            setpoint = piece.get("sp")
            if setpoint is None and held is not None:
                setpoint = np.full(length(piece), held)
            manual = None
            if "mode" in piece and self.frames.mode_known:
                manual = np.where(np.isnan(piece["mode"]), before, piece["mode"]) == 0.0
            between = ~piece["recorded"] & np.isfinite(piece["pv"]) if "recorded" in piece else None
            output = normalised(piece["op"], spans.op_range) if self.output else None
            yield Samples(
                piece["index"], None if setpoint is None else normalised(setpoint, spans.pv_range),
                normalised(piece["pv"], spans.pv_range), output, between, manual, self.frames.bridge,
                partial(flags, still, begin - first),
            ), first, last
            begin += last - first

    def notes(self, recipe: Recipe, spans: Spans, counts: Counts) -> list[Note]:
        """Return what is to be said of the record, in the order in which `build_record` says it."""
        frames, on = self.frames, self.frames.notes
        axes = [note for axis in frames.pv.axes for note in axis.notes]
        found = [*self.settings.notes, *axes, *frames.on_order, *frames.plan.notes(self.recorded / self.samples),
                 *on["pv"], *on.get("sp", ()), *on.get("op", ())]
        if "op" in on and not self.output:
            found.append(NO_OUTPUT)
        found += [*spans.notes, *counts.notes(self.samples)]
        if "sp" not in on and self.settings.constant_setpoint is None:
            found.append(without_setpoint(recipe.loop))
        found += [*counts.companion_notes(self.samples), *on.get("mode", ())]
        if "mode" in on and not frames.mode_known:
            found.append(MODE_EMPTY)
        elif "mode" in on and self.unknown:
            found.append(mode_before(self.first_mode, self.unknown)[1])
        return [*found, *counts.manual_notes(self.samples)]
