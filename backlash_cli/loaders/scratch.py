"""Columns of a file that is not columnar itself: in memory as long as they are few, else in one Arrow IPC scratch file.

A text file holds its rows one after the other, an analysis wants one signal after the other. The scratch file has no
name where the system allows that, so nothing is left behind even when the program is killed.
"""

from __future__ import annotations

import io
import os
import tempfile
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

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
        self.path, self._own, self._end = path, not path, 0
        self._file: io.FileIO | None = None

    def append(self, arrays: Mapping[str, NDArray[Any]]) -> dict[str, int]:
        """Write columns as an Arrow IPC file; return where in the file each begins. Raises BacklashError without room.
        """
        sink = pa.BufferOutputStream()
        batch = pa.RecordBatch.from_arrays([pa.array(column) for column in arrays.values()], list(arrays))
        with pa.ipc.new_file(sink, batch.schema) as writer:
            writer.write_batch(batch)
        data = sink.getvalue()
        place, view = self._end, memoryview(data)
        try:
            file = self._opened()
            file.seek(place)
            while view:
                view = view[file.write(view) :]
        except OSError as error:
            raise BacklashError(
                f"no room for temporary data: {error.strerror}", where=tempfile.gettempdir(), code="cannot_write",
                remedy="name a folder with more room in TMPDIR, or scan some of the loops with --loop") from None
        self._end += -(-len(data) // 64) * 64
        written = pa.ipc.open_file(data).get_batch(0)
        return {name: place + written.column(name).buffers()[1].address - data.address for name in arrays}

    def read(self, place: int, out: NDArray[Any]) -> NDArray[Any]:
        """Fill an array with what stands at a place. Raises BacklashError when it is not there."""
        file = self._opened()
        file.seek(place)
        if len(out) and file.readinto(memoryview(out).cast("B")) != out.nbytes:
            raise BacklashError("the temporary file is cut short", where=tempfile.gettempdir(),
                                remedy="is the disk full?", code="cannot_read")
        return out

    def _opened(self) -> io.FileIO:
        if self._file is None and not self._own:
            self._file = io.FileIO(self.path, "rb")
        elif self._file is None:
            number, self.path = tempfile.mkstemp(prefix="backlash-", suffix=".arrow")
            self._file = io.FileIO(number, "r+b")
            shared = f"/proc/{os.getpid()}/fd/{number}"
            if Path(shared).exists():
                os.unlink(self.path)
                self.path = shared
        return self._file

    def __reduce__(self) -> tuple[Callable[[str], ScratchFile], tuple[str]]:
        return _of_another_process, (self.path,)

    def __del__(self) -> None:
        if self._file is not None:
            self._file.close()
            if self._own and not self.path.startswith("/proc/"):
                Path(self.path).unlink(missing_ok=True)


_known: WeakValueDictionary[str, ScratchFile] = WeakValueDictionary()


def _of_another_process(path: str) -> ScratchFile:
    """Return the file that was sent here, opened once however many columns it holds."""
    found = _known.get(path) if path else None
    if found is None:
        found = ScratchFile(path)
        if path:
            _known[path] = found
    return found


class Room:
    """How much memory the columns of one run may still take, and the scratch file for what is beyond."""

    def __init__(self, size: int = IN_MEMORY) -> None:
        self.left, self.file = size, ScratchFile()


class Segment:
    """Some rows of several columns."""

    def __init__(self, arrays: Arrays, rows: int, room: Room, *, in_memory: bool) -> None:
        self.rows, self.names, self._room = rows, set(arrays), room
        self._arrays: Arrays | None = arrays
        self._places: dict[str, tuple[int, np.dtype[Any]]] = {}
        if not in_memory:
            self.spill()

    def spill(self) -> None:
        """Write what is in memory to the scratch file."""
        if self._arrays is not None:
            places = self._room.file.append(self._arrays)
            self._places = {name: (place, self._arrays[name].dtype) for name, place in places.items()}
            self._arrays = None

    def read(self, names: Sequence[str], first: int, last: int) -> Arrays:
        """Return rows first..last-1 of those of the columns that there are."""
        there = [name for name in names if name in self.names]
        if self._arrays is not None:
            return {name: self._arrays[name][first:last] for name in there}
        found = {}
        for name in there:
            place, kind = self._places[name]
            found[name] = self._room.file.read(place + first * kind.itemsize, np.empty(max(last - first, 0), kind))
        return found


class Store:
    """Columns of equal length that are written once, in pieces, and read often. groups: numbers of the rows' groups
    (tags) stand in the column "group" of each piece; rows are then kept group by group. stays: in memory, also when it
    is sent elsewhere."""

    def __init__(self, room: Room, *, groups: bool = False, stays: bool = False) -> None:
        self.room, self.groups, self.stays = room, groups, stays
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
        for segment in () if self.stays else self.segments:
            segment.spill()  # so that no process gets a copy of its own
        return self.__dict__


def _joined(parts: Sequence[Arrays]) -> Arrays:
    if len(parts) == 1:
        return parts[0]
    names = dict.fromkeys(name for part in parts for name in part)
    rows = [len(next(iter(part.values()))) for part in parts]
    return {name: np.concatenate([part[name] if name in part else np.full(n, -1, np.int32)
                                  for part, n in zip(parts, rows, strict=True)]) for name in names}
