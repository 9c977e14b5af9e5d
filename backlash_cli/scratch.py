"""Memory that the samples of one run may take, and one scratch file for what is beyond. Where it can, the file has no
name: nothing is left behind when the run is killed."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from typing import IO, Any
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from .errors import BacklashError
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
