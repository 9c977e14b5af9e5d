"""Columns of a large CSV, kept column by column: in memory as long as they are few, else in a temporary file.

A CSV holds its rows one after the other, an analysis wants one loop after the other. The store turns one into the
other in bounded memory.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from ..errors import BacklashError
from .temporary import TemporaryData

IN_MEMORY = 96 << 20  # bytes of samples that are kept in memory, over all files of a run


class Room:
    """How much memory the stores of one run may still use, and the temporary file for what is beyond."""

    def __init__(self, size: int = IN_MEMORY, beyond: TemporaryData | None = None) -> None:
        self.left = size
        self.beyond = beyond or TemporaryData()

    def take(self, size: int) -> bool:
        """Say whether `size` bytes may stay in memory, and count them."""
        if size > self.left:
            return False
        self.left -= size
        return True


_on_disk: WeakValueDictionary[int, TemporaryData] = WeakValueDictionary()  # by process: a forked one has its own


def on_disk() -> Room:
    """Return room in a temporary file only; the same file as long as something lies in it."""
    return Room(0, _on_disk.setdefault(os.getpid(), TemporaryData()))


class ColumnStore:
    """Pieces of (columns, rows) float64, taken in file order and given back column by column.

    It can be sent to another process of this machine, which reads it from the file: what is in memory goes there first,
    so that no process gets a copy of its own.
    """

    def __init__(self, room: Room | None = None) -> None:
        self.rows = 0
        self._room = room or Room()
        self._beyond = self._room.beyond
        self._full = False
        self._pieces: list[tuple[NDArray[np.float64] | int, int]] = []  # (array or place in the file, rows)

    def add(self, piece: NDArray[np.float64]) -> None:
        """Take the next rows, (columns, rows); the array may be kept.

        Raises BacklashError when the temporary file finds no room.
        """
        rows = piece.shape[1]
        if not rows:
            return
        self.rows += rows
        piece = np.ascontiguousarray(piece)
        self._full = self._full or not self._room.take(piece.nbytes)
        self._pieces.append((self._written(piece) if self._full else piece, rows))

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
        if rows:
            self._beyond.read(piece + (slot * there + first) * 8, memoryview(out).cast("B"))
        return out

    def _written(self, piece: NDArray[np.float64]) -> int:
        """Write a piece to the file and return its place there."""
        return self._beyond.write(memoryview(piece).cast("B"))

    def __getstate__(self) -> dict[str, Any]:
        with contextlib.suppress(BacklashError):  # without room on disk it is copied
            self._pieces = [(piece if isinstance(piece, int) else self._written(piece), rows)
                            for piece, rows in self._pieces]
        return {**self.__dict__, "_room": Room(0, self._beyond)}
