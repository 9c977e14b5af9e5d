"""Rows of some signals in pieces: brought into time order through a temporary file, and each stamp kept once."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from . import pieces as flow
from .ranks import StreamValues
from .repeats import far_apart, which_to_drop
from .store import Room
from .tag_store import TagStore

Rows = tuple[NDArray, ...]  # stamps, then values of each signal
Stream = Callable[[], Iterator[Rows]]
SEEN = 1 << 16  # stamps that tell where the parts of a record end


def by_parts(stream: Stream, count: int) -> tuple[TagStore, int]:
    """Put so many rows into parts by their stamps; return them and their number.

    Where the parts end is found from some of the stamps, so that each holds about PIECE rows.
    """
    seen = np.sort(np.concatenate([stamps[:: count // SEEN + 1] for stamps, *_ in stream()]))
    ends = np.unique(seen[:: len(seen) * flow.PIECE // count + 1])
    store = TagStore(Room(0))
    for stamps, *values in stream():
        store.add(np.searchsorted(ends, stamps, side="right").astype(np.int32), [stamps.view(np.float64), *values])
        store.cut()
    return store, len(ends) + 1


def by_time(parts: tuple[TagStore, int]) -> Iterator[Rows]:
    """Yield the rows of parts in time order; those of one stamp in the order of the file."""
    store, count = parts
    for part in range(count):
        rows = store.tag(part)
        if not rows.rows:
            continue
        stamps = rows.column(0).view(np.int64)
        turn = np.argsort(stamps, kind="stable")
        yield stamps[turn], *(rows.column(slot)[turn] for slot in range(1, store.fields))


def whole_stamps(stream: Stream) -> Iterator[Rows]:
    """Cut rows in time order where the stamp changes."""
    waiting: Rows | None = None
    for rows in stream():
        if waiting is not None:
            rows = tuple(np.concatenate(both) for both in zip(waiting, rows, strict=True))
        if not len(rows[0]):
            continue
        cut = int(np.searchsorted(rows[0], rows[0][-1]))
        waiting = tuple(part[cut:] for part in rows)
        if cut:
            yield tuple(part[:cut] for part in rows)
    if waiting is not None:
        yield waiting


def repeats_of(stream: Stream) -> tuple[int, int, float]:
    """Return how many rows repeat the stamp of the row before, how many of these with another value of the first
    signal, and their share."""
    count = sum(int(np.count_nonzero(np.diff(rows[0]) == 0)) for rows in stream())
    if not count:
        return 0, 0, 0.0
    values = StreamValues(lambda: (rows[1] for rows in stream()))
    low, high = values.quantiles([0.05, 0.95]) if values.ends else (0.0, 0.0)
    conflicts = 0
    for rows in stream():
        same = np.flatnonzero(np.diff(rows[0]) == 0)
        conflicts += int(far_apart(rows[1][same], rows[1][same + 1], high - low).sum())
    return count, conflicts, conflicts / count


def each_once(stream: Stream) -> Iterator[Rows]:
    """Yield one row of each stamp: the first one whose first signal has a value."""
    for rows in stream():
        keep = np.ones(len(rows[0]), bool)
        same = np.flatnonzero(np.diff(rows[0]) == 0)
        keep[which_to_drop(same, rows[1])] = False
        rows = tuple(part[keep] for part in rows)
        again = np.flatnonzero(np.diff(rows[0]) == 0)
        if len(again):  # a blank first row of three equal stamps leaves a pair
            rows = tuple(np.delete(part, again + 1) for part in rows)
        yield rows
