"""Compressed exports to bytes: damaged ones give what is whole, small files that expand without end are refused."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa

from ..errors import InputError
from ..record import Note
from .places import Remote, open_place

CHUNK = 1 << 20
# Text of measurements never shrinks to a 200th; beyond this a small file is a trap, not an export.
BOMB_RATIO, BOMB_FLOOR = 200, 64 << 20
CODECS = {b"\x1f\x8b": "gzip", b"\x28\xb5\x2f\xfd": "zstd", b"BZh": "bz2", b"\xfd7zXZ\x00": "xz"}


def codec_of(magic: bytes) -> str:
    """Return the name of the compression that the first bytes of a file tell, "" if none."""
    return next((name for mark, name in CODECS.items() if magic.startswith(mark)), "")


def decompress(
    file: BinaryIO, codec: str, size: int, path: Path | Remote, limit: int
) -> tuple[bytes, tuple[Note, ...]]:
    """Return all bytes and what was wrong. Raises InputError for a trap or a file with nothing whole in it."""
    parts: list[bytes] = []
    total = 0
    problem = ""
    pieces = _pieces(file, codec)
    while True:
        try:
            piece = next(pieces, b"")
        except (OSError, EOFError, zlib.error, ValueError, pa.ArrowException) as error:
            problem = str(error).strip() or type(error).__name__
            break
        if not piece:
            break
        parts.append(piece)
        total += len(piece)
        if total > limit or (total > BOMB_FLOOR and total > BOMB_RATIO * size):
            raise InputError(
                f"{size} bytes of {codec} expand to more than {total >> 20} MB",
                where=str(path),
                remedy="if this is a real export, decompress it first or cut it into parts",
            )
    data = b"".join(parts)
    if problem and len(data) < 200:
        raise InputError(f"damaged {codec} file: {problem}", where=str(path), remedy="export or copy it again")
    notes: tuple[Note, ...] = ()
    if problem:
        cut = data.rfind(b"\n") + 1
        data = data[:cut] if cut else data
        notes = (Note("truncated", f"damaged or truncated {codec} file ({problem}): only the part before is read"),)
    return data, notes


def first_pieces(file: BinaryIO, codec: str, size: int) -> Iterator[bytes]:
    """Yield the text of a file, decompressed where it has a codec, until there are `size` bytes or it is damaged."""
    total = 0
    pieces = _pieces(file, codec) if codec else iter(lambda: file.read(CHUNK), b"")
    while total < size:
        try:
            piece = next(pieces, b"")
        except (OSError, EOFError, zlib.error, ValueError, pa.ArrowException):
            return
        if not piece:
            return
        total += len(piece)
        yield piece


def limited_pieces(path: Path | Remote, codec: str) -> Iterator[bytes]:
    """Yield the text of a compressed file. Raises OSError when it is damaged or expands beyond all measure."""
    size = path.stat().st_size
    total = 0
    with open_place(path) as file:
        try:
            for piece in _pieces(file, codec):
                total += len(piece)
                if total > BOMB_FLOOR and total > BOMB_RATIO * size:
                    raise OSError("expands without end")
                yield piece
        except zlib.error as error:
            raise OSError(str(error)) from None


def _pieces(file: BinaryIO, codec: str) -> Iterator[bytes]:
    if codec == "gzip":
        yield from _gunzip(file)
        return
    if codec == "zstd":
        stream = pa.CompressedInputStream(pa.PythonFile(file, mode="r"), "zstd")
        while piece := stream.read(CHUNK):
            yield piece
        return
    import bz2
    import lzma

    opened: Any = (bz2 if codec == "bz2" else lzma).open(file)
    try:
        while piece := opened.read(CHUNK):
            yield piece
    except lzma.LZMAError as error:
        raise OSError(str(error)) from None


def _gunzip(file: BinaryIO) -> Iterator[bytes]:
    """Yield the text of a gzip file piece by piece, and all that is whole of a damaged one before the error."""
    inflate = zlib.decompressobj(wbits=31)
    rest = b""
    while chunk := rest or file.read(CHUNK):
        rest = b""
        if inflate.eof:
            if not chunk.startswith(b"\x1f\x8b"):
                return  # padding after the last member
            inflate = zlib.decompressobj(wbits=31)
        piece = inflate.decompress(chunk, CHUNK)
        if piece:
            yield piece
        rest = inflate.unused_data if inflate.eof else inflate.unconsumed_tail
        if not piece and not rest and inflate.eof:
            continue
    tail = inflate.flush()
    if tail:
        yield tail
    if not inflate.eof:
        raise EOFError("the compressed stream ends too early")
