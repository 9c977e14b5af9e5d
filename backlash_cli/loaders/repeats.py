"""Rows with one stamp: exact repeats, other values for the same time, and stamps written too coarsely."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import Note


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
    return Note(
        "duplicate_times",
        f"{count} rows repeat the time stamp of another row{more}; the first of each is kept",
        {"rows": float(count), "conflicts": float(conflicts)},
    )


def spread_evenly(stamps: NDArray[np.int64]) -> NDArray[np.int64] | None:
    """Stamps written too coarsely (to the minute): spread the rows of each stamp evenly, if their number is steady."""
    unique, counts = np.unique(stamps, return_counts=True)
    if len(unique) < 4:
        return None
    inner = counts[1:-1]
    usual = int(np.median(inner))
    steps = np.diff(unique)
    width = int(np.median(steps))
    if (
        usual < 2
        or np.mean(np.abs(inner - usual) <= 1) < 0.95
        or np.mean(steps == width) < 0.9
        or counts.max() > usual + 1
    ):
        return None
    starts = np.cumsum(counts) - counts
    rank = np.arange(len(stamps)) - np.repeat(starts, counts)
    share = np.where(np.abs(counts - usual) <= 1, counts, usual)
    share[0] = share[-1] = usual
    rank[: counts[0]] += max(usual - counts[0], 0)
    return stamps + (rank * width) // np.repeat(share, counts)


def without_repeats(
    stamps: NDArray[np.int64],
    rows: NDArray[np.int64],
    values: NDArray[np.float64] | None,
    repeats: NDArray[np.int64],
    notes: list[Note],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    conflicts = 0
    drop = repeats + 1
    if values is not None:
        conflicts = int(differ(values[repeats], values[repeats + 1], values).sum())
        drop = which_to_drop(repeats, values)
    keep = np.ones(len(stamps), bool)
    keep[drop] = False
    notes.append(repeated(len(repeats), conflicts))
    if conflicts > 0.5 * len(stamps):
        raise LoopError(
            "most rows repeat a time stamp with another value: the times do not tell the rows apart",
            code="constant_time",
            remedy="export with finer time stamps",
        )
    stamps, rows = stamps[keep], rows[keep]
    again = np.flatnonzero(np.diff(stamps) == 0)
    if len(again):  # a blank first row of three equal stamps leaves a pair
        keep = np.ones(len(stamps), bool)
        keep[again + 1] = False
        stamps, rows = stamps[keep], rows[keep]
    return stamps, rows
