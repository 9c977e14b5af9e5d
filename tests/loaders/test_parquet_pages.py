"""Columns of a Parquet file that are decoded here are, bit by bit, what Arrow makes of them; it reads the others."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pa_parquet
import pytest
from numpy.typing import NDArray

from backlash_cli import ScanOptions, scan_files
from backlash_cli.loaders import parquet_columns, parquet_pages
from backlash_cli.loaders.page_kernel import look_up
from backlash_cli.loaders.parquet_pages import PageReader
from backlash_cli.reporter.json_report import to_json

SAMPLE = Path(__file__).parents[2] / "sample_data" / "plant.parquet"


@pytest.fixture(autouse=True)
def _small_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parquet_pages, "LEAST", 1)


def made(rows: int, seed: int) -> dict[str, NDArray[np.float64]]:
    rng = np.random.default_rng(seed)
    odd = rng.normal(size=rows)
    odd[rng.random(rows) < 0.1] = np.nan
    odd[rng.random(rows) < 0.1] = -0.0
    odd[rng.random(rows) < 0.1] = np.inf
    return {
        "constant": np.full(rows, 50.0), "two": rng.choice([1.5, -2.5], rows),
        "steps": np.repeat(rng.normal(size=rows), 7)[:rows],
        "rounded": np.round(np.cumsum(rng.normal(size=rows)), 1), "digits": rng.normal(size=rows), "odd": odd,
        "rises": np.arange(rows) / 8.0,
    }


def written(path: Path, columns: dict[str, NDArray[np.float64]], kind: pa.DataType, *, nullable: bool = True,
            **options: object) -> Path:
    schema = pa.schema([pa.field(name, kind, nullable=nullable) for name in columns])
    table = pa.table([pa.array(values.astype(np.float32 if kind == pa.float32() else np.float64))
                      for values in columns.values()], schema=schema)
    pa_parquet.write_table(table, path, **options)
    return path


def compared(path: Path, first: int = 0) -> int:
    """How many columns were decoded here; all of them as Arrow does."""
    file = pa_parquet.ParquetFile(path)
    reader, decoded = PageReader(path, file.metadata), 0
    for column in range(file.metadata.num_columns):
        found = reader.numbers(column, first)
        if found is not None:
            groups = list(range(first, file.metadata.num_row_groups))
            expected = file.read_row_groups(groups).column(column).to_numpy().astype(np.float64)
            np.testing.assert_array_equal(found.view(np.int64), expected.view(np.int64))
            decoded += 1
    return decoded


CODECS = ("none", "snappy", "zstd")


@pytest.mark.parametrize("codec, version, kind, nullable", list(itertools.product(
    CODECS, ("1.0", "2.0"), (pa.float64(), pa.float32()), (True, False))))
def test_every_way_of_writing_floats(tmp_path: Path, codec: str, version: str, kind: pa.DataType,
                                     nullable: bool) -> None:
    for seed, (rows, dictionary) in enumerate(itertools.product((1, 7, 1000, 5003), (True, False))):
        columns = made(rows, seed)
        path = written(tmp_path / "a.parquet", columns, kind, nullable=nullable, compression=codec,
                       data_page_version=version, use_dictionary=dictionary)
        assert compared(path) == len(columns)


@pytest.mark.parametrize("options", [
    {"row_group_size": 700}, {"data_page_size": 500}, {"dictionary_pagesize_limit": 3000},
    {"dictionary_pagesize_limit": 3000, "data_page_size": 500, "row_group_size": 2000}, {"write_batch_size": 17},
    {"write_page_checksum": True}, {"write_page_index": True}, {"store_schema": False},
])
def test_pages_and_row_groups_of_any_size(tmp_path: Path, options: dict[str, object]) -> None:
    columns = made(5003, 1)
    for version in ("1.0", "2.0"):
        path = written(tmp_path / "a.parquet", columns, pa.float64(), data_page_version=version, **options)
        assert compared(path) == len(columns)
        last = pa_parquet.read_metadata(path).num_row_groups - 1
        assert compared(path, last) == len(columns)


def test_all_else_is_left_to_arrow(tmp_path: Path) -> None:
    columns = made(500, 2)
    path = tmp_path / "a.parquet"
    for options in ({"compression": "gzip"}, {"write_statistics": False},
                    {"use_dictionary": False, "column_encoding": "BYTE_STREAM_SPLIT"}):
        assert compared(written(path, columns, pa.float64(), **options)) == 0
    some = pa.table({"blank": pa.array([1.0, None, 2.0] * 100), "whole": pa.array(range(300)),
                     "words": pa.array(["a"] * 300), "lists": pa.array([[1.0]] * 300)})
    pa_parquet.write_table(some, path)
    assert compared(path) == 0


@pytest.mark.parametrize("seed", range(60))
def test_a_damaged_file_gives_what_arrow_gives_or_nothing(tmp_path: Path, seed: int) -> None:
    """Arrow may refuse what is read here (it looks at numbers that nobody needs), never the other way round."""
    rng = np.random.default_rng(seed)
    path = written(tmp_path / "a.parquet", made(600, seed), pa.float64(), compression=CODECS[seed % 3],
                   data_page_version="1.0" if seed % 2 else "2.0", use_dictionary=seed % 5 > 0)
    about = pa_parquet.read_metadata(path)
    whole = path.read_bytes()
    for _ in range(20):
        spoilt = bytearray(whole)
        for at in rng.integers(4, len(whole) - about.serialized_size - 8, rng.integers(1, 4)):
            spoilt[at] = rng.integers(0, 256)
        path.write_bytes(bytes(spoilt))
        reader, file = PageReader(path, about), pa_parquet.ParquetFile(path, metadata=about)
        for column in range(about.num_columns):
            found = reader.numbers(column)
            if found is None:
                continue
            try:
                expected = file.reader.read_column(column).to_numpy()
            except (OSError, ValueError):
                continue
            np.testing.assert_array_equal(found.view(np.int64), expected.view(np.int64))


def test_indices_never_lead_beyond_their_table() -> None:
    rng = np.random.default_rng(0)
    table = np.arange(5.0)
    for size in rng.integers(0, 40, 3000):
        data = rng.integers(0, 256, size).astype(np.uint8)
        data.flags.writeable = False
        out = np.full(rng.integers(1, 50), np.nan)
        found = look_up(data, 0, int(rng.integers(0, 33)), table, out)
        assert found == -1 or (found == len(out) and np.isin(out, table).all())


def test_a_report_does_not_depend_on_who_decodes(monkeypatch: pytest.MonkeyPatch) -> None:
    told = []
    for least in (1, 1 << 40):
        monkeypatch.setattr(parquet_pages, "LEAST", least)
        told.append(to_json(scan_files(SAMPLE, options=ScanOptions(confirm=False), jobs=1)))
    assert told[0] == told[1]


def test_columns_that_were_read_ahead_are_used(tmp_path: Path) -> None:
    path = written(tmp_path / "a.parquet", made(300, 3), pa.float64())
    file = parquet_columns.ParquetFileColumns(path)
    file.read_in_order([(0, 0), (1, 0), (2, 0), (2, 0)])
    first = file.numbers(0)
    assert first is not None and np.array_equal(first, file.file.read().column(0).to_numpy())
    assert file.numbers(2) is None  # wanted twice: Arrow keeps it
    file.column(1)
    assert len(file.column(2)) == len(file.column(2)) == 300
