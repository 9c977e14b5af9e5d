"""Where exports lie: plain paths, and addresses such as s3://, abfs:// or gs:// through fsspec.

`place` gives a Path for a path and a Remote for an address. A Remote has the few methods of a Path that reading needs,
so that nothing behind this door knows which of the two it has. Plain paths need no fsspec.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import unquote, urlsplit
from urllib.request import url2pathname

from ..errors import BacklashError, InputError, nearest

_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+(?:://|::)")  # one letter before the colon is a drive of Windows
_DRIVERS = {  # scheme -> what to install
    "s3": "backlash[s3]", "s3a": "backlash[s3]", "abfs": "backlash[azure]", "abfss": "backlash[azure]",
    "az": "backlash[azure]", "adl": "backlash[azure]", "gs": "backlash[gcs]", "gcs": "backlash[gcs]",
    "http": "fsspec[http]", "https": "fsspec[http]", "sftp": "paramiko", "ssh": "paramiko", "smb": "smbprotocol",
}  # fmt: skip
BLOCK = 8 << 20  # bytes fetched at a time from an object


def place(given: str | PathLike[str]) -> Path | Remote:
    """Return what a user calls an input: a Path, or a Remote for an address; file:// is a path."""
    if isinstance(given, (Path, Remote)):
        return given
    text = os.fspath(given)
    if not is_address(text):
        return Path(text)
    if text.lower().startswith(("file://", "local://")):
        parts = urlsplit(text)
        return Path(url2pathname(unquote(f"//{parts.netloc}{parts.path}" if parts.netloc else parts.path)))
    return Remote(text)


def is_address(text: str) -> bool:
    """Say whether a text is an address such as s3://bucket/key, and no path."""
    return _ADDRESS.match(text) is not None


def open_place(path: Path | Remote) -> BinaryIO:
    """Open a file for reading bytes."""
    return path.open_bytes() if isinstance(path, Remote) else open(path, "rb", buffering=0)


