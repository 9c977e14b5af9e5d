"""Text of another encoding as UTF-8, some bytes at a time: what `open_content` makes of the whole file."""

from __future__ import annotations

import codecs
from collections.abc import Callable
from contextlib import AbstractContextManager

from ..record import Note
from .text_blocks import Pieces, Source, read_up_to

CHUNK = 1 << 20
_NOT_CP1252 = (b"\x81", b"\x8d", b"\x8f", b"\x90", b"\x9d")  # bytes that stand for nothing in this encoding
WESTERN = Note("encoding", "text is not UTF-8; read with the encoding cp1252 (Western European)")


class Recoded(Pieces):
    """A source of UTF-8 text. begun: the first bytes after the byte-order mark; source: has those that follow.

    Raises ValueError for an encoding that is none of text.
    """

    def __init__(self, begun: bytes, source: Source, encoding: str) -> None:
        super().__init__(iter(self._piece, None))
        try:
            b"  ".decode(encoding, errors="replace")
            self._decoder = codecs.getincrementaldecoder(encoding)("strict")
        except LookupError as error:
            raise ValueError(str(error)) from None
        self.encoding, self.damaged = encoding, False
        self._begun, self._source, self._ended = begun, source, False
        self._ascii_alike = codecs.lookup(encoding).name in ("cp1252", "iso8859-1")

    @property
    def notes(self) -> tuple[Note, ...]:
        """What is to be said of the encoding, once all is read."""
        if not self.damaged:
            return ()
        return (Note("encoding", f"some bytes are not valid {self.encoding} text; they were replaced"),)

    def _piece(self) -> bytes | None:
        while not self._ended:
            data = self._begun or read_up_to(self._source, CHUNK)
            self._begun, self._ended = b"", not data
            if data and self._ascii_alike and data.isascii():
                return data
            if text := self._decoded(data):
                return text.encode("utf-8", errors="replace")
        return None

    def _decoded(self, data: bytes) -> str:
        before = self._decoder.getstate()
        try:
            return self._decoder.decode(data, not data)
        except UnicodeDecodeError:
            self.damaged = True
            self._decoder.errors = "replace"
            self._decoder.setstate(before)
            return self._decoder.decode(data, not data)


class Western(Recoded):
    """Text that is not UTF-8 and says nothing else: cp1252, or latin-1 where bytes occur that mean nothing in cp1252.

    again: opens the file once more.
    """

    def __init__(self, begun: bytes, source: Source, again: Callable[[], AbstractContextManager[Source]]) -> None:
        with again() as whole:
            found = read_up_to(whole, CHUNK)
            while found and not _foreign(found):
                found = read_up_to(whole, CHUNK)
        super().__init__(begun, source, "latin-1" if found else "cp1252")

    @property
    def notes(self) -> tuple[Note, ...]:
        return (WESTERN,)


def _foreign(data: bytes) -> bool:
    return not data.isascii() and any(byte in data for byte in _NOT_CP1252)
