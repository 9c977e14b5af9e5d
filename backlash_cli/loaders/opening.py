"""From a path to UTF-8 text in whole lines, or to Parquet: compression, encodings, workbooks, and what is no export."""

from __future__ import annotations

import bz2
import codecs
import gzip
import io
import lzma
import stat
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa

from ..errors import InputError
from ..record import Note
from .options import ReadOptions
from .remote import Remote, open_place

CHUNK = 1 << 20
HEAD = 4 << 20  # bytes that tell how a text is encoded
# Text of measurements never shrinks to a 200th; beyond this a small file is a trap, not an export.
BOMB_RATIO, BOMB_FLOOR = 200, 64 << 20
CODECS = {b"\x1f\x8b": "gzip", b"\x28\xb5\x2f\xfd": "zstd", b"BZh": "bz2", b"\xfd7zXZ\x00": "xz"}
_FOREIGN = {b"PK\x03\x04": ("a zip archive", "unpack it"),
            b"\xd0\xcf\x11\xe0": ("an old Excel workbook or Office document", "save the sheet as CSV or as .xlsx"),
            b"%PDF": ("a PDF document", "export the data as CSV or Parquet"),
            b"SQLite format 3": ("an SQLite database", "export the data as CSV or Parquet"),
            b"\x89HDF": ("an HDF5 file", "export the data as CSV or Parquet"),
            b"ORC": ("an ORC file", "export the data as CSV or Parquet")}
_DAMAGED = (OSError, EOFError, zlib.error, lzma.LZMAError, ValueError, pa.ArrowException)
_MARKS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe\x00\x00", "utf-32-le"), (b"\xff\xfe", "utf-16-le"),
          (b"\xfe\xff", "utf-16-be"))  # fmt: skip


