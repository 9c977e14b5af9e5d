"""A uniform grid for stamps that are nearly, or by intention not, uniform.

regular: the stamps lie on a grid; rows are put at their grid number, nothing is interpolated.
jitter: at least 90 % of the spacings lie within 0.3 to 1.7 of the usual one; values are interpolated to the grid.
compressed: the historian left rows out (exception or swinging-door compression); values in between are taken as
the historian means it. Anything else is refused.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import Note
from .order import Ordered
from .times import SECOND

MAX_HOLE = 5  # absent samples that may be bridged when nothing else is known
ABSENT_ROWS = 60  # absent samples that get rows of their own; more is a gap
SPARSE_SHARE = 0.15  # share of spacings longer than one interval that means compression, not loss
GAP_FACTOR = 5.0  # of the 99 % spacing: the longest that compressed data may bridge
MAX_GROWTH = 200  # grid points per recorded row
JITTER = (0.3, 1.7)
_NICE = np.array(
    [
        1,
        2,
        3,
        4,
        5,
        6,
        8,
        10,
        12,
        15,
        20,
        25,
        30,
        40,
        50,
        60,
        80,
        90,
        100,
        120,
        150,
        180,
        200,
        240,
        250,
        300,
        360,
        400,
        450,
        480,
        500,
        600,
        720,
        750,
        800,
        900,
        1000,
    ]
)


@dataclass(frozen=True, eq=False)
class Grid:
    """start, step: microseconds. index: (samples,) grid numbers, jumps are gaps. kind: see the module.

    regular: rows (samples,) row of each sample, -1 for an absent one, None when sample i is row i.
    jitter, compressed: stamps and rows of the recorded samples, to interpolate between; recorded (samples,) True
    where a row stands at (or, with jitter, next to) the grid point.
    """

    start: int
    step: int
    index: NDArray[np.int64]
    kind: str
    rows: NDArray[np.int64] | None = None
    stamps: NDArray[np.int64] | None = None
    recorded: NDArray[np.bool_] | None = None
    notes: tuple[Note, ...] = field(default=())

    @property
    def times(self) -> NDArray[np.int64]:
        """(samples,) microseconds since 1970 UTC."""
        return self.start + self.step * self.index

    @property
    def interval(self) -> float:
        return self.step / SECOND


def make_grid(order: Ordered) -> Grid:
    """Find the grid of strictly increasing stamps. Raises LoopError when they are too few or too irregular."""
    stamps = order.stamps
    if len(stamps) < 2:
        raise LoopError(f"only {len(stamps)} sample: too few", code="too_few_samples", remedy="export a longer time")
    steps = np.diff(stamps)
    if steps.min() == steps.max():
        return Grid(int(stamps[0]), int(steps[0]), np.arange(len(stamps)), "regular", order.rows, notes=order.notes)
    usual, share = _most_common(steps)
    multiple = steps / usual
    on_grid = np.abs(multiple - np.rint(multiple)) < 0.02
    if share >= 0.5 and on_grid.mean() >= 0.9 and np.mean(multiple > 1.5) <= SPARSE_SHARE:
        return _regular(order, steps, usual)
    middle = float(np.median(steps))
    if np.mean((steps >= JITTER[0] * middle) & (steps <= JITTER[1] * middle)) >= 0.9:
        return _jitter(order, steps, middle)
    return _compressed(order, steps)


def _most_common(steps: NDArray[np.int64]) -> tuple[int, float]:
    values, counts = np.unique(steps, return_counts=True)
    best = int(np.argmax(counts))
    return int(values[best]), float(counts[best] / len(steps))


def _regular(order: Ordered, steps: NDArray[np.int64], step: int) -> Grid:
    advance = np.maximum(1, np.rint(steps / step).astype(np.int64))
    rows = np.arange(len(order.stamps)) if order.rows is None else order.rows
    index = np.concatenate([[0], np.cumsum(advance)])
    notes = list(order.notes)
    holes = (advance > 1) & (advance <= ABSENT_ROWS + 1)
    gaps = advance > ABSENT_ROWS + 1
    _note_gaps(order.stamps, steps, gaps, step, notes)
    if holes.any():
        absent = int((advance[holes] - 1).sum())
        notes.append(
            Note(
                "missing_rows",
                f"{absent} samples are missing in {int(holes.sum())} short gaps",
                {"samples": float(absent)},
            )
        )
        copies = np.where(holes, advance, 1)
        # the row itself, then as many absent ones as the hole is wide
        first = np.concatenate([[0], np.cumsum(copies)])
        filled = np.full(first[-1] + 1, -1)
        filled[first] = rows
        owner = np.repeat(np.arange(len(copies)), copies)
        index = np.append(index[owner] + np.arange(first[-1]) - first[owner], index[-1])
        rows = filled
    return Grid(int(order.stamps[0]), step, index, "regular", rows, notes=tuple(notes))


def _jitter(order: Ordered, steps: NDArray[np.int64], middle: float) -> Grid:
    near = steps <= 10 * middle
    single = float(steps[steps <= 1.5 * middle].mean())  # the median of coarse stamps (2, 2, 3, 2, 3 s) is not the mean
    step = _nice(float(steps[near].sum()) / float(np.rint(steps[near] / single).sum()))
    gaps = steps > (MAX_HOLE + 1.5) * step
    spread = float(np.std(steps[~gaps] / step))
    notes = [
        *order.notes,
        Note(
            "resampled",
            f"time stamps vary around {step / SECOND:g} s (standard deviation {100 * spread:.0f} %); "
            f"values are interpolated to every {step / SECOND:g} s",
            {"interval_s": step / SECOND, "jitter": spread},
        ),
    ]
    _note_gaps(order.stamps, steps, gaps, step, notes)
    index, _ = _points(order.stamps, gaps, step)
    times = int(order.stamps[0]) + step * index
    after = np.searchsorted(order.stamps, times, side="right").clip(1, len(order.stamps) - 1)
    recorded = order.stamps[after] - order.stamps[after - 1] <= 1.75 * step
    return Grid(int(order.stamps[0]), step, index, "jitter", order.rows, order.stamps, recorded, tuple(notes))


def _compressed(order: Ordered, steps: NDArray[np.int64]) -> Grid:
    base = int(np.gcd.reduce(np.unique(steps)))
    middle = float(np.median(steps))
    if base < middle / MAX_GROWTH:
        base = _nice(float(np.quantile(steps, 0.1)))
    limit = max(GAP_FACTOR * float(np.quantile(steps, 0.99)), (MAX_HOLE + 1.5) * base)
    gaps = steps > limit
    points = float(steps[~gaps].sum()) / base
    if points > MAX_GROWTH * len(order.stamps):
        raise LoopError(
            f"samples are too irregular: {base / SECOND:g} s to {steps.max() / SECOND:g} s apart",
            code="irregular",
            remedy="export at a fixed interval, not interpolated",
        )
    index, _ = _points(order.stamps, gaps, base)
    times = int(order.stamps[0]) + base * index
    position = np.searchsorted(order.stamps, times).clip(0, len(order.stamps) - 1)
    before = (position - 1).clip(0)
    nearest = np.minimum(np.abs(order.stamps[position] - times), np.abs(order.stamps[before] - times))
    recorded = nearest <= base // 2
    share = float(recorded.mean())
    notes = [
        *order.notes,
        Note(
            "compressed",
            f"samples are irregular, as after exception or swinging-door compression: {100 * share:.0f} % of the "
            f"grid of {base / SECOND:g} s was recorded, up to {limit / SECOND:g} s are bridged",
            {"interval_s": base / SECOND, "recorded_share": share, "median_spacing_s": middle / SECOND},
        ),
    ]
    _note_gaps(order.stamps, steps, gaps, base, notes)
    return Grid(int(order.stamps[0]), base, index, "compressed", order.rows, order.stamps, recorded, tuple(notes))


def _points(stamps: NDArray[np.int64], gaps: NDArray[np.bool_], step: int) -> tuple[NDArray[np.int64], int]:
    """Grid numbers between first and last stamp of every stretch without a gap."""
    first = np.concatenate([[0], np.flatnonzero(gaps) + 1])
    last = np.append(first[1:] - 1, len(stamps) - 1)
    start = stamps[0]
    begin = -((start - stamps[first]) // step)  # rounded up: no point before the first stamp of a stretch
    end = (stamps[last] - start) // step
    counts = np.maximum(end - begin + 1, 0)
    total = int(counts.sum())
    offsets = np.repeat(begin - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts)
    index = np.arange(total) + offsets
    return index, total


def _note_gaps(
    stamps: NDArray[np.int64], steps: NDArray[np.int64], gaps: NDArray[np.bool_], step: int, notes: list[Note]
) -> None:
    if not gaps.any():
        return
    from .zones import utc_text

    where = np.flatnonzero(gaps)
    longest = int(where[np.argmax(steps[where])])
    notes.append(
        Note(
            "gaps",
            f"{len(where)} gap{'s' * (len(where) > 1)} in the record, the longest "
            f"{_length(steps[longest] / SECOND)} from {utc_text(stamps[longest])}; nothing is estimated across a gap",
            {"gaps": float(len(where)), "longest_s": float(steps[longest] / SECOND)},
        )
    )


def _length(seconds: float) -> str:
    for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:g} s"


def _nice(step: float) -> int:
    """Round a spacing to a usual sampling time when one lies within 1 %."""
    for unit in (1_000, 10_000, 100_000, 1_000_000, 60_000_000):
        near = _NICE * unit
        best = int(near[np.argmin(np.abs(near - step))])
        if abs(best - step) <= 0.01 * step:
            return best
    return max(1, round(step))
