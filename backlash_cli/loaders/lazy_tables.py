"""Tables whose columns are read when a loop needs them: wide CSV through the column store, Parquet from its file.

`lazy_table` gives the Table that `read_table` gives, or None where the file has to be read whole: other layouts, other
encodings, text that only a full CSV reader understands. It raises nothing about the file: `read_table` says it better.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import pyarrow as pa

from ..errors import InputError
from ..record import Note
from .columns import LazyColumn
from .compression import codec_of
from .csv_signal import ForeignText
from .fast_csv import BLOCK, read_blocks
from .fast_csv import Layout as CsvLayout
from .files import Content, guess_encoding, is_utf8
from .heap import keep_freed_memory
from .hourly_stamps import by_hours
from .layouts import layout_of
from .long_files import long_csv, long_parquet
from .long_tables import LongTable, long_layout
from .names import is_time_name, split_tag
from .options import ReadOptions
from .parquet_columns import ParquetColumn, ParquetFileColumns
from .places import Remote, open_place
from .recoded import Recoded, Western
from .store import Room
from .tables import (
    MAX_COLUMNS,
    MAX_GROWTH,
    Table,
    column_name,
    convert_options,
    find_dialect,
    parse_head,
    ragged_note,
    stem_of,
)
from .text_blocks import Source, read_up_to, source_of, whole_lines
from .timecolumns import time_columns

HEAD = 320 << 10
FEW_LINES = 40  # in HEAD bytes: more is looked at


@dataclass
class Lazily:
    """How to read lazily. needed: tells from the first rows of a table which columns the wanted loops use; all if not.
    wanted: tells of a tag (or of a loop, in rows of loops) whether the wanted loops use it.

    threads: of parsing. progress: called with the bytes of a file that were taken in. done: names of loops whose
    samples nobody will need.
    """

    needed: Callable[[Table], set[int]] = lambda table: set(range(len(table.names)))
    wanted: Callable[[str], bool] = lambda tag: True
    threads: int = 1
    progress: Callable[[int], None] | None = None
    done: Collection[str] = ()
    room: Room = field(default_factory=Room)


def lazy_table(
    path: Path | Remote, options: ReadOptions, partition: dict[str, str], lazily: Lazily
) -> Table | LongTable | None:
    """Return a file's table with lazy columns, or the signals of a long file; None where it has to be read whole."""
    keep_freed_memory()
    try:
        with open_place(path) as file:
            magic = file.read(16)
        parquet = magic[:4] == b"PAR1"
        packed = parquet or bool(codec_of(magic))  # then its bytes are not those of the text
        told = replace(lazily, progress=None) if packed else lazily
        table = _parquet(path, options, partition, lazily) if parquet else _csv(path, magic, options, partition, told)
        if packed and table is not None and lazily.progress is not None:
            lazily.progress(path.stat().st_size)
        return table
    except (InputError, pa.ArrowException, OSError, ValueError, OverflowError, EOFError, ForeignText):
        return None


def _parquet(
    path: Path | Remote, options: ReadOptions, partition: dict[str, str], lazily: Lazily
) -> Table | LongTable | None:
    source = ParquetFileColumns(path)
    about = source.file.metadata
    schema = source.file.schema_arrow
    flat = len(schema) == about.num_columns and not any(pa.types.is_nested(field.type) for field in schema)
    decoded = about.num_rows * about.num_columns * 8
    large = decoded > options.max_bytes and decoded > MAX_GROWTH * path.stat().st_size
    flat = flat and len(set(schema.names)) == len(schema.names)
    if not flat or large or not 0 < about.num_columns <= MAX_COLUMNS or not about.num_rows:
        return None
    names = tuple(column_name(name) for name in schema.names)
    seen = [i for i, f in enumerate(schema) if _tells(i, names[i], f.type)]
    batch = next(source.file.iter_batches(1000, columns=[schema.names[i] for i in seen])) if seen else None
    first = dict(zip(seen, batch.columns if batch else (), strict=True))
    rows = min(1000, about.num_rows)
    looked = (pa.chunked_array([first[i]]) if i in first else LazyColumn(f.type, rows) for i, f in enumerate(schema))
    head = Table(str(path), stem_of(path), names, tuple(looked), partition=partition)
    if layout_of(head, options) not in ("wide", "single"):
        long = long_layout(head, options)
        return None if long is None else long_parquet(source.file, head, long, options, lazily)
    stamps = time_columns(head)
    texts = tuple(f.name for i, f in enumerate(schema) if pa.types.is_string(f.type) and i not in stamps)
    if texts:
        source = ParquetFileColumns(path, texts, about)
    columns = tuple(ParquetColumn(source, i, f.type, about.num_rows) for i, f in enumerate(schema))
    return Table(str(path), stem_of(path), names, columns, partition=partition)


