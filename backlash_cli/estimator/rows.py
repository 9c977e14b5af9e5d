"""The rows of the dead-band test: block means of PV and of the valve positions, and parts of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray
from .decimate import STRETCH
from .row_loops import from_start
from .whitening import WARM_UP


@dataclass(frozen=True, eq=False)
class Rows:
    """Block means, centred: y (rows,) PV, x (1 + widths, rows) OP (first) and OP through each dead band of `widths`
    (ascending). first (rows,): True where a stretch begins. lag: typical lag of the process in rows (Ti / 4).
    line (columns, rows): shapes that a periodic load may have. at (rows,): row numbers, where there are holes.
    stem (4, rows): what is known of where the stem stood, see `decimate.BlockMeans`."""

    y: FloatArray
    x: FloatArray
    widths: FloatArray
    first: NDArray[np.bool_]
    lag: float
    line: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    at: IntArray | None = None
    stem: FloatArray | None = None


def begins(first: NDArray[np.bool_]) -> IntArray:
    """Return the place at which the stretch of each row (rows,) begins. first (rows,): True where one does."""
    return np.maximum.accumulate(np.where(first, np.arange(len(first)), 0))


def counted(first: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which rows (rows,) count: not those in which the filter settles, where a stretch begins (`first`)."""
    counts: NDArray[np.bool_] = np.arange(len(first)) - begins(first) >= WARM_UP
    return counts


def liveliest(rows: Rows, most: int) -> IntArray:
    """Return which of `rows` belong to the stretches in which OP travels most, as many until there are `most` rows."""
    at = np.arange(len(rows.y)) if rows.at is None else rows.at
    number = (at // STRETCH) - at[0] // STRETCH
    travel = np.bincount(number, np.abs(np.diff(rows.x[0], prepend=rows.x[0, 0])) * ~rows.first)
    size = np.bincount(number)
    order = np.argsort(-travel, kind="stable")
    taken = np.zeros(len(size), dtype=bool)
    taken[order[: 1 + int(np.searchsorted(np.cumsum(size[order]), most))]] = True
    return np.flatnonzero(taken[number])


def part_of(rows: Rows, use: IntArray) -> Rows:
    """Return the rows of the places `use` (ascending), each run of neighbours as a stretch of its own."""
    at = np.arange(len(rows.y)) if rows.at is None else rows.at
    first = rows.first[use] | (np.diff(at[use], prepend=at[use[0]] - 2) != 1)
    y, x = from_start(rows.y[None], use, first)[0], from_start(rows.x, use, first)
    stem = None if rows.stem is None else rows.stem[:, use]
    return replace(rows, y=y, x=x, first=first, line=np.take(rows.line, use, axis=1), at=at[use], stem=stem)


def beginning(rows: Rows, most: int) -> Rows:
    """Return the first `most` of `rows`."""
    return replace(rows, y=rows.y[:most], x=np.ascontiguousarray(rows.x[:, :most]), first=rows.first[:most],
                   line=np.ascontiguousarray(rows.line[:, :most]), at=None if rows.at is None else rows.at[:most],
                   stem=None if rows.stem is None else rows.stem[:, :most])
