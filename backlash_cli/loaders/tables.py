"""Files to tables: pyarrow reads the bulk, this module only tells it where the data begin and what to keep."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from ..errors import InputError
from ..record import Note
from .columns import LazyColumn
from .dialect import Dialect, sniff
from .files import Content, open_content
from .numbers import BLANK
from .options import ReadOptions
from .places import Remote, in_words

HEAD_SIZES = (256 << 10, 4 << 20, 32 << 20)
_TWO_LEVELS = re.compile(r"^\('([^']*)', '([^']*)'\)$")  # column names of two levels as pandas writes them
MAX_COLUMNS = 100_000
MAX_GROWTH = 1000  # bytes decoded per byte of a large Parquet file; constant columns reach some hundred


@dataclass(frozen=True)
class Table:
    """Columns as they stand in a file, nothing interpreted yet.

    where: path for messages. stem: file name without endings. first_line: line of the first row in a CSV
    file, 0 for Parquet. loop: name given by a partition folder (loop=FIC101), else "".
    """

    where: str
    stem: str
    names: tuple[str, ...]
    columns: tuple[pa.ChunkedArray | LazyColumn, ...]
    decimal: str = "."
    first_line: int = 0
    notes: tuple[Note, ...] = ()
    partition: dict[str, str] = field(default_factory=dict)
    kinds: tuple[str, ...] = ()

    def is_text(self, column: int) -> bool:
        """Say whether a column holds text."""
        kind = self.columns[column].type
        return pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_dictionary(kind)

    def kind(self, column: int) -> str:
        """What the first cells of a CSV column look like ("time", "clock", "number", "text"), "" for Parquet."""
        return self.kinds[column] if column < len(self.kinds) else ""

    @property
    def rows(self) -> int:
        return len(self.columns[0]) if self.columns else 0


def read_table(path: Path | Remote, options: ReadOptions, partition: dict[str, str] | None = None) -> Table:
    """Read one CSV or Parquet file. Raises InputError with the file and the reason."""
    with in_words(str(path)) if isinstance(path, Remote) else contextlib.nullcontext():
        return replace(_read(path, options), partition=partition or {})


def _read(path: Path | Remote, options: ReadOptions) -> Table:
    content = open_content(path, options)
    try:
        if content.kind == "parquet":
            return _read_parquet(path, options)
        return _read_csv(content, options)
    except (pa.ArrowException, ValueError, OSError, OverflowError, MemoryError) as error:
        raise cannot_be_read(error, str(path)) from None


def cannot_be_read(error: BaseException, where: str) -> InputError:
    """Return a reader's failure as an error that says where."""
    return InputError(f"cannot be read: {_first_line(error)}", where=where, remedy="export the file again")


def stem_of(path: Path | Remote) -> str:
    """File name without the endings of its format: FIC101.PV.csv.gz -> FIC101.PV."""
    name = path.name
    for endings in (
        (".gz", ".zst", ".zstd", ".bz2", ".xz"),
        (".csv", ".txt", ".tsv", ".dat", ".parquet", ".pq", ".asc"),
    ):
        for ending in endings:
            if name.lower().endswith(ending) and len(name) > len(ending):
                name = name[: -len(ending)]
                break
    return name


def _read_parquet(path: Path | Remote, options: ReadOptions) -> Table:
    file = pa_parquet.ParquetFile(path.open_bytes() if isinstance(path, Remote) else path)
    if file.metadata.num_columns > MAX_COLUMNS:
        raise InputError(f"{file.metadata.num_columns} columns are too many", where=str(path))
    decoded = file.metadata.num_rows * file.metadata.num_columns * 8
    if decoded > options.max_bytes and decoded > MAX_GROWTH * path.stat().st_size:
        raise InputError(
            f"{path.stat().st_size} bytes of Parquet expand to {decoded >> 20} MB",
            where=str(path),
            remedy="if this is a real export, cut it into parts",
        )
    table = file.read()
    names, columns = [], []
    for name, column in zip(table.column_names, table.columns, strict=True):
        if pa.types.is_nested(column.type):
            continue
        names.append(column_name(name))
        columns.append(column)
    return Table(str(path), stem_of(path), tuple(names), tuple(columns))


def column_name(name: str) -> str:
    """The name of a Parquet column; two levels as pandas writes them become one.

    >>> column_name("('FIC101', 'PV')")
    'FIC101.PV'
    """
    level = _TWO_LEVELS.match(name)
    return f"{level[1]}.{level[2]}" if level else name


