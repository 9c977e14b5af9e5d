"""Columns of a file that is not columnar itself: in memory as long as they are few, else in one scratch file.

A text file holds its rows one after the other, an analysis wants one signal after the other. The scratch file has no
name where the system allows that, so nothing is left behind even when the program is killed.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import IO, Any
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from ..errors import BacklashError
from ..record import IntArray

IN_MEMORY = 128 << 20  # bytes of samples that are kept in memory, over all files of a run


@dataclass(frozen=True)
class Spilled:
    """A column in the scratch file: a slice of it is read. nbytes: the memory it takes."""

    path: str
    place: int
    dtype: np.dtype[Any]
    count: int
    nbytes = 0

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        first, last, _ = rows.indices(self.count)
        count = max(last - first, 0)
        found = np.fromfile(self.path, self.dtype, count, offset=self.place + first * self.dtype.itemsize)
        if len(found) < count:
            raise BacklashError("the temporary file is cut short", where=tempfile.gettempdir(),
                                remedy="is the disk full?", code="cannot_read")
        return found


Piece = dict[str, NDArray[Any] | Spilled]  # some rows of several columns


class Room:
    """How much memory the columns of one run may still take, and the scratch file for what is beyond."""

    def __init__(self, size: int = IN_MEMORY) -> None:
        self.left = size
        self._file: IO[bytes] | None = None

    def spilled(self, column: NDArray[Any]) -> Spilled:
        """Append a column to the scratch file, which other processes of this machine can read. Raises BacklashError
        without room."""
        try:
            if self._file is None and os.path.exists(f"/proc/{os.getpid()}/fd"):
                self._file = tempfile.TemporaryFile("w+b", buffering=0, prefix="backlash-")  # noqa: SIM115
            elif self._file is None:
                self._file = tempfile.NamedTemporaryFile("w+b", buffering=0, prefix="backlash-",  # noqa: SIM115
                                                         delete=False)
                finalize(self, _remove, self._file)
            place, view = self._file.seek(0, os.SEEK_END), memoryview(column).cast("B")
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            raise BacklashError(
                f"no room for temporary data: {error.strerror}", where=tempfile.gettempdir(), code="cannot_write",
                remedy="name a folder with more room in TMPDIR, or scan some of the loops with --loop") from None
        name = self._file.name
        path = name if isinstance(name, str) else f"/proc/{os.getpid()}/fd/{name}"
        return Spilled(path, place, column.dtype, len(column))

    def __getstate__(self) -> dict[str, Any]:
        return {"left": self.left, "_file": None}


def _remove(file: IO[bytes]) -> None:
    file.close()
    os.unlink(file.name)


class Store:
    """Columns of equal length that are written once, in pieces, and read often.

    groups: numbers of the rows' groups (tags) stand in the column "group" of each piece; rows are then kept group by
    group. stays: in memory, also when it is sent elsewhere.
    """

    def __init__(self, room: Room, *, groups: bool = False, stays: bool = False) -> None:
        self.room, self.groups, self.stays = room, groups, stays
        self.pieces: list[Piece] = []
        self.starts: list[IntArray] = []  # of each piece: where its groups begin, or its only one

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
        piece |= {name: self.room.spilled(column) for name, column in piece.items() if isinstance(column, np.ndarray)}

    def rows(self, group: int = 0) -> IntArray:
        """(pieces,) Number of rows of a group in each piece."""
        return np.array([s[group + 1] - s[group] if group + 1 < len(s) else 0 for s in self.starts], np.int64)

    def read(self, name: str, first: int = 0, last: int | None = None, group: int = 0) -> NDArray[Any]:
        """Return rows of a column, of a group counted within it; what pieces lack is filled up with -1."""
        parts: list[NDArray[Any]] = []
        begin = 0
        for piece, starts, count in zip(self.pieces, self.starts, self.rows(group).tolist(), strict=True):
            low, high = max(first - begin, 0), count if last is None else min(last - begin, count)
            if low < high:
                own = slice(int(starts[group]) + low, int(starts[group]) + high)
                parts.append(piece[name][own] if name in piece else np.full(high - low, -1, np.int32))
            begin += count
        return parts[0] if len(parts) == 1 else np.concatenate(parts or [np.zeros(0)])

    def emptied(self) -> Iterator[Piece]:
        """Yield the pieces, which are gone from here then."""
        while self.pieces:
            self.starts.pop(0)
            piece = self.pieces.pop(0)
            self.room.left += sum(column.nbytes for column in piece.values())
            yield piece

    def __getstate__(self) -> dict[str, Any]:
        for piece in () if self.stays else self.pieces:
            self._spill(piece)  # so that no process gets a copy of its own
        return self.__dict__
