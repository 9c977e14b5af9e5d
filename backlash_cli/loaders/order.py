"""Stamps in time order: unreadable, far-off, repeated and set-back ones found and named."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import Note

NAT = np.iinfo(np.int64).min
SECOND = 1_000_000
DAY = 86_400 * SECOND
HOUR = 3600 * SECOND
OUTLIER_SHARE = 0.01  # of the stamps that may lie far from all others
CLOCK_CODES = ("dst_repeated_hour", "clock_set_back")


@dataclass(frozen=True, eq=False)
class Ordered:
    """stamps: strictly increasing microseconds. rows: row of each stamp, None when it is every row in order."""

    stamps: NDArray[np.int64]
    rows: NDArray[np.int64] | None
    notes: tuple[Note, ...] = ()


def ordered(micros: NDArray[np.int64], probe: NDArray[np.float64] | None = None, parts: tuple[int, ...] = (),
            line: int = 0) -> Ordered:
    """Bring stamps into strictly increasing order.

    probe: (rows,) one measured signal of these rows; it tells repeated rows from rows of another time.
    parts: first rows of further files. line: line of row 0 in its file, for messages.
    Raises LoopError when no time passes.
    """
    if len(micros) and micros.min() != NAT:
        steps = np.diff(micros)
        if (not len(steps) or steps.min() > 0) and not _far_span(micros):
            return Ordered(micros, None)
    notes: list[Note] = []
    rows = np.flatnonzero(micros != NAT)
    if len(rows) < len(micros):
        notes.append(unreadable(len(micros) - len(rows), int(np.flatnonzero(micros == NAT)[0]), line))
    if not len(rows):
        raise LoopError("no readable time stamps", remedy="describe them with --time-format", code="no_times")
    stamps = micros[rows]
    rows, stamps = _without_outliers(rows, stamps, notes)
    if len(stamps) > 1 and stamps.min() == stamps.max():
        raise LoopError(f"all {len(stamps)} rows carry the same time stamp {utc_text(stamps[0])}", code="constant_time",
                        remedy="export with full time stamps (the time does not advance)")
    back = np.flatnonzero(np.diff(stamps) < 0)
    values = None if probe is None else probe[rows]
    if len(back):
        shifted = _clock_set_back(stamps, back, rows, values, parts, notes)
        if shifted is not None:
            stamps = shifted
        else:
            turn = np.argsort(stamps, kind="stable")
            stamps, rows = stamps[turn], rows[turn]
            values = None if values is None else values[turn]
            notes.append(sorted_note(len(back)))
    repeats = np.flatnonzero(np.diff(stamps) == 0)
    if len(repeats):
        others = values is None or differ(values[repeats], values[repeats + 1], values).mean() > 0.5
        spread = spread_evenly(stamps) if others else None
        if spread is not None:
            notes.append(
                Note(
                    "coarse_stamps",
                    "several rows share each time stamp; they were spread evenly over the time to the next stamp",
                )
            )
            stamps = spread
        else:
            stamps, rows = without_repeats(stamps, rows, values, repeats, notes)
    return Ordered(stamps, rows, tuple(notes))


def _far_span(stamps: NDArray[np.int64]) -> bool:
    """A quick look: do the ends lie far outside the middle of the stamps?"""
    if len(stamps) < 20:
        return False
    low, high = stamps[len(stamps) // 20], stamps[-1 - len(stamps) // 20]
    return float(stamps[-1]) - float(stamps[0]) > 10.0 * (float(high) - float(low)) + 2.0 * DAY


def _without_outliers(
    rows: NDArray[np.int64], stamps: NDArray[np.int64], notes: list[Note]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Drop few stamps that lie far from all others (a clock reset to 1970, a year 9999)."""
    if len(stamps) < 20:
        return rows, stamps
    low, middle, high = np.quantile(stamps.astype(np.float64), [0.05, 0.5, 0.95])
    far = np.abs(stamps.astype(np.float64) - middle) > far_off(low, high)
    count = int(far.sum())
    if not count or count > max(3, OUTLIER_SHARE * len(stamps)):
        return rows, stamps
    notes.append(outliers(count, stamps[far][:3]))
    return rows[~far], stamps[~far]


