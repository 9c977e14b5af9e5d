"""Long CSV and Parquet files, block by block into a LongReader."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pa_parquet

from .csv_signal import ForeignText
from .dialect import Dialect
from .fast_csv import Layout as CsvLayout
from .fast_csv import parsed_blocks, piece_of
from .long_tables import LongLayout, LongReader, LongTable
from .options import ReadOptions
from .tables import Table, convert_options, ragged_note
from .text_blocks import Lines

if TYPE_CHECKING:
    from .lazy_tables import Lazily

BATCH_ROWS = 1 << 18  # of a Parquet file that are decoded at once


def long_csv(
    blocks: Iterator[Lines], head: Table, dialect: Dialect, layout: LongLayout, options: ReadOptions, lazily: Lazily
) -> LongTable | None:
    """Read the text below the header of a long CSV. Raises ForeignText where it has to be read whole."""
    reader = LongReader(head, layout, options, lazily.wanted, lazily.room)
    texts = {i for i in layout.stored if head.is_text(i)}
    plan = CsvLayout(dialect, convert_options(dialect), layout.stored, layout.others, texts)
    bad: list[tuple[int, int, int]] = []
    rows = 0
    for block in parsed_blocks(blocks, plan, lazily.threads):
        reader.take(block.columns, piece_of(block, reader.signals, plan))
        bad += [(rows + number, expected, found) for number, expected, found in block.bad]
        rows += block.rows + len(block.bad)
        if lazily.progress is not None:
            lazily.progress(block.size)
    found = reader.finish()
    return LongTable(found, (ragged_note(bad, dialect, head.where),) if bad else ()) if found else None


def long_parquet(
    file: pa_parquet.ParquetFile, head: Table, layout: LongLayout, options: ReadOptions, lazily: Lazily
) -> LongTable | None:
    """Read a long Parquet file. Raises ForeignText where it has to be read whole."""
    reader = LongReader(head, layout, options, lazily.wanted, lazily.room)
    names = file.schema_arrow.names
    columns = sorted({*layout.stored, *layout.others})
    batches = file.iter_batches(BATCH_ROWS, columns=[names[i] for i in columns], use_threads=False)
    for batch in _ahead(batches, lazily.threads):
        cells = {i: pa.chunked_array([batch.column(names[i])]) for i in columns}
        values = np.empty((len(layout.stored), batch.num_rows))
        for signal, i, out in zip(reader.signals, layout.stored, values, strict=True):
            signal.take(_storable(cells[i]), out, ".")
        reader.take(cells, values)
    found = reader.finish()
    return LongTable(found) if found else None


def _ahead(batches: Iterator[pa.RecordBatch], threads: int) -> Iterator[pa.RecordBatch]:
    """Yield each batch while the next one is decoded by another thread."""
    if threads <= 1:
        yield from batches
        return
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(next, batches, None)
        while (batch := coming.result()) is not None:
            coming = pool.submit(next, batches, None)
            yield batch


def _storable(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """Numbers as float64, texts as they are. Raises ForeignText for anything else."""
    kind = column.type
    if pa.types.is_float64(kind) or pa.types.is_string(kind) or pa.types.is_dictionary(kind):
        return column
    numeric = (pa.types.is_floating, pa.types.is_integer, pa.types.is_decimal, pa.types.is_boolean)
    if any(is_one(kind) for is_one in numeric):
        return column.cast(pa.float64(), safe=False)
    if pa.types.is_large_string(kind):
        return column.cast(pa.string())
    raise ForeignText
