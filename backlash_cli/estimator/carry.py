"""The cut at midnight: what one night must leave behind so that no half period is lost between two exports.

A night leaves its tail (filter states and the open half period) and its head: the samples during which the filters
still remember that they started at rest, and the first half period after that. The tail of one night run through the
head of the next gives the half periods that the uncut record would have given; the rest of the night is the same
either way. Both nights may arrive in any order. As bytes (`pack`) a carry is small enough to keep for every loop and
night.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from ..half_periods import ErrorScanner, OpenHalfPeriod, Segments, segment
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

    head: (index, setpoint, measurement, usable) of the first samples. first: the half period from the end of the head
    on, as if it had begun there with a crossing; `first_end` is where it ended, None if it was still open, and
    `first_whole` says that it ended with a crossing. tail: None where no sample was usable. travel: how far the output
    moved per hour [spans/h], reversals below 0.5 % left out; None without output.
    """

    Ti: float
    Tf: float
    interval: float
    head: tuple[FloatArray, ...]
    settled: bool
    first: OpenHalfPeriod | None
    edge: tuple[int, float, float]
    first_end: float | None
    first_whole: bool
    tail: Tail | None
    travel: float | None = None

    def fits(self, other: Carry) -> bool:
        """Whether two nights ran the same filters, so that one can go on where the other ended."""
        return (self.Ti, self.Tf, self.interval) == (other.Ti, other.Tf, other.interval)


class CarryRecorder:
    """Collects a night's Carry block by block; keeps no samples after the head."""

    def __init__(self, settings: LoopSettings, interval: float) -> None:
        self.settings, self.interval = settings, interval
        self.cold = error_scanner(settings, interval)
        self.head: list[Record] = []
        self.until: int | None = None
        self.body: ErrorScanner | None = None
        self.edge: tuple[int, float, float] | None = None
        self.position: float | None = None
        self.moved, self.samples = 0.0, 0

    def update(self, block: Record) -> None:
        """Take the next block of the record."""
        self._travel(block)
        if not len(block) or (self.body is not None and len(self.body.smooth.ended)):
            return
        if self.until is None:
            assert self.settings.Ti is not None
            memory = FORGET * (self.settings.Ti / 2.0 + (self.settings.filter_time or 0.0))
            self.until = int(block.index[0]) + int(np.ceil(memory / self.interval))
        split = int(np.searchsorted(block.index, self.until))
        if split:
            self.head.append(block.slice(0, split))
            self.cold.update(self.head[-1])
        if split < len(block):
            self._go_on(block.slice(split, len(block)))

    def _go_on(self, block: Record) -> None:
        if self.body is None:
            self.body = ErrorScanner(self.cold.stages)
            self.body.go_on(self.cold.states, self.cold.last_index)
        if self.edge is None:
            usable = np.flatnonzero(block.usable & np.isfinite(block.measurement) & np.isfinite(block.setpoint))
            one = int(usable[0]) + 1 if len(usable) else len(block)
            self.body.update(block.slice(0, one))
            block = block.slice(one, len(block))
            left = self.body.smooth.open
            if left is None:
                return
            self.edge = (left.last_index, left.last_error, left.last_setpoint)
            self.body.smooth.open = replace(left, crossed=True)
        self.body.update(block)

    def _travel(self, block: Record) -> None:
        if block.output is None:
            return
        output = block.output[np.isfinite(block.output)]
        if not len(output):
            return
        from ..kernels import play

        start = float(output[0]) if self.position is None else self.position
        path = play(output, SMALLEST_MOVE, start)
        self.moved += float(np.abs(np.diff(path, prepend=start)).sum())
        self.samples += len(output)
        self.position = float(path[-1])

    def finish(self, scanner: ErrorScanner) -> Carry:
        """Return the night's carry; `scanner` is the one that ran over the whole night."""
        assert self.settings.Ti is not None
        head = (
            _join(self.head, "index"), _join(self.head, "setpoint"), _join(self.head, "measurement"),
            _join(self.head, "state"),
        )
        first, end, whole = None, None, False
        if self.body is not None and self.edge is not None:
            done = self.body.smooth.ended
            if len(done):
                first = OpenHalfPeriod(int(done.direction[0]), float(done.begin[0]), True, float(done.area[0]),
                                       float(done.e_max[0]), float(done.setpoint_move[0]), 0, 0.0, 0.0)
                end, whole = float(done.end[0]), bool(done.complete[0])
            else:
                first = self.body.smooth.open
        tail = None
        if scanner.states:
            tail = Tail(scanner.smooth.open, tuple(scanner.states), scanner.last_index)
        return Carry(self.settings.Ti, self.settings.filter_time or 0.0, self.interval, head,
                     self.body is not None, first, self.edge or (0, 0.0, 0.0), end, whole, tail,
                     self.moved / (self.samples * self.interval / 3600.0) if self.samples else None)


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
    scanner.go_on(tail.states, tail.last_index + shift)
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
    at, error, sp = night.edge
    closed, left = segment(np.array([error]), np.array([sp]), np.array([at]), scanner.smooth.open)
    assert left is not None
    first = night.first
    merged = replace(left, sign=first.sign, area=left.area + first.area, e_max=max(left.e_max, first.e_max),
                     move=left.move + first.move, last_index=first.last_index, last_error=first.last_error,
                     last_setpoint=first.last_setpoint)
    done = Segments.join([scanner.smooth.ended, closed])
    if night.first_end is None:
        own = night.tail
        return done, None, None if own is None else Tail(merged, own.states, own.last_index)
    whole = Segments(np.array([merged.begin]), np.array([night.first_end]), np.array([merged.area]),
                     np.array([merged.e_max]), np.array([merged.sign], np.int64), np.array([merged.move]),
                     np.array([merged.crossed and night.first_whole]))
    return Segments.join([done, whole]), night.first_end, None


def _join(blocks: list[Record], name: str) -> FloatArray:
    return np.concatenate([np.zeros(0), *(getattr(b, name).astype(float) for b in blocks)])


def pack(value: Carry) -> bytes:
    """Return `value` as bytes: MessagePack, compressed; the same value gives the same bytes."""
    return zlib.compress(msgspec.msgpack.encode(value, enc_hook=lambda array: array.astype("<f8").tobytes()), 6)


def unpack(data: bytes) -> Carry:
    """Return the Carry that `pack` made bytes of."""
    return msgspec.msgpack.decode(zlib.decompress(data), type=Carry, dec_hook=_array)


def _array(kind: type, data: bytes) -> FloatArray:
    return np.frombuffer(data, dtype="<f8").copy()
