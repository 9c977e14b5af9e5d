"""Stamps in time order, a uniform grid for them, and values brought to its points.
regular: the stamps lie on a grid; rows are put at their grid number, nothing is interpolated.
jitter: at least 90 % of the spacings lie within 0.3 to 1.7 of the usual one; values are interpolated to the grid.
compressed: the historian left rows out (exception, swinging door); values in between are taken as it means them."""

from collections import defaultdict
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Self

import numpy as np

from ..errors import LoopError
from ..record import NAT, BoolArray, FloatArray, Frozen, IntArray, Note, duration, utc_text
from ..samples import MAX_HOLE, torn
from .names import explained, noted

SECOND, HOUR, DAY = 1_000_000, 3_600_000_000, 86_400_000_000  # microseconds
LIKELY = range(600_000_000 * SECOND, 2_020_000_000 * SECOND)  # 1989 to 2034: dates of plant data, numbers since 1970
OUTLIER_SHARE, FAR = 0.01, 10.0  # of the stamps may lie far from others: that times what 90 % span, and two days
CLOCK_CODES = ("dst_repeated_hour", "clock_set_back")
EVEN = 20  # stamps at both ends that tell whether the interval changes
FINEST = 1000  # microseconds: no controller is that fast
ABSENT_ROWS = 60  # absent samples that get rows of their own; more is a gap
SPARSE_SHARE = 0.15  # share of spacings longer than one interval that means compression, not loss
GAP_FACTOR = 5.0  # of the 99 % spacing: the longest that compressed data may bridge
MAX_GROWTH, JITTER = 200, (0.3, 1.7)  # grid points per recorded row; spacings over the usual one
_NICE = np.array([1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 90, 100, 120, 150, 180, 200, 240, 250,
                  300, 360, 400, 450, 480, 500, 600, 720, 750, 800, 900, 1000])
Files = tuple[tuple[int, str], ...]  # first row and name of each


class Ordered(Frozen, eq=False):
    """stamps: strictly increasing microseconds. rows: row of each stamp, None when it is every row in order."""

    stamps: IntArray
    rows: IntArray | None
    notes: tuple[Note, ...] = ()


