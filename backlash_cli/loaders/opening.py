"""From a path to UTF-8 text in whole lines, or to Parquet: compression, encodings, workbooks, and what is no export."""

from __future__ import annotations

import bz2
import codecs
import csv
import gzip
import io
import lzma
import re
import zlib
from collections.abc import Callable, Iterable, Iterator
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import Any

import pyarrow as pa

from ..errors import InputError
from ..record import Note
from .options import ReadOptions
from .sources import Remote, open_place

CHUNK = 1 << 20  # bytes that are read at once
BLOCK = 8 << 20  # bytes of text that are handed on at once
SAMPLE = 64 << 10  # bytes that tell how a text is encoded
# Text of measurements never shrinks to a 200th; beyond this a small file is a trap, not an export.
BOMB_RATIO, BOMB_FLOOR = 200, 64 << 20
_CODECS: dict[bytes, tuple[str, Callable[[Any], Any]]] = {
    b"\x1f\x8b": ("gzip", gzip.open), b"BZh": ("bz2", bz2.open), b"\xfd7zXZ\x00": ("xz", lzma.open),
    b"\x28\xb5\x2f\xfd": ("zstd", lambda file: pa.CompressedInputStream(pa.PythonFile(file, mode="r"), "zstd"))}
_FOREIGN = {b"PK\x03\x04": ("a zip archive", "unpack it"),
            b"\xd0\xcf\x11\xe0": ("an old Excel workbook or Office document", "save the sheet as CSV or as .xlsx"),
            b"%PDF": ("a PDF document", "export the data as CSV or Parquet"),
            b"SQLite format 3": ("an SQLite database", "export the data as CSV or Parquet"),
            b"\x89HDF": ("an HDF5 file", "export the data as CSV or Parquet"),
            b"ORC": ("an ORC file", "export the data as CSV or Parquet")}
_DAMAGED = (OSError, EOFError, zlib.error, lzma.LZMAError, ValueError, pa.ArrowException)
_MARKS = {"utf-32": (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE), "utf-16": (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)}
_TEXT = bytes({9, 10, 11, 12, 13, 26, 27, *range(32, 256)})
_ANNOTATION = re.compile(rb"^#(?:datatype|group|default)\b", re.MULTILINE)


def kind_of(path: Path | Remote, magic: bytes = b"") -> str:
    """Return "parquet", "workbook" or "text" for a file, or for one that begins so. Raises InputError for what is no
    export."""
    try:
        if not path.is_file():
            raise InputError("not a regular file", where=str(path), remedy="save the export as a file first")
        if not magic:
            with open_place(path) as file:
                magic = file.read(16)
    except OSError as error:
        raise InputError(f"cannot read the file: {error.strerror or error}", where=str(path)) from None
    if not magic:
        raise InputError("file is empty (0 bytes)", where=str(path), remedy="export it again")
    if magic.startswith(b"PK\x03\x04") and path.name.lower().endswith((".xlsx", ".xlsm")):
        return "workbook"
    for what, remedy in (said for mark, said in _FOREIGN.items() if magic.startswith(mark)):
        raise InputError(f"this is {what}, not CSV or Parquet", where=str(path), remedy=remedy)
    return "parquet" if magic.startswith(b"PAR1") else "text"


class Text:
    """The text of a file as UTF-8, in blocks of whole lines; `notes` are complete when all was read.

    head: the first of them. rest: all others, to be gone through once. taken: called with the bytes of the file that
    were read. Raises InputError for what is no text, and for small files that expand without end; of a damaged file
    what is whole is read.
    """

    def __init__(self, path: Path | Remote, options: ReadOptions, taken: Callable[[int], None] | None = None,
                 data: bytes | None = None) -> None:
        self.path, self.options, self._taken = path, options, taken
        self.notes: list[Note] = []
        self.rest = lines_together(self._decoded(self._pieces() if data is None else iter([data])))
        self.head = next(self.rest, bytearray())
        if _ANNOTATION.search(self.head, 0, SAMPLE):
            self.rest = _without_annotations(chain([self.head], self.rest))
            self.head = next(self.rest, bytearray())

    def _pieces(self) -> Iterator[bytes]:
        """Yield the bytes of the file, decompressed."""
        size, total = self.path.stat().st_size, 0
        with open_place(self.path) as file:
            magic = file.read(16)
            file.seek(0)
            codec, opened = next((own for mark, own in _CODECS.items() if magic.startswith(mark)), ("", None))
            stream, told = opened(file) if opened else file, 0
            read = getattr(stream, "read1", stream.read)  # no more than one piece at once
            while True:
                try:
                    piece = read(CHUNK)
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
                if self._taken is not None:
                    self._taken(file.tell() - told)
                    told = file.tell()
                if not piece:
                    return
                total += len(piece)
                if codec and (total > self.options.max_bytes or (total > BOMB_FLOOR and total > BOMB_RATIO * size)):
                    raise InputError(f"{size} bytes of {codec} expand to more than {total >> 20} MB",
                                     where=str(self.path),
                                     remedy="if this is a real export, decompress it first or cut it into parts")
                yield piece

    def _decoded(self, pieces: Iterator[bytes]) -> Iterator[bytes]:
        """Yield text as UTF-8; from the first bytes on that are not, it counts as Western European."""
        head = b""
        while len(head) < SAMPLE and (piece := next(pieces, b"")):
            head += piece
        if not head:
            raise InputError("file holds no data", where=str(self.path), remedy="export it again")
        if kind_of(self.path, head) == "parquet":
            raise InputError("compressed Parquet file", where=str(self.path), remedy="decompress it first")
        encoding = guess_encoding(head, self.path, self.options)
        decoder = codecs.getincrementaldecoder(encoding)("strict" if encoding == "utf-8" else "replace")
        for piece in chain([head.removeprefix(codecs.BOM_UTF8)], pieces, [b""]):
            if encoding == "utf-8" and piece.isascii() and not decoder.getstate()[0]:
                yield piece
                continue
            try:
                text = decoder.decode(piece, final=not piece)
            except UnicodeDecodeError:
                piece, encoding = decoder.getstate()[0] + piece, "cp1252"
                decoder = codecs.getincrementaldecoder("cp1252")("replace")
                text = decoder.decode(piece)
                self.notes.append(Note("encoding", "text is not UTF-8; read with the encoding cp1252 (Western "
                                       "European)"))
            if "\ufffd" in text and encoding != "utf-8" and not self.notes:
                self.notes.append(Note("encoding", f"some bytes are not valid {encoding} text; they were replaced"))
            yield text.encode("utf-8", errors="replace")


