"""Columns of a file that is not columnar itself: in memory as long as they are few, else in one Arrow IPC scratch file.

A text file holds its rows one after the other, an analysis wants one signal after the other. The scratch file has no
name where the system allows that, so nothing is left behind even when the program is killed.
"""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from weakref import WeakValueDictionary, finalize

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import BacklashError
from ..record import IntArray

IN_MEMORY = 128 << 20  # bytes of samples that are kept in memory, over all files of a run
Arrays = dict[str, NDArray[Any]]


class ScratchFile:
    """One file to which Arrow tables are appended; other processes of this machine can read it."""

    def __init__(self, path: str = "") -> None:
        self.path, self._end = path, 0
        self._file: io.FileIO | None = None

    def append(self, arrays: Arrays) -> dict[str, Spilled]:
        """Write columns as an Arrow IPC file; return them as they lie there. Raises BacklashError without room."""
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
        return {name: Spilled(self, place + written.column(name).buffers()[1].address - data.address, column.dtype,
                              len(column)) for name, column in arrays.items()}

    def read(self, place: int, out: NDArray[Any]) -> NDArray[Any]:
        """Fill an array with what stands at a place. Raises BacklashError when it is not there."""
        file = self._opened()
        file.seek(place)
        if len(out) and file.readinto(memoryview(out).cast("B")) != out.nbytes:
            raise BacklashError("the temporary file is cut short", where=tempfile.gettempdir(),
                                remedy="is the disk full?", code="cannot_read")
        return out

    def _opened(self) -> io.FileIO:
        if self._file is None and self.path:
            self._file = io.FileIO(self.path, "rb")
        elif self._file is None:
            number, name = tempfile.mkstemp(prefix="backlash-", suffix=".arrow")
            self._file, self.path = io.FileIO(number, "r+b"), f"/proc/{os.getpid()}/fd/{number}"
            if os.path.exists(self.path):
                os.unlink(name)
            else:
                self.path = name
                finalize(self, os.unlink, name)
        return self._file

    def __reduce__(self) -> tuple[Callable[[str], ScratchFile], tuple[str]]:
        return _of_another_process, (self.path,)


_sent: WeakValueDictionary[str, ScratchFile] = WeakValueDictionary()


def _of_another_process(path: str) -> ScratchFile:
    """Return the file that was sent here, opened once however many columns it holds."""
    return _sent.get(path) or _sent.setdefault(path, ScratchFile(path))


@dataclass(frozen=True)
class Spilled:
    """A column in the scratch file: a slice of it is read. nbytes: the memory it takes."""

    file: ScratchFile
    place: int
    dtype: np.dtype[Any]
    count: int
    nbytes = 0

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        first, last, _ = rows.indices(self.count)
        return self.file.read(self.place + first * self.dtype.itemsize, np.empty(max(last - first, 0), self.dtype))


Piece = dict[str, NDArray[Any] | Spilled]  # some rows of several columns


class Room:
    """How much memory the columns of one run may still take, and the scratch file for what is beyond."""

    def __init__(self, size: int = IN_MEMORY) -> None:
        self.left, self.file = size, ScratchFile()


class Store:
    """Columns of equal length that are written once, in pieces, and read often.

    groups: numbers of the rows' groups (tags) stand in the column "group" of each piece; rows are then kept group by
    group. stays: in memory, also when it is sent elsewhere.
    """

    def __init__(self, room: Room, *, groups: bool = False, stays: bool = False) -> None:
        self.room, self.groups, self.stays = room, groups, stays
        self.pieces: list[Piece] = []
        self.starts: list[IntArray] = []  # of each piece: where its groups begin, or its only one

    @property
    def rows(self) -> int:
        return sum(int(starts[-1]) for starts in self.starts)

    def add(self, arrays: Mapping[str, NDArray[Any] | Spilled]) -> None:
        """Take the next rows."""
        piece = dict(arrays)
        rows = len(next(iter(piece.values()), ()))
        if not rows:
            return
        starts = np.array([0, rows])
        if self.groups:
            group = piece.pop("group")[:]
            turn = np.argsort(group.astype(np.uint16) if group.max() < 1 << 16 else group, kind="stable")
            starts = np.searchsorted(group[turn], np.arange(int(group.max()) + 2))
            piece = {name: column[:][turn] for name, column in piece.items()}
        size = sum(column.nbytes for column in piece.values())
        self.pieces.append(piece)
        self.starts.append(starts)
        if size <= self.room.left:
            self.room.left -= size
        else:
            self._spill(piece)

    def _spill(self, piece: Piece) -> None:
        """Bring what is in memory of a piece to the scratch file."""
        if inside := {name: column for name, column in piece.items() if isinstance(column, np.ndarray)}:
            piece |= self.room.file.append(inside)

    def group_rows(self, group: int) -> IntArray:
        """(pieces,) Number of rows of a group in each piece."""
        return np.array([s[group + 1] - s[group] if group + 1 < len(s) else 0 for s in self.starts], np.int64)

    def read(self, names: Sequence[str], first: int = 0, last: int | None = None, group: int = 0) -> Arrays:
        """Return rows of some columns, of a group counted within it; one that a piece lacks is filled up with -1."""
        parts: list[Arrays] = []
        begin = 0
        for piece, starts, count in zip(self.pieces, self.starts, self.group_rows(group).tolist(), strict=True):
            low, high = max(first - begin, 0), count if last is None else min(last - begin, count)
            if low < high:
                own = slice(int(starts[group]) + low, int(starts[group]) + high)
                parts.append({name: piece[name][own] if name in piece else np.full(high - low, -1, np.int32)
                              for name in names})
            begin += count
        if len(parts) == 1:
            return parts[0]
        return {name: np.concatenate([part[name] for part in parts]) if parts else np.zeros(0) for name in names}

    def changed(self, change: Callable[[Piece, int], Mapping[str, NDArray[Any] | Spilled]], *, groups: bool = False
                ) -> Store:
        """Return another store whose pieces are made of the pieces of this one and their first rows; this one is
        emptied on the way."""
        out = Store(self.room, groups=groups)
        first = 0
        while self.pieces:
            piece, starts = self.pieces.pop(0), self.starts.pop(0)
            self.room.left += sum(column.nbytes for column in piece.values())
            out.add(change(piece, first))
            first += int(starts[-1])
        return out

    def __getstate__(self) -> dict[str, Any]:
        for piece in () if self.stays else self.pieces:
            self._spill(piece)  # so that no process gets a copy of its own
        return self.__dict__
