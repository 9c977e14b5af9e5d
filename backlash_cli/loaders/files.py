"""From a path to UTF-8 text or a Parquet file: compression, encodings, and what is no export at all."""

from __future__ import annotations

import stat
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa

from ..errors import InputError
from ..record import Note
from .compression import codec_of, decompress, first_pieces
from .options import ReadOptions
from .places import Remote, open_place
from .text_blocks import Source

CHUNK = 1 << 20
FETCHED_WHOLE = 256 << 20  # bytes of a remote text that is kept in memory rather than fetched twice
_FOREIGN = {
    b"PK\x03\x04": ("a zip archive or an Excel workbook", "unpack it, or save the sheet as CSV"),
    b"\xd0\xcf\x11\xe0": ("an old Excel workbook or Office document", "save the sheet as CSV"),
    b"%PDF": ("a PDF document", "export the data as CSV or Parquet"),
    b"SQLite format 3": ("an SQLite database", "export the data as CSV or Parquet"),
    b"\x89HDF": ("an HDF5 file", "export the data as CSV or Parquet"),
    b"ORC": ("an ORC file", "export the data as CSV or Parquet"),
}


@dataclass(frozen=True)
class Content:
    """What a file holds: `kind` "parquet" or "text". `data`: UTF-8 bytes, or None: the file itself is UTF-8 text.

    `prefix`: bytes of a byte-order mark to skip.
    """

    path: Path | Remote
    kind: str
    data: bytes | None = None
    prefix: int = 0
    notes: tuple[Note, ...] = ()

    def head(self, size: int) -> bytes:
        """Return the first `size` bytes after the byte-order mark."""
        if self.data is not None:
            return self.data[self.prefix : self.prefix + size]
        with open_place(self.path) as file:
            file.seek(self.prefix)
            return file.read(size)

    def stream(self, offset: int) -> Any:
        """Return an Arrow input stream that starts `offset` bytes after the byte-order mark."""
        if self.data is not None:
            buffer = pa.py_buffer(self.data)
            start = min(self.prefix + offset, buffer.size)
            return pa.BufferReader(buffer.slice(start))
        if isinstance(self.path, Remote):
            file = pa.PythonFile(self.path.open_bytes(), mode="r")
        else:
            file = pa.OSFile(str(self.path), "rb")
        file.seek(self.prefix + offset)
        return file


def open_content(path: Path | Remote, options: ReadOptions) -> Content:
    """Look at a file, decompress it and bring its text to UTF-8. Raises InputError for what is no export."""
    try:
        size = _regular_size(path)
        with open_place(path) as file:
            magic = _first_bytes(file, path)
            if magic[:4] == b"PAR1":
                return Content(path, "parquet")
            codec = codec_of(magic)
            if codec:
                data, notes = decompress(file, codec, size, path, options.max_bytes)
                if data[:4] == b"PAR1":
                    raise InputError("compressed Parquet file", where=str(path), remedy="decompress it first")
                _refuse_foreign(data[:16], path)
                return _decoded(path, data, options, notes)
            if isinstance(path, Remote) and size <= min(FETCHED_WHOLE, options.max_bytes):
                return _decoded(path, file.read(), options, ())
            head = file.read(4 * CHUNK)
            encoding, prefix = guess_encoding(head, path, options)
            if encoding == "utf-8":
                file.seek(prefix)
                if is_utf8(file):  # type: ignore[arg-type]
                    return Content(path, "text", None, prefix)
                encoding = "cp1252"
            if size > options.max_bytes:
                raise InputError(f"more than {options.max_bytes >> 20} MB of {encoding} text", where=str(path))
            file.seek(0)
            return _decoded(path, file.read(), options, ())
    except FileNotFoundError:
        raise InputError("no such file", where=str(path), remedy="check the name and the folder") from None
    except OSError as error:
        raise InputError(f"cannot read the file: {error.strerror or error}", where=str(path)) from None


def first_part(path: Path | Remote, options: ReadOptions, size: int = 4 * CHUNK) -> Content:
    """Look at the beginning of a file only: whole lines of about `size` bytes of text, or that it is Parquet.

    Raises InputError as `open_content` does for what is seen there.
    """
    _regular_size(path)
    with open_place(path) as file:
        magic = _first_bytes(file, path)
        if magic[:4] == b"PAR1":
            return Content(path, "parquet")
        data = b"".join(first_pieces(file, codec_of(magic), size))
    _refuse_foreign(data[:16], path)
    if len(data) >= size:
        data = data[: data.rfind(b"\n") + 1] or data
    return _decoded(path, data, options, ())