def kind_of(path: Path | Remote) -> str:
    """Return "parquet", "workbook" or "text". Raises InputError for what is no export."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise InputError("not a regular file", where=str(path), remedy="save the export as a file first")
        with open_place(path) as file:
            magic = file.read(16)
    except FileNotFoundError:
        raise InputError("no such file", where=str(path), remedy="check the name and the folder") from None
    except OSError as error:
        raise InputError(f"cannot read the file: {error.strerror or error}", where=str(path)) from None
    if not magic:
        raise InputError("file is empty (0 bytes)", where=str(path), remedy="export it again")
    if magic[:4] == b"PAR1":
        return "parquet"
    if magic.startswith(b"PK\x03\x04") and path.name.lower().endswith((".xlsx", ".xlsm")):
        return "workbook"
    _refuse_foreign(magic, path)
    return "text"


class Text:
    """The text of a file as UTF-8, in blocks of whole lines; `notes` are complete when all was read.

    taken: called with the bytes of the file that were read. Raises InputError for what is no text, and for small files
    that expand without end; of a damaged file what is whole is read.
    """

    def __init__(self, path: Path | Remote, options: ReadOptions, taken: Callable[[int], None] | None = None,
                 data: bytes | None = None) -> None:
        self.path, self.options, self._taken = path, options, taken
        self.notes: list[Note] = []
        self._cut = b""  # the beginning of a character whose end comes later
        self._raw = self._pieces() if data is None else iter([data])
        self.head, self.complete = self._begin()

    def _begin(self) -> tuple[bytes, bool]:
        """Return the first text after a byte-order mark, and whether it is all of it."""
        begun = bytearray()
        while len(begun) < HEAD and (piece := next(self._raw, b"")):
            begun += piece
        if not begun:
            raise InputError("file holds no data", where=str(self.path), remedy="export it again")
        if begun[:4] == b"PAR1":
            raise InputError("compressed Parquet file", where=str(self.path), remedy="decompress it first")
        _refuse_foreign(bytes(begun[:16]), self.path)
        encoding, mark = guess_encoding(bytes(begun), self.path, self.options)
        self._decode = self._decoder(encoding)
        self._first = self._decode(bytes(begun[mark:]), len(begun) < HEAD)
        return self._first, len(begun) < HEAD

    def blocks(self, offset: int, size: int) -> Iterator[bytes]:
        """Yield the text from an offset on, about `size` bytes of whole lines at a time; to be called once."""
        rest, more = self._first[offset:], True
        self._first = b""
        while more:
            parts, length = [rest], len(rest)
            while length < size and (more := bool(piece := next(self._raw, b""))):
                parts.append(self._decode(piece, False))
                length += len(parts[-1])
            text = b"".join(parts)
            if not more:
                yield text + self._decode(b"", True)
                return
            cut = _whole_lines(text)
            rest = text[cut:]
            if cut:
                yield text[:cut]
            else:
                size *= 2  # a line longer than a block

    def changed(self, change: Callable[[bytes], bytes]) -> Text:
        """Return the same text with every block of whole lines changed."""
        blocks = filter(None, (change(block) for block in self.blocks(0, HEAD)))
        other = object.__new__(Text)
        other.__dict__.update({**self.__dict__, "_raw": blocks, "_cut": b""})
        other._decode = lambda data, last: data
        other.head, other.complete = b"", self.complete
        while len(other.head) < HEAD and (more := next(blocks, b"")):
            other.head += more
        other._first = other.head
        return other

    def _pieces(self) -> Iterator[bytes]:
        """Yield the bytes of the file, decompressed."""
        size, total = self.path.stat().st_size, 0
        with open_place(self.path) as file:
            magic = file.read(16)
            file.seek(0)
            codec = next((name for mark, name in CODECS.items() if magic.startswith(mark)), "")
            pieces = _decompressed(_Counting(file, self._taken), codec)
            while True:
                try:
                    piece = next(pieces, None)
                except _DAMAGED as error:
                    if not codec:
                        raise
                    problem = "the compressed stream ends too early" if isinstance(error, EOFError) else str(error)
                    if total < 200 or isinstance(error, gzip.BadGzipFile):  # a wrong checksum: any part may be wrong
                        raise InputError(f"damaged {codec} file: {problem}", where=str(self.path),
                                         remedy="export or copy it again") from None
                    self.notes.append(Note("truncated", f"damaged or truncated {codec} file ({problem}): only the part "
                                           "before is read"))
                    return
                if piece is None:
                    return
                total += len(piece)
                if codec and (total > self.options.max_bytes or (total > BOMB_FLOOR and total > BOMB_RATIO * size)):
                    raise InputError(f"{size} bytes of {codec} expand to more than {total >> 20} MB",
                                     where=str(self.path),
                                     remedy="if this is a real export, decompress it first or cut it into parts")
                if piece:
                    yield piece

    def _decoder(self, encoding: str) -> Callable[[bytes, bool], bytes]:
        """Return what brings bytes to UTF-8; the flag says that they are the last."""
        if encoding == "utf-8":
            return self._checked
        try:
            decoder = codecs.getincrementaldecoder("latin-1" if encoding == "cp1252" else encoding)(errors="replace")
            decoder.decode(b"")
        except (LookupError, ValueError) as error:
            raise InputError(f"cannot decode the text as {encoding}: {error}", where=str(self.path)) from None
        if encoding == "cp1252":
            self._say(f"text is not UTF-8; read with the encoding {encoding} (Western European)")
            return lambda data, last: _western(data).encode()

        def decode(data: bytes, last: bool) -> bytes:
            text = decoder.decode(data, last)
            if "\ufffd" in text:
                self._say(f"some bytes are not valid {encoding} text; they were replaced")
            return text.encode("utf-8", errors="replace")

        return decode

    def _checked(self, data: bytes, last: bool) -> bytes:
        """UTF-8 as it is; from the first bytes on that are not, the text counts as Western European."""
        data = self._cut + data
        whole = len(data) if last else _whole_characters(data)
        self._cut = data[whole:]
        try:
            str(memoryview(data)[:whole], "utf-8")
            return data[:whole]
        except UnicodeDecodeError:
            self._decode = self._decoder("cp1252")
            self._cut = b""
            return self._decode(data, last)

    def _say(self, text: str) -> None:
        if not any(note.message == text for note in self.notes):
            self.notes.append(Note("encoding", text))


class _Counting:
    """A file that tells how much of it was read."""

    def __init__(self, file: BinaryIO, taken: Callable[[int], None] | None) -> None:
        self._file, self._taken, self.closed = file, taken, False

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(size)
        if self._taken is not None:
            self._taken(len(data))
        return data

    def readable(self) -> bool:
        return True

    def close(self) -> None:
        self.closed = True  # the file itself is closed by who opened it


def _decompressed(file: Any, codec: str) -> Iterator[bytes]:
    """Yield the text piece by piece, and all that is whole of a damaged file before the error."""
    openers: dict[str, Any] = {"gzip": gzip.open, "bz2": bz2.open, "xz": lzma.open}
    if codec == "zstd":
        file = pa.CompressedInputStream(pa.PythonFile(file, mode="r"), "zstd")
    read = openers[codec](file).read1 if codec in openers else file.read  # no more than one piece at once
    while piece := read(CHUNK):
        yield piece


def guess_encoding(head: bytes, path: Path | Remote, options: ReadOptions) -> tuple[str, int]:
    """Return (encoding, length of the byte-order mark) of text that begins with `head`. Raises InputError for binary
    data."""
    for mark, name in _MARKS:
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
        raise InputError("not text: binary data that is neither CSV nor Parquet", where=str(path),
                         remedy="export it again as CSV")
    return "utf-8", 0


def _whole_lines(text: bytes) -> int:
    """Length of the lines that end in a text; a quoted cell may hold line ends."""
    end = b"\n" if b"\n" in text else b"\r"
    quotes, cut = text.count(b'"') if b'"' in text else 0, text.rfind(end)
    last = cut
    for _ in range(200 if quotes else 0):
        if cut < 0 or (quotes - text.count(b'"', cut)) % 2 == 0:
            break
        cut = text.rfind(end, 0, cut)
    else:
        cut = last  # quotes that never end are taken as they are
    return cut + 1


def _whole_characters(data: bytes) -> int:
    """Length of UTF-8 data without a character that is cut at its end."""
    for back in range(1, min(4, len(data)) + 1):
        if data[-back] < 0x80:
            return len(data) - back + 1
        if data[-back] >= 0xC0:
            return len(data) - back
    return len(data)


def _western(data: bytes) -> str:
    try:
        return data.decode("cp1252")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _refuse_foreign(magic: bytes, path: Path | Remote) -> None:
    for mark, (what, remedy) in _FOREIGN.items():
        if magic.startswith(mark):
            raise InputError(f"this is {what}, not CSV or Parquet", where=str(path), remedy=remedy)


def sheets(path: Path | Remote) -> list[tuple[str, bytes]]:
    """Return (name, text as CSV) of the sheets of a workbook that hold more than a few cells.

    Raises InputError where it cannot be read.
    """
    try:
        from python_calamine import CalamineWorkbook
    except ImportError:
        raise InputError("reading Excel workbooks needs python-calamine", where=str(path),
                         remedy="pip install 'backlash[excel]', or save the sheet as CSV") from None
    import csv

    found = []
    try:
        with open_place(path) as file:
            book = CalamineWorkbook.from_filelike(io.BytesIO(file.read()))
        for name in book.sheet_names:
            rows = book.get_sheet_by_name(name).to_python()
            if len(rows) > 1:
                text = io.StringIO()
                csv.writer(text, lineterminator="\n").writerows([[_cell(cell) for cell in row] for row in rows])
                found.append((name, text.getvalue().encode()))
    except Exception as error:  # the library raises kinds of its own for damaged workbooks
        raise InputError(f"damaged workbook: {str(error).strip() or type(error).__name__}", where=str(path),
                         remedy="save it again, or save the sheet as CSV") from None
    if not found:
        raise InputError("the workbook holds no table", where=str(path), remedy="export it again")
    return found


def _cell(value: Any) -> Any:
    from datetime import datetime

    if isinstance(value, datetime):  # a day number carries some microseconds of rounding
        return (value.replace(microsecond=0) if value.microsecond < 500 else value).isoformat(" ", "milliseconds")
    return value