def far_off(low: float, high: float) -> float:
    """Return how far from the middle a stamp may lie [microseconds], by the 5 % and 95 % quantiles."""
    return 10.0 * (high - low) + 2.0 * DAY


def unreadable(count: int, first: int, line: int) -> Note:
    """Say that rows have no stamp; first: the first of them. line: that of row 0, 0 where there are no lines."""
    at = f", the first in line {line + first}" if line else ""
    return Note("unreadable_times", f"{count} rows without a readable time stamp were dropped{at}",
                {"rows": float(count)})


def outliers(count: int, first: NDArray[np.int64]) -> Note:
    """Say that rows have stamps far from all others, the first of which are shown."""
    shown = ", ".join(utc_text(s) for s in first)
    return Note("time_outliers", f"{count} rows with implausible time stamps far out of range were dropped ({shown})",
                {"rows": float(count)})


def sorted_note(steps: int) -> Note:
    """Say that rows were sorted."""
    return Note("unsorted", f"rows were not in time order ({steps} steps backwards); they were sorted",
                {"steps": float(steps)})


def moved_on(stamps: NDArray[np.int64], back: NDArray[np.int64], seconds: list[float]) -> NDArray[np.int64]:
    """Move all stamps after each step back on by its seconds; unreadable ones stay unreadable."""
    out = stamps.copy()
    for position, lost in zip(back, seconds, strict=True):
        out[position + 1 :] += round(lost * SECOND)
    out[stamps == NAT] = NAT
    return out


