"""Columns of numbers of a local Parquet file, page by page, without Arrow in between.

Arrow decodes any column; this decodes what most exports hold, floating point numbers with no cell empty, plain or by a
dictionary, into the array that the loops read: two thirds of the time. For everything else, and for whatever is not
as expected, it gives None, and Arrow takes its turn.
"""

from __future__ import annotations

from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pa_parquet
from numpy.typing import NDArray

from . import page_kernel as kernel

LEAST = 10_000  # rows of a usual row group below which Arrow is as quick
CODECS: dict[str, str | None] = {"UNCOMPRESSED": None, "SNAPPY": "snappy", "ZSTD": "zstd"}
KINDS: dict[str, np.dtype[Any]] = {"DOUBLE": np.dtype("<f8"), "FLOAT": np.dtype("<f4")}
DATA, DICTIONARY, DATA_2 = 0, 2, 3  # kinds of pages
PLAIN, BY_DICTIONARY = 0, (2, 8)  # encodings
ENCODING = 2  # a field of the headers of pages
NULLS_2, ENCODING_2, LEVELS_2, REPEATS_2, PACKED_2 = 2, 4, 5, 6, 7  # the same of the second version


class PageReader:
    """Reads columns of one file. about: what the file says of itself."""

    def __init__(self, path: Path, about: pa_parquet.FileMetaData) -> None:
        self._name, self._about, self._schema = str(path), about, about.schema
        self._small = about.num_rows < LEAST * about.num_row_groups
        self._fields, self._stack = np.empty(kernel.PLACES, np.int64), np.empty(kernel.DEPTH, np.int64)

    def numbers(self, column: int, first: int = 0) -> NDArray[np.float64] | None:
        """Return one column from row group `first` on, None where Arrow has to read it."""
        if self._small:
            return None
        level = self._schema.column(column)
        if level.max_repetition_level or level.max_definition_level > 1 or level.physical_type not in KINDS:
            return None
        groups = [self._about.row_group(g) for g in range(first, self._about.num_row_groups)]
        out, done = np.empty(sum(group.num_rows for group in groups)), 0
        try:
            with FileIO(self._name) as file:
                for group in groups:
                    part, done = out[done : done + group.num_rows], done + group.num_rows
                    if not self._chunk(file, group.column(column), part, optional=level.max_definition_level > 0):
                        return None
        except (pa.ArrowException, OSError, ValueError, OverflowError):
            return None  # Arrow says better what is wrong
        return out

    def _chunk(self, file: FileIO, chunk: pa_parquet.ColumnChunkMetaData, out: NDArray[np.float64], *,
               optional: bool) -> bool:
        said = chunk.statistics
        known = chunk.compression in CODECS and not chunk.file_path and chunk.num_values == len(out)
        if not known or (optional and not (said and said.has_null_count and said.null_count == 0)):
            return False
        kind, codec = KINDS[chunk.physical_type], CODECS[chunk.compression]
        begin, size = chunk.data_page_offset, chunk.total_compressed_size
        if chunk.has_dictionary_page and 0 < chunk.dictionary_page_offset < begin:
            begin = chunk.dictionary_page_offset
        file.seek(begin)
        data = np.frombuffer(file.read(size), np.uint8)
        pages = _Pages(data, kind, codec, optional, chunk.total_uncompressed_size, self._fields, self._stack)
        return len(data) == size and pages.read(out)


class _Pages:
    """The pages of one column in one row group. most: bytes that all of them have when they are unpacked."""

    def __init__(self, data: NDArray[np.uint8], kind: np.dtype[Any], codec: str | None, optional: bool, most: int,
                 fields: NDArray[np.int64], stack: NDArray[np.int64]) -> None:
        self.data, self.kind, self.optional, self._most = data, kind, optional, most
        self._codec = None if codec is None else pa.Codec(codec)
        self._fields, self._stack = fields, stack
        self._table: NDArray[np.float64] | None = None

    def read(self, out: NDArray[np.float64]) -> bool:
        """Write the numbers of all pages; False where something is not as expected."""
        at = done = 0
        while done < len(out):
            at = kernel.page_header(self.data, at, self._fields, self._stack)
            if at < 0:
                return False
            page = self._fields.tolist()
            size, unpacked = page[kernel.PACKED], page[kernel.UNPACKED]
            if not 0 <= size <= len(self.data) - at or not 0 <= unpacked <= self._most:
                return False
            body, at = self.data[at : at + size], at + size
            if page[kernel.KIND] == DICTIONARY:
                if not self._dictionary(page, body, unpacked):
                    return False
                continue
            found = self._values(page, body, unpacked)
            if found is None or not 0 < found[2] <= len(out) - done:
                return False
            values, encoding, count = found
            if not self._numbers(values, encoding, out[done : done + count]):
                return False
            done += count
        return True

    def _unpacked(self, body: NDArray[np.uint8], size: int) -> NDArray[np.uint8] | None:
        if self._codec is None:
            return body if len(body) == size else None
        found = np.frombuffer(self._codec.decompress(body, size), np.uint8)
        found.flags.writeable = False
        return found

    def _dictionary(self, page: list[int], body: NDArray[np.uint8], size: int) -> bool:
        values = self._unpacked(body, size)
        count = page[kernel.OF_DICTIONARY + kernel.VALUES]
        plain = page[kernel.OF_DICTIONARY + ENCODING] in (PLAIN, BY_DICTIONARY[0])
        if values is None or not plain or count < 1 or len(values) != count * self.kind.itemsize:
            return False
        self._table = values.view(self.kind).astype(np.float64)
        return True

    def _values(self, page: list[int], body: NDArray[np.uint8], size: int) -> tuple[NDArray[np.uint8], int, int] | None:
        """The bytes of the values of a data page, their encoding and their number."""
        if page[kernel.KIND] == DATA:
            of, values = kernel.OF_DATA, self._unpacked(body, size)
            count = page[of + kernel.VALUES]
            begin = kernel.levels_end(values, count) if self.optional and values is not None else 0
        elif page[kernel.KIND] == DATA_2:
            of, count = kernel.OF_DATA_2, page[kernel.OF_DATA_2 + kernel.VALUES]
            levels = page[of + LEVELS_2] + page[of + REPEATS_2]
            if page[of + NULLS_2] != 0 or page[of + REPEATS_2] != 0 or not 0 <= levels <= min(len(body), size):
                return None
            rest = body[levels:]
            values = rest if page[of + PACKED_2] == 0 else self._unpacked(rest, size - levels)
            of, begin = of + ENCODING_2 - ENCODING, 0
        else:
            return None
        if values is None or begin < 0:
            return None
        return values[begin:], page[of + ENCODING], count

    def _numbers(self, values: NDArray[np.uint8], encoding: int, out: NDArray[np.float64]) -> bool:
        if encoding == PLAIN:
            if len(values) != len(out) * self.kind.itemsize:
                return False
            out[:] = values.view(self.kind)
            return True
        if encoding not in BY_DICTIONARY or self._table is None or not len(values) or values[0] > 32:
            return False
        return bool(kernel.look_up(values, 1, int(values[0]), self._table, out) == len(out))