def ordered(micros: IntArray, probe: FloatArray, files: Files = (), line: int = 0) -> Ordered:
    """Bring stamps into strictly increasing order. Raises LoopError when no time passes. probe: (rows,) measured, tells
    repeated rows from those of another time. files: of the rows, if several. line: of row 0 in its file."""
    if len(micros) and micros.min() != NAT:
        steps, few = np.diff(micros), len(micros) // 20
        if (not len(steps) or steps.min() > 0) and not (few and float(micros[-1]) - float(micros[0]) > FAR * (
                float(micros[-1 - few]) - float(micros[few])) + 2.0 * DAY):
            return Ordered(micros, None)
    notes, rows = list[Note](), np.flatnonzero(micros != NAT)
    if lost := len(micros) - len(rows):
        at = f", the first in line {line + int(np.argmax(micros == NAT))}" if line else ""
        notes.append(noted("unreadable_times", {"rows": float(lost)}, at=at))
    if not len(rows):
        raise LoopError(**explained("no_times"))
    stamps = micros[rows]
    low, middle, high = np.quantile(stamps.astype(np.float64), [0.05, 0.5, 0.95])
    far = np.abs(stamps.astype(np.float64) - middle) > FAR * (high - low) + 2.0 * DAY
    if len(stamps) >= 20 and 0 < far.sum() <= max(3, OUTLIER_SHARE * len(stamps)):  # a clock reset to 1970, a year 9999
        shown = ", ".join(map(utc_text, stamps[far][:3]))
        notes.append(noted("time_outliers", {"rows": float(far.sum())}, shown=shown))
        rows, stamps = rows[~far], stamps[~far]
    if len(stamps) > 1 and stamps.min() == stamps.max():
        raise LoopError(**explained("constant_time", rows=len(stamps), stamp=utc_text(stamps[0])))
    values, back, firsts = probe[rows], np.flatnonzero(np.diff(stamps) < 0), [row for row, _ in files[1:]]
    shifted = None if np.isin(rows[back + 1], firsts).any() else _clock_set_back(stamps, back, values, notes)
    stamps = stamps if shifted is None else shifted
    if shifted is None and len(back):
        half = np.abs(stamps[back + 1] - stamps[back] + DAY // 2) < HOUR // 2  # 12:59 is followed by 01:00
        notes.append(noted("unsorted:half_day" if half.all() else "unsorted", {"steps": float(len(back))}))
        turn = np.argsort(stamps, kind="stable")
        stamps, rows, values = stamps[turn], rows[turn], values[turn]
    repeats = np.flatnonzero(np.diff(stamps) == 0)
    differ, of_file = _differ(values[repeats], values[repeats + 1], values), np.searchsorted(firsts, rows, side="right")
    between = repeats[differ & (across := np.diff(of_file)[repeats] != 0)]  # other values in another file
    which = " and ".join(files[i][1] for i in of_file[between[0] : between[0] + 2]) if len(between) else ""
    coarse = len(repeats) and differ.mean() > 0.5 and not which and not len(back)
    if coarse and (spread := _spread_evenly(stamps, values)) is not None:
        notes.append(noted("coarse_stamps"))
        stamps = spread
    elif len(repeats):
        conflicts = int(differ.sum())
        more = f", {conflicts} of them with another value" * (conflicts > 0) + f" ({which})" * bool(which)
        notes.append(noted("duplicate_times", {"rows": float(len(repeats)), "conflicts": float(conflicts)}, more=more))
        if conflicts > 0.4 * (len(stamps) - bool(which) * len(repeats)) or 2 * len(between) > max(20, across.sum()):
            at, code = utc_text(stamps[repeats[differ][0]]), "files_differ" if which else "coarse_times"
            raise LoopError(**explained(code, rows=conflicts, at=at, files=which))
        # of rows with one stamp the first, or the first that holds a value
        kept = np.lexsort((~np.isfinite(values), stamps))[np.diff(stamps, prepend=stamps[0] - 1) != 0]
        stamps, rows = stamps[kept], rows[kept]
    if len(back) and torn(probe[rows], probe[np.sort(rows)]):
        raise LoopError(**explained("unsorted_jumps", steps=len(back)))
    return Ordered(stamps, rows, tuple(notes))


def _clock_set_back(stamps: IntArray, back: IntArray, values: FloatArray, notes: list[Note]) -> IntArray | None:
    """Stamps in file order after a clock was set back while recording: few steps back, and other values for the same
    stamps, or an hour in the night of a Sunday. None when the rows are simply not in order."""
    if not 0 < len(back) <= max(3, len(stamps) // 2000):
        return None
    forward, before = np.diff(stamps), stamps[back]
    step = int(np.median(forward[forward > 0])) if np.any(forward > 0) else 0
    lost = before - stamps[back + 1] + step
    hour = np.abs(lost - HOUR) <= 2 * step
    if np.any(~hour & (lost > np.ptp(stamps) / 2)):  # another recording
        return None
    day, clock = divmod(int(before[0]), DAY)
    sunday = len(back) == 1 and (day + 3) % 7 == 6 and clock <= 4 * HOUR and bool(hour[0]) and 2 * step < HOUR
    turn = np.argsort(stamps, kind="stable")
    same = np.flatnonzero(np.diff(stamps[turn]) == 0)
    if not sunday and not (len(same) and _differ(values[turn[same]], values[turn[same + 1]], values).mean() >= 0.5):
        return None
    lost[hour] = HOUR
    out = stamps + np.cumsum(np.bincount(back + 1, lost, len(stamps))).astype(np.int64)
    if np.any(np.diff(out) < 0):
        return None
    for stamp, is_hour, seconds in zip(before, hour, lost / SECOND, strict=True):
        name = "dst_repeated_hour:moved" if is_hour else "clock_set_back"
        notes.append(noted(name, {"seconds": float(seconds)}, at=utc_text(stamp)))
    return out


def _differ(a: FloatArray, b: FloatArray, values: FloatArray) -> BoolArray:
    """Whether values differ by more than 0.2 % of the width of what 90 % of all values lie in."""
    known = values[np.isfinite(values)] if len(a) else values[:0]
    scale = float(np.subtract(*np.quantile(known, [0.95, 0.05]))) if len(known) else 0.0
    with np.errstate(invalid="ignore", over="ignore"):
        return (np.abs(a - b) > 0.002 * scale) & np.isfinite(a) & np.isfinite(b)


def _spread_evenly(stamps: IntArray, values: FloatArray) -> IntArray | None:
    """Spread the rows of stamps cut to the minute or so evenly where their number is steady, of one source."""
    unique, counts = np.unique(stamps, return_counts=True)
    if len(unique) < 4:
        return None
    inner, steps = counts[1:-1], np.diff(unique)
    usual, width = int(np.median(inner)), int(np.median(steps))
    steady = np.mean(np.abs(inner - usual) <= 1) >= 0.95 and np.mean(steps == width) >= 0.9
    whole = width in (SECOND // 1000, SECOND // 100, SECOND // 10, SECOND, 60 * SECOND, HOUR)  # what stamps are cut to
    if not (whole and 2 <= usual <= width and steady) or counts.max() > usual + 1:
        return None
    # of one source the next row is as far off with the same stamp as with another, and no further than the one behind
    moves, on, same = np.abs(np.diff(values)), np.diff(stamps) > 0, np.abs(values[usual:] - values[:-usual])
    within, across, of_rank = (np.fmin(x, np.nanquantile(moves, 0.95)).mean() for x in (moves[~on], moves[on], same))
    if of_rank < 0.9 * min(within, across) or min(within, across) < 0.5 * max(within, across):
        return None
    rank = np.arange(len(stamps)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = np.where(np.abs(counts - usual) <= 1, counts, usual)
    share[[0, -1]] = usual
    rank[: counts[0]] += max(usual - counts[0], 0)
    return stamps + (rank * width) // np.repeat(share, counts)


class Grid(Frozen, eq=False):
    """A grid and its points. start, step, gap, usual: microseconds; longer distances than gap are gaps, unless it is
    regular. index: (samples,) grid numbers, jumps are gaps. rows: (samples,) of a regular one, -1 for an absent one,
    None when sample i is row i. recorded: (samples,) of others, True where a row stands there (jitter: beside it)."""

    start: int
    step: int
    kind: str
    gap: float = np.inf
    usual: float = 0.0
    index: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    rows: IntArray | None = None
    recorded: BoolArray | None = None
    notes: tuple[Note, ...] = ()

    def laid(self, order: Ordered, number: int = 0) -> Self:
        """Return the grid with its points among stamps. number: of the first stamp on a regular grid."""
        stamps, rows = order.stamps, order.rows
        if self.kind != "regular":
            return self._between(stamps)
        place = np.rint((stamps - self.start) / self.step).astype(np.int64)  # steps that are rounded would add up
        advance = np.maximum(1, np.diff(place, prepend=place[0] - 1))
        holes = (advance > 1) & (advance <= ABSENT_ROWS + 1)
        if holes.any():
            own = np.arange(len(stamps))
            absent = np.repeat(own, np.where(holes, advance - 1, 0))  # the row after each absent one
            advance = np.insert(np.where(holes, 1, advance), absent, 1)
            rows = np.insert(own if rows is None else rows, absent, -1)
        return replace(self, index=number - 1 + np.cumsum(advance), rows=rows)

    def _between(self, stamps: IntArray) -> Self:
        """The grid with the points between the first and last stamp of every stretch without a gap."""
        last = (stamps - self.start) // self.step
        first = -((self.start - stamps) // self.step)  # rounded up: no point before the first stamp of a stretch
        goes_on = np.flatnonzero(np.diff(stamps) <= self.gap) + 1
        first[goes_on] = last[goes_on - 1] + 1
        counts = np.maximum(last - first + 1, 0)
        index = np.arange(int(counts.sum())) + np.repeat(first - (np.cumsum(counts) - counts), counts)
        times = self.start + self.step * index
        after = np.searchsorted(stamps, times, side="right").clip(1, len(stamps) - 1)
        recorded = stamps[after] - stamps[after - 1] <= 1.75 * self.step if self.kind == "jitter" else np.minimum(
            np.abs(stamps[after] - times), np.abs(stamps[after - 1] - times)) <= self.step // 2
        return replace(self, index=index, recorded=recorded)

    def said(self, stamps: IntArray, recorded: BoolArray | None, tally: defaultdict[str, float]) -> list[Note]:
        """Add to a tally what stamps, and which points are recorded, tell; return what is to be said of all so far."""
        steps, regular, found = np.diff(stamps), self.kind == "regular", list[Note]()
        long = np.flatnonzero(steps >= 1.5 * self.step if regular else steps > self.gap)
        advance = np.rint(steps[long] / self.step)
        holes = regular & (advance <= ABSENT_ROWS + 1)
        if len(long) and steps[long].max() > tally["longest"]:
            tally["longest"], tally["from"] = steps[long].max(), stamps[long[np.argmax(steps[long])]]
        near = steps[steps <= self.gap] / self.step if self.kind == "jitter" else np.zeros(0)
        points = np.zeros(0) if recorded is None else recorded
        for name, more in {"gaps": np.sum(~holes), "short": np.sum(holes), "absent": np.sum(advance[holes] - 1),
                           "near": len(near), "sum": near.sum(), "squares": near @ near,
                           "recorded": np.sum(points), "points": np.size(points)}.items():
            tally[name] += float(more)
        if self.kind == "jitter":
            variance = tally["squares"] / max(tally["near"], 1.0) - (tally["sum"] / max(tally["near"], 1.0)) ** 2
            spread = round(max(variance, 0.0) ** 0.5, 9)
            found.append(noted("resampled", {"interval_s": self.step / SECOND, "jitter": spread}, percent=100 * spread))
        elif self.kind == "compressed":
            share, usual = tally["recorded"] / max(tally["points"], 1.0), self.usual / SECOND
            values = {"interval_s": self.step / SECOND, "recorded_share": share, "median_spacing_s": usual}
            found.append(noted("compressed", values, percent=100 * share, bridged=self.gap / SECOND))
        if gaps := tally["gaps"]:
            found.append(noted("gaps", {"gaps": gaps, "longest_s": tally["longest"] / SECOND}, s="s" * (gaps > 1),
                               length=duration(tally["longest"] / SECOND), begin=utc_text(int(tally["from"]))))
        if short := tally["short"]:
            found.append(noted("missing_rows", {"samples": tally["absent"]}, gaps=short))
        return found


@dataclass(eq=False)
class Times:
    """Stamps of rows (micros since 1970 UTC, NAT where unreadable) and their order. files, line: as in `ordered`."""

    micros: IntArray
    notes: tuple[Note, ...] = ()
    files: Files = ()
    line: int = 0
    in_order: Ordered | None = field(default=None, init=False)  # no row is moved or left out, whatever the signal

    def order(self, probe: FloatArray) -> Ordered:
        """Return the stamps in time order; `probe` is the measured signal that tells rows with one stamp apart."""
        found = self.in_order or ordered(self.micros, probe, self.files, self.line)
        self.in_order = found if found.rows is None else None
        return found


@lru_cache(1)  # loops of one file share their stamps
def make_grid(order: Ordered) -> Grid:
    """Find the grid of strictly increasing stamps. Raises LoopError when they are too few or too irregular."""
    if len(order.stamps) < 2:
        why = "".join(f"; {note.message}" for note in order.notes)
        raise LoopError(**explained("too_few_samples", samples=len(order.stamps), why=why))
    if (apart := (order.stamps[-1] - order.stamps[0]) / (len(order.stamps) - 1)) < FINEST:
        raise LoopError(**explained("too_fine", seconds=apart / SECOND))
    grid = _plan(order.stamps).laid(order)
    first, last = (np.diff(part) / SECOND for part in (order.stamps[:EVEN], order.stamps[-EVEN:]))
    changes = len(order.stamps) > 2 * EVEN and np.ptp(first) == np.ptp(last) == 0.0 and first[0] != last[0]
    more = [noted("interval_changes", first=first[0], last=last[0])] if changes else []
    return replace(grid, notes=(*order.notes, *more, *grid.said(order.stamps, grid.recorded, defaultdict(float))))


def _plan(stamps: IntArray) -> Grid:
    start, steps = int(stamps[0]), np.diff(stamps)
    if steps.min() == steps.max():
        return Grid(start, int(steps[0]), "regular")
    values, counts = np.unique(steps, return_counts=True)
    usual = int(values[np.argmax(counts)])
    near = steps[steps < 1.5 * usual]
    usual = usual if abs(near.sum() - usual * len(near)) < usual else _nice(near.mean())  # 1.997, 2.007, 1.997 s: 2 s
    multiple = steps / usual
    if counts.max() >= 0.5 * len(steps) and np.mean(np.abs(multiple - np.rint(multiple)) < 0.02) >= 0.9 and (
            np.mean(multiple > 1.5) <= SPARSE_SHARE and np.all(np.diff(np.rint((stamps - start) / usual)) >= 1)):
        return Grid(start, usual, "regular")
    low, middle, high = np.quantile(steps, [0.1, 0.5, 0.99]).tolist()
    if np.mean((steps >= JITTER[0] * middle) & (steps <= JITTER[1] * middle)) >= 0.9:
        spacing = steps[steps <= JITTER[1] * middle].mean()  # the median of coarse stamps (2, 2, 3, 2, 3 s) is not it
        near = steps[steps <= 10 * middle]
        step = _nice(near.mean() / np.floor(near / spacing + 2.0 - JITTER[1]).clip(1.0).mean())
        return Grid(start, step, "jitter", (MAX_HOLE + 1.5) * step)
    base = fine if (fine := int(np.gcd.reduce(values))) >= middle / MAX_GROWTH else _nice(low)
    gap = max(GAP_FACTOR * high, (MAX_HOLE + 1.5) * base)
    if steps[steps <= gap].sum(dtype=float) / base > MAX_GROWTH * len(stamps):
        raise LoopError(**explained("irregular", least=base / SECOND, most=values[-1] / SECOND))
    return Grid(start, base, "compressed", gap, middle)


def _nice(step: float) -> int:
    """Round a spacing to a usual sampling time when one lies within 1 %."""
    near = np.outer([1_000, 10_000, 100_000, 1_000_000, 60_000_000], _NICE).ravel()
    best = int(near[np.argmin(np.abs(near - step))])
    return best if abs(best - step) <= 0.01 * step else max(1, round(step))
