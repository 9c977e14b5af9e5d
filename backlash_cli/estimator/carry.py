"""The cut at midnight: what one night must leave behind so that no half period is lost between two exports.

A night leaves its tail (filter states and the open half period) and its head: the samples during which the filters
still remember that they started at rest, and the first half period after that. The tail of one night run through the
head of the next gives the half periods that the uncut record would have given; the rest of the night is the same
either way. Both nights may arrive in any order, and a carry is small enough to keep for every loop and night.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from ..half_periods import PIECE, ErrorScanner, ErrorTrack, OpenHalfPeriod, Segments
from ..record import FloatArray, LoopSettings, Record
from .haegglund import error_scanner

FORGET = 25.0  # after 25 time constants a start at rest is forgotten: (1 + x) exp(-x) = 4e-10
SMALLEST_MOVE = 0.005  # reversals of the output within 0.5 % of span do not move a valve


@dataclass(frozen=True, eq=False)
class Tail:
    """State of the error scanner after the last sample; positions on the grid of its night."""

    open: OpenHalfPeriod | None
    states: tuple[FloatArray, ...]
    last_index: int


@dataclass(frozen=True, eq=False)
class Carry:
    """What one night leaves behind. Positions are on its own grid.

    head: (index, setpoint, measurement, state) of the first samples; before the last of them the filters have forgotten
    how they started. first: the half period from there on, as if it had begun with a crossing; `first_end` is where it
    ended, None if it was still open, and `first_whole` says that it ended with a crossing. tail: None where no sample
    was usable. travel: how far the output moved per hour [spans/h], reversals below 0.5 % left out; None without one.
    """

    Ti: float
    Tf: float
    interval: float
    head: tuple[FloatArray, ...]
    settled: bool
    first: OpenHalfPeriod | None
    first_end: float | None
    first_whole: bool
    tail: Tail | None
    travel: float | None = None

    def fits(self, other: Carry) -> bool:
        """Whether two nights ran the same filters, so that one can go on where the other ended."""
        return (self.Ti, self.Tf, self.interval) == (other.Ti, other.Tf, other.interval)


def carry_of(record: Record, settings: LoopSettings, scanner: ErrorScanner) -> Carry:
    """Return what the record of one night leaves behind; `scanner` is the one that ran over it."""
    Ti, Tf = settings.Ti or 0.0, settings.filter_time or 0.0
    until = int(record.index[0]) + int(np.ceil(FORGET * (Ti / 2.0 + Tf) / record.interval))
    split = at = int(np.searchsorted(record.index, until))
    known = record.usable[split:] & np.isfinite(record.measurement[split:] + record.setpoint[split:])
    if known.any():  # the head ends with a sample that counts
        at += int(np.argmax(known)) + 1
    head, body = record.slice(0, at), error_scanner(settings, record.interval)
    body.update(head)
    first, end, whole, begun = None, None, False, body.smooth.open
    if known.any() and begun is not None:
        body.smooth = ErrorTrack()
        body.smooth.open = replace(begun, begin=float(begun.last_index), crossed=True, area=0.0,
                                   e_max=abs(begun.last_error), move=0.0)
        while at < len(record) and not len(body.smooth.ended):
            body.update(record.slice(at, at + PIECE))
            at += PIECE
        first, done = body.smooth.open, body.smooth.ended
        if len(done):
            first = OpenHalfPeriod(int(done.direction[0]), float(done.begin[0]), True, float(done.area[0]),
                                   float(done.e_max[0]), float(done.setpoint_move[0]), 0, 0.0, 0.0)
            end, whole = float(done.end[0]), bool(done.complete[0])
    tail = Tail(scanner.smooth.open, tuple(scanner.states), scanner.last_index) if scanner.states else None
    columns = tuple(x.astype(float) for x in (head.index, head.setpoint, head.measurement, head.state))
    return Carry(Ti, Tf, record.interval, columns, split < len(record), first, end, whole, tail, _travel(record))


def _travel(record: Record) -> float | None:
    """How far the output moved per hour [spans/h]."""
    output = np.zeros(0) if record.output is None else record.output[np.isfinite(record.output)]
    if not len(output):
        return None
    from ..kernels import play

    path = play(output, SMALLEST_MOVE, output[0])
    return float(np.abs(np.diff(path)).sum()) / (len(output) * record.interval / 3600.0)


def resume(tail: Tail, night: Carry, shift: int) -> tuple[Segments, float | None, Tail | None]:
    """Go on from the `tail` of the night before through the head of `night`.

    shift: grid position of the earlier night's index 0 on the grid of `night`. Returns the half periods that ended,
    the grid position up to which they replace those of `night` (None: all of them), and the tail of `night` where it
    depends on the night before (None: its own holds).
    """
    settings = LoopSettings(K=1.0, Ti=night.Ti, Tf=night.Tf)
    scanner = error_scanner(settings, night.interval)
    scanner.smooth.open = None if tail.open is None else replace(
        tail.open, begin=tail.open.begin + shift, last_index=tail.open.last_index + shift)
    scanner.states, scanner.last_index = list(tail.states), tail.last_index + shift
    index, setpoint, measurement, state = night.head
    new = index > tail.last_index + shift
    scanner.update(Record("", 0.0, night.interval, index[new].astype(np.int64), setpoint[new], measurement[new], None,
                          state[new].astype(np.uint8)))
    if not night.settled:
        left_over = Tail(scanner.smooth.open, tuple(scanner.states), scanner.last_index)
        return scanner.smooth.ended, None, left_over
    if night.first is None:
        done = scanner.smooth.ended
        return done, float(index[-1]) if len(index) else 0.0, None
    left, first, done = scanner.smooth.open, night.first, scanner.smooth.ended
    assert left is not None
    merged = replace(first, begin=left.begin, crossed=left.crossed, area=left.area + first.area,
                     e_max=max(left.e_max, first.e_max), move=left.move + first.move)
    if night.first_end is None:
        own = night.tail
        return done, None, None if own is None else Tail(merged, own.states, own.last_index)
    whole = merged.ended(night.first_end, merged.crossed and night.first_whole)
    return Segments.join([done, whole]), night.first_end, None


def pack(value: Carry) -> bytes:
    """Return `value` as bytes: MessagePack, compressed; the same value gives the same bytes."""
    return zlib.compress(msgspec.msgpack.encode(value, enc_hook=lambda array: array.astype("<f8").tobytes()), 6)


def unpack(data: bytes) -> Carry:
    """Return the Carry that `pack` made bytes of."""
    return msgspec.msgpack.decode(zlib.decompress(data), type=Carry,
                                  dec_hook=lambda kind, array: np.frombuffer(array, dtype="<f8").copy())
