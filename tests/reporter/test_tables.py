"""DataFrame, CSV and Parquet say the same, with fixed columns, and run nothing in a spreadsheet."""

import csv
import io

import pandas as pd
import pytest

from backlash_cli.errors import UsageError
from backlash_cli.reporter.scan_report import write
from backlash_cli.reporter.tables import TABLES, csv_parts, to_dataframe
from backlash_cli.results import ScanResult
from tests.reporter.reports import HOSTILE, report, result


def test_one_row_per_loop_with_typed_columns():
    frame = to_dataframe(result())
    assert list(frame.columns) == list(TABLES["loops"]) and len(frame) == 8
    assert frame.d.tolist()[:2] == [0.01, 0.05] and frame.d.isna().tolist()[3:] == [True] * 5
    assert str(frame.start.dt.tz) == "UTC" and frame.detections.dtype == "int64"
    assert frame.reasons[7] == "missing_pv: there is no PV column"


def test_one_row_per_half_period():
    frame = to_dataframe(result(report("a"), report("b")), "estimates")
    assert list(frame.columns) == list(TABLES["estimates"]) and frame.loop.tolist() == ["a", "a", "b", "b"]
    assert frame.accepted.tolist() == [True, False, True, False] and frame.why[1] == "too_short"


@pytest.mark.parametrize("table", ["loops", "estimates"])
def test_columns_are_the_same_without_rows(table):
    empty, full = to_dataframe(ScanResult(()), table), to_dataframe(result(), table)
    assert list(empty.dtypes.index) == list(full.dtypes.index)
    assert [t for t in empty.dtypes if str(t)[:8] != "datetime"] == [t for t in full.dtypes if str(t)[:8] != "datetime"]


@pytest.mark.parametrize("table", ["loops", "estimates"])
def test_csv_and_parquet_hold_the_same(tmp_path, table):
    found = result(report("a"), report("b", None))
    frame = to_dataframe(found, table)
    write(found, {}, "parquet", tmp_path / "t.parquet", table)
    parquet = pd.read_parquet(tmp_path / "t.parquet")
    text = pd.read_csv(io.StringIO("".join(csv_parts(found, table))))
    assert list(text.columns) == list(parquet.columns) == list(frame.columns)
    for column in ("d", "dt_s", "spread", "detections"):
        if column in frame:
            assert parquet[column].tolist() == pytest.approx(frame[column].tolist(), nan_ok=True)
            assert text[column].tolist() == pytest.approx(frame[column].tolist(), nan_ok=True)
    assert (parquet.start == frame.start).all()
    assert (pd.to_datetime(text.start, utc=True) == frame.start).all()


def test_csv_defuses_formulas_and_keeps_one_row_per_loop():
    found = "".join(csv_parts(result(*(report(name) for name in HOSTILE))))
    rows = list(csv.DictReader(io.StringIO(found)))
    assert len(rows) == len(HOSTILE)
    for row in rows:
        assert all(not (cell or "").lstrip().startswith(("=", "+", "@")) for cell in row.values())
    assert rows[2]["loop"] == "'" + HOSTILE[2]
    # every text stands in quotation marks: a spreadsheet with semicolons cannot be led into a new cell
    assert '"a;=cmd()\t|b"' in found


def test_parquet_takes_names_that_are_no_text(tmp_path):
    write(result(report("lone \udc80 surrogate")), {}, "parquet", tmp_path / "t.parquet")
    assert pd.read_parquet(tmp_path / "t.parquet").loop[0] == "lone \\udc80 surrogate"


def test_unknown_table():
    for make in (to_dataframe, csv_parts):
        with pytest.raises(UsageError, match="loops, estimates"):
            make(result(), "nights")