def head_table(content: Content, options: ReadOptions) -> Table:
    """Return the first rows of a CSV. Raises InputError when it cannot be understood."""
    return _read_csv(content, options)


def _read_csv(content: Content, options: ReadOptions) -> Table:
    where = str(content.path)
    dialect = find_dialect(content, options, where)
    table, bad = _parse(content, dialect)
    notes = list(content.notes)
    if bad:
        notes.append(ragged_note(_locate(content, dialect, bad), dialect, where))
    if table.num_rows == 0:
        raise InputError("no rows of data below the header", where=where, remedy="export it again with samples")
    return Table(
        where,
        stem_of(content.path),
        dialect.names,
        tuple(table.columns),
        dialect.decimal,
        dialect.line,
        tuple(notes),
        kinds=dialect.kinds,
    )


def ragged_note(bad: Sequence[tuple], dialect: Dialect, where: str) -> Note:
    """Say which rows were dropped; bad: (number of the row from 1 or None, columns expected, columns found)."""
    first = next((b[0] for b in bad if b[0] is not None), None)
    line = "" if first is None else f", the first is line {dialect.line + first - 1}"
    return Note(
        "ragged_rows",
        f"{len(bad)} rows have too few or too many cells and were dropped{line} "
        f"({bad[0][2]} columns instead of {bad[0][1]})",
        {"rows": float(len(bad)), "file": where},
    )


def find_dialect(content: Content, options: ReadOptions, where: str) -> Dialect:
    """Find how a CSV file is written from as many of its first lines as that takes. Raises InputError."""
    problem: InputError | None = None
    for size in HEAD_SIZES:
        raw = content.head(size)
        complete = len(raw) < size
        if raw.count(b"\n") + raw.count(b"\r") < 40 and not complete and size != HEAD_SIZES[-1]:
            continue
        try:
            return sniff(raw.decode("utf-8", errors="replace" if complete else "ignore"), complete, options, where)
        except InputError as error:
            problem = error
            if complete:
                break
    assert problem is not None
    raise problem


def _parse(content: Content, dialect: Dialect, threads: bool = True) -> tuple[pa.Table, list[tuple]]:
    bad: list[tuple] = []

    def on_bad_row(row: pa_csv.InvalidRow) -> str:
        bad.append((row.number, row.expected_columns, row.actual_columns))
        return "skip"

    # Unique names: two columns of the file may be called the same.
    names = [f"c{i}" for i in range(len(dialect.names))]
    if len(names) > MAX_COLUMNS:
        raise InputError(f"{len(names)} columns are too many", where=str(content.path))
    table = pa_csv.read_csv(
        content.stream(dialect.offset),
        read_options=pa_csv.ReadOptions(column_names=names, use_threads=threads, block_size=1 << 22),
        parse_options=pa_csv.ParseOptions(
            delimiter=dialect.delimiter,
            newlines_in_values=dialect.quoted_lines,
            invalid_row_handler=on_bad_row,
        ),
        convert_options=convert_options(dialect),
    )
    return table, bad


def convert_options(dialect: Dialect) -> pa_csv.ConvertOptions:
    """How pyarrow turns cells into columns."""
    return pa_csv.ConvertOptions(
        decimal_point=dialect.decimal,
        null_values=["", " ", *BLANK],
        quoted_strings_can_be_null=True,
        auto_dict_encode=True,
        auto_dict_max_cardinality=4096,
        true_values=["\x00"],
        false_values=["\x00"],
    )


def parse_head(content: Content, dialect: Dialect) -> Table:
    """Return the first rows of a CSV file as a table; the content may end anywhere in a line."""
    text = content.head(HEAD_SIZES[1])[dialect.offset :]
    cut = text.rfind(b"\n") + 1 or len(text)
    table, _ = _parse(Content(content.path, "text", text[:cut]), replace(dialect, offset=0), threads=False)
    return Table(str(content.path), stem_of(content.path), dialect.names, tuple(table.columns), dialect.decimal,
                 dialect.line, kinds=dialect.kinds)


def _locate(content: Content, dialect: Dialect, bad: list[tuple]) -> list[tuple]:
    """Read once more in one thread, where pyarrow numbers the rows, to name the first bad line."""
    if any(number is not None for number, _, _ in bad):
        return bad
    try:
        return _parse(content, dialect, threads=False)[1] or bad
    except pa.ArrowException:
        return bad


def _first_line(error: BaseException) -> str:
    text = str(error).strip().split("\n")[0] or type(error).__name__
    return text if len(text) <= 300 else text[:297] + "..."
