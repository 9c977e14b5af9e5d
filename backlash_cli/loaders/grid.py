"""A uniform grid for stamps that are nearly, or by intention not, uniform.

regular: the stamps lie on a grid; rows are put at their grid number, nothing is interpolated.
jitter: at least 90 % of the spacings lie within 0.3 to 1.7 of the usual one; values are interpolated to the grid.
compressed: the historian left rows out (exception or swinging-door compression); values in between are taken as
the historian means it. Anything else is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import FloatArray, IntArray, Note
from .order import SECOND, Ordered, utc_text

MAX_HOLE = 5  # absent samples that may be bridged when nothing else is known
ABSENT_ROWS = 60  # absent samples that get rows of their own; more is a gap
SPARSE_SHARE = 0.15  # share of spacings longer than one interval that means compression, not loss
GAP_FACTOR = 5.0  # of the 99 % spacing: the longest that compressed data may bridge
MAX_GROWTH = 200  # grid points per recorded row
JITTER = (0.3, 1.7)
_NICE = np.array([1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 90, 100, 120, 150, 180, 200, 240, 250,
                  300, 360, 400, 450, 480, 500, 600, 720, 750, 800, 900, 1000])


@dataclass(frozen=True, eq=False)
class Steps:
    """values: (distinct,) distances in microseconds, ascending; counts: how often each occurs.

    first, last: the ends of the stamps. before_longest: the stamp before the first of the longest distances.
    """

    values: IntArray
    counts: IntArray
    first: int
    last: int
    before_longest: int

    @staticmethod
    def of(stamps: IntArray) -> Steps:
        """Count the distances of two or more stamps."""
        steps = np.diff(stamps)
        low, high = int(steps.min()), int(steps.max())
        if low == high:
            values, counts = np.array([low]), np.array([len(steps)])
        else:
            values, counts = np.unique(steps, return_counts=True)
        return Steps(values, counts, int(stamps[0]), int(stamps[-1]), int(stamps[np.argmax(steps)]))

    @staticmethod
    def joined(parts: Sequence[Steps]) -> Steps:
        """Put the distances of several stretches together."""
        values, place = np.unique(np.concatenate([part.values for part in parts]), return_inverse=True)
        counts = np.bincount(place, np.concatenate([part.counts for part in parts])).astype(np.int64)
        longest = max(parts, key=lambda part: part.longest)
        return Steps(values, counts, parts[0].first, parts[-1].last, longest.before_longest)

    @property
    def total(self) -> int:
        """Number of distances."""
        return int(self.counts.sum())

    @property
    def longest(self) -> int:
        return int(self.values[-1])

    def share(self, which: NDArray[np.bool_]) -> float:
        """Return the share of the distances that are of the chosen values."""
        return float(self.counts[which].sum() / self.total)

    def sum(self, which: NDArray[np.bool_], of: FloatArray | IntArray) -> float:
        """Return the sum of something over the distances of the chosen values; of: (distinct,)."""
        return float((of[which].astype(np.float64) * self.counts[which]).sum())

    def quantile(self, share: float) -> float:
        """Return a quantile, between two distances on a straight line, as NumPy does."""
        place = share * (self.total - 1)
        low = int(np.floor(place))
        a, b = self._at(low), self._at(min(low + 1, self.total - 1))
        rest = place - low
        return a + (b - a) * rest if rest < 0.5 else b - (b - a) * (1.0 - rest)

    @property
    def median(self) -> float:
        return (self._at((self.total - 1) // 2) + self._at(self.total // 2)) / 2.0

    def _at(self, rank: int) -> float:
        return float(self.values[np.searchsorted(np.cumsum(self.counts), rank, side="right")])


@dataclass(frozen=True, eq=False)
class GridPlan:
    """start, step: microseconds. kind: as in `grid`. gap: longer distances are gaps, unless it is regular.

    usual: a distance in the middle [microseconds].
    """

    start: int
    step: int
    kind: str
    gap: float
    steps: Steps
    usual: float = 0.0

    def rows(self, stamps: IntArray, before: tuple[int, int] | None = None) -> tuple[IntArray, IntArray]:
        """Return (index, rows) of a regular grid: the grid number of each sample, and its row, -1 for an absent one.

        before: stamp and grid number of the row before the first.
        """
        stamp, number = (stamps[0] - self.step, -1) if before is None else before
        advance = np.maximum(1, np.rint(np.diff(stamps, prepend=stamp) / self.step).astype(np.int64))
        index = number + np.cumsum(advance)
        holes = (advance > 1) & (advance <= ABSENT_ROWS + 1)
        if not holes.any():
            return index, np.arange(len(stamps))
        copies = np.where(holes, advance, 1)  # the row itself, after as many absent ones as the hole is wide
        ends = np.cumsum(copies) - 1
        rows = np.full(ends[-1] + 1, -1)
        rows[ends] = np.arange(len(stamps))
        owner = np.repeat(np.arange(len(stamps)), copies)
        return index[owner] - (ends[owner] - np.arange(len(rows))), rows

    def points(self, stamps: IntArray) -> IntArray:
        """Return the grid numbers between the first and last stamp of every stretch without a gap."""
        last = (stamps - self.start) // self.step
        first = -((self.start - stamps) // self.step)  # rounded up: no point before the first stamp of a stretch
        goes_on = np.flatnonzero(np.diff(stamps) <= self.gap) + 1
        first[goes_on] = last[goes_on - 1] + 1
        counts = np.maximum(last - first + 1, 0)
        return np.arange(int(counts.sum())) + np.repeat(first - (np.cumsum(counts) - counts), counts)

    def recorded(self, stamps: IntArray, times: IntArray) -> NDArray[np.bool_]:
        """(times,) True where a row stands at (or, with jitter, next to) a grid point."""
        if self.kind == "jitter":
            after = np.searchsorted(stamps, times, side="right").clip(1, len(stamps) - 1)
            return stamps[after] - stamps[after - 1] <= 1.75 * self.step
        position = np.searchsorted(stamps, times).clip(0, len(stamps) - 1)
        before = (position - 1).clip(0)
        nearest = np.minimum(np.abs(stamps[position] - times), np.abs(stamps[before] - times))
        return nearest <= self.step // 2

    def notes(self, share: float) -> list[Note]:
        """Return what is to be said of the grid. share: of its points that are recorded."""
        found: list[Note] = []
        steps, step = self.steps, self.step
        apart = steps.values / step
        if self.kind == "jitter":
            near = steps.values <= self.gap
            middle = steps.sum(near, apart) / max(int(steps.counts[near].sum()), 1)
            variance = steps.sum(near, (apart - middle) ** 2) / max(int(steps.counts[near].sum()), 1)
            spread = round(float(np.sqrt(variance)), 9)
            found.append(Note(
                "resampled", f"time stamps vary around {step / SECOND:g} s (standard deviation {100 * spread:.0f} %); "
                f"values are interpolated to every {step / SECOND:g} s",
                {"interval_s": step / SECOND, "jitter": spread}))
        elif self.kind == "compressed":
            found.append(Note(
                "compressed", f"samples are irregular, as after exception or swinging-door compression: "
                f"{100 * share:.0f} % of the grid of {step / SECOND:g} s was recorded, "
                f"up to {self.gap / SECOND:g} s are bridged", {"interval_s": step / SECOND, "recorded_share": share,
                            "median_spacing_s": self.usual / SECOND}))
        advance = np.maximum(1, np.rint(apart))
        gaps = int(steps.counts[advance > ABSENT_ROWS + 1 if self.kind == "regular" else steps.values > self.gap].sum())
        if gaps:
            found.append(Note(
                "gaps", f"{gaps} gap{'s' * (gaps > 1)} in the record, the longest {_length(steps.longest / SECOND)} "
                f"from {utc_text(steps.before_longest)}; nothing is estimated across a gap",
                {"gaps": float(gaps), "longest_s": float(steps.longest / SECOND)}))
        if self.kind == "regular":
            holes = (advance > 1) & (advance <= ABSENT_ROWS + 1)
            if holes.any():
                absent = int(steps.sum(holes, advance - 1))
                text = f"{absent} samples are missing in {int(steps.counts[holes].sum())} short gaps"
                found.append(Note("missing_rows", text, {"samples": float(absent)}))
        return found


@dataclass(frozen=True, eq=False)
class Grid:
    """Points of a grid. index: (samples,) grid numbers, jumps are gaps.

    regular: rows (samples,) row of each sample, -1 for an absent one, None when sample i is row i.
    jitter, compressed: stamps and rows of the recorded samples, to interpolate between; recorded (samples,) True
    where a row stands at (or, with jitter, next to) the grid point.
    """

    plan: GridPlan
    index: IntArray
    rows: IntArray | None = None
    stamps: IntArray | None = None
    recorded: NDArray[np.bool_] | None = None
    notes: tuple[Note, ...] = ()

    @property
    def start(self) -> int:
        return self.plan.start

    @property
    def step(self) -> int:
        return self.plan.step

    @property
    def kind(self) -> str:
        return self.plan.kind

    @property
    def times(self) -> IntArray:
        """(samples,) microseconds since 1970 UTC."""
        return self.start + self.step * self.index

    @property
    def interval(self) -> float:
        """Seconds between points."""
        return self.step / SECOND


def make_grid(order: Ordered) -> Grid:
    """Find the grid of strictly increasing stamps. Raises LoopError when they are too few or too irregular."""
    stamps = order.stamps
    if len(stamps) < 2:
        raise LoopError(f"only {len(stamps)} sample: the record is too short", code="too_few_samples",
                        remedy="export a longer time")
    plan = plan_grid(Steps.of(stamps))
    rows: IntArray | None = None
    recorded = None
    if plan.kind == "regular":
        index, places = plan.rows(stamps)
        rows = order.rows
        if len(places) > len(stamps):
            rows = places if rows is None else np.where(places >= 0, rows[places], -1)
    else:
        index, rows = plan.points(stamps), order.rows
        recorded = plan.recorded(stamps, plan.start + plan.step * index)
    share = 1.0 if recorded is None else float(recorded.mean())
    return Grid(plan, index, rows, None if recorded is None else stamps, recorded, (*order.notes, *plan.notes(share)))


def plan_grid(steps: Steps) -> GridPlan:
    """Find the grid of strictly increasing stamps. Raises LoopError when they are too irregular."""
    start, values = steps.first, steps.values
    usual = int(values[np.argmax(steps.counts)])
    multiple = values / usual
    on_grid = np.abs(multiple - np.rint(multiple)) < 0.02
    if steps.counts.max() >= 0.5 * steps.total and steps.share(on_grid) >= 0.9 and (
            steps.share(multiple > 1.5) <= SPARSE_SHARE):
        return GridPlan(start, usual, "regular", np.inf, steps)
    middle = steps.median
    if steps.share((values >= JITTER[0] * middle) & (values <= JITTER[1] * middle)) >= 0.9:
        return _jitter(steps, middle)
    return _compressed(steps, middle)


def _jitter(steps: Steps, middle: float) -> GridPlan:
    values = steps.values
    single = values <= 1.5 * middle  # the median of coarse stamps (2, 2, 3, 2, 3 s) is not the mean
    spacing = steps.sum(single, values) / int(steps.counts[single].sum())
    near = values <= 10 * middle
    step = _nice(steps.sum(near, values) / steps.sum(near, np.rint(values / spacing)))
    return GridPlan(steps.first, step, "jitter", (MAX_HOLE + 1.5) * step, steps)


def _compressed(steps: Steps, middle: float) -> GridPlan:
    base = int(np.gcd.reduce(steps.values))
    if base < middle / MAX_GROWTH:
        base = _nice(steps.quantile(0.1))
    gap = max(GAP_FACTOR * steps.quantile(0.99), (MAX_HOLE + 1.5) * base)
    if steps.sum(steps.values <= gap, steps.values) / base > MAX_GROWTH * (steps.total + 1):
        raise LoopError(f"samples are too irregular: {base / SECOND:g} s to {steps.longest / SECOND:g} s apart",
                        code="irregular", remedy="export at a fixed interval, not interpolated")
    return GridPlan(steps.first, base, "compressed", gap, steps, usual=middle)


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
