"""Columns of samples, the memory that those of one run may take, and one scratch file for what is beyond. Where it
can, the file has no name: nothing is left behind when the run is killed."""

import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any, Self
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from .errors import BacklashError
from .record import IntArray
from .words import explained

IN_MEMORY = 128 << 20  # bytes of samples, over all files


@dataclass(frozen=True, slots=True)  # there are millions of a large file
class Spilled:
    """A column in the scratch file: a slice of it is read. nbytes: the memory it takes."""

    path: str
    place: int
    dtype: np.dtype[Any]
    count: int
    nbytes = 0

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        first, last, _ = rows.indices(self.count)
        return np.fromfile(self.path, self.dtype, max(last - first, 0), offset=self.place + first * self.dtype.itemsize)


class Room:
    """How much memory the columns of one run may still take, and the scratch file for what is beyond."""

    def __init__(self, size: int = IN_MEMORY) -> None:
        self.left = size
        self._file: IO[bytes] | None = None
        self._path = ""

    def spilled(self, column: NDArray[Any]) -> Spilled:
        """Append a column to the scratch file, which other processes can read. Raises BacklashError without room."""
        try:
            if self._file is None:
                if os.path.isdir("/proc/self/fd"):  # where a file needs no name to be opened by others
                    self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115
                    self._path = f"/proc/{os.getpid()}/fd/{self._file.fileno()}"
                else:
                    self._file = tempfile.NamedTemporaryFile(buffering=0, prefix="backlash-", delete=False)  # noqa: SIM115
                    self._path = self._file.name
                    finalize(self, lambda file: file.close() or os.unlink(file.name), self._file)  # type: ignore
            place, view = self._file.seek(0, os.SEEK_END), memoryview(column).cast("B")
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            raise BacklashError(**explained("no_room", problem=error.strerror), where=tempfile.gettempdir()) from None
        return Spilled(self._path, place, column.dtype, len(column))

    def __getstate__(self) -> dict[str, Any]:
        return {"left": self.left, "_file": None, "_path": ""}


Piece = dict[str, NDArray[Any] | Spilled]  # some rows of several columns


class Columns:
    """Columns of equal length that are written once, in pieces, and read often; lexicons: of those that hold words.
    grouped: rows are kept by the numbers in the column "group" of each piece. stays: in memory, also when sent."""

    def __init__(self, room: Room, *, grouped: bool = False, stays: bool = False) -> None:
        self.room, self.grouped, self.stays = room, grouped, stays
        self.lexicons: dict[str, Any] = {}
        self.pieces: list[Piece] = []
        self.starts: list[IntArray] = []  # of each piece: where its groups begin, or its only one

    @classmethod
    def in_memory(cls) -> Self:
        """Return columns without a limit, which stay in memory also when they are sent."""
        return cls(Room(1 << 62), stays=True)

    def add(self, piece: Piece) -> None:
        starts = np.array([0, len(next(iter(piece.values()), np.zeros(0))[:])])
        if not starts[1]:
            return
        if self.grouped:
            group = piece["group"][:]
            turn = np.argsort(group.astype(np.uint16) if group.max() < 1 << 16 else group, kind="stable")
            starts = np.searchsorted(group[turn], np.arange(int(group.max()) + 2))
            piece = {name: column[:][turn] for name, column in piece.items() if name != "group"}
        self.pieces.append(piece)
        self.starts.append(starts)
        if (size := sum(column.nbytes for column in piece.values())) <= self.room.left:
            self.room.left -= size
        else:
            self._spill(piece)

    def _spill(self, piece: Piece) -> None:
        piece |= {name: self.room.spilled(column) for name, column in piece.items() if isinstance(column, np.ndarray)}

    def rows(self, group: int = 0) -> IntArray:
        """(pieces,) Number of rows of a group in each piece."""
        return np.array([s[group + 1] - s[group] if group + 1 < len(s) else 0 for s in self.starts], np.int64)

    def read(self, name: str, first: int, last: int, group: int = 0) -> NDArray[Any]:
        """Return rows of a column, of a group counted within it; what pieces lack is filled up with -1."""
        parts: list[NDArray[Any]] = []
        for piece, starts, count in zip(self.pieces, self.starts, self.rows(group).tolist(), strict=True):
            low, high = max(first, 0), min(last, count)
            if low < high:
                own = slice(int(starts[group]) + low, int(starts[group]) + high)
                parts.append(piece[name][own] if name in piece else np.full(high - low, -1, np.int32))
            first, last = first - count, last - count
        return parts[0] if len(parts) == 1 else np.concatenate(parts or [np.zeros(0, np.int64)])

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
