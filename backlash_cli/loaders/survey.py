"""Which loops a file holds, from its header and its column of tags: enough to plan a scan without reading samples."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from ..errors import BacklashError
from .file_signals import READING_ERRORS
from .files import Content, first_part, open_content
from .identity import mark_of
from .layouts import layout_of, series_of
from .long_layouts import GROUPS, name_columns
from .names import IGNORED, QUALITY, TAG, plain, signal_role, split_tag
from .numbers import codes_and_words
from .options import ReadOptions
from .places import Remote, open_place
from .series import Axis, Cells, Series
from .sources import Source
from .tables import Table, cannot_be_read, column_name, find_dialect, head_table, stem_of
from .timecolumns import time_axis, time_columns
from .times import NAT, Times

HEAD_ROWS = 4000


@dataclass(frozen=True)
class Survey:
    """What one file holds. series: its signals without samples. size: bytes. last: its last stamp [microseconds], if
    that was asked for. text: it is no Parquet file, and so can only be read as a whole. mark: what changes when its
    content does. failure: why it cannot be read.
    """

    source: Source
    series: tuple[Series, ...] = ()
    size: int = 0
    last: int | None = None
    text: bool = False
    mark: str | None = None
    failure: BacklashError | None = None


def survey_all(sources: Iterable[Source], options: ReadOptions, *, end: bool = False) -> list[Survey]:
    """Look at several files. end: also find the last stamps, for which all stamps have to be read."""
    return [survey(source, options, end=end) for source in sources]


def survey(source: Source, options: ReadOptions, *, end: bool = False) -> Survey:
    """Look at one file; what is wrong with it stands in `failure`."""
    try:
        return _survey(source, options, end)
    except BacklashError as error:
        return Survey(source, failure=error)
    except READING_ERRORS as error:
        return Survey(source, failure=cannot_be_read(error, str(source.path)))


def _survey(source: Source, options: ReadOptions, end: bool) -> Survey:
    path = source.path
    size, mark = path.stat().st_size, mark_of(path)
    content = first_part(path, options)
    if content.kind == "parquet":
        file = pa_parquet.ParquetFile(open_place(path) if isinstance(path, Remote) else path)
        first = next(file.iter_batches(HEAD_ROWS), None)
        flat = [i for i, field in enumerate(file.schema_arrow) if not pa.types.is_nested(field.type)]
        names = tuple(column_name(file.schema_arrow.names[i]) for i in flat)
        columns = tuple(pa.chunked_array([first.column(i) if first is not None else []]) for i in flat)
        head = Table(str(path), stem_of(path), names, columns, partition=source.partition)
        reader: _Columns = _ParquetColumns(file, flat)
    else:
        head = replace(head_table(content, options), partition=source.partition)
        reader = _TextColumns(path, content, options)
    layout = layout_of(head, options)
    found = {"long": _long, "tall": _tall}.get(layout, _whole)(head, reader, options)
    return Survey(source, tuple(found), size, _last_stamp(head, reader, options) if end else None, reader.text,
                  mark)


class _Columns:
    """Some columns of a file, piece by piece, without the others."""

    text = False

    def pieces(self, columns: Sequence[int]) -> Iterator[list[pa.Array]]:
        """Yield the cells of the columns, a list per piece."""
        raise TypeError(f"{type(self).__name__} has no columns")


class _ParquetColumns(_Columns):
    def __init__(self, file: pa_parquet.ParquetFile, flat: Sequence[int]) -> None:
        self.file, self.flat = file, flat

    def pieces(self, columns: Sequence[int]) -> Iterator[list[pa.Array]]:
        names = [self.file.schema_arrow.names[self.flat[i]] for i in columns]
        for batch in self.file.iter_batches(1 << 20, columns=names):
            yield [batch.column(batch.schema.names.index(name)) for name in names]


class _TextColumns(_Columns):
    text = True

    def __init__(self, path: Path | Remote, head: Content, options: ReadOptions) -> None:
        self.path, self.options = path, options
        self.dialect = find_dialect(head, options, str(path))

    def pieces(self, columns: Sequence[int]) -> Iterator[list[pa.Array]]:
        content = open_content(self.path, self.options)
        names = [f"c{i}" for i in range(len(self.dialect.names))]
        wanted = [names[i] for i in columns]
        reader = pa_csv.open_csv(
            content.stream(self.dialect.offset),
            read_options=pa_csv.ReadOptions(column_names=names, block_size=1 << 22),
            parse_options=pa_csv.ParseOptions(
                delimiter=self.dialect.delimiter, newlines_in_values=self.dialect.quoted_lines,
                invalid_row_handler=lambda row: "skip",
            ),
            convert_options=pa_csv.ConvertOptions(
                include_columns=wanted, column_types=dict.fromkeys(wanted, pa.string())
            ),
        )
        for batch in reader:
            yield batch.columns


def _whole(head: Table, reader: _Columns, options: ReadOptions) -> list[Series]:
    """Layouts whose header says it all."""
    return [_light(item.tag, item.loop, item.role, item.signal, head) for item in series_of(head, options)]


def _long(head: Table, reader: _Columns, options: ReadOptions) -> list[Series]:
    _, used = time_axis(head, options)
    naming = name_columns(head, [i for i in range(len(head.names)) if head.is_text(i) and i not in used])
    if not naming:
        return _whole(head, reader, options)  # says what is missing
    found = []
    headers = tuple(head.names[i] for i in naming)
    for words in _distinct(reader, naming):
        # a header that is repeated in between is no tag
        if words != headers and (name := ".".join(words).strip()):
            tag = split_tag(name)
            found.append(_light(name, tag.loop, tag.role if tag.role in SIGNAL_ROLES else "", tag.signal, head))
    return found


def _tall(head: Table, reader: _Columns, options: ReadOptions) -> list[Series]:
    _, used = time_axis(head, options)
    words = [plain(name) for name in head.names]
    texts = [i for i in range(len(words)) if head.is_text(i) and i not in used]
    which = next((i for i in texts if words[i] in GROUPS), next((i for i in texts if words[i] in TAG), None))
    if which is None:
        return _whole(head, reader, options)
    signals = [
        name for i, name in enumerate(head.names)
        if i not in used and i != which and words[i] not in IGNORED | QUALITY and head.columns[i].null_count < head.rows
    ]  # fmt: skip
    loops = [loop for (text,) in _distinct(reader, [which]) if (loop := text.strip())]
    if head.names[which].strip() in loops:  # a header that is repeated in between is no loop
        loops.remove(head.names[which].strip())
    return [_light(f"{loop}.{name}", loop, signal_role(name), name, head) for loop in loops for name in signals]


SIGNAL_ROLES = ("sp", "pv", "op", "mode")


def _distinct(reader: _Columns, columns: Sequence[int]) -> list[tuple[str, ...]]:
    """Return the combinations of texts that occur in some columns, in order."""
    found: set[tuple[str, ...]] = set()
    for piece in reader.pieces(columns):
        coded = [codes_and_words(pa.chunked_array([cells])) for cells in piece]
        codes = np.stack([codes for codes, _ in coded])
        for row in np.unique(codes[:, np.all(codes >= 0, axis=0)], axis=1).T.tolist():
            found.add(tuple(words[code] for code, (_, words) in zip(row, coded, strict=True)))
    return sorted(found)


def _last_stamp(head: Table, reader: _Columns, options: ReadOptions) -> int | None:
    """Return the last stamp of a file, from all its stamps."""
    columns = time_columns(head)
    pieces = list(reader.pieces(columns))
    if not columns or not pieces:
        return None
    stamps = Table(
        head.where, head.stem, tuple(head.names[i] for i in columns),
        tuple(_like(pa.chunked_array([p[k] for p in pieces]), head, i) for k, i in enumerate(columns)),
        head.decimal, head.first_line, kinds=tuple(head.kind(i) for i in columns),
    )
    paired = layout_of(head, options) == "pairs"
    axes = [time_axis(stamps, options, only=k)[0] for k in range(len(columns))] if paired else [
        time_axis(stamps, options)[0]
    ]
    lasts = [int(axis.micros.max()) for axis in axes if len(axis.micros)]
    return max((last for last in lasts if last != NAT), default=None)


def _like(texts: pa.ChunkedArray, head: Table, column: int) -> pa.ChunkedArray:
    """Bring texts of a CSV to the type that its first rows have; they stay texts where that is not possible."""
    kind = head.columns[column].type
    if texts.type == kind or pa.types.is_dictionary(kind):
        return texts
    try:
        return texts.cast(kind)
    except pa.ArrowInvalid:
        return texts


def _light(tag: str, loop: str, role: str, signal: str, table: Table) -> Series:
    nothing = Axis(Times(np.zeros(0, np.int64)), table.where)
    return Series(tag, loop, role, signal, nothing, Cells(values=np.zeros(0)), None, table.where)
