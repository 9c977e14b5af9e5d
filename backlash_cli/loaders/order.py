"""Stamps in time order: unreadable, far-off, repeated and set-back ones found and named."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import FloatArray, IntArray, Note

NAT = np.iinfo(np.int64).min
SECOND = 1_000_000
DAY = 86_400 * SECOND
HOUR = 3600 * SECOND
OUTLIER_SHARE = 0.01  # of the stamps that may lie far from all others:
FAR = 10.0  # times the distance of their 5 % and 95 % quantiles, and two days
CLOCK_CODES = ("dst_repeated_hour", "clock_set_back")


@dataclass(frozen=True, eq=False)
class Ordered:
    """stamps: strictly increasing microseconds. rows: row of each stamp, None when it is every row in order."""

    stamps: IntArray
    rows: IntArray | None
    notes: tuple[Note, ...] = ()


def ordered(micros: IntArray, probe: FloatArray, parts: tuple[int, ...] = (), line: int = 0) -> Ordered:
    """Bring stamps into strictly increasing order.

    probe: (rows,) one measured signal of these rows; it tells repeated rows from rows of another time.
    parts: first rows of further files. line: line of row 0 in its file, for messages. Raises LoopError when no time
    passes.
    """
    if len(micros) and micros.min() != NAT:
        steps, few = np.diff(micros), len(micros) // 20
        if (not len(steps) or steps.min() > 0) and not (few and float(micros[-1]) - float(micros[0]) > FAR * (
                float(micros[-1 - few]) - float(micros[few])) + 2.0 * DAY):
            return Ordered(micros, None)
    notes: list[Note] = []
    rows = np.flatnonzero(micros != NAT)
    if lost := len(micros) - len(rows):
        at = f", the first in line {line + int(np.argmax(micros == NAT))}" if line else ""
        notes.append(_counted("unreadable_times", lost, f"rows without a readable time stamp were dropped{at}"))
    if not len(rows):
        raise LoopError("no readable time stamps", remedy="describe them with --time-format", code="no_times")
    stamps = micros[rows]
    low, middle, high = np.quantile(stamps.astype(np.float64), [0.05, 0.5, 0.95])
    far = np.abs(stamps.astype(np.float64) - middle) > FAR * (high - low) + 2.0 * DAY
    few = len(stamps) >= 20 and far.sum() <= max(3, OUTLIER_SHARE * len(stamps))
    if few and far.any():  # a clock reset to 1970, a year 9999
        shown = ", ".join(utc_text(s) for s in stamps[far][:3])
        notes.append(_counted("time_outliers", int(far.sum()),
                              f"rows with implausible time stamps far out of range were dropped ({shown})"))
        rows, stamps = rows[~far], stamps[~far]
    if len(stamps) > 1 and stamps.min() == stamps.max():
        raise LoopError(f"all {len(stamps)} rows carry the same time stamp {utc_text(stamps[0])}", code="constant_time",
                        remedy="export with full time stamps (the time does not advance)")
    back = np.flatnonzero(np.diff(stamps) < 0)
    values = probe[rows]
    if len(back):
        shifted = _clock_set_back(stamps, back, rows, values, parts, notes)
        if shifted is not None:
            stamps = shifted
        else:
            turn = np.argsort(stamps, kind="stable")
            stamps, rows, values = stamps[turn], rows[turn], values[turn]
            text = f"rows were not in time order ({len(back)} steps backwards); they were sorted"
            notes.append(Note("unsorted", text, {"steps": float(len(back))}))
    repeats = np.flatnonzero(np.diff(stamps) == 0)
    if len(repeats):
        others = _differ(values[repeats], values[repeats + 1], values).mean() > 0.5
        spread = _spread_evenly(stamps) if others else None
        if spread is not None:
            notes.append(Note("coarse_stamps", "several rows share each time stamp; they were spread evenly over the "
                              "time to the next stamp"))
            stamps = spread
        else:
            stamps, rows = _without_repeats(stamps, rows, values, repeats, notes)
    return Ordered(stamps, rows, tuple(notes))


def _counted(code: str, count: int, text: str, **more: float) -> Note:
    return Note(code, f"{count} {text}", {"rows": float(count), **more})


def _clock_set_back(stamps: IntArray, back: IntArray, rows: IntArray, values: FloatArray, parts: tuple[int, ...],
                    notes: list[Note]) -> IntArray | None:
    """A clock that was set back while recording: few steps back, and other values for the same stamps.

    The rows went on in file order, so all stamps after the step are moved on by it. In the night of a Sunday one
    step back of an hour is enough. Returns None when the rows are simply not in order.
    """
    if len(back) > max(3, len(stamps) // 2000) or np.isin(rows[back + 1], parts).any():
        return None
    forward = np.diff(stamps)
    step = int(np.median(forward[forward > 0])) if np.any(forward > 0) else 0
    before = stamps[back]
    lost = before - stamps[back + 1] + step
    hour = np.abs(lost - HOUR) <= 2 * step
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
        what = ("time stamps go back one hour (end of daylight saving time?); the repeated hour is kept in file order,"
                if is_hour else f"the clock jumps backwards by {seconds:g} s with other values for the same time")
        notes.append(Note("dst_repeated_hour" if is_hour else "clock_set_back", f"{what} at {utc_text(stamp)}; later "
                          "stamps are moved on by it", {"seconds": float(seconds)}))
    return out


def _differ(a: FloatArray, b: FloatArray, values: FloatArray) -> NDArray[np.bool_]:
    """Whether values differ by more than 0.2 % of the width of what 90 % of all values lie in."""
    known = values[np.isfinite(values)]
    scale = float(np.subtract(*np.quantile(known, [0.95, 0.05]))) if len(known) else 0.0
    with np.errstate(invalid="ignore", over="ignore"):
        return (np.abs(a - b) > 0.002 * scale) & np.isfinite(a) & np.isfinite(b)


def _spread_evenly(stamps: IntArray) -> IntArray | None:
    """Stamps written too coarsely (to the minute): spread the rows of each stamp evenly, if their number is steady."""
    unique, counts = np.unique(stamps, return_counts=True)
    if len(unique) < 4:
        return None
    inner, steps = counts[1:-1], np.diff(unique)
    usual, width = int(np.median(inner)), int(np.median(steps))
    steady = np.mean(np.abs(inner - usual) <= 1) >= 0.95 and np.mean(steps == width) >= 0.9
    if not 2 <= usual <= width or not steady or counts.max() > usual + 1:
        return None
    starts = np.cumsum(counts) - counts
    rank = np.arange(len(stamps)) - np.repeat(starts, counts)
    share = np.where(np.abs(counts - usual) <= 1, counts, usual)
    share[0] = share[-1] = usual
    rank[: counts[0]] += max(usual - counts[0], 0)
    return stamps + (rank * width) // np.repeat(share, counts)


def _without_repeats(stamps: IntArray, rows: IntArray, values: FloatArray, repeats: IntArray, notes: list[Note]
                     ) -> tuple[IntArray, IntArray]:
    """Keep of rows with one stamp the first, or the first that holds a value."""
    conflicts = int(_differ(values[repeats], values[repeats + 1], values).sum())
    more = f", {conflicts} of them with another value" if conflicts else ""
    text = f"rows repeat the time stamp of another row{more}; the first of each is kept"
    notes.append(_counted("duplicate_times", len(repeats), text, conflicts=float(conflicts)))
    if conflicts > 0.5 * len(stamps):
        raise LoopError("most rows repeat a time stamp with another value: the times do not tell the rows apart",
                        code="constant_time", remedy="export with finer time stamps")
    kept = np.lexsort((~np.isfinite(values), stamps))[np.diff(stamps, prepend=stamps[0] - 1) != 0]
    return stamps[kept], rows[kept]


def utc_text(micros: int) -> str:
    """Return a stamp as readable text, for messages."""
    return str(np.datetime64(int(micros) // SECOND, "s")).replace("T", " ")
