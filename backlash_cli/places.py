"""Where an input lies: `place` gives a Path, or for an address such as s3:// a Remote, which has the few methods of a
Path that reading needs."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from functools import cached_property
from os import PathLike
from pathlib import Path, PurePosixPath
from types import SimpleNamespace
from typing import Any, BinaryIO, cast
from urllib.parse import unquote, urlsplit
from urllib.request import url2pathname

from .errors import BacklashError, InputError, nearest
from .words import WORDS, explained

_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+(?:://|::)")  # one letter before the colon is a drive of Windows
_VERSIONS = ("ETag", "etag", "md5Hash", "mtime", "LastModified", "last_modified", "created")  # as the stores call it
BLOCK = 8 << 20  # bytes fetched at a time from an object


def place(given: str | PathLike[str]) -> Path | Remote:
    """Return what a user calls an input: a Path, or a Remote for an address; file:// is a path."""
    if isinstance(given, (Path, Remote)):
        return given
    if not (text := os.fspath(given)):
        raise InputError(**explained("no_name"))
    if not _ADDRESS.match(text):
        return Path(text)
    if text.lower().startswith(("file://", "local://")):
        parts = urlsplit(text)
        return Path(url2pathname(unquote(f"//{parts.netloc}{parts.path}" if parts.netloc else parts.path)))
    return Remote(text)


class Remote(str):
    """A file or folder behind an address, opened by fsspec; a failure is an InputError that says what to do."""

    @property
    def scheme(self) -> str:
        return self.rpartition("::")[2].partition("://")[0].lower()

    @property
    def _parts(self) -> tuple[str, PurePosixPath]:
        """What stands before the path, and the path without what follows a question mark on the web."""
        head, slashes, key = self.partition("://")
        return head + slashes, PurePosixPath(key.partition("?")[0] if self.scheme in ("http", "https") else key)

    @property
    def name(self) -> str:
        return self._parts[1].name

    @property
    def parent(self) -> Remote:
        head, key = self._parts
        return Remote(head if len(key.parts) < 2 else f"{head}{key.parent}")

    def __truediv__(self, name: str) -> Remote:
        head, key = self._parts
        return Remote(f"{head}{key / name}")

    def absolute(self) -> Remote:
        return self

    def is_dir(self) -> bool:
        return self._info["type"] == "directory"

    def is_file(self) -> bool:
        return self._info["type"] not in ("directory", "nothing")

    def stat(self) -> SimpleNamespace:
        """Return st_size, and as `version` what changes with the object, "" if unknown. Raises FileNotFoundError."""
        info = self._info
        if info["type"] == "nothing":
            raise FileNotFoundError(self)
        version = next((f"{info.get('size')} {info[key]}" for key in _VERSIONS if info.get(key)), "")
        return SimpleNamespace(st_size=int(info.get("size") or 0), version=version)

    def open(self, mode: str = "rb", buffering: int = 0) -> BinaryIO:
        """Open the object for reading; it is fetched in blocks, only where it is read."""
        with self._in_words():
            self.stat()  # tells why it is not there
            return cast(BinaryIO, self._system[0].open(self._system[1], mode, block_size=BLOCK))

    def files_below(self) -> list[tuple[str, ...]]:
        """Return the files in and below a folder as (folder, ..., name)."""
        with self._in_words():
            system, path = self._system
            return [tuple(name[len(path.rstrip("/")) :].strip("/").split("/")) for name in system.find(path)]

    @cached_property
    def _system(self) -> tuple[Any, str]:
        with self._in_words():
            from fsspec.core import url_to_fs

            return url_to_fs(self)

    @cached_property
    def _info(self) -> dict[str, Any]:
        with self._in_words():
            system, path = self._system
            try:
                found = dict(system.info(path))
            except FileNotFoundError as error:
                # the web's driver says "not found" for every failure and keeps the reason behind it
                reason = error.__cause__
                if isinstance(reason, Exception) and not isinstance(reason, FileNotFoundError) and (
                        getattr(reason, "status", 0) not in (404, 410)):
                    raise reason from None
                return {"type": "nothing"}
            if self.scheme in ("http", "https"):
                found["type"] = "directory" if self.partition("?")[0].endswith("/") else "file"
            return found

    @contextlib.contextmanager
    def _in_words(self) -> Iterator[None]:
        """Turn what a driver raises into an InputError; drivers raise many kinds for the same thing."""
        try:
            yield
        except BacklashError:
            raise
        except Exception as error:
            line = str(error).strip().split("\n")[0][:200] or type(error).__name__
            name, known, what = "unreachable", "", "fsspec" if "fsspec" in line else "a driver"
            if isinstance(error, FileNotFoundError):
                name = "no_object"
            elif isinstance(error, ImportError):
                name, known = "no_driver", WORDS["drivers"].get(self.scheme, "backlash[remote]")
            elif (isinstance(error, PermissionError) or getattr(error, "status", None) in (401, 403)
                  or "credential" in type(error).__name__.lower()):
                name = "denied"
            elif isinstance(error, ValueError) and "rotocol not known" in line:
                from fsspec import available_protocols

                name, known = "no_storage", nearest(self.scheme, [*WORDS["drivers"], *available_protocols()])
            raise InputError(**explained(name, kind=type(error).__name__, line=line, what=what, scheme=self.scheme,
                                         known=known), where=self) from None
