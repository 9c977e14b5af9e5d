"""Columns of a file that is not columnar itself: in memory as long as they are few, else in one Arrow IPC scratch file.

A text file holds its rows one after the other, an analysis wants one signal after the other. The scratch file has no
name where the system allows that, so nothing is left behind even when the program is killed.
"""

from __future__ import annotations

import os
import tempfile
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import BacklashError
from ..record import IntArray

IN_MEMORY = 128 << 20  # bytes of samples that are kept in memory, over all files of a run
SEGMENT = 16 << 20  # bytes of samples that are put together before they are kept; twice as many of groups
Arrays = dict[str, NDArray[Any]]


class ScratchFile:
    """One file to which Arrow tables are appended; other processes of this machine can read it."""

    def __init__(self, path: str = "") -> None:
        self.path, self._own, self._number, self._end = path, not path, -1, 0

    def append(self, arrays: Mapping[str, NDArray[Any]]) -> tuple[int, int]:
        """Write columns as an Arrow IPC file; return its place and length. Raises BacklashError without room."""
        sink = pa.BufferOutputStream()
        batch = pa.RecordBatch.from_arrays([pa.array(column) for column in arrays.values()], list(arrays))
        with pa.ipc.new_file(sink, batch.schema) as writer:
            writer.write_batch(batch)
        data = sink.getvalue()
        place, view = self._end, memoryview(data)
        try:
            if self._number < 0:
                self._open()
            os.lseek(self._number, place, os.SEEK_SET)
            while view:
                view = view[os.write(self._number, view) :]
        except OSError as error:
            raise BacklashError(
                f"no room for temporary data: {error.strerror}", where=tempfile.gettempdir(), code="cannot_write",
                remedy="name a folder with more room in TMPDIR, or scan some of the loops with --loop") from None
        self._end += -(-len(data) // 64) * 64
        return place, len(data)

    def read(self, place: int, length: int) -> pa.RecordBatch:
        """Return columns that were written; nothing is copied before they are used."""
        with pa.memory_map(self.path) as file:
            file.seek(place)
            return pa.ipc.open_file(pa.BufferReader(file.read_buffer(length))).get_batch(0)

    def _open(self) -> None:
        self._number, self.path = tempfile.mkstemp(prefix="backlash-", suffix=".arrow")
        shared = f"/proc/{os.getpid()}/fd/{self._number}"
        if Path(shared).exists():
            os.unlink(self.path)
            self.path = shared

    def __reduce__(self) -> tuple[type[ScratchFile], tuple[str]]:
        return ScratchFile, (self.path,)

    def __del__(self) -> None:
        if self._number >= 0:
            os.close(self._number)
            if not self.path.startswith("/proc/"):
                Path(self.path).unlink(missing_ok=True)


class Room:
    """How much memory the columns of one run may still take, and the scratch file for what is beyond."""

    def __init__(self, size: int = IN_MEMORY) -> None:
        self.left, self.file = size, ScratchFile()


class Segment:
    """Some rows of several columns."""

    def __init__(self, arrays: Arrays, rows: int, room: Room, *, in_memory: bool) -> None:
        self.rows, self.names, self._room = rows, set(arrays), room
        self._arrays: Arrays | None = arrays
        self._place = (0, 0)
        if not in_memory:
            self.spill()

    def spill(self) -> None:
        """Write what is in memory to the scratch file."""
        if self._arrays is not None:
            self._place = self._room.file.append(self._arrays)
            self._arrays = None

    def read(self, names: Sequence[str], first: int, last: int) -> Arrays:
        """Return rows first..last-1 of those of the columns that there are."""
        there = [name for name in names if name in self.names]
        if self._arrays is not None:
            return {name: self._arrays[name][first:last] for name in there}
        batch = self._room.file.read(*self._place)
        return {name: np.array(batch.column(name).slice(first, last - first).to_numpy()) for name in there}


class Store:
    """Columns of equal length that are written once, in pieces, and read often. groups: numbers of the rows' groups
    (tags) stand in the column "group" of each piece; rows are then kept group by group."""

    def __init__(self, room: Room, *, groups: bool = False) -> None:
        self.room, self.groups = room, groups
        self.segments: list[Segment] = []
        self.firsts: list[int] = [0]  # row of each segment, and the number of all
        self.starts: list[IntArray] = []  # of each segment: where its groups begin
        self._waiting: list[Arrays] = []
        self._size = 0

    @property
    def rows(self) -> int:
        return self.firsts[-1]

    def add(self, arrays: Arrays) -> None:
        """Take the next rows."""
        self._waiting.append(arrays)
        self._size += sum(column.nbytes for column in arrays.values())
        if self._size >= SEGMENT * (1 + self.groups):
            self.close()

    def close(self) -> Store:
        """Keep what was taken so far."""
        waiting = [arrays for arrays in self._waiting if len(next(iter(arrays.values())))]
        self._waiting, self._size = [], 0
        if not waiting:
            return self
        joined = _joined(waiting)
        rows = len(next(iter(joined.values())))
        if self.groups:
            group = joined.pop("group")
            turn = np.argsort(group.astype(np.uint16) if group.max(initial=0) < 1 << 16 else group, kind="stable")
            self.starts.append(np.searchsorted(group[turn], np.arange(int(group.max(initial=-1)) + 2)))
            joined = {name: column[turn] for name, column in joined.items()}
        size = sum(column.nbytes for column in joined.values())
        kept = size <= self.room.left
        self.room.left -= size if kept else 0
        self.segments.append(Segment(joined, rows, self.room, in_memory=kept))
        self.firsts.append(self.rows + rows)
        return self

    def read(self, names: Sequence[str], first: int = 0, last: int | None = None) -> Arrays:
        """Return rows of some columns; one that a segment does not have is filled up with -1."""
        last = self.rows if last is None else min(last, self.rows)
        parts = []
        for k in range(max(bisect_right(self.firsts, first) - 1, 0), len(self.segments)):
            begin = self.firsts[k]
            if begin >= last:
                break
            parts.append(self.segments[k].read(names, max(first - begin, 0), min(last - begin, self.segments[k].rows)))
        return _joined(parts) if parts else {name: np.zeros(0) for name in names}

    def pieces(self, names: Sequence[str], rows: int = 1 << 20) -> Iterator[tuple[int, Arrays]]:
        """Yield (first row, columns) some rows at a time."""
        for segment, begin in zip(self.segments, self.firsts, strict=False):
            for first in range(0, segment.rows, rows):
                yield begin + first, _joined([segment.read(names, first, min(first + rows, segment.rows))])

    def group_rows(self, group: int) -> IntArray:
        """(segments,) Number of rows of a group in each segment."""
        return np.array([s[group + 1] - s[group] if group + 1 < len(s) else 0 for s in self.starts], np.int64)

    def read_group(self, group: int, names: Sequence[str], first: int = 0, last: int | None = None) -> Arrays:
        """Return rows of some columns of a group, counted within it."""
        parts, begin = [], 0
        for segment, starts, count in zip(self.segments, self.starts, self.group_rows(group).tolist(), strict=True):
            low, high = max(first - begin, 0), count if last is None else min(last - begin, count)
            if low < high:
                at = int(starts[group])
                parts.append(segment.read(names, at + low, at + high))
            begin += count
        return _joined(parts) if parts else {name: np.zeros(0) for name in names}

    def mapped(self, change: Callable[[Arrays, int], Arrays], *, groups: bool = False) -> Store:
        """Return another store whose pieces are made of the pieces of this one and their first rows; this one is
        emptied on the way."""
        out = Store(self.room, groups=groups)
        for k, begin in enumerate(self.firsts[:-1]):
            segment, self.segments[k] = self.segments[k], None  # type: ignore[call-overload]
            if segment._arrays is not None:
                self.room.left += sum(column.nbytes for column in segment._arrays.values())
            out.add(change(segment.read(sorted(segment.names), 0, segment.rows), begin))
        self.segments = []
        return out.close()

    def __getstate__(self) -> dict[str, Any]:
        for segment in self.segments:
            segment.spill()  # so that no process gets a copy of its own
        return self.__dict__


def _joined(parts: Sequence[Arrays]) -> Arrays:
    if len(parts) == 1:
        return parts[0]
    names = dict.fromkeys(name for part in parts for name in part)
    rows = [len(next(iter(part.values()))) for part in parts]
    return {name: np.concatenate([part[name] if name in part else np.full(n, -1, np.int32)
                                  for part, n in zip(parts, rows, strict=True)]) for name in names}