def _clock_set_back(stamps: NDArray[np.int64], back: NDArray[np.int64], rows: NDArray[np.int64],
                    values: NDArray[np.float64] | None, parts: tuple[int, ...],
                    notes: list[Note]) -> NDArray[np.int64] | None:
    """A clock that was set back while recording: few steps back, and other values for the same stamps.

    The rows went on in file order, so all stamps after the step are moved on by it. In the night of a Sunday one
    step back of an hour is enough. Returns None when the rows are simply not in order.
    """
    if len(back) > max(3, len(stamps) // 2000) or np.isin(rows[back + 1], parts).any():
        return None
    forward = np.diff(stamps)
    step = int(np.median(forward[forward > 0])) if np.any(forward > 0) else 0
    one = len(back) == 1 and sunday_night(int(stamps[back[0]]), int(stamps[back[0] + 1]), step)
    if not (_conflicts(stamps, values) or one):
        return None
    lost, said = set_back(stamps[back], stamps[back + 1], step)
    out = moved_on(stamps, back, [float(s) / SECOND for s in lost])
    if np.any(np.diff(out) < 0):
        return None
    notes += said
    return out


def set_back(before: NDArray[np.int64], after: NDArray[np.int64], step: int) -> tuple[NDArray[np.int64], list[Note]]:
    """Return by how much a clock was set back between stamps [microseconds], and what is to be said of it."""
    lost = before - after + step
    hour = np.abs(lost - HOUR) <= 2 * step
    lost[hour] = HOUR
    notes = []
    for stamp, is_hour, seconds in zip(before, hour, lost / SECOND, strict=True):
        what = ("time stamps go back one hour (end of daylight saving time?); the repeated hour is kept in file order,"
                if is_hour else f"the clock jumps backwards by {seconds:g} s with other values for the same time")
        code = "dst_repeated_hour" if is_hour else "clock_set_back"
        text = f"{what} at {utc_text(stamp)}; later stamps are moved on by it"
        notes.append(Note(code, text, {"seconds": float(seconds)}))
    return lost, notes


def _conflicts(stamps: NDArray[np.int64], values: NDArray[np.float64] | None) -> bool:
    """Do most of the repeated stamps carry another value than the first time?"""
    if values is None:
        return False
    turn = np.argsort(stamps, kind="stable")
    same = np.flatnonzero(np.diff(stamps[turn]) == 0)
    return bool(len(same)) and differ(values[turn[same]], values[turn[same + 1]], values).mean() >= 0.5


def sunday_night(before: int, after: int, step: int) -> bool:
    """A step back of one hour, give or take two records, between 0 and 4 o'clock of a Sunday."""
    lost = before - after + step
    day, clock = divmod(before, DAY)
    return (day + 3) % 7 == 6 and clock <= 4 * HOUR and abs(lost - HOUR) <= 2 * step < HOUR


def differ(a: NDArray[np.float64], b: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.bool_]:
    known = values[np.isfinite(values)]
    scale = float(np.subtract(*np.quantile(known, [0.95, 0.05]))) if len(known) else 0.0
    return far_apart(a, b, scale)


def far_apart(a: NDArray[np.float64], b: NDArray[np.float64], scale: float) -> NDArray[np.bool_]:
    """Whether values differ; scale: the width of what 90 % of all values lie in."""
    with np.errstate(invalid="ignore", over="ignore"):
        far = np.abs(a - b) > 0.002 * scale
    return far & np.isfinite(a) & np.isfinite(b)


def which_to_drop(repeats: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return which of each two rows with one stamp to drop; repeats: the first ones."""
    first_blank = ~np.isfinite(values[repeats]) & np.isfinite(values[repeats + 1])
    return np.where(first_blank, repeats, repeats + 1)


def repeated(count: int, conflicts: int) -> Note:
    """Say that rows repeat stamps, some of them with another value."""
    more = f", {conflicts} of them with another value" if conflicts else ""
    return Note("duplicate_times",
                f"{count} rows repeat the time stamp of another row{more}; the first of each is kept",
                {"rows": float(count), "conflicts": float(conflicts)})


def spread_evenly(stamps: NDArray[np.int64]) -> NDArray[np.int64] | None:
    """Stamps written too coarsely (to the minute): spread the rows of each stamp evenly, if their number is steady."""
    unique, counts = np.unique(stamps, return_counts=True)
    if len(unique) < 4:
        return None
    inner = counts[1:-1]
    usual = int(np.median(inner))
    steps = np.diff(unique)
    width = int(np.median(steps))
    if (usual < 2 or np.mean(np.abs(inner - usual) <= 1) < 0.95 or np.mean(steps == width) < 0.9
        or counts.max() > usual + 1):
        return None
    starts = np.cumsum(counts) - counts
    rank = np.arange(len(stamps)) - np.repeat(starts, counts)
    share = np.where(np.abs(counts - usual) <= 1, counts, usual)
    share[0] = share[-1] = usual
    rank[: counts[0]] += max(usual - counts[0], 0)
    return stamps + (rank * width) // np.repeat(share, counts)


def without_repeats(stamps: NDArray[np.int64], rows: NDArray[np.int64], values: NDArray[np.float64] | None,
                    repeats: NDArray[np.int64], notes: list[Note]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    conflicts = 0
    drop = repeats + 1
    if values is not None:
        conflicts = int(differ(values[repeats], values[repeats + 1], values).sum())
        drop = which_to_drop(repeats, values)
    keep = np.ones(len(stamps), bool)
    keep[drop] = False
    notes.append(repeated(len(repeats), conflicts))
    if conflicts > 0.5 * len(stamps):
        raise LoopError("most rows repeat a time stamp with another value: the times do not tell the rows apart",
                        code="constant_time", remedy="export with finer time stamps")
    stamps, rows = stamps[keep], rows[keep]
    again = np.flatnonzero(np.diff(stamps) == 0)
    if len(again):  # a blank first row of three equal stamps leaves a pair
        keep = np.ones(len(stamps), bool)
        keep[again + 1] = False
        stamps, rows = stamps[keep], rows[keep]
    return stamps, rows


def utc_text(micros: int) -> str:
    """Return a stamp as readable text, for messages."""
    try:
        moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=int(micros))
        return moment.strftime("%Y-%m-%d %H:%M:%S")
    except OverflowError:
        return f"{micros / 1e6:.0f} s"
