"""Whole files only: written beside their destination, then moved there, so that nobody meets half a report."""

import contextlib
import errno
import functools
import os
import secrets
import stat
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from ..errors import BacklashError, UsageError
from ..words import WORDS, explained

LEFT_BEHIND = 86400.0  # seconds; no run takes a day to write one file


def form_of(output: Path | None, forms: Mapping[str, str]) -> str:
    """Return the form that a file's ending asks for, the first of `forms` without one; UsageError for another."""
    suffix = output.suffix.lower() if output else ""
    if suffix[1:].isalpha() and suffix not in forms:
        raise UsageError(**explained("no_such_form", suffix=suffix, forms=", ".join(forms)), where=f"--output {output}")
    return forms.get(suffix, next(iter(forms.values())))


def write_text(path: str | os.PathLike[str], text: str | Iterable[str]) -> None:
    """Write a text, or one in pieces, as UTF-8 to `path`, whole or not at all.

    Raises BacklashError when the disk is full or the folder cannot be written; the old file is then untouched."""
    with (replacing(path) as temporary,
          temporary.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file):
        file.writelines([text] if isinstance(text, str) else text)


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary file to write to, and move it to `path` when the block ends well.

    It stands in the same folder, because only then is the move one step for every reader. On any failure, and on
    Ctrl-C, it is removed and `path` keeps its old content. A link is followed; a device or pipe (/dev/stdout) is
    written straight, since it must not be replaced by a file. Raises BacklashError as `write_text`."""
    given, target = Path(path), Path(os.path.realpath(path))
    with told(path):
        mode = given.stat().st_mode if given.exists() else None
        if given.is_dir():
            raise IsADirectoryError(errno.EISDIR, "is a folder")
        if mode is not None and not stat.S_ISREG(mode):
            yield given  # the name behind a pipe's link names nothing
            return
        _sweep(target.parent)
        temporary = target.parent / f".backlash-{secrets.token_hex(6)}.tmp"
        try:
            # O_EXCL: never through a link that somebody put there; 0o666 leaves the rights to the user's umask.
            os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
            yield temporary
            if mode is not None:
                os.chmod(temporary, stat.S_IMODE(mode))
            _flush(temporary)
            os.replace(temporary, target)
        except BaseException:
            with contextlib.suppress(OSError):
                temporary.unlink()
            raise
        with contextlib.suppress(OSError):
            _flush(target.parent)


def make_folder(path: str | os.PathLike[str]) -> None:
    """Make a folder, and those above it, where they do not exist. Raises BacklashError when that is not possible."""
    with told(path):
        Path(path).mkdir(parents=True, exist_ok=True)


@contextlib.contextmanager
def told(path: str | os.PathLike[str]) -> Iterator[None]:
    """Say what is wrong with a place that cannot be written, and how to mend it."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        what, remedy = WORDS["cannot_write"].get(errno.errorcode.get(error.errno or 0, ""), (
            error.strerror or str(error), "choose another place"))
        raise BacklashError(f"cannot write: {what}", where=str(path), remedy=remedy, code="cannot_write") from error


@functools.cache
def _sweep(folder: Path) -> None:
    """Remove, once per run and folder, the temporary files that runs left there which were killed outright."""
    for path in folder.glob(f".backlash-{12 * '[0-9a-f]'}.tmp"):
        with contextlib.suppress(OSError):
            about = path.lstat()
            if stat.S_ISREG(about.st_mode) and about.st_mtime < time.time() - LEFT_BEHIND:
                path.unlink()


def _flush(path: Path) -> None:
    """Have the operating system put a file or folder entry on the disk: a power cut must not leave an empty report."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
