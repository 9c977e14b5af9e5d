"""One recorded signal: its stamps and cells and where they lie; they are read when a loop asks for them.

A text file holds its rows one after the other, an analysis wants one signal after the other: a Store keeps columns, in
memory as long as they are few, else in one scratch file. That has no name where the system allows it, so nothing is
left behind even when the program is killed.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import IO, Any, Protocol
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from ..errors import BacklashError
from ..record import IntArray, Note
from .cells import Cells, Lexicon
from .grid import NAT

IN_MEMORY = 128 << 20  # bytes of samples that are kept in memory, over all files of a run
PIECE = 1 << 20  # rows that are looked at together


@dataclass(frozen=True)
class Spilled:
    """A column in the scratch file: a slice of it is read. nbytes: the memory it takes."""

    path: str
    place: int
    dtype: np.dtype[Any]
    count: int
    nbytes = 0

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        first, last, _ = rows.indices(self.count)
        return np.fromfile(self.path, self.dtype, max(last - first, 0),
                           offset=self.place + first * self.dtype.itemsize)


Piece = dict[str, NDArray[Any] | Spilled]  # some rows of several columns


class Room:
    """How much memory the columns of one run may still take, and the scratch file for what is beyond."""

    def __init__(self, size: int = IN_MEMORY) -> None:
        self.left = size
        self._file: IO[bytes] | None = None
        self._path = ""

    def spilled(self, column: NDArray[Any]) -> Spilled:
        """Append a column to the scratch file, which other processes of this machine can read. Raises BacklashError
        without room."""
        try:
            if self._file is None:
                self._file = tempfile.NamedTemporaryFile("w+b", buffering=0, prefix="backlash-",  # noqa: SIM115
                                                         delete=False)
                self._path = f"/proc/{os.getpid()}/fd/{self._file.fileno()}"
                if os.path.exists(self._path):
                    os.unlink(self._file.name)
                else:
                    self._path = self._file.name
                    finalize(self, _remove, self._file)
            place, view = self._file.seek(0, os.SEEK_END), memoryview(column).cast("B")
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            raise BacklashError(
                f"no room for temporary data: {error.strerror}", where=tempfile.gettempdir(), code="cannot_write",
                remedy="name a folder with more room in TMPDIR, or scan some of the loops with --loop") from None
        return Spilled(self._path, place, column.dtype, len(column))

    def __getstate__(self) -> dict[str, Any]:
        return {"left": self.left, "_file": None, "_path": ""}


def _remove(file: IO[bytes]) -> None:
    file.close()
    os.unlink(file.name)


class Rows(Protocol):
    """Rows of a file; `column`: a name by which they know their columns; group: of which they are, if they are."""

    def cells(self, column: str, first: int, last: int, group: int) -> Cells:
        """Return the cells of rows first..last-1."""

    def stamps(self, column: str, first: int, last: int, group: int) -> IntArray:
        """Return the stamps of rows first..last-1 [microseconds since 1970 UTC], NAT where unreadable."""


class Store:
    """Columns of equal length that are written once, in pieces, and read often.

    Places of texts in the lexicon of a column "v3" stand in the column "v3w". grouped: numbers of the rows' groups
    (tags) stand in the column "group" of each piece; rows are then kept group by group. stays: in memory, also when it
    is sent elsewhere.
    """

    def __init__(self, room: Room, *, grouped: bool = False, stays: bool = False) -> None:
        self.room, self.grouped, self.stays = room, grouped, stays
        self.lexicons: dict[str, Lexicon] = {}
        self.pieces: list[Piece] = []
        self.starts: list[IntArray] = []  # of each piece: where its groups begin, or its only one

    def add(self, piece: Piece) -> None:
        """Take the next rows."""
        starts = np.array([0, len(next(iter(piece.values()))[:])])
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
        return parts[0] if len(parts) == 1 else np.concatenate(parts or [np.zeros(0)])

    def cells(self, column: str, first: int, last: int, group: int = 0) -> Cells:
        values, lexicon = self.read(column, first, last, group), self.lexicons.get(column)
        return Cells(values, self.read(f"{column}w", first, last, group), lexicon) if lexicon else Cells(values)

    def stamps(self, column: str, first: int, last: int, group: int = 0) -> IntArray:
        return self.read(column, first, last, group).astype(np.int64, copy=False)

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


@dataclass(frozen=True, eq=False)
class Axis:
    """Rows that belong together, and where their stamps lie, which all signals recorded in these rows share.

    column: of their stamps. which: of the rows, or of those of a group, these are. absolute: False for stamps that
    count from an unknown start. where: file. first_line: line of row 0. end: the last stamp where it is known.
    """

    rows: Rows
    column: str
    which: range | IntArray
    group: int = 0
    absolute: bool = True
    notes: tuple[Note, ...] = ()
    where: str = ""
    first_line: int = 0
    end: int | None = None

    def __len__(self) -> int:
        return len(self.which)

    def _base(self, first: int, last: int) -> tuple[tuple[int, int, int], slice | IntArray]:
        """Between which rows of the file these lie, and which of those they are."""
        which = self.which[first:last]
        if isinstance(which, range):
            return (which.start, which.stop, self.group), slice(None)
        begin, end = (int(which.min()), int(which.max()) + 1) if len(which) else (0, 0)
        return (begin, end, self.group), which - begin

    def read(self, first: int = 0, last: int | None = None) -> IntArray:
        """Return the stamps of rows first..last-1: microseconds since 1970 UTC, NAT where unreadable."""
        between, taken = self._base(first, len(self) if last is None else last)
        return self.rows.stamps(self.column, *between)[taken]

    def cells(self, column: str) -> Cells:
        """Return the cells of a column in all rows."""
        between, taken = self._base(0, len(self))
        return self.rows.cells(column, *between)[taken]

    def pieces(self) -> Iterator[IntArray]:
        """Yield all stamps, some rows at a time."""
        return (self.read(first, min(first + PIECE, len(self))) for first in range(0, len(self), PIECE))

    def first(self) -> int:
        """Return the first stamp that was read, 0 if there is none."""
        return next((int(piece[known][0]) for piece in self.pieces() if (known := piece != NAT).any()), 0)

    def last(self) -> int | None:
        """Return the last stamp, None if there is none."""
        last = self.end if self.end is not None else max((int(p.max()) for p in self.pieces()), default=NAT)
        return None if last == NAT else last

    def part(self, chosen: slice | IntArray) -> Axis:
        """Return some of the rows."""
        if isinstance(chosen, slice):
            line = self.first_line and self.first_line + int(chosen.start or 0)
            return replace(self, which=self.which[chosen], first_line=line, end=None)
        return replace(self, which=np.asarray(self.which)[chosen], first_line=0, end=None)

    def packed(self, columns: Iterable[str]) -> Axis:
        """Return rows that lie in the scratch file of this machine with some columns of cells in memory; all others as
        they are."""
        if not isinstance(self.rows, Store):
            return self
        store = Store(Room(1 << 62), stays=True)
        store.lexicons = self.rows.lexicons
        piece: Piece = {self.column: self.read()}
        for column in columns:
            cells = self.cells(column)
            piece |= {column: cells.values} | ({} if cells.codes is None else {f"{column}w": cells.codes})
        store.add(piece)
        return replace(self, rows=store, which=range(len(self)), group=0)


@dataclass(frozen=True, eq=False)
class Series:
    """One signal of one file. tag: its name as written. loop, role, signal: that name taken apart. column: of the
    file. stamps: place of its set of rows in the layout. quality: name of the column `marked` by which it is good or
    not, "" if there is none. axis: its rows, once they are stored."""

    tag: str
    loop: str
    role: str
    signal: str
    column: int
    stamps: int = 0
    marked: int = -1
    quality: str = ""
    axis: Axis = field(default=None)  # type: ignore[assignment]

    def cells(self) -> Cells:
        """Return its cells."""
        return self.axis.cells(f"v{self.column}")

    def marks(self) -> Cells | None:
        """Return the quality of its cells, None where there is none."""
        return self.axis.cells(f"v{self.marked}") if self.quality else None
