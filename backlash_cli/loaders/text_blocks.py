"""Text of any length in blocks of whole lines, each in memory of its own with some room behind it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .compression import limited_pieces
from .places import Remote, open_place

PAD = 32  # bytes of room behind the lines
_TAIL = 1 << 16
_LONGEST = 64 << 20  # bytes of a line that is no line of an export


class EndlessLine(ValueError):
    """There is no end of a line for very long."""


@dataclass(frozen=True)
class Lines:
    """Whole lines of text: the first `size` bytes of `data`, the last one a line end; PAD more follow."""

    data: NDArray[np.uint8]
    size: int

    @property
    def text(self) -> NDArray[np.uint8]:
        """(bytes,) the lines alone."""
        return self.data[: self.size]

    def buffer(self) -> pa.BufferReader:
        """Return the lines as Arrow reads them."""
        return pa.BufferReader(pa.py_buffer(self.text))

    def __len__(self) -> int:
        return self.size


class Source(Protocol):
    """Where bytes come from, one after the other."""

    def readinto(self, room: memoryview, /) -> int | None:
        """Fill the beginning of `room` and return how many bytes that are; none at the end."""


class Pieces:
    """A source of pieces of text."""

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self._pieces = pieces
        self._rest = memoryview(b"")

    def readinto(self, room: memoryview, /) -> int:
        """Fill the beginning of `room` and return how many bytes that are; none at the end."""
        if not self._rest:
            self._rest = memoryview(next(self._pieces, b""))
        count = min(len(room), len(self._rest))
        room[:count] = self._rest[:count]
        self._rest = self._rest[count:]
        return count


@contextmanager
def source_of(path: Path | Remote, codec: str, size: int) -> Iterator[Source]:
    """Open the text of a file, which is fetched `size` bytes at a time where it lies elsewhere."""
    if codec:
        yield Pieces(limited_pieces(path, codec))
        return
    with open_place(path) as file:
        yield file if isinstance(path, Path) else Pieces(iter(lambda: file.read(size), b""))  # type: ignore[misc]


def read_up_to(source: Source, size: int) -> bytes:
    """Return the next bytes of a source, `size` of them unless it ends before."""
    room = bytearray(size)
    return bytes(memoryview(room)[: _fill(source, memoryview(room))])


def whole_lines(begun: bytes, source: Source, size: int) -> Iterator[Lines]:
    """Yield blocks of about `size` bytes, cut where lines end: first what has begun, then the rest of its source.

    Raises EndlessLine.
    """
    rest = np.frombuffer(begun, np.uint8)
    ended = False
    while not ended:
        data = np.empty(len(rest) + size + PAD, np.uint8)
        data[: len(rest)] = rest
        count = _fill(source, memoryview(data)[len(rest) : -PAD])
        ended, filled = count < size, len(rest) + count
        cut = _last_line_end(data[:filled])
        if cut:
            yield Lines(data, cut)
        elif filled > _LONGEST:
            raise EndlessLine
        rest = data[cut:filled].copy()
    if len(rest):
        yield Lines(np.concatenate([rest, np.full(1, 10, np.uint8), np.zeros(PAD, np.uint8)]), len(rest) + 1)


def _fill(source: Source, room: memoryview) -> int:
    filled = 0
    while filled < len(room):
        count = source.readinto(room[filled:])
        if not count:
            break
        filled += count
    return filled


def _last_line_end(data: NDArray[np.uint8]) -> int:
    """Number of bytes up to the last line end, 0 where there is none."""
    end = len(data)
    while end:
        begin = max(end - _TAIL, 0)
        place = data[begin:end].tobytes().rfind(b"\n")
        if place >= 0:
            return begin + place + 1
        end = begin
    return 0
