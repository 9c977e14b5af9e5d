"""One nightly job at a time: a lock that the operating system gives back when a run dies."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

from ..errors import BacklashError


@contextlib.contextmanager
def lock(path: Path) -> Iterator[str]:
    """Hold the lock file at `path`; gives a remark on a stale lock that was taken over, else an empty text.

    The file holds process and host of the run that works, and is empty when none does. A file that is not empty and
    that nobody holds was left by a run that was killed. Raises BacklashError when another run works.
    """
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise BacklashError(f"cannot make the lock file: {error.strerror}", where=str(path), code="lock",
                            remedy="check the folder, or set `lock` in the configuration") from None
    try:
        try:
            _hold(handle)
        except OSError:
            raise BacklashError(f"another nightly job is working ({_read(handle) or 'unknown'})", where=str(path),
                                code="busy", remedy="wait for it; the next run does what this one did not") from None
        before = _read(handle)
        _write(handle, f"process {os.getpid()} on {socket.gethostname()}\n")
        try:
            yield f"the last job ({before}) was stopped before its end; its lock is taken over" if before else ""
        finally:
            _write(handle, "")
    finally:
        os.close(handle)


def _hold(handle: int) -> None:
    """Take the lock or raise OSError at once."""
    if sys.platform == "win32":
        import msvcrt

        os.lseek(handle, 1 << 20, os.SEEK_SET)  # beyond the text, which others must be able to read
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _read(handle: int) -> str:
    os.lseek(handle, 0, os.SEEK_SET)
    return os.read(handle, 200).decode("utf-8", "replace").strip()


def _write(handle: int, text: str) -> None:
    os.ftruncate(handle, 0)
    os.lseek(handle, 0, os.SEEK_SET)
    os.write(handle, text.encode())
