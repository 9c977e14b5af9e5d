"""The cut at midnight: what one night must leave behind so that no half period is lost between two exports.

A night leaves its tail (filter states and the open half period) and its head: the samples up to the first end of a half
period at which the filters have forgotten that they started at rest. The tail of one night run through the head of the
next gives the half periods that the uncut record would have given; those after it are the same either way. Both nights
may arrive in any order. Only a night that stays on one side of the setpoint throughout is kept as a whole."""

import math
import zlib
from dataclasses import replace
from typing import Self

import msgspec
import numpy as np

from ..half_periods import ErrorScanner, OpenHalfPeriod, Segments
from ..record import PIECE, FloatArray, Frozen, LoopSettings, Record
from .haegglund import error_scanner

FORGET = 25.0  # after 25 time constants a start at rest is forgotten: (1 + x) exp(-x) = 4e-10
SMALLEST_MOVE = 0.005  # reversals of the output within 0.5 % of span do not move a valve
NEAR = 1e-3  # samples: crossings so close are the same one


class Tail(Frozen, eq=False):
    """State of the error scanner after the last sample; positions on the grid of its night."""

    open: OpenHalfPeriod | None
    states: tuple[FloatArray, ...]
    last_index: int


class Carry(Frozen, eq=False):
    """What one night leaves behind. Positions are on its own grid.

    head: (index, setpoint, measurement, state) of the first samples. tail: None where no sample was usable. travel: how
    far the output moved per hour [spans/h], reversals below 0.5 % left out; None without one. until: where the half
    periods that are the night's own begin; None if all depend on the night before. In old histories all are its own."""

    Ti: float
    Tf: float
    interval: float
    head: tuple[FloatArray, ...]
    tail: Tail | None
    travel: float | None = None
    until: float | None = -math.inf

    def fits(self, other: Self) -> bool:
        """Whether two nights ran the same filters, so that one can go on where the other ended."""
        return (self.Ti, self.Tf, self.interval) == (other.Ti, other.Tf, other.interval)


def carry_of(record: Record, settings: LoopSettings, scanner: ErrorScanner) -> Carry:
    """Return what the record of one night leaves behind; `scanner` is the one that ran over it."""
    Ti, Tf = settings.Ti or 0.0, settings.filter_time or 0.0
    sure = int(record.index[0]) + int(np.ceil(FORGET * (Ti / 2.0 + Tf) / record.interval))
    again, at, begins = error_scanner(settings, record.interval), 0, np.zeros(0)
    while at < len(record) and not len(begins):
        again.update(record.slice(at, at + PIECE))
        begins = again.smooth.finish().begin
        at, begins = at + PIECE, begins[begins >= sure]
    counts = record.usable & np.isfinite(record.measurement + record.setpoint)
    none_later = record.index[-1] >= sure and not counts[record.index >= sure].any()
    until = float(begins[0]) if len(begins) else sure if none_later else None
    # the sample behind a crossing shows it
    head = record if until is None else record.slice(0, int(np.searchsorted(record.index, until, "right")) + 1)
    tail = Tail(scanner.smooth.open, tuple(scanner.states), scanner.last_index) if scanner.states else None
    columns = tuple(x.astype(float) for x in (head.index, head.setpoint, head.measurement, head.state))
    return Carry(Ti, Tf, record.interval, columns, tail, _travel(record), until)


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
    depends on the night before (None: its own holds)."""
    scanner = error_scanner(LoopSettings(K=1.0, Ti=night.Ti, Tf=night.Tf), night.interval)
    scanner.smooth.open = None if tail.open is None else replace(
        tail.open, begin=tail.open.begin + shift, last_index=tail.open.last_index + shift)
    scanner.states, scanner.last_index = list(tail.states), tail.last_index + shift
    index, setpoint, measurement, state = night.head
    new = index > scanner.last_index
    scanner.update(Record("", 0.0, night.interval, index[new].astype(np.int64), setpoint[new], measurement[new], None,
                          state[new].astype(np.uint8)))
    done = Segments.join(scanner.smooth.parts)
    if night.until is None:
        return done, None, Tail(scanner.smooth.open, tuple(scanner.states), scanner.last_index)
    return done.select(done.begin < night.until - NEAR), night.until, None


def pack(value: Carry) -> bytes:
    """Return `value` as bytes: MessagePack, compressed; the same value gives the same bytes."""
    return zlib.compress(msgspec.msgpack.encode(value, enc_hook=lambda array: array.astype("<f8").tobytes()), 6)


def unpack(data: bytes) -> Carry:
    """Return the Carry that `pack` made bytes of."""
    return msgspec.msgpack.decode(zlib.decompress(data), type=Carry,
                                  dec_hook=lambda kind, array: np.frombuffer(array, dtype="<f8").copy())