def _tells(column: int, name: str, kind: pa.DataType) -> bool:
    """Say whether the first rows of a column tell about the layout; to read them is to decode much of the column."""
    if pa.types.is_timestamp(kind):
        return False
    if pa.types.is_floating(kind) or pa.types.is_integer(kind):
        return column == 0 or is_time_name(name) or split_tag(name).role == "time"
    return True


def _csv(
    path: Path | Remote, magic: bytes, options: ReadOptions, partition: dict[str, str], lazily: Lazily
) -> Table | LongTable | None:
    opened = partial(source_of, path, codec_of(magic), BLOCK)
    with opened() as source:
        begun = read_up_to(source, HEAD)
        encoding, prefix = guess_encoding(begun, path, options)
        if not begun or begun[:4] == b"PAR1":
            return None
        if encoding == "utf-8":
            with suppress(ForeignText):
                return _text(path, source, begun, prefix, options, partition, lazily)
    with opened() as source:
        if encoding == "utf-8" and is_utf8(source):
            return None
    with opened() as source:
        begun = read_up_to(source, HEAD)[prefix:]
        western = encoding in ("utf-8", "cp1252")
        text = Western(begun, source, opened) if western else Recoded(begun, source, encoding)
        table = _text(path, text, read_up_to(text, HEAD), 0, options, partition, lazily)
        return None if table is None else replace(table, notes=(*text.notes, *table.notes))


def _text(
    path: Path | Remote, source: Source, begun: bytes, prefix: int, options: ReadOptions, partition: dict[str, str],
    lazily: Lazily,
) -> Table | LongTable | None:
    """Read text that has begun, after a mark of so many bytes. Raises ForeignText, as where it is not UTF-8."""
    while begun.count(b"\n") < FEW_LINES and len(begun) <= BLOCK:
        more = read_up_to(source, 2 * len(begun))
        begun += more
        if not more:
            break
    content = Content(path, "text", begun, prefix)
    dialect = find_dialect(content, options, str(path))
    if dialect.quoted_lines or not dialect.delimiter.isascii():
        return None
    head = parse_head(content, dialect)
    head = Table(str(path), stem_of(path), dialect.names, head.columns, dialect.decimal, dialect.line,
                 partition=partition, kinds=dialect.kinds)
    if not head.rows:
        return None
    rest = whole_lines(begun[prefix + dialect.offset :], source, BLOCK)
    if layout_of(head, options) not in ("wide", "single"):
        long = long_layout(head, options)
        return None if long is None else long_csv(rest, head, dialect, long, options, lazily)
    named = time_columns(head)
    stamps = [i for i, c in enumerate(head.columns)
              if i in named or pa.types.is_temporal(c.type) or head.kind(i) in _STAMPS]
    kinds = [c.type for c in head.columns]
    stored = sorted(lazily.needed(head) - set(stamps))
    texts = {i for i in stored if head.is_text(i)}
    layout = CsvLayout(dialect, convert_options(dialect), stored, stamps, texts, by_hours(options.time_format),
                       options.time_format is None)
    read = read_blocks(rest, layout, kinds, room=lazily.room, threads=lazily.threads, progress=lazily.progress)
    if read is None:
        raise ForeignText
    if not len(read[0][0]):
        return None
    columns, bad = read
    notes: tuple[Note, ...] = (ragged_note(bad, dialect, str(path)),) if bad else ()
    return Table(str(path), stem_of(path), dialect.names, tuple(columns), dialect.decimal, dialect.line, notes,
                 partition, dialect.kinds)


_STAMPS = ("time", "clock")
