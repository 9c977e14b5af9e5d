"""Half periods of the control error, block by block: measurement filters, zero crossings, duration, area, peak.

A half period is complete when it begins and ends with a zero crossing of e = ysp - yf. One that touches the start of
the record, its end, a gap or a sample that must not be used is incomplete: nothing is estimated on it. From block to
block the states of the filters and the open half period are carried, so the cut into blocks does not matter.

Both filters of the method are Y_f(s) = Y(s) / (1 + s T)^2: the measurement filter (3) with T = Tf and the estimator's
own with T = Ti/2 (Haegglund 2007, eq. 3 and section 4), discretised exactly for a signal held between samples."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import scipy

from .record import PIECE, BoolArray, FloatArray, Frozen, IntArray, Record, SampleState

NOT_USED = 2  # in place of the sign of an error
MISSING, IMPLAUSIBLE, FILLED = (s.value for s in (SampleState.MISSING, SampleState.IMPLAUSIBLE, SampleState.FILLED))


class DoubleLag(Frozen):
    """Coefficients (3,) of 1/(1 + s T)^2 sampled every h seconds behind a zero-order hold; T = 0 is the identity.

    With a = exp(-h/T), r = h/T:  H(z) = ((1 - a - r a) z + a (a - 1 + r)) / (z - a)^2."""

    numerator: FloatArray
    denominator: FloatArray

    def settled(self, value: float) -> FloatArray:
        """Return the filter state (2,) that has rested at `value` for ever."""
        b, a = self.numerator, self.denominator
        # direct form II transposed at rest: z2 = (b2 - a2) v, z1 = (b1 - a1) v + z2 with unit static gain
        z2 = (b[2] - a[2]) * value
        return np.array([(b[1] - a[1]) * value + z2, z2])

    def run(self, values: FloatArray, state: FloatArray, firsts: Sequence[int] | IntArray = ()
            ) -> tuple[FloatArray, FloatArray]:
        """Filter `values` (samples,) from `state` (2,); return output and new state. firsts: places behind a hole, at
        which the filter has rested for ever."""
        parts = []
        for first, last in pairwise([0, *firsts, len(values)]):
            state = self.settled(values[first]) if first else state
            part, state = scipy.signal.lfilter(self.numerator, self.denominator, values[first:last], zi=state)
            parts.append(part)
        return parts[0] if len(parts) == 1 else np.concatenate(parts), state


def double_lag(time_constant: float, interval: float) -> DoubleLag:
    """Return the sampled filter 1/(1 + s T)^2 for T = `time_constant` [s], 0 or more, and sampling `interval` [s]."""
    if interval <= 0 or time_constant < 0:
        raise ValueError(f"need interval > 0 and time constant >= 0, got {interval} and {time_constant}")
    if time_constant == 0:
        return DoubleLag(np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    r = interval / time_constant
    a, less = float(np.exp(-r)), float(np.expm1(-r))  # a - 1, with all its digits when the sampling is fast
    return DoubleLag(np.array([0.0, -less - r * a, a * (less + r)]), np.array([1.0, -2.0 * a, a * a]))


class Segments(Frozen, eq=False):
    """Half periods of one loop, (half_periods,) arrays; positions in samples on the record's grid.

    begin, end: grid position of the two zero crossings, interpolated between samples. area: integral of |e|
    [span * samples], the error taken as straight between samples. e_max: largest |e| [span].
    direction: sign of e. setpoint_move: sum of |change of setpoint| inside [span]. complete: crossing at both ends."""

    begin: FloatArray
    end: FloatArray
    area: FloatArray
    e_max: FloatArray
    direction: IntArray
    setpoint_move: FloatArray
    complete: BoolArray

    def __len__(self) -> int:
        return len(self.begin)

    def select(self, places: object) -> "Segments":
        """Return some of them; places: numbers or a mask."""
        return Segments(*(values[places] for values in vars(self).values()))

    @staticmethod
    def join(parts: Sequence["Segments"]) -> "Segments":
        """Return the half periods of all parts, one part after the other."""
        if not parts:
            return Segments(*(np.zeros(0, kind) for kind in (float, float, float, float, np.int64, float, bool)))
        return Segments(*map(np.concatenate, zip(*(vars(p).values() for p in parts), strict=True)))


class OpenHalfPeriod(Frozen):
    """The half period that the next block goes on with."""

    sign: int
    begin: float
    crossed: bool  # began with a zero crossing
    area: float  # up to the last sample
    e_max: float
    move: float
    last_index: int
    last_error: float
    last_setpoint: float

    def ended(self) -> Segments:
        """Return it as an incomplete half period up to the last sample; none where the error was zero throughout."""
        values = (self.begin, float(self.last_index), self.area, self.e_max, self.sign, self.move, False)
        return Segments(*(np.array([x])[: abs(self.sign)] for x in values))


def behind_gaps(index: IntArray, before: int) -> BoolArray:
    """Return which places in `index` (samples,) do not follow the one before; `before` stands ahead."""
    apart = np.zeros(len(index), bool)
    if index[-1] - before != len(index):  # strictly increasing: else nothing is left out
        apart[0], apart[1:] = index[0] != before + 1, index[1:] != index[:-1] + 1
    return apart


def segment(error: FloatArray, setpoint: FloatArray, index: IntArray, open_: OpenHalfPeriod | None,
            least: tuple[float, float] = (0.0, 0.0), use: BoolArray | None = None
            ) -> tuple[Segments, OpenHalfPeriod | None, int]:
    """Cut a block of samples into half periods.

    error, setpoint: (samples,) [span]. index: (samples,) grid positions, strictly increasing; a jump ends a half
    period, and so does a sample that is not to `use` (None: all are). open_: what the previous block left open. Returns
    the half periods that ended inside this block, the one left open, if the last sample is used, and the number of
    complete ones below the least area [span samples] or length [samples]."""
    if not len(error):
        return Segments.join([]), open_, 0
    if open_ is None:  # as if the first error had stood there one sample before, less the area of that step
        first = float(error[0]) if use is None or use[0] else 0.0
        open_ = OpenHalfPeriod(int(np.sign(first)), float(index[0]), False, -abs(first), abs(first), 0.0,
                               int(index[0]) - 1, first, float(setpoint[0]))
    o, n = open_, len(error)
    size, sign = np.empty(n + 1), np.empty(n + 1, dtype=np.int8)  # of the last sample before the block as well
    size[0], sign[0] = abs(o.last_error), o.sign
    np.abs(error, out=size[1:])
    np.subtract((error > 0.0).view(np.int8), (error < 0.0).view(np.int8), out=sign[1:])
    apart = behind_gaps(index, o.last_index)
    if use is not None and not use.all():  # what is not used is a stretch of its own, in no direction
        size[1:][~use], sign[1:][~use] = 0.0, NOT_USED
        apart |= np.diff(use, prepend=True)
    if not sign.all():  # an exact zero belongs to the half period before it
        known = (sign != 0) | np.append(True, apart)
        sign = sign[np.maximum.accumulate(np.where(known, np.arange(n + 1), 0))]
    ends = np.flatnonzero((sign[1:] * sign[:-1] < 0) | apart)  # last sample of each that ends
    firsts, crossed, before, behind = np.append(0, ends + 1), ~apart[ends], size[ends], size[ends + 1]
    # how much of the step to the next sample lies before the error crosses zero; both triangles have the same area
    share = np.divide(before, before + behind, out=np.zeros(len(ends)), where=crossed)
    area, triangle = np.add.reduceat(size, firsts), behind * share
    area[0] += o.area - 0.5 * size[0]
    area[-1] -= 0.5 * size[n]
    area[:-1] -= 0.5 * np.where(crossed, triangle, before)
    area[1:] -= 0.5 * np.where(crossed, triangle, behind)
    end = np.where(ends > 0, index[ends - 1], o.last_index) + share
    begin, began = np.append(o.begin, np.where(crossed, end, index[ends])), np.append(o.crossed, crossed)
    complete, direction = began[:-1] & crossed, sign[ends].astype(int)
    small = complete & ((area[:-1] < least[0]) | (end - begin[:-1] < least[1]))
    kept = np.flatnonzero((np.abs(direction) == 1) & ~small)
    # only of those that are kept, and of the one left open: what lies between two of them is one piece for `reduceat`
    cuts, size[0] = np.append(firsts[kept[:, None] + [0, 1]], firsts[-1]), o.e_max
    peak, moved = np.maximum.reduceat(size, cuts)[::2], np.where(cuts[::2] == 0, o.move, 0.0)
    if (setpoint != o.last_setpoint).any():
        steps = np.abs(np.diff(setpoint, prepend=o.last_setpoint))
        moved += np.add.reduceat(np.append(0.0, np.where(apart, 0.0, steps)), cuts)[::2]
    done = Segments(begin[kept], end[kept], area[kept], peak[:-1], direction[kept], moved[:-1], complete[kept])
    left = OpenHalfPeriod(int(sign[-1]), float(begin[-1]), bool(began[-1]), float(area[-1]), float(peak[-1]),
                          float(moved[-1]), int(index[-1]), float(error[-1]), float(setpoint[-1]))
    return done, left if use is None or use[-1] else None, int(np.count_nonzero(small))


class ErrorTrack:
    """Half periods of one error signal: those that have ended, and the open one. Most complete ones below least, an
    area [span samples] and a length [samples], are counted and not kept."""

    def __init__(self, least: tuple[float, float]) -> None:
        self.open: OpenHalfPeriod | None = None
        self.left_out = 0
        self._least = least
        self.parts: list[Segments] = []  # those that have ended

    def update(self, error: FloatArray, setpoint: FloatArray, index: IntArray, use: BoolArray | None) -> None:
        """Take the next samples; see `segment`."""
        done, self.open, left_out = segment(error, setpoint, index, self.open, self._least, use)
        self.left_out += left_out
        self.parts.append(done)

    def finish(self) -> Segments:
        """All half periods, the open one as incomplete."""
        return Segments.join(self.parts if self.open is None else [*self.parts, self.open.ended()])


class ErrorScanner:
    """Filters the measurement block by block and cuts two errors into half periods.

    `plain` is the error after the measurement filter (3), for the oscillation detector; `smooth` after the second
    filter of Ti/2 as well, for the estimator. The filters run on through manual operation and saturation, where PV
    is still true, and start afresh at rest after a hole. Half periods end at any sample that must not be used.

    least: area of plain and length of smooth half periods, see ErrorTrack."""

    def __init__(self, stages: tuple[DoubleLag, DoubleLag], least: tuple[float, float] = (0.0, 0.0)) -> None:
        self.stages = stages
        self.states: list[FloatArray] = []  # of each filter; none before the first sample
        self.last_index = 0  # position of the last sample that went through the filters
        self.plain, self.smooth = ErrorTrack((least[0], 0.0)), ErrorTrack((0.0, least[1]))

    def update(self, block: Record) -> None:
        """Take the next block of the record."""
        for first in range(0, len(block), PIECE):
            cut = slice(first, first + PIECE)
            index, state, setpoint, pv = block.index[cut], block.state[cut], block.setpoint[cut], block.measurement[cut]
            known = np.isfinite(pv) & (state != MISSING) & (state != IMPLAUSIBLE)
            if not known.all():
                index, setpoint, pv, state = index[known], setpoint[known], pv[known], state[known]
            if not len(index):
                continue
            if not self.states or index[0] != self.last_index + 1:
                self.states = [stage.settled(pv[0]) for stage in self.stages]
            holes = np.flatnonzero(behind_gaps(index, int(index[0]) - 1))
            plain, self.states[0] = self.stages[0].run(pv, self.states[0], holes)
            smooth, self.states[1] = self.stages[1].run(plain, self.states[1], holes)
            self.last_index = int(index[-1])
            use = (state <= FILLED) & np.isfinite(setpoint)
            self.plain.update(np.subtract(setpoint, plain, out=plain), setpoint, index, use)
            self.smooth.update(np.subtract(setpoint, smooth, out=smooth), setpoint, index, use)