def lines_together(pieces: Iterable[bytes]) -> Iterator[bytearray]:
    """Yield text in blocks of whole lines; a line longer than a block is one block."""
    block, enough = bytearray(), BLOCK
    for piece in pieces:
        block += piece
        if len(block) < enough:
            continue
        cut = _whole_lines(block)
        rest = block[cut:]
        del block[cut:]
        if block:
            yield block
        block, enough = rest, max(BLOCK, 2 * len(rest))
    if block:
        yield block


def _whole_lines(text: bytearray) -> int:
    """Length of the lines that end in a text; a quoted cell may hold line ends."""
    end = b"\n" if b"\n" in text else b"\r"
    last = text.rfind(end)
    begin = text.rfind(b'"', 0, last) if text.count(b'"', 0, last) % 2 else -1
    # quotes that never end are taken as they are
    return (text.rfind(end, 0, begin) if begin >= 0 and text.count(end, begin, last) < 200 else last) + 1


def _without_annotations(blocks: Iterable[bytearray]) -> Iterator[bytearray]:
    """Take the annotations out of InfluxDB's annotated CSV, where a table of other columns may follow after a blank
    line; the columns of all tables are brought to those of the first."""
    columns: list[bytes] = []
    place, fresh = [0], True
    for block in blocks:
        out = []
        for line in bytes(block).splitlines():
            cells = line.split(b",")
            if not line.strip(b" ,\r") or line.startswith((b"#", b'"#')):
                fresh = True
            elif fresh and not any(cell[:1].isdigit() for cell in cells):
                names, fresh = [cell.strip(b'"\r ') for cell in cells], False
                out += [] if columns else [b",".join(names)]
                columns = columns or names
                place = [names.index(name) if name in names else -1 for name in columns]
            else:
                fresh, known = False, dict(enumerate(cells))
                out.append(b",".join([known.get(k, b"") for k in place]))
        if out:
            yield bytearray(b"\n".join(out) + b"\n")


def guess_encoding(head: bytes, path: Path | Remote, options: ReadOptions) -> str:
    """Return the encoding of text that begins with `head`. Raises InputError for binary data."""
    for encoding in ("utf-32", "utf-16"):  # a mark of utf-16 begins one of utf-32
        if head.startswith(_MARKS[encoding]):
            return encoding
    if options.encoding:
        return options.encoding.lower().replace("utf8", "utf-8")
    sample = head[:SAMPLE]
    even, odd = sample[0::2].count(0), sample[1::2].count(0)
    for encoding, many, few in (("utf-16-le", odd, even), ("utf-16-be", even, odd)):
        if many > 0.2 * len(sample) and few < many / 8:
            return encoding
    if len(sample.translate(None, _TEXT)) > 0.02 * len(sample):
        raise InputError("not text: binary data that is neither CSV nor Parquet", where=str(path),
                         remedy="export it again as CSV")
    return "utf-8"


def sheets(path: Path | Remote) -> list[tuple[str, bytes]]:
    """Return (name, text as CSV) of the sheets of a workbook that hold more than a few cells. Raises InputError where
    it cannot be read."""
    try:
        from python_calamine import CalamineWorkbook
    except ImportError:
        raise InputError("reading Excel workbooks needs python-calamine", where=str(path),
                         remedy="pip install 'backlash[excel]', or save the sheet as CSV") from None
    found = []
    try:
        with open_place(path) as file:
            book = CalamineWorkbook.from_filelike(io.BytesIO(file.read()))
        for name in book.sheet_names:
            rows = book.get_sheet_by_name(name).to_python()
            if len(rows) > 1:
                text = io.StringIO()
                # to the millisecond: a day number carries some microseconds of rounding
                csv.writer(text, lineterminator="\n").writerows([[
                    cell.isoformat(" ", "milliseconds") if isinstance(cell, datetime) else cell for cell in row]
                    for row in rows])
                found.append((name, text.getvalue().encode()))
    except Exception as error:  # the library raises kinds of its own for damaged workbooks
        raise InputError(f"damaged workbook: {str(error).strip() or type(error).__name__}", where=str(path),
                         remedy="save it again, or save the sheet as CSV") from None
    if not found:
        raise InputError("the workbook holds no table", where=str(path), remedy="export it again")
    return found