@dataclass(frozen=True, order=True)
class Remote(PathLike[str]):
    """A file or folder behind an address; every failure is an InputError that says what to do.

    Credentials come from where the drivers look for them (environment, ~/.aws, ~/.config/fsspec ...), never from here.
    """

    url: str

    @property
    def scheme(self) -> str:
        return self.url.rpartition("::")[2].partition("://")[0].lower()

    @property
    def name(self) -> str:
        return self._path.rstrip("/").rpartition("/")[2]

    @property
    def suffix(self) -> str:
        return Path(self.name).suffix

    @property
    def parent(self) -> Remote:
        head, _, _ = self._path.rstrip("/").rpartition("/")
        if head.endswith(":/"):  # a bucket has nothing above it
            return Remote(f"{head}/") if self.scheme == "memory" else self
        return Remote(head) if head else self

    @property
    def _path(self) -> str:
        """The address without what follows a question mark, which only the web knows."""
        return self.url.partition("?")[0] if self.scheme in ("http", "https") else self.url

    def __truediv__(self, name: str) -> Remote:
        head = self._path
        return Remote(head + name if head.endswith("://") else f"{head.rstrip('/')}/{name}")

    def absolute(self) -> Remote:
        """Return the address itself."""
        return self

    resolve = absolute

    def exists(self) -> bool:
        """Say whether something is there. Raises InputError where that cannot be known."""
        return self._info is not None

    def is_dir(self) -> bool:
        """Say whether this is a folder."""
        if self.scheme in ("http", "https"):
            return self._path.endswith("/") and self.exists()
        return self._info is not None and self._info.get("type") == "directory"

    def is_file(self) -> bool:
        """Say whether this is a file."""
        return self.exists() and not self.is_dir()

    def stat(self) -> os.stat_result:
        """Return kind and size (and times as zero). Raises FileNotFoundError when nothing is there."""
        if self._info is None:
            raise FileNotFoundError(self.url)
        kind = stat.S_IFDIR if self.is_dir() else stat.S_IFREG
        return os.stat_result((kind | 0o444, 0, 0, 1, 0, 0, int(self._info.get("size") or 0), 0, 0, 0))

    def version(self) -> str:
        """What changes when the object does: its tag or time as the store gives it, else its size."""
        info = self._info or {}
        for key in ("ETag", "etag", "md5Hash", "mtime", "LastModified", "last_modified", "created"):
            if info.get(key):
                return f"{info.get('size')} {info[key]}"
        return str(info.get("size"))

    def open_bytes(self) -> BinaryIO:
        """Open the object for reading; it is fetched in blocks, only where it is read."""
        with in_words(self.url):
            system, path = self._system
            opened: Any = system.open(path, "rb", block_size=BLOCK)
            return opened

    def read_bytes(self) -> bytes:
        """Fetch the whole object."""
        with in_words(self.url):
            system, path = self._system
            return bytes(system.cat_file(path))

    def files_below(self) -> list[tuple[str, ...]]:
        """Return the files in and below a folder as (folder, ..., name), a folder's own files before its folders."""
        with in_words(self.url):
            system, path = self._system
            root = path.rstrip("/")
            found = [tuple(name[len(root) :].strip("/").split("/")) for name in system.find(path)]
        return sorted(found, key=lambda parts: (*((1, part) for part in parts[:-1]), (0, parts[-1])))

    @cached_property
    def _system(self) -> tuple[Any, str]:
        with in_words(self.url, self.scheme):
            try:
                from fsspec.core import url_to_fs
            except ImportError:
                raise InputError(f"reading {self.scheme}:// needs fsspec", where=self.url,
                                 remedy=f"pip install '{_DRIVERS.get(self.scheme, 'backlash[remote]')}'") from None
            return url_to_fs(self.url)

    @cached_property
    def _info(self) -> dict[str, Any] | None:
        with in_words(self.url):
            system, path = self._system
            try:
                return dict(system.info(path))
            except FileNotFoundError as error:
                # the web's driver says "not found" for every failure and keeps the reason behind it
                reason = error.__cause__
                if isinstance(reason, Exception) and getattr(reason, "status", 0) not in (404, 410) and (
                    not isinstance(reason, FileNotFoundError)
                ):
                    raise reason from None
                return None

    def __fspath__(self) -> str:
        return self.url

    __str__ = __fspath__

    def __reduce__(self) -> tuple[type[Remote], tuple[str]]:
        return Remote, (self.url,)


@contextlib.contextmanager
def in_words(where: str, scheme: str = "") -> Iterator[None]:
    """Turn what a driver raises into an InputError; drivers raise many kinds for the same thing."""
    try:
        yield
    except (BacklashError, KeyboardInterrupt):
        raise
    except FileNotFoundError:
        raise InputError("no such file or folder: not found", where=where, remedy="check the address") from None
    except ImportError as error:
        raise InputError(f"reading {scheme}:// needs a driver that is not installed ({_line(error)})", where=where,
                         remedy=f"pip install '{_DRIVERS.get(scheme, scheme)}'") from None
    except Exception as error:
        status = getattr(error, "status", None)
        if isinstance(error, PermissionError) or status in (401, 403) or "credential" in type(error).__name__.lower():
            raise InputError(f"access denied: {_line(error)}", where=where,
                             remedy="check the credentials of this machine and the rights of the object") from None
        if isinstance(error, ValueError) and "rotocol not known" in str(error):
            from fsspec import available_protocols

            raise InputError(f"no storage is called {scheme}://", where=where,
                             remedy=nearest(scheme, [*_DRIVERS, *available_protocols()])) from None
        raise InputError(f"cannot be read: {type(error).__name__}: {_line(error)}", where=where,
                         remedy="check the address and the network") from None


def _line(error: BaseException) -> str:
    text = str(error).strip().split("\n")[0] or type(error).__name__
    return text if len(text) <= 200 else text[:197] + "..."
