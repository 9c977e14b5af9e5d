"""From a path to UTF-8 text in whole lines, or to Parquet: compression, encodings, workbooks, and what is no export."""

from __future__ import annotations

import bz2
import codecs
import gzip
import io
import lzma
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import Any
from zipfile import BadZipFile, ZipFile

import pyarrow as pa

from ..errors import InputError
from ..record import Note
from .names import WORDS
from .options import ReadOptions
from .sources import Remote, is_export, open_place, stem_of

CHUNK = 1 << 20  # bytes that are read at once
BLOCK = 8 << 20  # bytes of text that are handed on at once
SAMPLE = 64 << 10  # bytes that tell how a text is encoded
# Text of measurements never shrinks to a 200th; beyond this a small file is a trap, not an export.
BOMB_RATIO, BOMB_FLOOR = 200, 64 << 20
_CODECS: dict[bytes, tuple[str, Callable[[Any], Any]]] = {
    b"\x1f\x8b": ("gzip", gzip.open), b"BZh": ("bz2", bz2.open), b"\xfd7zXZ\x00": ("xz", lzma.open),
    b"\x28\xb5\x2f\xfd": ("zstd", lambda file: pa.CompressedInputStream(pa.PythonFile(file, mode="r"), "zstd"))}
_DAMAGED = (OSError, EOFError, zlib.error, lzma.LZMAError, ValueError, BadZipFile, pa.ArrowException)
_MARKS = {"utf-32": (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE), "utf-16": (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)}
_TEXT = bytes({9, 10, 11, 12, 13, 26, 27, *range(32, 256)})
_ANNOTATION = re.compile(rb"^#(?:datatype|group|default)\b", re.MULTILINE)


def kind_of(path: Path | Remote, magic: bytes = b"") -> str:
    """Return "parquet", "workbook", "archive" or "text" for what begins so. Raises InputError for what is no export."""
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
    if magic.startswith(b"PK\x03\x04"):
        return "workbook" if path.name.lower().endswith((".xlsx", ".xlsm")) else "archive"
    for mark, (what, remedy) in WORDS["foreign"].items():
        if magic.startswith(mark.encode("latin-1")):
            raise InputError(f"this is {what}, not CSV or Parquet", where=str(path), remedy=remedy)
    return "parquet" if magic.startswith(b"PAR1") else "text"


class Text:
    """The text of a file as UTF-8, in blocks of whole lines: `head`, and `rest`, to be gone through once; `notes` are
    complete then. taken: called with the bytes that were read. opened: gives the text, where it is but a part of the
    file. Raises InputError for what is no text, and for small files that expand without end; of a damaged file what is
    whole is read."""

    def __init__(self, path: Path | Remote, options: ReadOptions, taken: Callable[[int], None] = lambda count: None,
                 opened: Callable[[], Any] | None = None) -> None:
        self.path, self.options, self._taken = path, options, taken
        self.notes: list[Note] = []
        self.rest = lines_together(self._decoded(self._pieces(opened)))
        self.head = next(self.rest, bytearray())
        if _ANNOTATION.search(self.head, 0, SAMPLE):
            self.rest = _without_annotations(chain([self.head], self.rest))
            self.head = next(self.rest, bytearray())

    def _pieces(self, part: Callable[[], Any] | None) -> Iterator[bytes]:
        size, total = self.path.stat().st_size, 0
        with part() if part else open_place(self.path) as file:
            magic = file.read(16)
            file.seek(0)
            codec, opened = next((own for mark, own in _CODECS.items() if magic.startswith(mark)),
                                 ("zip" if part else "", None))
            stream, told = opened(file) if opened else file, 0
            read = getattr(stream, "read1", stream.read)  # no more than one piece at once
            while True:
                try:
                    piece = read(CHUNK)
                except _DAMAGED as error:
                    if not codec:
                        raise
                    problem = "the compressed stream ends too early" if isinstance(error, EOFError) else str(error)
                    # with a wrong checksum any part may be wrong
                    if total < 200 or isinstance(error, (gzip.BadGzipFile, BadZipFile)):
                        raise InputError(f"damaged {codec} file: {problem}", where=str(self.path),
                                         remedy="export or copy it again") from None
                    self.notes.append(Note("truncated", f"damaged or truncated {codec} file ({problem}): only the part "
                                           "before is read"))
                    return
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
        end = b"\n" if b"\n" in block else b"\r"
        last = block.rfind(end)
        if block.count(b'"', 0, last) % 2:  # within a quoted cell, unless quotes never end
            begin = block.rfind(b'"', 0, last)
            last = block.rfind(end, 0, begin) if block.count(end, begin, last) < 200 else last
        rest = block[last + 1 :]
        del block[last + 1 :]
        if block:
            yield block
        block, enough = rest, max(BLOCK, 2 * len(rest))
    if block:
        yield block


def _without_annotations(blocks: Iterable[bytearray]) -> Iterator[bytearray]:
    """Take out the annotations of InfluxDB's CSV, and bring tables of other columns to those of the first."""
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


def members(path: Path | Remote) -> Sequence[tuple[str, Callable[[], Any]]]:
    """Return (stem, what opens it) of the exports in a zip archive. Raises InputError without any."""
    try:
        archive = ZipFile(open_place(path))
        found = [(stem_of(Path(name)), partial(archive.open, name)) for name in archive.namelist()
                 if is_export(PurePosixPath(name).name)]
        for _, opened in found:
            opened().close()
    except (BadZipFile, OSError, ValueError, RuntimeError) as error:  # damaged, encrypted, or packed in another way
        raise InputError(f"the zip archive cannot be opened: {error}", where=str(path),
                         remedy="unpack it, or copy it again") from None
    if not found:
        raise InputError("the zip archive holds no export (no CSV files)", where=str(path), remedy="pack CSV files")
    return found


def sheets(path: Path | Remote) -> Sequence[tuple[str, Callable[[], Any]]]:
    """Return (name, what opens it as CSV) of the sheets that hold more than a few cells. Raises InputError."""
    import pandas as pd

    try:
        with open_place(path) as file:
            book = pd.read_excel(io.BytesIO(file.read()), sheet_name=None, header=None, engine="calamine")
    except ImportError:
        raise InputError("reading Excel workbooks needs python-calamine", where=str(path),
                         remedy="pip install 'backlash[excel]', or save the sheet as CSV") from None
    except Exception as error:  # the library raises kinds of its own for damaged workbooks
        raise InputError(f"damaged workbook: {str(error).strip() or type(error).__name__}", where=str(path),
                         remedy="save it again, or save the sheet as CSV") from None
    found = [(name, partial(io.BytesIO, rows.to_csv(header=False, index=False).encode()))
             for name, rows in book.items() if len(rows) > 1]
    if not found:
        raise InputError("the workbook holds no table", where=str(path), remedy="export it again")
    return found
