"""What a scan has finished so far, beside the history: a scan that was stopped goes on from there.

One file per scan (the same inputs and options), `HISTORY.unfinished-...`, gone when the scan has ended well. Every
process adds a line to its end as soon as it has finished a loop, in one write: what it finished before it was killed is
there, and a line that was cut short is left out, for it cannot be read. A report is taken over only where its key fits,
which stands for all that the report is made from."""

import base64
import contextlib
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from .._version import __version__
from ..errors import BacklashError
from ..record import Note, fingerprint
from ..results import LoopReport, Verdict
from ..words import explained
from .store import check_folder

KEPT = 30 * 86400.0  # seconds; what a stopped scan left is no use any more


class Unfinished:
    """The finished loops of one scan, `known` by their keys. Can be sent to other processes, which only add to it.

    history: its database. scan: all that makes two scans the same one. resume: take over what is there; else it begins
    anew. Raises BacklashError when the file cannot be made."""

    def __init__(self, history: str | Path, scan: Iterable[object], *, resume: bool) -> None:
        check_folder(history := Path(history))
        name = fingerprint(repr((__version__, *scan)), 12)
        self.path = history.with_name(f"{history.name}.unfinished-{name}")
        self.known: dict[str, LoopReport] = {}
        self.resumed = resume
        try:
            with open(self.path, "a+b" if resume else "w+b") as file:
                file.seek(0)
                for line in file:
                    with contextlib.suppress(ValueError):
                        self.known.update([from_text(line)])
        except OSError as error:
            raise BacklashError(**explained("history_unusable", problem=error.strerror), where=str(history)) from None
        # what scans left that were stopped long ago and never resumed
        for path in history.parent.glob(f"{history.name}.unfinished-????????????"):
            with contextlib.suppress(OSError):
                if path.stat().st_mtime < time.time() - KEPT:
                    path.unlink()

    def add(self, key: str, report: LoopReport | Note) -> None:
        """Keep the report of a finished loop; one that failed is tried again next time. key: empty, nothing is kept.

        A full disk costs no more than the resuming."""
        if not key or isinstance(report, Note) or report.verdict is Verdict.ERROR:
            return
        with contextlib.suppress(OSError, TypeError, ValueError, OverflowError):
            line = b"\n" + to_text(key, report) + b"\n"
            with open(self.path, "ab", buffering=0) as file:
                while line:
                    line = line[file.write(line) :]

    def close(self, *, ended: bool = False) -> None:
        """The scan has stopped: the file stays where it holds anything; or has ended well, and leaves nothing to do."""
        with contextlib.suppress(OSError):
            if ended or not self.path.stat().st_size:
                self.path.unlink()

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "known": {}}


def to_text(key: str, report: LoopReport) -> bytes:
    """Return a finished loop and its key as text without a line end: numbers with all their digits, arrays as such.

    Raises TypeError, ValueError or OverflowError for what cannot be brought back as it was."""
    return base64.b64encode(msgspec.msgpack.encode((key, report), enc_hook=_plain))


def from_text(text: bytes) -> tuple[str, LoopReport]:
    """Return what `to_text` was given. Raises ValueError for any other text."""
    return msgspec.msgpack.decode(base64.b64decode(text), type=tuple[str, LoopReport], dec_hook=lambda kind, value: (
        value if kind is object else np.frombuffer(value[1], value[0])))  # what may be anything stays as it is


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        return value.dtype.str, value.tobytes()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} cannot be kept")
