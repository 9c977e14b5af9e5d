"""Arrow columns become the arrays that Arrow itself makes of them, and pandas is not asked."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from backlash_cli.loaders.arrays import to_array, to_column, to_texts, where_true

SAMPLE = Path(__file__).parents[2] / "sample_data"
KINDS = (pa.float64(), pa.float32(), pa.int64(), pa.int32(), pa.uint8(), pa.int16())
COLUMNS = [pa.array(values, kind) for kind in KINDS
           for values in ([1, 2, 3, 4, 5], [1, None, 3, None, 5], [None, None], [])]
COLUMNS += [pa.array([True, False, True, True, False]), pa.array([], pa.bool_())]


@pytest.mark.parametrize("column", COLUMNS, ids=lambda c: f"{c.type}, {c.null_count} of {len(c)} empty")
def test_an_array_is_what_arrow_makes_of_a_column(column: pa.Array) -> None:
    for cells in (column, column.slice(1), column.slice(2, 2)):
        found, expected = to_array(cells), cells.to_numpy(zero_copy_only=False)
        assert found.dtype == expected.dtype
        np.testing.assert_array_equal(found, expected)
    for chunks in ([], [column], [column, column.slice(1)], [column.slice(2, 1), column.slice(0, 0), column]):
        chunked = pa.chunked_array(chunks, column.type)
        np.testing.assert_array_equal(to_array(chunked), chunked.to_numpy())


def test_the_array_of_a_column_cannot_be_written_to() -> None:
    column = pa.array([1.0, 2.0])
    with pytest.raises(ValueError, match="read-only"):
        to_array(column)[0] = 3.0


def test_flags_without_a_value_are_false() -> None:
    assert where_true(pa.array([True, None, False])).tolist() == [True, False, False]


def test_stamps_and_texts_become_columns() -> None:
    stamps = np.array([0, 1, -5, 2**40])
    for kind in (pa.int64(), pa.timestamp("us"), pa.timestamp("s", "UTC")):
        assert to_column(stamps[::2], kind).equals(pa.array(stamps[::2]).cast(kind))
    for words in ([], [""], ["AUTO", "", "µ°C", "日本"]):
        found = to_texts(words)
        found.validate(full=True)
        assert found.equals(pa.array(words, pa.string()))


@pytest.mark.parametrize("name", ["plant.csv", "plant.parquet"])
def test_a_scan_does_not_import_pandas(name: str) -> None:
    """It would double the time that a small file takes."""
    code = ("import sys, backlash_cli as b; b.scan_files(sys.argv[1], options=b.ScanOptions(confirm=False), jobs=1); "
            "sys.exit('pandas' in sys.modules)")
    done = subprocess.run([sys.executable, "-c", code, str(SAMPLE / name)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr or "pandas was imported"