def _regular_size(path: Path | Remote) -> int:
    about = path.stat()
    if not stat.S_ISREG(about.st_mode):
        raise InputError("not a regular file", where=str(path), remedy="save the export as a file first")
    return about.st_size


def _first_bytes(file: BinaryIO, path: Path | Remote) -> bytes:
    """The bytes that tell the kind of a file; the file is left at its beginning."""
    magic = file.read(16)
    if not magic:
        raise InputError("file is empty (0 bytes)", where=str(path), remedy="export it again")
    _refuse_foreign(magic, path)
    file.seek(0)
    return magic


def guess_encoding(head: bytes, path: Path | Remote, options: ReadOptions) -> tuple[str, int]:
    """Return (encoding, length of the byte-order mark) of text that begins with `head`.

    Raises InputError for binary data.
    """
    for mark, name in ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe\x00\x00", "utf-32-le"), (b"\xff\xfe", "utf-16-le"),
                       (b"\xfe\xff", "utf-16-be")):  # fmt: skip
        if head.startswith(mark):
            return (options.encoding if options.encoding and name == "utf-8" else name), len(mark)
    if options.encoding:
        return options.encoding.lower().replace("utf8", "utf-8"), 0
    sample = head[: 64 << 10]
    even, odd = sample[0::2].count(0), sample[1::2].count(0)
    if odd > 0.4 * len(sample) / 2 and even < odd / 8:
        return "utf-16-le", 0
    if even > 0.4 * len(sample) / 2 and odd < even / 8:
        return "utf-16-be", 0
    control = sum(sample.count(c) for c in range(32) if c not in (9, 10, 11, 12, 13, 26, 27))
    if control > 0.02 * len(sample):
        raise InputError(
            "not text: binary data that is neither CSV nor Parquet", where=str(path), remedy="export it again as CSV"
        )
    try:
        head.decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start < len(head) - 3:
            return "cp1252", 0
    return "utf-8", 0


def is_utf8(file: Source) -> bool:
    """Say whether the rest of a file is UTF-8; read through one small buffer that stays in the processor's cache."""
    space = bytearray(CHUNK // 2)
    view = memoryview(space)
    kept = 0
    while count := file.readinto(view[kept:]):
        filled = kept + count
        cut = space.rfind(b"\n", 0, filled) + 1 or _whole_characters(space, filled)
        if not valid_utf8(view[:cut]):
            return False
        kept = filled - cut
        space[:kept] = space[cut:filled]
    return valid_utf8(view[:kept])


def _whole_characters(data: bytearray, size: int) -> int:
    """Length of the first `size` bytes without a character that is cut at their end."""
    for back in range(1, min(4, size) + 1):
        if data[size - back] < 0x80:
            return size - back + 1
        if data[size - back] >= 0xC0:
            return size - back
    return size


def valid_utf8(data: bytes | memoryview) -> bool:
    """Arrow checks some gigabytes per second and makes no copy."""
    offsets = pa.py_buffer(struct.pack("<qq", 0, len(data)))
    try:
        pa.Array.from_buffers(pa.large_string(), 1, [None, offsets, pa.py_buffer(data)]).validate(full=True)
    except pa.ArrowInvalid:
        return False
    return True


def _decoded(path: Path | Remote, data: bytes, options: ReadOptions, notes: tuple[Note, ...]) -> Content:
    if not data:
        raise InputError("file holds no data", where=str(path), remedy="export it again")
    encoding, prefix = guess_encoding(data[: 4 * CHUNK], path, options)
    if encoding == "utf-8":
        if valid_utf8(data[prefix:] if prefix else data):
            return Content(path, "text", data, prefix, notes)
        encoding = "cp1252"
    if encoding == "cp1252":
        text = _single_byte(data[prefix:])
        notes = (*notes, _encoding_note(encoding))
    else:
        try:
            text = data[prefix:].decode(encoding)
        except UnicodeDecodeError:
            text = data[prefix:].decode(encoding, errors="replace")
            notes = (*notes, Note("encoding", f"some bytes are not valid {encoding} text; they were replaced"))
        except (LookupError, ValueError) as error:
            raise InputError(f"cannot decode the text as {encoding}: {error}", where=str(path)) from None
    return Content(path, "text", text.encode("utf-8", errors="replace"), 0, notes)


def _single_byte(data: bytes) -> str:
    try:
        return data.decode("cp1252")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _encoding_note(encoding: str) -> Note:
    return Note("encoding", f"text is not UTF-8; read with the encoding {encoding} (Western European)")


def _refuse_foreign(magic: bytes, path: Path | Remote) -> None:
    for mark, (what, remedy) in _FOREIGN.items():
        if magic.startswith(mark):
            raise InputError(f"this is {what}, not CSV or Parquet", where=str(path), remedy=remedy)
