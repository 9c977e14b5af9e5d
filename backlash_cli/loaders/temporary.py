"""One temporary file for all columns of a run that do not stay in memory.

It has no name where the system allows that, so nothing is left behind even when the program is killed. One for all: a
folder may hold more files than a process may have open.
"""

from __future__ import annotations

import io
import os
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

from ..errors import BacklashError


class TemporaryData:
    """Bytes that are written once and read often. It can be sent to another process of this machine, which reads them.

    path, inode: of the file of another process.
    """

    def __init__(self, path: str = "", inode: int = 0) -> None:
        self._path, self._inode = path, inode
        self._own = not path
        self._file: io.FileIO | None = None
        self._end = 0
        self._lock = threading.Lock()

    def write(self, data: memoryview) -> int:
        """Add bytes and return their place. Raises BacklashError where there is no room."""
        try:
            with self._lock:
                file = self._opened()
                file.seek(self._end)
                written = 0
                while written < len(data):
                    written += file.write(data[written:])
                place, self._end = self._end, self._end + len(data)
        except OSError as error:
            raise BacklashError(
                f"no room for temporary data: {error.strerror}", where=tempfile.gettempdir(), code="cannot_write",
                remedy="name a folder with more room in TMPDIR, or scan some of the loops with --loop",
            ) from None
        return place

    def read(self, place: int, out: memoryview) -> None:
        """Fill `out` with the bytes from a place on. Raises BacklashError when they are not there."""
        with self._lock:
            file = self._opened()
            file.seek(place)
            count = file.readinto(out)
        if count != len(out):
            raise BacklashError("the temporary file is cut short", where=tempfile.gettempdir(),
                                remedy="is the disk full?", code="cannot_read")

    def _opened(self) -> io.FileIO:
        if self._file is None and not self._own:
            self._file = io.FileIO(self._path, "rb")
        elif self._file is None:
            number, self._path = tempfile.mkstemp(prefix="backlash-", suffix=".columns")
            self._file = io.FileIO(number, "r+b")
            self._inode = os.fstat(number).st_ino
            shared = f"/proc/{os.getpid()}/fd/{number}"
            if Path(shared).exists():
                os.unlink(self._path)
                self._path = shared
        return self._file

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return _of_another_process, (self._path, self._inode)

    def __del__(self) -> None:
        if self._file is not None:
            self._file.close()
            if self._own and not self._path.startswith("/proc/"):
                Path(self._path).unlink(missing_ok=True)


_known: WeakValueDictionary[tuple[str, int], TemporaryData] = WeakValueDictionary()


def _of_another_process(path: str, inode: int) -> TemporaryData:
    """Return the file that was sent here, opened once however many columns it holds."""
    if not path:
        return TemporaryData()
    found = _known.get((path, inode))
    if found is None:
        found = _known[path, inode] = TemporaryData(path, inode)
    return found
