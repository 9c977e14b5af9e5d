"""Columns of a large CSV, kept column by column: in memory as long as they are few, else in a temporary file.

A CSV holds its rows one after the other, an analysis wants one loop after the other. The store turns one into the
other in bounded memory. The temporary file has no name where the system allows that, so nothing is left behind even
when the program is killed.
"""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BacklashError

IN_MEMORY = 96 << 20  # bytes of samples that are kept in memory, over all files of a run


class Room:
    """How much memory the stores of one run may still use."""

    def __init__(self, size: int = IN_MEMORY) -> None:
        self.left = size

    def take(self, size: int) -> bool:
        """Say whether `size` bytes may stay in memory, and count them."""
        if size > self.left:
            return False
        self.left -= size
        return True


class ColumnStore:
    """Pieces of (columns, rows) float64, taken in file order and given back column by column.

    It can be sent to another process of this machine, which reads it from the file: what is in memory goes there first,
    so that no process gets a copy of its own.
    """

    def __init__(self, room: Room | None = None) -> None:
        self.rows = 0
        self._room = room or Room()
        self._pieces: list[tuple[NDArray[np.float64] | int, int]] = []  # (array or place in the file, rows)
        self._file: io.FileIO | None = None
        self._path = ""
        self._end = 0
        self._own = True

    def add(self, piece: NDArray[np.float64]) -> None:
        """Take the next rows, (columns, rows); the array may be kept.

        Raises BacklashError when the temporary file finds no room.
        """
        rows = piece.shape[1]
        if not rows:
            return
        self.rows += rows
        piece = np.ascontiguousarray(piece)
        kept = self._file is None and self._room.take(piece.nbytes)
        self._pieces.append((piece if kept else self._written(piece), rows))

    @property
    def pieces(self) -> int:
        """Number of pieces taken so far."""
        return len(self._pieces)

    def column(self, slot: int) -> NDArray[np.float64]:
        """Return all rows of one column, a new array."""
        out = np.empty(self.rows)
        at = 0
        for part in self.parts(slot):
            out[at : at + len(part)] = part
            at += len(part)
        return out

    def parts(self, slot: int) -> Iterator[NDArray[np.float64]]:
        """Yield the rows of one column piece by piece."""
        return (self.part(number, slot) for number in range(len(self._pieces)))

    def part(self, number: int, slot: int, first: int = 0, rows: int | None = None) -> NDArray[np.float64]:
        """Return some rows of one column of one piece; all from `first` on if `rows` is None."""
        piece, there = self._pieces[number]
        rows = there - first if rows is None else rows
        if not isinstance(piece, int):
            return piece[slot, first : first + rows]
        out = np.empty(rows)
        file = self._opened()
        file.seek(piece + (slot * there + first) * 8)
        if file.readinto(memoryview(out).cast("B")) != 8 * rows:
            raise BacklashError("the temporary file is cut short", where=tempfile.gettempdir(),
                                remedy="is the disk full?", code="cannot_read")
        return out

    def _written(self, piece: NDArray[np.float64]) -> int:
        """Write a piece to the file and return its place there."""
        data = memoryview(piece).cast("B")
        try:
            file = self._opened()
            file.seek(self._end)
            written = 0
            while written < len(data):
                written += file.write(data[written:])
        except OSError as error:
            raise BacklashError(
                f"no room for temporary data: {error.strerror}", where=tempfile.gettempdir(), code="cannot_write",
                remedy="name a folder with more room in TMPDIR, or scan some of the loops with --loop",
            ) from None
        place = self._end
        self._end += len(data)
        return place

    def _opened(self) -> io.FileIO:
        if self._file is None and self._path:  # sent here by the process that made it
            self._file = io.FileIO(self._path, "rb")
        elif self._file is None:
            number, self._path = tempfile.mkstemp(prefix="backlash-", suffix=".columns")
            self._file = io.FileIO(number, "r+b")
            shared = f"/proc/{os.getpid()}/fd/{number}"
            if Path(shared).exists():
                os.unlink(self._path)
                self._path = shared
        return self._file

    def __getstate__(self) -> dict[str, Any]:
        with contextlib.suppress(BacklashError):  # without room on disk it is copied
            self._pieces = [(piece if isinstance(piece, int) else self._written(piece), rows)
                            for piece, rows in self._pieces]
        return {**self.__dict__, "_file": None, "_own": False, "_room": Room(0)}

    def __del__(self) -> None:
        if self._file is not None:
            self._file.close()
            if self._own and not self._path.startswith("/proc/"):
                Path(self._path).unlink(missing_ok=True)
