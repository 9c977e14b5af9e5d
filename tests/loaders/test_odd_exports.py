"""Exports that were once read wrongly or not at all: marks, lone zeros, dates, annotated CSV, workbooks, messages."""

from __future__ import annotations

import datetime as dt
import gzip
import io
import re
import tarfile
import time
import zipfile
from datetime import timedelta
from itertools import chain
from zoneinfo import ZoneInfo

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from backlash_cli.errors import BacklashError, InputError
from backlash_cli.loaders import ReadOptions, read
from backlash_cli.loaders.names import COLUMNS, plain, split_tag
from backlash_cli.loaders.names import SIGNALS as SIGNALS_WORDS
from backlash_cli.loaders.times import read_dates
from backlash_cli.record import SampleState
from backlash_cli.results import Verdict
from backlash_cli.scanning import scan

from .exports import ROWS, SETTINGS, SIGNALS, STAMPS, arrow, cell, iso, long, wide
from .test_more_layouts import packed


def save(folder, text, name="plant.csv"):
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    (folder / "loops.toml").write_text(SETTINGS, encoding="utf-8")
    return folder / name


def codes(notes):
    return {note.code for note in notes}


def equals_the_recording(record, loop="FIC101", span=900.0, near=1e-6):
    np.testing.assert_allclose(record.measurement * span, SIGNALS[f"{loop}.PV"], atol=near * span)


SPOILT = range(200, 260, 4)  # rows of FIC101.PV that a fault of the recording replaces by 0


@pytest.mark.parametrize("header", ["Validity", "Validität", "OPCQuality", "IsGood", "QualityFlag", "DataValidity"])
def test_bad_rows_that_carry_the_value_zero_are_no_measurements(tmp_path, header):
    """Rows of a control system's archive: decimal comma, a column of validity, an end mark as last row."""
    def row(tag, stamp, value):
        bad = tag == "FIC101.PV" and int((stamp - STAMPS[0]).total_seconds()) in SPOILT
        return f'"{tag}";"{stamp:%d.%m.%Y %H:%M:%S}";{"0" if bad else value.replace(".", ",")};{0 if bad else 1}'

    text = long(row, f"VarName;TimeString;VarValue;{header}") + '"$RT_OFF$";"18.03.2026 00:04:59";0;2\n'
    plant = read(save(tmp_path, text))
    record = plant["FIC101"]
    assert [r.loop for r in plant] == ["FIC101", "PIC303"]
    assert (record.measurement > 0.3).all() and np.count_nonzero(record.state == SampleState.FILLED) == len(SPOILT)
    assert "bad_quality" in codes(record.notes)


def test_most_rows_may_be_invalid(tmp_path):
    def row(tag, stamp, value):
        bad = tag == "FIC101.PV" and int((stamp - STAMPS[0]).total_seconds()) % 5 > 1
        return f"{tag},{iso(stamp)},{'0' if bad else value},{0 if bad else 1}"

    record = read(save(tmp_path, long(row, "tag,time,value,Validity")))["FIC101"]
    assert (record.measurement[record.usable] > 0.3).all()


def test_qualities_are_known_by_their_content_too(tmp_path):
    def row(tag, stamp, value):
        bad = tag == "FIC101.PV" and int((stamp - STAMPS[0]).total_seconds()) in SPOILT
        return f"{tag},{iso(stamp)},{'0' if bad else value},{'Bad' if bad else 'Good'}"

    record = read(save(tmp_path, long(row, "tag,time,value,remark 7")))["FIC101"]
    assert (record.measurement > 0.3).all() and "bad_quality" in codes(record.notes)


@pytest.mark.parametrize("runs", [[(100, 1)], [(100, 1), (250, 2), (400, 3)]])
def test_lone_zeros_far_outside_are_named_and_not_used(tmp_path, runs):
    rows = {k for first, count in runs for k in range(first, first + count)}
    lines = wide().splitlines()
    for k in rows:
        cells = lines[k + 1].split(",")
        cells[2] = "0.00"
        lines[k + 1] = ",".join(cells)
    record = read(save(tmp_path, "\n".join(lines) + "\n"))["FIC101"]
    assert (record.measurement > 0.3).all() and set(np.flatnonzero(record.state)) == rows
    (note,) = [n for n in record.notes if n.code == "no_values"]
    assert note.message.startswith(f"{len(rows)} samples of FIC101.PV jump to exactly 0")


def test_zeros_that_belong_to_the_signal_are_kept(tmp_path):
    rng = np.random.default_rng(1)
    values = np.round(np.abs(rng.standard_normal(ROWS)), 1)  # comes down to zero by itself
    lines = [line.split(",") for line in wide().splitlines()]
    for k, value in enumerate(values):
        lines[k + 1][2] = f"{value}"
    record = read(save(tmp_path, "\n".join(map(",".join, lines)) + "\n"))["FIC101"]
    assert "no_values" not in codes(record.notes) and np.array_equal(record.measurement * 900, values)


@pytest.mark.parametrize(("form", "separator"), [("%d/%m/%Y %H:%M:%S", "/"), ("%m/%d/%Y %H:%M:%S", "/"),
                                                 ("%d-%m-%Y %H:%M:%S", "-"), ("%m-%d-%y %I:%M:%S %p", "-"),
                                                 ("%d/%m/%Y %I:%M:%S %p", "/")])
def test_the_file_itself_tells_day_from_month(tmp_path, form, separator):
    """11 April to midnight of the 12th: read the other way round, time would jump by a month."""
    begin = dt.datetime(2025, 4, 11, 23, 55)
    shift = begin - STAMPS[0]
    record = read(save(tmp_path, wide(lambda t: (t + shift).strftime(form))))["FIC101"]
    assert record.start == begin.replace(tzinfo=dt.UTC).timestamp() and len(record) == ROWS
    equals_the_recording(record)


def test_a_date_that_is_truly_open_is_refused(tmp_path):
    shift = dt.datetime(2025, 4, 11, 8) - STAMPS[0]
    with pytest.raises(InputError, match="ambiguous"):
        read(save(tmp_path, wide(lambda t: (t + shift).strftime("%d/%m/%Y %H:%M:%S"))))


def annotated(order=("_time", "_value", "_field", "_measurement"), blank="\r\n", types=True):
    """InfluxDB's annotated CSV: every series a table of its own with annotations and header."""
    text = ""
    for table, (tag, values) in enumerate(SIGNALS.items()):
        loop, field = tag.split(".")
        turned = order if table % 2 == 0 else (*order[2:], *order[:2])  # the columns of a table may stand otherwise
        if types:
            text += "#group,false,false,true,true,false,false\r\n"
            text += "#datatype,string,long,string,string,dateTime:RFC3339,double\r\n#default,_result,,,,,\r\n"
        text += ",".join(["", "result", "table", *turned]) + "\r\n"
        for stamp, value in zip(STAMPS, values, strict=True):
            cells = {"_time": f"{iso(stamp)}Z", "_value": cell(tag, value), "_field": field, "_measurement": loop}
            text += ",".join(["", "", str(table), *(cells[name] for name in turned)]) + "\r\n"
        text += blank
    return text


@pytest.mark.parametrize("blank", ["\r\n", ""])
def test_annotated_csv_with_a_header_for_every_table(tmp_path, blank):
    plant = read(save(tmp_path, annotated(blank=blank)))
    assert [r.loop for r in plant] == ["FIC101", "PIC303"] and not plant.failures
    equals_the_recording(plant["FIC101"])
    assert plant["FIC101"].usable.all() and plant["PIC303"].usable.all()


def book(folder, sheets):
    openpyxl = pytest.importorskip("openpyxl", reason="openpyxl is not installed: pip install openpyxl")
    made = openpyxl.Workbook()
    made.remove(made.active)
    for name, rows in sheets.items():
        sheet = made.create_sheet(name)
        for row in rows:
            sheet.append(row)
    made.save(folder / "plant.xlsx")
    (folder / "loops.toml").write_text(SETTINGS, encoding="utf-8")
    return folder / "plant.xlsx"


def wide_rows():
    names = list(SIGNALS)
    return [["Time", *names], *([t, *(float(SIGNALS[n][i]) for n in names)] for i, t in enumerate(STAMPS))]


def long_rows():
    return [["Tag", "Timestamp", "Value"], *([tag, t, float(v)] for tag, values in SIGNALS.items()
                                             for t, v in zip(STAMPS, values, strict=True))]


def pair_rows():
    """As historian add-ins write them: a pair of columns per tag, its name above."""
    head = [x for tag in SIGNALS for x in (tag, None)]
    body = [[x for values in SIGNALS.values() for x in (t, float(values[i]))] for i, t in enumerate(STAMPS)]
    return [head, ["Timestamp", "Value"] * len(SIGNALS), *body]


@pytest.mark.parametrize("rows", [wide_rows, long_rows, pair_rows])
def test_a_workbook_is_read_in_any_layout(tmp_path, rows):
    pytest.importorskip("python_calamine", reason="python-calamine is not installed: pip install 'backlash[excel]'")
    path = book(tmp_path, {"Notes": [["Exported by", "J. Doe"], ["at", "night"]], "Data": rows()})
    for source in (path, tmp_path, save(tmp_path, path.read_bytes())):  # under another name, too
        plant = read(source)
        assert [r.loop for r in plant] == ["FIC101", "PIC303"] and not plant.failures
        equals_the_recording(plant["FIC101"])
        assert plant["FIC101"].interval == 1.0


def test_a_workbook_without_a_table_says_so(tmp_path):
    pytest.importorskip("python_calamine", reason="python-calamine is not installed: pip install 'backlash[excel]'")
    with pytest.raises(InputError, match="no table"):
        read(book(tmp_path, {"Notes": []}))


def test_a_parquet_cut_off_within_a_folder_is_an_error_of_that_file(tmp_path):
    (tmp_path / "set").mkdir()
    for name in ("a", "b"):
        pq.write_table(arrow().rename_columns(["time", *(f"{name}{tag}" for tag in SIGNALS)]),
                       tmp_path / "set" / f"{name}.parquet")
    whole = (tmp_path / "set" / "b.parquet").read_bytes()
    (tmp_path / "set" / "b.parquet").write_bytes(whole[: len(whole) // 2])
    plant = read(tmp_path / "set")
    (lost,) = plant.failures
    assert str(lost.values["file"]).endswith("b.parquet") and "damaged Parquet" in lost.message
    assert {record.loop for record in plant} == {"aFIC101", "aPIC303"}


def test_a_time_that_stands_still_says_so(tmp_path):
    with pytest.raises(BacklashError, match="all 600 rows carry the same time stamp 2026-03-17 23:55:00"):
        read(save(tmp_path, wide(lambda t: iso(STAMPS[0]))))


def test_a_record_of_one_sample_is_too_short(tmp_path):
    with pytest.raises(BacklashError, match="only 1 sample: the record is too short"):
        read(save(tmp_path, "\n".join(wide().splitlines()[:2]) + "\n"))


def test_a_date_in_the_first_row_only_leaves_one_sample_and_says_why(tmp_path):
    text = wide(lambda t: f"{t:%Y-%m-%d,%H:%M:%S}" if t == STAMPS[0] else f",{t:%H:%M:%S}", time_name="Date,Time")
    with pytest.raises(BacklashError, match=f"only 1 sample.*{ROWS - 1} rows without a readable time stamp"):
        read(save(tmp_path, text))["FIC101"]


def test_a_folder_without_data_names_what_is_there(tmp_path):
    (tmp_path / "x").mkdir()
    with pytest.raises(InputError, match="it is empty"):
        read(tmp_path / "x")
    for name in ("trend.pdf", "notes.docx"):
        (tmp_path / "x" / name).write_bytes(b"x")
    with pytest.raises(InputError, match=r"found there: \.docx, \.pdf"):
        read(tmp_path / "x")


def test_a_byte_that_is_no_text_in_a_row_too_short_is_silent(tmp_path, capfd):
    lines = wide().encode().splitlines()
    lines[300] = b"what is \xff\xfe this,1"
    plant = read(save(tmp_path, b"\n".join(lines) + b"\n"))
    assert "ragged_rows" in codes(plant.warnings) and len(plant) == 2
    assert capfd.readouterr().err == ""


def test_stamps_in_a_wrong_unit_are_refused(tmp_path):
    """Spreadsheet days taken for milliseconds: 17 rows lie within each microsecond."""
    day = (STAMPS[0] - dt.datetime(1899, 12, 30)) / dt.timedelta(days=1)
    path = save(tmp_path, wide(lambda t: f"{day + (t - STAMPS[0]) / dt.timedelta(days=1):.9f}"))
    with pytest.raises(BacklashError, match="most rows repeat a time stamp"):
        read(path, options=ReadOptions(time_format="epoch_ms"))


def test_the_whole_file_tells_day_from_month_where_date_and_time_stand_apart(tmp_path):
    """The first 4000 rows are of one day; the others go on over midnight, from the third to the fourth of April."""
    stamps = np.datetime64("2026-04-03T09:00:00") + 10 * np.arange(9000)
    rows = [f"{str(t)[8:10]}/04/2026,{str(t)[11:]},0.5,0.{400 + k % 7},0.{300 + k % 5}" for k, t in enumerate(stamps)]
    record = read(save(tmp_path, "\n".join(["date,time,A.SP,A.PV,A.OP", *rows])))["A"]
    assert record.start == stamps[0].astype(int) and record.interval == 10.0 and len(record) == 9000


def test_a_date_at_midnight_beside_the_time_of_day(tmp_path):
    """As data bases write a date that stands in a column of its own."""
    path = save(tmp_path, wide(lambda t: t.strftime("%Y-%m-%d 00:00:00,%H:%M:%S"), time_name="Date,Time"))
    equals_the_recording(read(path)["FIC101"])


def test_a_workbook_may_have_date_and_time_of_day_in_two_columns(tmp_path):
    pytest.importorskip("python_calamine", reason="python-calamine is not installed: pip install 'backlash[excel]'")
    head, *body = wide_rows()
    rows = [["Date", "Time", *head[1:]], *([row[0].date(), row[0].time(), *row[1:]] for row in body)]
    equals_the_recording(read(book(tmp_path, {"Data": rows}))["FIC101"])


@pytest.mark.parametrize(("files", "said"), [
    ({"picture.png": b"\x89PNG"}, "holds no export"),
    ({}, "holds no export"),
    ({"day.csv": b"\x00" * (200 << 20)}, "holds no export|expand|binary"),
])
def test_a_zip_archive_without_an_export_says_so(tmp_path, files, said):
    with pytest.raises(InputError, match=said):
        read(save(tmp_path, packed(files), "plant.zip"))


def test_a_damaged_zip_archive_is_refused(tmp_path):
    whole = packed({"day.csv": wide()})
    middle = bytearray(whole)
    middle[2000:2004] = b"\xff\x00\xff\x00"
    for damaged in (whole[: len(whole) // 2], bytes(middle)):
        with pytest.raises(InputError, match="zip"):
            read(save(tmp_path, damaged, "plant.zip"))


def test_files_of_an_archive_that_cannot_be_read_are_failures_as_in_a_folder(tmp_path):
    archive = packed({"day.csv": wide(), "remarks.txt": "valve was greased\non Monday\n", "old/trend.xlsx": b"PK\3\4"})
    plant = read(save(tmp_path, archive, "plant.zip"))
    assert [r.loop for r in plant] == ["FIC101", "PIC303"]
    assert [note.message.split(": ")[1] for note in plant.failures] == ["remarks.txt", "old/trend.xlsx"]
    assert [note.values["file"] for note in plant.failures] == [
        f"{tmp_path}/plant.zip: {name}" for name in ("remarks.txt", "old/trend.xlsx")]


@pytest.mark.parametrize(("text", "options", "said"), [
    (wide(), {"decimal": ","}, r"',' is not the decimal sign of numbers such as \d+\.\d+ -> mend --decimal"),
    (wide(delimiter=";", value=lambda n, v: cell(n, v).replace(".", ",")), {"decimal": "."}, "'.' is not the decimal"),
    (wide(), {"columns": ("time", "SP", "PV", "OP")}, "--columns gives 4 names, the rows have"),
    (wide(), {"header_row": 9999}, "line 9999 cannot be the header"),
    (wide(value=lambda n, v: ""), {}, "the rows have times, and no column holds a number"),
    (wide(lambda t: f"{t:%d/%m/%Y %H:%M:%S}"), {"time_format": "mdy"}, "17/03/2026 23:55:00 .* be mdy"),
    (long(lambda n, t, v: f"{n},{t:%s}{'000' * (t > STAMPS[300])},{v}", "tag,time,value"), {}, "change their unit"),
])
def test_options_and_files_that_contradict_each_other_are_refused(tmp_path, text, options, said):
    with pytest.raises(BacklashError, match=said):
        read(save(tmp_path, text), options=ReadOptions(**options))


def test_rows_that_are_dropped_are_told_by_their_line_and_cause(tmp_path):
    text = wide()
    whole = read(save(tmp_path, text[: text.rindex("T00:04:5") + 8], "cut.csv"))  # so begins a whole row before, too
    assert "the first is line 601 (1 columns" in next(n.message for n in whole.warnings if n.code == "ragged_rows")
    head, *lines = text.splitlines()
    mixed = "\n".join([head, *lines * 6, *(line.replace(",", ";") for line in lines)])  # beyond what tells the form
    told = next(n.message for n in read(save(tmp_path, mixed, "mixed.csv")).warnings if n.code == "ragged_rows")
    assert "600 rows of " in told and "mixed.csv were dropped, from line 3602 on" in told and "separated by ';'" in told


def test_a_clock_of_12_hours_without_am_and_pm_is_told(tmp_path):
    plant = read(save(tmp_path, wide(lambda t: f"{t + timedelta(hours=13):%Y-%m-%d %I:%M:%S}")))
    assert "go back by 12 hours 1 times" in next(n.message for n in plant["FIC101"].notes if n.code == "unsorted")


def test_an_order_that_says_nothing_about_the_dates_is_told(tmp_path):
    for order, said in (("dmy", True), ("mdy", True), ("ymd", False), ("iso", False)):
        plant = read(save(tmp_path, wide()), options=ReadOptions(time_format=order))
        assert ("time_format" in codes(plant["FIC101"].notes)) is said
    slashed = wide(lambda t: f"{t:%d/%m/%Y %H:%M:%S}")
    plant = read(save(tmp_path, slashed), options=ReadOptions(time_format="dmy"))
    assert "time_format" not in codes(plant["FIC101"].notes)


def test_cells_with_an_error_of_excel_are_told(tmp_path):
    pytest.importorskip("python_calamine", reason="python-calamine is not installed: pip install 'backlash[excel]'")
    rows = wide_rows()
    for row in rows[50:400:70]:
        row[2] = "#REF!"
    record = read(book(tmp_path, {"Data": rows}))["FIC101"]
    assert [note.message for note in record.notes if note.code == "not_numbers"] == [
        "5 cells of FIC101.PV are no good numbers, or have an odd unit: #REF! (5)"]
    assert np.isfinite(record.measurement).sum() >= ROWS - 5 and len(record) == ROWS
    assert "compressed" not in codes(record.notes)
    assert "not_numbers" not in codes(read(book(tmp_path, {"Data": wide_rows()}))["FIC101"].notes)


def test_cells_with_an_error_that_excel_itself_writes_are_told(tmp_path):
    """As Excel keeps them: a cell of the kind "e", which the library reads as an empty one."""
    pytest.importorskip("python_calamine", reason="python-calamine is not installed: pip install 'backlash[excel]'")
    rows = wide_rows()
    for row in rows[50:400:70]:
        row[2] = "#N/A"
    path = book(tmp_path, {"Data": rows})
    with zipfile.ZipFile(path) as old:
        parts = {name: old.read(name) for name in old.namelist()}
    with zipfile.ZipFile(path, "w") as new:
        for name, text in parts.items():
            new.writestr(name, re.sub(rb'<c r="(C\d+)"[^>]*>(?:(?!</c>).)*#N/A(?:(?!</c>).)*</c>',
                                      rb'<c r="\1" t="e"><v>#N/A</v></c>', text))
    record = read(path)["FIC101"]
    assert [note.message for note in record.notes if note.code == "not_numbers"] == [
        "5 cells of FIC101.PV are no good numbers, or have an odd unit: #N/A (5)"]


def test_two_sheets_that_contradict_each_other_are_named(tmp_path):
    pytest.importorskip("python_calamine", reason="python-calamine is not installed: pip install 'backlash[excel]'")
    rows, others = wide_rows(), wide_rows()
    for row in others[1:]:
        row[2] = str(float(row[2]) * 1.1)
    (lost,) = read(book(tmp_path, {"Data": rows, "Copy": others})).failures
    assert re.search(r"FIC101.*plant\.xlsx: Data and .*plant\.xlsx: Copy\)", lost.message)


@pytest.mark.parametrize(("unit", "span"), [("mA", (4.0, 20.0)), ("psi", (3.0, 15.0))])
def test_a_column_of_units_that_is_called_unit_tells_the_span(tmp_path, unit, span):
    low, high = span
    rows = (f"{t},{tag},{low + (high - low) * v[i] / 100.0},{unit}" if tag.endswith("OP") else f"{t},{tag},{v[i]},m3/h"
            for i, t in enumerate(STAMPS) for tag, v in SIGNALS.items())
    path = save(tmp_path, "timestamp,tag,value,unit\n" + "\n".join(rows))
    (tmp_path / "loops.toml").unlink()
    record = read(path)["FIC101"]
    assert record.settings.op_range == span and "span_told" in codes(record.notes)


def test_an_hour_that_a_zone_skips_is_told(tmp_path):
    text = wide(lambda t: f"{t + timedelta(days=11, hours=2, minutes=4):%Y-%m-%d %H:%M:%S}")
    plant = read(save(tmp_path, text), options=ReadOptions(timezone="Europe/Berlin"))
    assert "540 rows lie in an hour that Europe/Berlin skips" in next(
        note.message for note in plant["FIC101"].notes if note.code == "dst_skipped_hour")


def test_lists_in_parquet_are_no_numbers(tmp_path):
    table = pa.table({"time": STAMPS, "F1.SP": [1.0] * ROWS, "F1.PV": [[1.0]] * ROWS, "F1.OP": [5.0] * ROWS})
    pq.write_table(table, tmp_path / "plant.parquet")
    with pytest.raises(BacklashError, match=r"600 cells of F1\.PV are no good numbers.*: list<element: double>"):
        read(tmp_path / "plant.parquet")


def test_ten_thousand_columns_of_no_loop_are_passed_over_soon(tmp_path):
    lines = wide().splitlines()[:50]
    text = "\n".join([lines[0] + "".join(f",X{k}" for k in range(10_000)), *(x + ",1" * 10_000 for x in lines[1:])])
    begun = time.perf_counter()
    assert len(read(save(tmp_path, text))) == 2
    assert time.perf_counter() - begun < 30.0  # far longer where a column is looked for among all others


@pytest.mark.parametrize(("text", "said"), [
    ("<!DOCTYPE html>\n<html><body>User</body></html>\n", "web page"),
    ("\ufeff<TABLE><tr><td>Time</td><td>FIC101.PV</td></tr></TABLE>\n", "table saved as one .HTML."),
    ("BM\x10\0\0\0\0\0\0\0\x36\0\0\0", "a picture"), ("GIF89a\x10\0", "a picture"),
    ("TDSm\x0e\0\0\0", "TDMS"), ("Rar!\x1a\x07\x01\0", "RAR archive.* unpack"),
    ('[{"tag": "FIC101.PV", "value": 1.0},\n{"tag": "FIC101.PV", "value": 2.0}]\n', "JSON"),
    ("ARROW1\x00\x00" + 500 * "\x00", "Arrow"),
])
def test_what_is_no_export_is_called_by_its_name(tmp_path, text, said):
    with pytest.raises(InputError, match=said):
        read(save(tmp_path, text))


def test_where_no_sample_is_good_the_quality_is_named(tmp_path):
    text = long(lambda n, t, v: f"{n},{iso(t)},{v},Bad", "tag,time,value,quality")
    with pytest.raises(BacklashError, match=r"600 samples of FIC101\.PV have bad quality.*--good-quality"):
        read(save(tmp_path, text))


def test_two_files_that_contradict_each_other_are_refused(tmp_path):
    first = save(tmp_path, wide(), "a.csv")
    second = save(tmp_path, wide(value=lambda tag, value: cell(tag, value * 1.2)), "b.csv")
    said = r"two files give different values for the same times, 600 rows, .*a\.csv and .*b\.csv\)"
    with pytest.raises(BacklashError, match=said):
        read([first, second])
    again = save(tmp_path, wide(), "c.csv")
    equals_the_recording(read([first, again])["FIC101"])


@pytest.mark.parametrize(("text", "said"), [
    ("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n",
     "pointer to a large file in Git LFS.*git lfs pull"),
    ("-- dump of hist.samples\nSET NAMES utf8mb4;\nCREATE TABLE `samples` (`ts` datetime);\n", "an SQL script"),
    ("From: shift@plant.example\nTo: control@plant.example\nSubject: Export\n\nHi, here it is.\n", "an e-mail"),
    ("L\0\0\0\x01\x14\x02\0\0\0\0\0", "a shortcut of Windows.*give the file that it points to"),
    ('{"error": "time range exceeds 10000 points"}', "JSON, perhaps the answer of a service"),
    (bytes([255]) * 100_000, "a file of bytes 255, .*export it again"),
    (b"\x04Anna" + b" " * 50 + b"\x04\0" + "Anna".ljust(54).encode("utf-16-le"), "the mark that Excel sets.*without ~"),
])
def test_what_is_no_export_is_called_what_it_is(tmp_path, text, said):
    with pytest.raises(InputError, match=said):
        read(save(tmp_path, text, "plant.csv"))


def test_text_of_a_mainframe_is_called_so_and_a_line_of_capitals_is_not(tmp_path):
    with pytest.raises(InputError, match=r"text of a mainframe \(EBCDIC\).*iconv"):
        read(save(tmp_path, wide().encode("cp037"), "a.csv"))
    equals_the_recording(read(save(tmp_path, "K%" * 400 + "\n\n" + wide(), "b.csv"))["FIC101"])


def test_lines_above_a_table_are_no_head_of_an_e_mail(tmp_path):
    equals_the_recording(read(save(tmp_path, "From: 17.03.2026 08:00\nTo: 18.03.2026 08:00\n\n" + wide()))["FIC101"])


@pytest.mark.parametrize(("stamp", "told"), [("{:%Y-%m-%dT%H:%M:%SZ}", True), ("{:%Y-%m-%d %H:%M:%S}", False)])
def test_a_time_zone_that_is_not_used_is_told(tmp_path, stamp, told):
    record = read(save(tmp_path, wide(stamp.format)), options=ReadOptions(timezone="Asia/Tokyo"))["FIC101"]
    assert ("timezone_unused" in [note.code for note in record.notes]) is told


@pytest.mark.parametrize("words", ["Raw,{}", "Raw, {}", "Interpolated|{}"])
def test_a_kind_of_value_may_stand_before_its_quality(tmp_path, words):
    def row(tag, stamp, value):
        good = tag != "FIC101.PV" or int((stamp - STAMPS[0]).total_seconds()) not in SPOILT
        return f"{tag};{iso(stamp)};{value if good else 0};{words.format('Good' if good else 'Bad')}"

    record = read(save(tmp_path, long(row, "tag;time;value;status")))["FIC101"]
    assert np.count_nonzero(record.state != SampleState.GOOD) == len(SPOILT) and (record.measurement > 0.3).all()


@pytest.mark.parametrize("called", [
    "FIC101.PV_is_good", "FIC101.PV Quality Code", "FIC101.PV.StatusCode", "FIC101.PV.Q"])
def test_a_quality_may_be_called_by_two_words(tmp_path, called):
    lines = [line.split(",") for line in wide().splitlines()]
    lines[0].append(called)
    for k, cells in enumerate(lines[1:]):
        cells[2] = "500.00" if k in SPOILT else cells[2]
        cells.append("0" if k in SPOILT else "192")
    record = read(save(tmp_path, "\n".join(map(",".join, lines)) + "\n"))["FIC101"]
    assert set(np.flatnonzero(record.state)) == set(SPOILT) and "bad_quality" in codes(record.notes)


@pytest.mark.parametrize("spoilt", ["16-Jul", "01. Jul", "500 High Limit", "1 State", "0.9 K"])
def test_words_behind_a_few_numbers_are_no_units(tmp_path, spoilt):
    """Spreadsheets turn 16.7 into a date, historians write states with a number before them."""
    lines = [line.split(",") for line in wide().splitlines()]
    for k in SPOILT:
        lines[1 + k][2] = spoilt
    record = read(save(tmp_path, "\n".join(map(",".join, lines)) + "\n"))["FIC101"]
    assert set(np.flatnonzero(record.state)) == set(SPOILT)
    assert any(note.code == "not_numbers" and f"{spoilt} ({len(SPOILT)})" in note.message for note in record.notes)


@pytest.mark.parametrize("count", [1, 5, 9, 12, 40, 150])
@pytest.mark.parametrize("value", ["0", "900"])
def test_a_run_at_the_end_of_the_range_is_no_measurement(tmp_path, count, value):
    """The steps into and out of it are none of the signal's noise. A few samples at the top may be real."""
    lines = [line.split(",") for line in wide().splitlines()]
    for k in range(200, 200 + count):
        lines[1 + k][2] = value
    record = read(save(tmp_path, "\n".join(map(",".join, lines)) + "\n"))["FIC101"]
    assert bool(record.state[200:200 + count].all()) == (value == "0" or count > 10)


def test_a_flag_of_automatic_is_a_mode(tmp_path):
    lines = [line.split(",") for line in wide().splitlines()]
    lines[0] += ["FIC101.AUTO"]
    for k, cells in enumerate(lines[1:]):
        cells.append("FALSE" if k in SPOILT else "TRUE")
    record = read(save(tmp_path, "\n".join(map(",".join, lines)) + "\n"))["FIC101"]
    assert set(np.flatnonzero(record.state == SampleState.MANUAL)) == set(SPOILT)


def test_values_that_are_good_for_no_part_of_their_time_are_not_used(tmp_path):
    def row(tag, stamp, value):
        return f"{tag},{iso(stamp)},{value},{0 if tag == 'FIC101.PV' else 100}"

    plant = read(save(tmp_path, long(row, "Tag,Time,Value,PercentGood")))
    assert [r.loop for r in plant] == ["PIC303"]
    assert "600 samples of FIC101.PV have bad quality" in plant.failures[0].message


def test_a_quality_of_zero_everywhere_is_told(tmp_path):
    text = long(lambda tag, stamp, value: f"{tag},{iso(stamp)},{value},0", "Tag,Time,Value,Quality")
    record = read(save(tmp_path, text))["FIC101"]
    assert record.usable.all() and "quality_one" in codes(record.notes)


def test_an_output_that_may_be_a_current_limits_the_verdict(tmp_path):
    path = save(tmp_path, wide(value=lambda n, v: f"{4.0 + 0.16 * v:.4f}" if n.endswith("OP") else cell(n, v)))
    (tmp_path / "loops.toml").write_text(SETTINGS.replace("op_range = [0, 100]", ""), encoding="utf-8")
    note, = (note for note in read(path)["FIC101"].notes if note.code == "op_percent")
    assert note.values["effect"] == "limits" and "op_range = [4, 20]" in note.message


def test_a_guessed_range_of_the_output_limits_the_verdict(tmp_path):
    path = save(tmp_path, wide(value=lambda n, v: f"{320.0 * v:.0f}" if n.endswith("OP") else cell(n, v)))
    (tmp_path / "loops.toml").write_text("", encoding="utf-8")
    note, = (note for note in read(path)["FIC101"].notes if note.code == "guessed_op_range")
    assert note.values["effect"] == "limits" and "give op_range" in note.message


@pytest.mark.parametrize(("name", "auto", "manual"), [("BA", "A", "H"), ("A/H", "A", "H"), ("Mod", "OTO", "MANUEL")])
def test_modes_as_plants_call_them(tmp_path, name, auto, manual):
    head, *rows = wide().splitlines()
    lines = [f"{head},FIC101.{name}", *(f"{row},{manual if i < 100 else auto}" for i, row in enumerate(rows))]
    record = read(save(tmp_path, "\n".join(lines) + "\n"))["FIC101"]
    assert np.count_nonzero(record.state == SampleState.MANUAL) == 100


def test_settings_of_one_spelling_are_not_those_of_another_loop(tmp_path):
    path = save(tmp_path, wide(name=lambda n: n.replace("PIC303", "FIC-101")))
    (tmp_path / "loops.toml").write_text("[loops.FIC101]\nK = 0.9\nTi = 20.0\npv_range = [0, 900]\n", encoding="utf-8")
    plant = read(path)
    assert plant["FIC101"].settings.K == 0.9 and plant["FIC-101"].settings.K is None
    assert "not_in_metadata" in codes(plant["FIC-101"].notes)


@pytest.mark.parametrize("form", ["epoch_s", "excel"])
def test_numbers_asked_for_where_texts_stand_are_refused(tmp_path, form):
    german = wide(lambda t: f"{t:%d.%m.%Y %H:%M:%S}")
    for text, words in ((wide(), "holds dates, no numbers"), (german, "17.03.2026 23")):
        with pytest.raises(BacklashError, match=words):
            read(save(tmp_path, text), options=ReadOptions(time_format=form))


@pytest.mark.parametrize(("name", "factor", "given", "span", "code"), [
    ("OP [mA]", 0.16, "", (4.0, 20.0), "span_told"), ("OP [mA]", 0.16, "op_range = [0, 20]", (0.0, 20.0), ""),
    ("OP [mA]", 0.16, "op_range = [0, 100]", (0.0, 100.0), "op_milliamps"), ("OP", 0.01, "", (0.0, 1.0), "op_share"),
    ("OP", 9.0, "op_range = [0, 100]", (0.0, 100.0), "op_outside"),
    ("OP", 0.01, "op_range = [0, 100]", (0.0, 100.0), "op_tiny"), ("OP", 0.01, "op_range = [0, 1]", (0.0, 1.0), "")])
def test_an_output_in_another_unit_is_taken_for_what_it_is_or_told(tmp_path, name, factor, given, span, code):
    text = wide(name=lambda n: n.replace("OP", name),
                value=lambda n, v: f"{4.0 * (factor == 0.16) + factor * v:.4f}" if n.endswith("OP") else cell(n, v))
    path = save(tmp_path, text)
    (tmp_path / "loops.toml").write_text(SETTINGS.replace("op_range = [0, 100]", given), encoding="utf-8")
    record = read(path)["FIC101"]
    assert record.settings.op_range == span
    assert {note.code for note in record.notes if note.code.startswith(("op_", "span_"))} == {code} - {""}


@pytest.mark.parametrize(("above", "factor", "zero", "span"), [
    (["Unit,m3/h,m3/h,mA,,"], 0.16, 4.0, (4.0, 20.0)), ([",m3/h,m3/h,psi,,"], 0.12, 3.0, (3.0, 15.0)),
    (["Range,0-900,0-900,0..10,,"], 0.1, 0.0, (0.0, 10.0)), (["EU,,,V (0-10),,"], 0.1, 0.0, (0.0, 10.0)),
    (["Low,0,0,0,,", "High,900,900,27648,,"], 276.48, 0.0, (0.0, 27648.0)), ([",bar,bar,%,,"], 1.0, 0.0, (0.0, 100.0)),
    (["Range,0-900,0-900,200-300,,"], 1.0, 0.0, (0.0, 100.0))])  # far from the values: no range of theirs
def test_lines_above_tell_the_unit_or_the_range_of_an_output(tmp_path, above, factor, zero, span):
    text = wide(value=lambda n, v: f"{zero + factor * v:.4f}" if n.endswith("OP") else cell(n, v))
    width = text.split("\n")[0].count(",")
    header, *rows = text.split("\n")
    lines = [line.rstrip(",") + "," * (width - line.rstrip(",").count(",")) for line in above]
    path = save(tmp_path, "\n".join([header, *lines, *rows]))
    (tmp_path / "loops.toml").unlink()
    record = read(path)["FIC101"]
    assert record.settings.op_range == span
    assert record.settings.pv_range == ((0.0, 900.0) if "900" in "".join(above) else record.settings.pv_range)
    np.testing.assert_allclose(record.output * 100.0, SIGNALS["FIC101.OP"], atol=0.06)


def test_a_column_of_units_tells_the_span_of_an_output(tmp_path):
    def row(tag, stamp, value):
        is_op = tag.endswith("OP")
        return f"{tag},{iso(stamp)},{4.0 + 0.16 * float(value) if is_op else value},{'mA' if is_op else 'bar'}"

    path = save(tmp_path, long(row, "tag,time,value,Units"))
    (tmp_path / "loops.toml").unlink()
    record = read(path)["FIC101"]
    assert record.settings.op_range == (4.0, 20.0) and record.settings.pv_range != (0.2, 1.0)
    np.testing.assert_allclose(record.output * 100.0, SIGNALS["FIC101.OP"], atol=1e-6)


def test_names_of_devices_make_one_loop_where_each_signal_stands_once(tmp_path):
    devices = {"FIC101.PV": "FT101.PV", "FIC101.OP": "FV101.OP"}
    plant = read(save(tmp_path, wide(name=lambda n: devices.get(n, n))))
    assert "FIC101" in [record.loop for record in plant] and not {"FT101", "FV101"} & {r.loop for r in plant}
    equals_the_recording(plant["FIC101"])
    twice = wide(name=lambda n: {**devices, "PIC303.PV": "FFT101.PV"}.get(n, n))  # whose measurement is it?
    (tmp_path / "twice").mkdir()
    with pytest.raises(BacklashError, match=r"FIC101: no measurement"):
        read(save(tmp_path / "twice", twice))


@pytest.mark.parametrize(("name", "loop", "role"), [
    ("FIC101.SP Setpoint", "FIC101", "sp"), ("FIC101.PV Process value", "FIC101", "pv"),
    ("FIC101_OP_输出", "FIC101", "op")])
def test_a_signal_that_is_named_twice_is_one(name, loop, role):
    tag = split_tag(name)
    assert (tag.loop, tag.role) == (loop, role)


def test_codes_in_hexadecimal_with_their_words_are_qualities(tmp_path):
    def row(tag, stamp, value):
        bad = tag == "FIC101.PV" and int((stamp - STAMPS[0]).total_seconds()) in SPOILT
        return f"{tag};{iso(stamp)};{'0' if bad else value};" + (
            "0x00000018 (Bad, Comm Failure)" if bad else "0x000000C0 (Good)")

    plant = read(save(tmp_path, long(row, "ItemID;Timestamp;Value;Quality")))
    assert np.count_nonzero(np.isnan(plant["FIC101"].measurement)) + np.count_nonzero(
        plant["FIC101"].state == SampleState.FILLED) == len(SPOILT)
    assert "quality_one" not in codes(plant["PIC303"].notes)


def test_the_offset_of_a_stamp_holds_whatever_zone_is_named(tmp_path):
    """Every second stamp in UTC with its offset, the others as the clock in Berlin showed them."""
    berlin, stamps = ZoneInfo("Europe/Berlin"), iter(range(10**6))

    def mixed(stamp):
        aware = stamp.replace(tzinfo=dt.UTC)
        return f"{aware:%Y-%m-%dT%H:%M:%SZ}" if next(stamps) % 2 else f"{aware.astimezone(berlin):%Y-%m-%dT%H:%M:%S}"

    record = read(save(tmp_path, wide(mixed)), options=ReadOptions(timezone="Europe/Berlin"))["FIC101"]
    assert record.start == STAMPS[0].replace(tzinfo=dt.UTC).timestamp() and len(record) == ROWS
    assert "mixed_zones" in codes(record.notes)
    equals_the_recording(record)
    stamps = iter(range(10**6))
    slashed = re.sub(r"(?m)^(\d+)-(\d+)-(\d+)T", r"\3/\2/\1 ", wide(mixed))  # dates that are open at first
    again = read(save(tmp_path, slashed, "other.csv"), options=ReadOptions(timezone="Europe/Berlin"))["FIC101"]
    assert again.start == record.start
    equals_the_recording(again)


@pytest.mark.parametrize(("zones", "said"), [(("+01:00", "+01:00"), False), (("+01:00", ""), True), (("", ""), False)])
def test_an_offset_behind_the_time_of_day_is_told_from_none(tmp_path, zones, said):
    rows = (f"{t:%Y-%m-%d},{t:%H:%M:%S}{zones[k % 2]},450,{450 + k % 7},40" for k, t in enumerate(STAMPS))
    record = read(save(tmp_path, "date,time,FIC101.SP,FIC101.PV,FIC101.OP\n" + "\n".join(rows)))["FIC101"]
    assert ("mixed_zones" in codes(record.notes)) is said


@pytest.mark.parametrize("form", ["%Y-%m-%d", "%d/%m/%Y", "%Y%m%d"])
def test_a_time_of_day_keeps_its_own_offset_beside_a_zone(tmp_path, form):
    """Every second row carries +03:00, the others are of Berlin in winter."""
    rows = []
    for k, stamp in enumerate(STAMPS):
        local = stamp + timedelta(hours=3 if k % 2 else 1)
        rows.append(f"{local.strftime(form)},{local:%H:%M:%S}{'+03:00' * (k % 2)},450,{SIGNALS['FIC101.PV'][k]},40")
    path = save(tmp_path, "date,time,FIC101.SP,FIC101.PV,FIC101.OP\n" + "\n".join(rows))
    record = read(path, options=ReadOptions(timezone="Europe/Berlin"))["FIC101"]
    assert record.start == STAMPS[0].replace(tzinfo=dt.UTC).timestamp() and record.interval == 1.0
    equals_the_recording(record)


def test_zero_bytes_that_were_never_written_are_told_and_the_rest_is_read(tmp_path):
    whole = wide().encode()
    middle, size = len(whole) // 2, len(whole)
    for begin, end in ((middle, size), (middle, middle + 3000), (size - 900, size)):
        path = save(tmp_path, whole[:begin] + bytes(end - begin) + whole[end:])
        plant = read(path)
        (told,) = (note for note in plant.warnings if note.code == "truncated")
        assert "zero bytes" in told.message and path.name in told.message
        record = plant["FIC101"]
        known = np.isfinite(record.measurement)
        assert begin / len(whole) * ROWS - 60 < known.sum() < ROWS
        wanted = np.asarray(SIGNALS["FIC101.PV"])[record.index[known]]
        np.testing.assert_allclose(record.measurement[known] * 900.0, wanted, atol=1e-3)
    with pytest.raises(InputError, match="binary"):
        read(save(tmp_path, bytes(5000), "zeros.csv"))


def test_dates_that_change_their_order_are_refused(tmp_path):
    day = dt.datetime(2026, 3, 31, 23, 58)

    def turned(stamp):
        stamp = day + (stamp - STAMPS[0])
        return f"{stamp:%d/%m/%Y %H:%M:%S}" if stamp.day > 12 else f"{stamp:%m/%d/%Y %H:%M:%S}"

    text = wide(turned)
    with pytest.raises(InputError, match=r"after 2026-03-31 they do not go on, read as dmy.*--time-format"):
        read(save(tmp_path, text))
    assert len(read(save(tmp_path, text), options=ReadOptions(time_format="dmy"))) == 2


def test_tags_below_the_channels_of_a_recorder_name_its_signals(tmp_path):
    tags = [f"FIC101.{signal}" for signal in ("PV", "SP", "OP")]
    text = f"Model,GX20\nDate,Time,Sec,CH0001,CH0002,CH0003\n,,,{','.join(tags)}\n,,,m3/h,m3/h,%\n"
    text += "".join(f"{stamp:%Y/%m/%d,%H:%M:%S},0.0,{','.join(cell(tag, SIGNALS[tag][i]) for tag in tags)}\n"
                    for i, stamp in enumerate(STAMPS))
    plant = read(save(tmp_path, text))
    assert [record.loop for record in plant] == ["FIC101"] and plant["FIC101"].output is not None
    equals_the_recording(plant["FIC101"])


@pytest.mark.parametrize("written", ["{:.2f}-", "({:.2f})", "{:.2f} -", "\u2212{:.2f}"])
def test_a_minus_may_stand_behind_its_number_or_be_a_printed_one(tmp_path, written):
    def value(tag, v):
        v -= 405.0 * (tag == "FIC101.PV")
        return written.format(-v) if v < 0.0 else cell(tag, v)

    record = read(save(tmp_path, wide(value=value)))["FIC101"]
    np.testing.assert_allclose(record.measurement * 900.0 + 405.0, SIGNALS["FIC101.PV"], atol=0.006)


def test_a_word_behind_half_of_the_numbers_is_no_unit(tmp_path):
    lines = [line.split(",") for line in wide().splitlines()]
    for k in range(1, len(lines), 2):
        lines[k][2] += " B"
    record = read(save(tmp_path, "\n".join(map(",".join, lines)) + "\n"))["FIC101"]
    assert np.count_nonzero(record.state) == ROWS // 2 and "not_numbers" in codes(record.notes)


def with_column(name, of_row):
    """A wide export with one more column, right of FIC101.OP."""
    lines = [line.split(",") for line in wide().splitlines()]
    cells = ([*row[:4], of_row(k - 1) if k else name, *row[4:]] for k, row in enumerate(lines))
    return "\n".join(map(",".join, cells)) + "\n"


@pytest.mark.parametrize(("name", "bad", "good"), [
    ("FIC101.BADPV", "1", "0"), ("FIC101.PV.IsBad", "TRUE", "FALSE"), ("FIC101.Quality", "Bad", "Good"),
    ("FIC101.PV_STS", "0", "192"), ("FIC101.BADPV", "ON", "OFF"), ("FIC101.PV.BadPV", "Yes", "No"),
    ("FIC101.BADPVFL", "TRUE", "FALSE"), ("FIC101.PV_Bad", "WAHR", "FALSCH"), ("FIC101.PV质量", "坏", "好")])
def test_a_mark_of_the_loop_is_one_of_its_measurement(tmp_path, name, bad, good):
    record = read(save(tmp_path, with_column(name, lambda k: bad if k in SPOILT else good)))["FIC101"]
    assert set(np.flatnonzero(record.state)) == set(SPOILT) and "bad_quality" in codes(record.notes)


@pytest.mark.parametrize(("name", "manual", "auto", "code"), [
    ("FIC101.MAN", "TRUE", "FALSE", ""), ("FIC101.Manual", "1", "0", ""), ("FIC101.STATUS", "MANUAL", "AUTO", ""),
    ("FIC101.MODE", "0", "1", "mode_numbers"), ("FIC101.MAN", "MAN", "AUTO", ""),
    ("FIC101.MODE", "NR,MAN", "NR,AUT", ""), ("FIC101.MODE", "P-MAN", "P-AUTO", ""),
    ("FIC101.MODE", "7ZQ", "AUTO", "mode_words"), ("FIC101.AUTO", "f", "t", ""), ("FIC101.AUTO", "N", "Y", ""),
    ("FIC101.Auto", "FALSCH", "WAHR", ""), ("FIC101.Auto", "FAUX", "VRAI", ""), ("FIC101.Manual", "Yes", "No", ""),
    ("FIC101.Hand", "Ja", "Nein", ""), ("FIC101.Automatik", "Nein", "Ja", ""),
    ("FIC101.AUTO", "disabled", "enabled", "")])
def test_modes_are_known_by_name_and_by_their_words(tmp_path, name, manual, auto, code):
    text = with_column(name, lambda k: f'"{manual if k in range(100, 300) else auto}"')
    record = read(save(tmp_path, text))["FIC101"]
    assert set(np.flatnonzero(record.state == SampleState.MANUAL)) == set(range(100, 300))
    assert {c for c in codes(record.notes) if c.startswith("mode")} == {code} - {""}


@pytest.mark.parametrize(("target", "actual", "other"), [
    ("FIC101.MODE.TARGET", "FIC101.MODE.ACTUAL", "AUTO"), ("FIC101_MODE_TARGET", "FIC101_MODE_ACTUAL", "CAS")])
def test_of_two_modes_the_actual_one_counts(tmp_path, target, actual, other):
    """Both were put together, and the first column of a row won."""
    modes = with_column(f"{target},{actual}", lambda k: f"{other},{'MAN' if k in range(100, 300) else other}")
    record = read(save(tmp_path, modes))["FIC101"]
    assert set(np.flatnonzero(record.state == SampleState.MANUAL)) == set(range(100, 300))
    assert "several_columns" in codes(record.notes)


def test_channels_before_tags_are_no_part_of_them(tmp_path):
    first, *rows = wide(delimiter="\t").splitlines()
    names = [name if not k else f"[0:{k}] {name}" for k, name in enumerate(first.split("\t"))]
    equals_the_recording(read(save(tmp_path, "\n".join(["\t".join(names), *rows])))["FIC101"])


def test_the_output_in_manual_is_no_mode(tmp_path):
    record = read(save(tmp_path, with_column("FIC101.MAN", lambda k: f"{40 + k % 7}.5")))["FIC101"]
    assert record.usable.all() and "mode_empty" in codes(record.notes)


def test_three_digits_behind_every_comma_are_decimals_also_between_commas(tmp_path):
    text = wide(value=lambda n, v: f'"{v:.3f}"'.replace(".", ","))
    equals_the_recording(read(save(tmp_path, text))["FIC101"])


@pytest.mark.parametrize("delimiter", [",", ";"])
def test_two_commas_in_a_number_stand_between_thousands(tmp_path, delimiter):
    text = wide(delimiter=delimiter, value=lambda n, v: f'"{1e4 * v:,.0f}"')
    (tmp_path / "plant.csv").write_text(text, encoding="utf-8")
    record = read(tmp_path / "plant.csv")["FIC101"]
    low, high = record.settings.pv_range
    np.testing.assert_allclose(low + record.measurement * (high - low), 1e4 * SIGNALS["FIC101.PV"], atol=0.51)


def test_numbers_as_in_india_and_quotes_behind_a_blank_are_read(tmp_path):
    def indian(n, v):
        whole = round(2e5 + 1e3 * v)
        return f'"{whole // 100_000},{whole // 1000 % 100:02d},{whole % 1000:03d}.0"'

    (tmp_path / "india.csv").write_text(wide(value=indian))
    record = read(tmp_path / "india.csv")["FIC101"]
    low, high = record.settings.pv_range
    wanted = np.round(2e5 + 1e3 * SIGNALS["FIC101.PV"])
    np.testing.assert_allclose(low + record.measurement * (high - low), wanted, atol=0.51)
    quoted = "\n".join(", ".join(f'"{cell}"' for cell in line.split(",")) for line in wide().splitlines())
    equals_the_recording(read(save(tmp_path, quoted))["FIC101"])


def test_times_in_an_unknown_unit_are_refused_or_told(tmp_path):
    days = wide(lambda t: f"{(t - STAMPS[0]).total_seconds() / 86400:.9f}", time_name="Time")
    with pytest.raises(BacklashError, match="--time-format minutes, hours, days"):
        read(save(tmp_path, days))["FIC101"]
    record = read(tmp_path / "plant.csv", options=ReadOptions(time_format="days"))["FIC101"]
    assert record.interval == pytest.approx(1.0, rel=1e-3)
    counted = read(save(tmp_path, wide(lambda t: f"{(t - STAMPS[0]).total_seconds():.0f}", time_name="Sample")))
    assert any("are taken as seconds" in note.message for record in counted for note in record.notes)


@pytest.mark.parametrize(("name", "east"), [("Timestamp (UTC+01:00)", 1.0), ("Time [GMT-5]", -5.0), ("Time UTC", 0.0),
                                            ("Zeit (MESZ)", 2.0), ("Timestamp CDT", -5.0), ("TIME", 0.0),
    ("Timestamp (America/New_York)", -4.0), ("Zeit [Europe/Berlin]", 1.0), ("Start Date/Time", 0.0)])
def test_the_name_of_the_times_may_tell_their_zone(tmp_path, name, east):
    record = read(save(tmp_path, wide(time_name=name)))["FIC101"]
    assert record.start == STAMPS[0].replace(tzinfo=dt.UTC).timestamp() - 3600.0 * east


def test_measurements_of_a_laboratory_begin_behind_their_head(tmp_path):
    head = ("LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\t\nChannels\t6\nX_Dimension" + "\tTime" * 6
            + "\nX0" + "\t0.0" * 6 + "\nDelta_X" + "\t1.0" * 6 + "\n***End_of_Header***\n")
    text = wide(lambda t: f"{(t - STAMPS[0]).total_seconds():.6f}", delimiter="\t", time_name="X_Value", before=head,
                tail="\t")
    equals_the_recording(read(save(tmp_path, text, "plant.txt"))["FIC101"])


def test_a_tar_archive_is_called_so(tmp_path):
    held = io.BytesIO()
    with tarfile.open(fileobj=held, mode="w") as archive:
        for name in ("a.csv", "b.csv"):
            entry = tarfile.TarInfo(name)
            entry.size = len(wide().encode())
            archive.addfile(entry, io.BytesIO(wide().encode()))
    for name, packed_as in (("plant.csv", bytes), ("plant.csv.gz", gzip.compress)):
        with pytest.raises(InputError, match="tar archive"):
            read(save(tmp_path, packed_as(held.getvalue()), name))


@pytest.mark.parametrize(("sp", "op"), [("RSP", "OP"), ("TargetSP", "WorkingOP")])
def test_rarer_names_of_signals_are_known(tmp_path, sp, op):
    record = read(save(tmp_path, wide(name=lambda n: n.replace("SP", sp).replace("OP", op))))["FIC101"]
    assert np.isfinite(record.setpoint).all() and record.output is not None


def numbered(text: str, *, newest_first: bool = False) -> str:
    """Give every row of a table its number, below "#"."""
    head, *rows = text.splitlines()
    rows = rows[::-1] if newest_first else rows
    return "\n".join([f"#,{head}", *(f"{k},{row}" for k, row in enumerate(rows, 1))]) + "\n"


@pytest.mark.parametrize("newest_first", [False, True])
@pytest.mark.parametrize("factor", [1, 1000])
def test_times_counted_since_1970_need_no_name_that_is_known(tmp_path, factor, newest_first):
    text = wide(lambda t: f"{factor * t.replace(tzinfo=dt.UTC).timestamp():.0f}", time_name="Klukkan")
    equals_the_recording(read(save(tmp_path, numbered(text, newest_first=newest_first)))["FIC101"])


def test_a_header_that_begins_with_a_hash_over_row_numbers_is_no_comment(tmp_path):
    head, *rows = numbered(wide()).splitlines()
    below = ",," + ",".join(f"{name.replace('.', ' ')} of unit 3" for name in SIGNALS)
    equals_the_recording(read(save(tmp_path, "\n".join([head, below, *rows]) + "\n"))["FIC101"])


def test_descriptions_below_tags_are_no_header(tmp_path):
    words = {"SP": "setpoint", "PV": "measured value", "OP": "output"}
    below = "," + ",".join(f"{'Feed water' if name < 'G' else 'Steam'} {words[name[7:]]}" for name in SIGNALS)
    head, *rows = wide(time_name="Klukkan").splitlines()
    equals_the_recording(read(save(tmp_path, "\n".join([head, below, *rows]) + "\n"))["FIC101"])


def test_two_sources_of_one_tag_in_turn_are_refused(tmp_path):
    rows = [f"{name},{iso(stamp)},{value:.3f}" for name, values in SIGNALS.items()
            for stamp, first in zip(STAMPS, values, strict=True) for value in (first, 1.7 * first)]
    with pytest.raises(BacklashError, match=r"of two sources of a tag, or .* one below the other, leave one out"):
        read(save(tmp_path, "tag,time,value\n" + "\n".join(rows) + "\n"))["FIC101"]


@pytest.mark.parametrize(("header", "value"), [("序号,位号,时间,数值,质量", "{k},{tag},{t},{v},好"),
                                               ("n,Tag,Time,Quantity", "{k},{tag},{t},{v}"),
                                               ("Tag,Time,Raw,Eng", "{tag},{t},12345,{v}")])
def test_the_values_of_rows_are_no_row_numbers_and_no_raw_counts(tmp_path, header, value):
    rows = [value.format(k=k, tag=name, t=iso(stamp), v=cell(name, v))
            for k, (stamp, name, v) in enumerate(((t, n, v) for n, values in SIGNALS.items()
                                                  for t, v in zip(STAMPS, values, strict=True)), 1)]
    equals_the_recording(read(save(tmp_path, "\n".join([header, *rows]) + "\n"))["FIC101"])


def test_of_two_unknown_columns_of_numbers_none_is_taken_for_the_values(tmp_path):
    text = "Tag,Time,Rounded,Exact\n" + "".join(f"{name},{iso(stamp)},{v:.0f},{v}\n" for name, values in SIGNALS.items()
                                               for stamp, v in zip(STAMPS, values, strict=True))
    with pytest.raises(InputError, match="Rounded, Exact"):
        read(save(tmp_path, text))


@pytest.mark.parametrize("more", ["", ",FIC300.MODE"])
def test_the_table_of_another_loop_below_is_read(tmp_path, more):
    head, *rows = wide().splitlines()
    other = [head.replace("FIC101", "FIC300").replace("PIC303", "PIC300") + more,
             *(row.replace("2026-03-1", "2026-04-1") + ",AUTO" * bool(more) for row in rows)]
    plant = read(save(tmp_path, "\n".join([head, *rows, *other[: 300 if more else None]]) + "\n"))
    assert {record.loop: len(record) for record in plant} == {
        "FIC101": 600, "PIC303": 600, "FIC300": 299 if more else 600, "PIC300": 299 if more else 600}
    equals_the_recording(plant["FIC101"])


@pytest.mark.parametrize("form", ["%y%m%d%H%M%S", "%d%m%Y%H%M%S", "%d%m%y%H%M"])
def test_digits_of_dates_are_no_times_since_1970(tmp_path, form):
    with pytest.raises(BacklashError, match="--time-format"):
        read(save(tmp_path, wide(lambda t: (t + (t - STAMPS[0]) * 59 * form.endswith("M")).strftime(form),
                                 time_name="Time")))["FIC101"]


@pytest.mark.parametrize("options", [{}, {"time_format": "%Y%m%d%H%M%S%f"}])
def test_digits_of_dates_with_the_millisecond_are_read_to_the_last_one(tmp_path, options):
    text = wide(lambda t: (t + timedelta(milliseconds=125)).strftime("%Y%m%d%H%M%S%f")[:-3], time_name="TIMESTAMP")
    record = read(save(tmp_path, text), options=ReadOptions(**options))["FIC101"]
    equals_the_recording(record)
    assert record.start % 1.0 == 0.125 and record.interval == 1.0


@pytest.mark.parametrize("mark", [";", ",", "|", "\t"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_blank_cells_behind_the_last_column_are_none(tmp_path, mark, line_end):
    """A row that has more cells than names because its last ones are blank is whole; one with words there is not."""
    head, *rows = wide(delimiter=mark).splitlines()
    rows = [row + mark * (k % 4) + " " * (k % 2) + "remark" * (k == 303) for k, row in enumerate(rows)]
    plant = read(save(tmp_path, line_end.join([head, *rows]) + line_end))
    assert np.flatnonzero(plant["FIC101"].state != SampleState.GOOD).tolist() == [303]
    found, wanted = plant["FIC101"].measurement * 900.0, SIGNALS["FIC101.PV"]
    np.testing.assert_allclose(np.delete(found, 303), np.delete(wanted, 303), atol=1e-3)
    assert [note.values["rows"] for note in plant.warnings if note.code == "ragged_rows"] == [1.0]


def test_long_runs_of_blanks_between_cells_take_no_time(tmp_path):
    """A remark far to the right, between blanks, is one row too long, and not looked at in every possible way."""
    head, *rows = wide(lambda t: f"{t:%Y-%m-%dT%H:%M:%S}", delimiter=" ").splitlines()
    rows[300] += " " * 400 + "remark"
    began = time.perf_counter()
    plant = read(save(tmp_path, "\n".join([head, *rows]) + "\n"))
    assert time.perf_counter() - began < 10.0
    assert np.flatnonzero(plant["FIC101"].state != SampleState.GOOD).tolist() == [300]


def test_a_state_that_stands_alone_is_the_value(tmp_path):
    """Home automation calls the value so, and writes words where it has none."""
    text = long(lambda tag, stamp, value: f"{tag},{'unknown' if stamp == STAMPS[7] else value},{iso(stamp)}.000Z",
                "entity_id,state,last_changed")
    record = read(save(tmp_path, text))["FIC101"]
    assert np.flatnonzero(record.state != SampleState.GOOD).tolist() == [7] and "not_numbers" in codes(record.notes)


@pytest.mark.parametrize(("zone", "hours"), [("Europe/Berlin", -1), ("UTC+02:00", -2), ("-05:00", 5), ("CET", -1),
                                             ("W. Europe Standard Time", -1), ("(UTC+03:00) Moscow", -3)])
@pytest.mark.parametrize("place", ["above", "apart", "column"])
def test_a_zone_beside_the_stamps_is_that_of_the_stamps(tmp_path, zone, hours, place):
    head, *rows = wide(time_name="Date,Time" if place == "apart" else "Time").splitlines()
    rows = [row.replace("T", "," if place == "apart" else " ", 1) for row in rows]
    lines = [f"Time zone: {zone}", head, *rows] if place == "above" else [
        f"{head},Time Zone", *(f"{row},{zone}" for row in rows)]
    for timezone, east in ((None, hours), ("Asia/Tokyo", -9)):  # what the user says counts more
        record = read(save(tmp_path, "\n".join(lines) + "\n"), options=ReadOptions(timezone=timezone))["FIC101"]
        equals_the_recording(record)
        assert record.start == STAMPS[0].replace(tzinfo=dt.UTC).timestamp() + 3600.0 * east


@pytest.mark.parametrize(("line", "name", "hours"), [
    ("Time zone: (UTC+01:00) Amsterdam, Berlin", "Time", -1), ("Часовой пояс: UTC+3", "Time", -3),
    ("时区: UTC+8", "Time", -8), ("All times are UTC+3", "Time", -3),
    ("All times in local time (Europe/Berlin)", "Time", -1),
    ("Exported by Anna", "Time_MSK", -3), ("Exported by Anna", "Время (МСК)", -3), ("导出", "北京时间", -8),
    ("Exported by Anna", "TimeStamp(+0300)", -3), ("Exported by Anna", "Time (Eastern Standard Time)", 4),
    ("Export time: 2026-03-17 07:53:20 UTC+5", "Time", 0), ("Time zone: UTC+3", "Time (UTC+1)", -1)])
def test_a_zone_is_told_by_a_line_above_or_the_name_of_the_stamps(tmp_path, line, name, hours):
    plant = read(save(tmp_path, f"{line}\n{wide(time_name=name)}"))
    equals_the_recording(plant["FIC101"])
    assert plant["FIC101"].start == STAMPS[0].replace(tzinfo=dt.UTC).timestamp() + 3600.0 * hours
    assert "zone_unknown" not in codes(plant.warnings)


@pytest.mark.parametrize(("line", "name", "told"), [
    ("Time zone: CET", "Date (y-m-d)", False), ("Time zone:", "Time", False), ("Time zone: of the plant", "Time", True),
    ("UTC offset (min): 180", "Time", True)])
def test_a_zone_that_is_not_understood_does_no_harm_and_is_told(tmp_path, line, name, told):
    plant = read(save(tmp_path, f"{line}\n{wide(time_name=name)}"))
    equals_the_recording(plant["FIC101"])
    assert plant["FIC101"].start == STAMPS[0].replace(tzinfo=dt.UTC).timestamp()
    assert ("zone_unknown" in codes(plant.warnings)) is told


@pytest.mark.parametrize(("line", "name"), [
    ("", "Time (DD/MM/YYYY HH:MM:SS)"), ("Date format: DD/MM/YYYY\n", "Time"), ("", "Timestamp [dd/mm/yyyy hh:mm:ss]")])
def test_an_order_of_dates_that_the_file_states_is_taken_where_it_can_be(tmp_path, line, name):
    day = dt.timedelta(days=-13)  # 4 March
    for form, order in (("%d/%m/%Y %H:%M:%S", line + name), ("%m/%d/%Y %H:%M:%S", (line + name).replace(
            "DD/MM", "MM/DD").replace("dd/mm", "mm/dd"))):
        *above, called = order.rpartition("\n")
        text = "".join(above) + wide(lambda t, f=form: f"{t + day:{f}}", time_name=called)
        record = read(save(tmp_path, text))["FIC101"]
        assert record.start == (STAMPS[0] + day).replace(tzinfo=dt.UTC).timestamp()
    untrue = wide(lambda t: f"{t:%m/%d/%Y %H:%M:%S}", time_name="Time (DD/MM/YYYY)")  # 17 March
    assert read(save(tmp_path, untrue))["FIC101"].start == STAMPS[0].replace(tzinfo=dt.UTC).timestamp()


@pytest.mark.parametrize("first", [0, 28_400])
def test_times_of_day_below_a_start_are_elapsed_or_those_of_the_clock(tmp_path, first):
    """Start 07:53:20: rows that begin at 00:00:00 count from it, and those that begin at 07:53:20 are of the clock."""
    begin = dt.datetime(2026, 3, 14, 7, 53, 20)
    text = wide(lambda t: f"{dt.datetime(2000, 1, 1) + (t - STAMPS[0]) + timedelta(seconds=first):%H:%M:%S}")
    record = read(save(tmp_path, f"Start time,{begin}\n\n{text}"))["FIC101"]
    assert record.start == begin.replace(tzinfo=dt.UTC).timestamp() and "day_above" in codes(record.notes)
    equals_the_recording(record)


@pytest.mark.parametrize(("name", "auto", "manual"), [
    ("MODE", "Program Auto", "Program Manual"), ("MODE", "Cascade", "Cascade Hand"),
    ("MODE", "Remote", "REMOTE MANUAL"), ("MODE", "Operator Auto", "Operator Manual"),
    ("MODE", "PID Auto", "Manual-Auto"), ("MODE", "RCAS", "Not Auto"), ("MODE", "AUTO", "Off-Auto"),
    ("MODE (0=Auto, 1=Manual)", "0", "1"),
    ("MODE [1:MAN 2:AUTO 3:CAS]", "2", "1"), ("MODE", "自动模式", "手动")])
def test_a_mode_is_what_its_words_or_its_header_say(tmp_path, name, auto, manual):
    header, *rows = wide().splitlines()
    held = range(100, 140)
    rows = [f"{row},{manual if k in held else auto}" for k, row in enumerate(rows)]
    tag = f'"FIC101.{name}"'
    record = read(save(tmp_path, "\n".join([f"{header},{tag}", *rows])))["FIC101"]
    assert np.flatnonzero(record.state == SampleState.MANUAL).tolist() == [*held]


def test_a_quality_is_what_its_header_says(tmp_path):
    header, *rows = wide().splitlines()
    most = set(range(50, 400))  # the usual number is the bad one
    rows = [f"{row},{int(k in most)}" for k, row in enumerate(rows)]
    record = read(save(tmp_path, "\n".join([header + ",Quality (0=good)", *rows])))["FIC101"]
    assert set(np.flatnonzero(~np.isfinite(record.measurement)).tolist()) == most


@pytest.mark.parametrize("form", ["{loop}.{signal}", "{loop}_{signal}"])
def test_files_of_a_tag_whose_column_is_called_after_its_signal_make_one_loop(tmp_path, form):
    for tag, values in SIGNALS.items():
        loop, signal = tag.split(".")
        rows = "\n".join(f"{iso(t)},{cell(tag, v)}" for t, v in zip(STAMPS, values, strict=True))
        save(tmp_path, f"Time,{signal}\n{rows}\n", f"{form.format(loop=loop, signal=signal)}.csv")
    plant = read(tmp_path)
    assert [record.loop for record in plant] == ["FIC101", "PIC303"] and not plant.failures
    equals_the_recording(plant["FIC101"])


def test_a_lone_name_beside_whole_tags_is_no_measurement_of_theirs(tmp_path):
    """A table of statistics at the right of the data has a column PV of its own."""
    header, *rows = wide().splitlines()
    right = {3: ",,Mean,53.3", 5: ",,Minimum,46.0", 7: ",,Maximum,59.0"}
    rows = [row + right.get(k, ",,,") for k, row in enumerate(rows)]
    plant = read(save(tmp_path, "\n".join([header + ",,Statistics,PV", *rows])))
    assert [record.loop for record in plant] == ["FIC101", "PIC303"]
    equals_the_recording(plant["FIC101"])


@pytest.mark.parametrize("written", [lambda n: n.replace(".", "\u00a0"), lambda n: "".join(
    chr(ord(c) + 0xFEE0) for c in n)])
def test_blanks_that_do_not_break_and_wide_letters_are_as_usual_ones(tmp_path, written):
    plant = read(save(tmp_path, wide(name=written)))
    assert [record.loop for record in plant] == ["FIC101", "PIC303"]
    equals_the_recording(plant["FIC101"])


@pytest.mark.parametrize("stamp", ["{:%Y-%m-%dT%H:%M:%SZ}", "{0:%s}"])
def test_a_zone_beside_stamps_that_need_none_moves_nothing(tmp_path, stamp):
    since = {"{0:%s}": lambda t: str(int(t.replace(tzinfo=dt.UTC).timestamp()))}.get(stamp, stamp.format)
    head, *rows = wide(since, time_name="Time").splitlines()
    record = read(save(tmp_path, "\n".join([f"{head},TZ", *(f"{row},Asia/Tokyo" for row in rows)]) + "\n"))["FIC101"]
    assert record.start == STAMPS[0].replace(tzinfo=dt.UTC).timestamp()


@pytest.mark.parametrize("header", [True, False])
def test_names_given_in_the_place_of_a_header_are_told(tmp_path, header):
    head, *rows = wide().splitlines()
    text = "\n".join([head] * header + rows) + "\n"
    plant = read(save(tmp_path, text), options=ReadOptions(columns=tuple(head.split(","))))
    equals_the_recording(plant["FIC101"])
    assert ("header_unused" in codes(plant.warnings)) is header


@pytest.mark.parametrize("stamp", ["{:%m/%d/%Y %I:%M:%S %p}", "{:%Y-%m-%d %H:%M:%S} +00:00"])
def test_blanks_in_names_and_stamps_are_not_what_parts_the_cells(tmp_path, stamp):
    text = long(lambda tag, t, value: f"{stamp.format(t)},{tag},{value},Good",
                "Timestamp (UTC),Point Name,Value,Status")
    equals_the_recording(read(save(tmp_path, text))["FIC101"])


def test_numbers_between_blanks_keep_their_decimal_commas(tmp_path):
    text = wide(delimiter=" ", value=lambda tag, value: cell(tag, value).replace(".", ","))
    equals_the_recording(read(save(tmp_path, text))["FIC101"])


@pytest.mark.parametrize("name", ["Units of measure", "Unit of Measurement", "Measurement Unit", "UoM"])
def test_a_column_of_units_is_no_signal(tmp_path, name):
    text = long(lambda tag, stamp, value: f"{tag};{iso(stamp)};{value};m3/h", f"Tag Name;Time;Value;{name}")
    equals_the_recording(read(save(tmp_path, text))["FIC101"])


def test_the_day_of_times_may_be_that_of_the_folder(tmp_path):
    head, *rows = wide(lambda t: f"{t:%H:%M:%S}", time_name="Time").splitlines()
    for day, part in (("2026-03-17", rows[:300]), ("2026-03-18", rows[300:])):
        (tmp_path / day).mkdir()
        save(tmp_path / day, "\n".join([head, *part]) + "\n", "trend.csv")
    record = read(tmp_path)["FIC101"]
    equals_the_recording(record)
    assert record.start == STAMPS[0].replace(tzinfo=dt.UTC).timestamp() and STAMPS[299].day < STAMPS[300].day


@pytest.mark.parametrize(("auto", "by_hand"), [("自动", "手动"), ("自動", "手動"), ("자동", "수동"), ("АВТ", "РУЧ")])
def test_modes_are_known_by_their_content_in_other_languages(tmp_path, auto, by_hand):
    head, *rows = wide().splitlines()
    rows = [f"{row},{by_hand if 100 <= k < 200 else auto}" for k, row in enumerate(rows)]
    record = read(save(tmp_path, "\n".join([f"{head},FIC101.手自动", *rows]) + "\n"))["FIC101"]
    assert np.flatnonzero(record.state == SampleState.MANUAL).tolist() == list(range(100, 200))


def test_a_single_sheet_may_be_called_after_its_loop(tmp_path):
    pytest.importorskip("python_calamine")
    pd.DataFrame({"Time": STAMPS, **{role: SIGNALS[f"FIC101.{role}"] for role in ("SP", "PV", "OP")}}).to_excel(
        tmp_path / "export.xlsx", sheet_name="FIC777", index=False)
    assert [record.loop.rpartition(".")[2] for record in read(tmp_path / "export.xlsx")] == ["FIC777"]


def test_tags_below_descriptions_name_the_loops(tmp_path):
    head, *rows = wide(time_name="").splitlines()
    words = {"SP": "setpoint", "PV": "measured value", "OP": "valve output"}
    above = ",".join(["Timestamp", *("Feed flow " + words[tag.rpartition(".")[2]] for tag in head.split(",")[1:4]),
                      *("Header pressure " + words[tag.rpartition(".")[2]] for tag in head.split(",")[4:])])
    plant = read(save(tmp_path, "\n".join([above, head, *rows]) + "\n"))
    assert [record.loop for record in plant] == ["FIC101", "PIC303"]
    equals_the_recording(plant["FIC101"])


def test_a_title_of_two_cells_does_not_decide_what_parts_the_cells(tmp_path):
    """Blanks part title, date and time into two cells, and semicolons every row into five."""
    text = long(lambda tag, stamp, value: f"{stamp:%d.%m.%Y %H:%M:%S};{tag};{value.replace('.', ',')};degC;Gut",
                "Datum/Zeit;Objekt;Wert;Einheit;Qualität", before="Trendansicht;Regelkreis Heizung\n\n")
    equals_the_recording(read(save(tmp_path, text))["FIC101"])


@pytest.mark.parametrize("extra", ["12,5", "7,1"])
def test_the_decimal_sign_is_that_of_the_signals(tmp_path, extra):
    head, *rows = wide(delimiter=";").splitlines()
    text = "\n".join([f"{head};Charge", *(f"{row};{extra}" for row in rows)]) + "\n"
    equals_the_recording(read(save(tmp_path, text))["FIC101"])


def test_exponents_of_fortran_are_no_units(tmp_path):
    text = wide(value=lambda n, v: f"{v:.6E}".replace("E", "D"))
    equals_the_recording(read(save(tmp_path, text))["FIC101"])
    (tmp_path / "plant.csv").write_text(wide(value=lambda n, v: f"{v / 100:.4f}x10^+02"), encoding="utf-8")
    with pytest.raises(BacklashError, match="no good numbers"):
        read(tmp_path / "plant.csv")["FIC101"]


def test_a_column_before_the_first_block_of_a_tag_is_passed_over(tmp_path):
    tags = ["FIC101.PV", *(name for name in SIGNALS if name != "FIC101.PV")]
    blocks = [f"{n}_NUMERICID,{n}_VALUE,{n}_TIMESTAMP,{n}_QUALITY" for n in tags]
    rows = [",".join([str(k), *(f"0,{cell(n, SIGNALS[n][k])},{iso(stamp)},192" for n in tags)])
            for k, stamp in enumerate(STAMPS)]
    text = "\n".join([",".join(["ID", *blocks]), *rows]) + "\n"
    equals_the_recording(read(save(tmp_path, text))["FIC101"])


def test_a_tag_in_a_file_of_its_own_may_have_further_columns(tmp_path):
    for name, values in SIGNALS.items():
        rows = "".join(f"{iso(t)},192,{cell(name, v)},{v - 1:.3f},{v + 1:.3f}\n"
                       for t, v in zip(STAMPS, values, strict=True))
        (tmp_path / f"{name}.csv").write_text(f"Time,Quality,Value,Min,Max\n{rows}", encoding="utf-8")
    (tmp_path / "loops.toml").write_text(SETTINGS, encoding="utf-8")
    equals_the_recording(read(tmp_path)["FIC101"])


@pytest.mark.parametrize(("name", "manual", "auto"), [
    ("FIC101.MA", "0", "1"), ("FIC101.ManAct", "1", "0"), ("FIC101.MAN_ON", "TRUE", "FALSE"),
    ("FIC101.QMAN_AUT", "0", "1"),
    ("FIC101.MODE", "0 - Man", "1 - Auto"), ("FIC101.模式", "手动", "自动"),
    ("FIC101.Режим", "РУЧ", "АВТ"), ("FIC101.LoopMode", "MAN", "AUTO")])
def test_modes_in_other_words_and_languages(tmp_path, name, manual, auto):
    record = read(save(tmp_path, with_column(name, lambda k: manual if 100 <= k < 160 else auto)))["FIC101"]
    assert (record.state[100:160] == SampleState.MANUAL).all() and record.usable[:100].all()


def test_a_value_beside_setpoint_and_output_is_the_measurement(tmp_path):
    equals_the_recording(read(save(tmp_path, wide(name=lambda n: n.replace("PV", "Значение"))))["FIC101"])


def test_times_of_day_beside_a_date_may_have_dots(tmp_path):
    text = wide(lambda t: t.strftime("%d/%m/%Y,%H.%M.%S"), time_name="Data,Ora")
    equals_the_recording(read(save(tmp_path, text))["FIC101"])


def test_a_file_of_each_signal_may_have_a_column_per_loop(tmp_path):
    for role in ("PV", "SP", "OP"):
        text = "Time,FIC101,PIC303\n" + "".join(
            f"{iso(stamp)},{SIGNALS[f'FIC101.{role}'][k]},{SIGNALS[f'PIC303.{role}'][k]}\n"
            for k, stamp in enumerate(STAMPS))
        (tmp_path / f"{role}_20260317.csv").write_text(text, encoding="utf-8")
    (tmp_path / "loops.toml").write_text(SETTINGS, encoding="utf-8")
    plant = read(tmp_path)
    assert {record.loop for record in plant} == {"FIC101", "PIC303"}
    equals_the_recording(plant["FIC101"])


@pytest.mark.parametrize("form", ["101 <{}.{}> (VDC)", "{}-{}.UNIT1@NET0", "{}.{}@SRV1", "{}.{}.UNIT@NET", "{}!{}"])
def test_names_of_loggers_and_points_of_networks(tmp_path, form):
    equals_the_recording(read(save(tmp_path, wide(name=lambda n: form.format(*n.split(".")))))["FIC101"])


def test_rows_that_are_lost_are_counted_and_the_line_of_the_first_is_named(tmp_path):
    lines = long(lambda n, t, v: f"{n},{iso(t)},{v}", "tag,time,value").splitlines()
    for row in range(100, 1000, 10):
        lines[row] = "," + lines[row].partition(",")[2]
    record = read(save(tmp_path, "\n".join(lines) + "\n"))["FIC101"]
    assert any(note.code == "no_tag" and "90 rows" in note.message for note in record.notes)
    lines = wide().splitlines()
    lines[333] = "SERVICE STOPPED"
    note, = (n for n in read(save(tmp_path, "\n".join(lines) + "\n")).warnings if n.code == "ragged_rows")
    assert "1 rows" in note.message and "line 334" in note.message


def test_records_where_pv_has_none_are_told(tmp_path):
    stamps = np.array(STAMPS, "M8[us]")
    for part, rows in enumerate((slice(0, 250), slice(250, None))):
        columns = {"time": stamps[rows], **{s: SIGNALS[f"FIC101.{s}"][rows] for s in ("SP", "PV", "OP")}}
        pq.write_table(pa.table({k: v for k, v in columns.items() if part == 0 or k != "PV"}),
                       tmp_path / f"part-{part}.parquet")
    folder = tmp_path.rename(tmp_path.parent / "FIC101")
    record, = read(folder)
    assert len(record) == 250 and any(note.code == "outside_pv" and "58 %" in note.message for note in record.notes)


def test_lines_above_tell_start_and_interval_of_counted_rows(tmp_path):
    """The step of the times is the interval where rows are counted, or where both are written in one unit."""
    counted = wide(lambda t: f"{(t - STAMPS[0]).total_seconds():.0f}", time_name="Sample")
    for interval, seconds in (("2 s", 2.0), ("0.5", 0.5), ("100 ms", 0.1), ("00:01:00", 60.0)):
        record = read(save(tmp_path, f"Start: 2026-04-13 08:00\nSampling interval: {interval}\n{counted}"))["FIC101"]
        assert (record.interval, record.start) == (seconds, dt.datetime(2026, 4, 13, 8, tzinfo=dt.UTC).timestamp())
    table = wide(lambda t: f"{10 * (t - STAMPS[0]).total_seconds():.0f}", time_name="Name", delimiter="\t")
    unit = "SampleTime[ms]\t10" + "\tSampleTime[ms]\t10" * 3 + "\n"
    assert read(save(tmp_path, unit + table))["FIC101"].interval == 0.01
    named = wide(lambda t: f"{(t - STAMPS[0]).total_seconds():.0f}", time_name="Time (s)")  # each tenth is listed
    assert read(save(tmp_path, f"Sample interval: 100 ms\n{named}"))["FIC101"].interval == 1.0
    apart = wide(lambda t: f"{5 * (t - STAMPS[0]).total_seconds():.0f}", time_name="Seconds")  # each fifth is listed
    assert read(save(tmp_path, f"Sample interval: 1 s\n{apart}"))["FIC101"].interval == 5.0


@pytest.mark.parametrize("name", [
    "FIC101.OP mA", "FIC101_OP_mA", "FIC101.OP in mA", "FIC101.OP act", "FIC101.OP@UNIT1.NET0"])
def test_a_unit_or_node_behind_a_signal_is_no_signal(name):
    assert (split_tag(name).loop, split_tag(name).role) == ("FIC101", "op")


@pytest.mark.parametrize(("name", "loop", "role"), [
    ("C.SP", "C", "sp"), ("W.SP", "W", "sp"), ("S.PV", "S", "pv"), ("TARGET.SP", "TARGET", "sp"),
    ("L.SP.Value", "L", "sp"), ("Set.Point", "", "sp"), ("Local SP", "", "sp"), ("FIC101.L.SP", "FIC101.", "sp"),
    ("Setpoint.Value", "", "sp"), ("FIC101.Set.Point", "FIC101", "sp")])
def test_a_short_name_of_a_loop_is_no_part_of_its_signal(name, loop, role):
    assert (split_tag(name).loop.rstrip("."), split_tag(name).role) == (loop.rstrip("."), role)


def test_lines_that_only_begin_as_those_that_are_rewritten_are_refused_in_one_message(tmp_path):
    rows = [f"/Date({1773791700000 + 1000 * k}?,405,405.5,44.9" for k in range(9)]
    with pytest.raises(InputError):
        read(save(tmp_path, "\n".join(["time,FIC101.SP,FIC101.PV,FIC101.OP", *rows]) + "\n"))


@pytest.mark.parametrize(("text", "month"), [
    ("14 juill. 2026", 7), ("14 juil. 2026", 7), ("14 juin 2026", 6), ("3 marraskuu 2026", 11), ("3 mart 2026", 3),
    ("5 Ocak 2026", 1), ("5 Temmuz 2026", 7), ("1 Sept 2026", 9), ("1 января 2026", 1)])
def test_a_month_is_what_its_name_begins_like_and_not_its_first_three_letters(text, month):
    micros, _, _ = read_dates([text])
    assert micros.astype("M8[us]").astype("M8[M]")[0].item().month == month


def test_every_known_name_can_be_met():
    """Names are compared without blanks, dots and apostrophes."""
    words = [*" ".join(SIGNALS_WORDS.values()).split(), *chain.from_iterable(COLUMNS.values())]
    assert [word for word in words if plain(word) != word] == []


def test_newest_first_is_the_same_record_also_over_the_doubled_hour(tmp_path):
    begin = dt.datetime(2025, 10, 25, 22, 30, tzinfo=ZoneInfo("UTC"))
    stamps = [(begin + timedelta(seconds=20 * k)).astimezone(ZoneInfo("Europe/Berlin")) for k in range(1000)]
    rows = [f"{t:%Y-%m-%d %H:%M:%S},50,{50 + k % 7},{40 + k % 5}" for k, t in enumerate(stamps)]
    found = []
    for order in (rows, rows[::-1]):
        text = "\n".join(["time,FIC101.SP,FIC101.PV,FIC101.OP", *order]) + "\n"
        found.append(read(save(tmp_path, text), options=ReadOptions(timezone="Europe/Berlin"))["FIC101"])
    np.testing.assert_array_equal(found[0].time, found[1].time)
    np.testing.assert_array_equal(found[0].measurement, found[1].measurement)
    assert len(found[0]) == 1000 and found[0].time[-1] - found[0].time[0] == 999 * 20


def test_files_of_one_tag_with_the_same_stamps_are_rows_of_one_table(tmp_path):
    text = wide(iso)
    header, *rows = [line.split(",") for line in text.splitlines()]
    for column, tag in enumerate(header[1:], 1):
        lines = [["time", tag], *([row[0], row[column]] for row in rows)]
        (tmp_path / f"{tag}.csv").write_text("\n".join(map(",".join, lines)) + "\n")
    (tmp_path / "loops.toml").write_text(SETTINGS)
    record = read(tmp_path)["FIC101"]
    assert "expanded" not in {note.code for note in record.notes}
    whole = read(save(tmp_path, text))["FIC101"]
    for name in ("time", "setpoint", "measurement", "output", "state"):
        np.testing.assert_array_equal(getattr(record, name), getattr(whole, name))


def test_a_setpoint_that_holds_since_before_the_record_is_not_left_out(tmp_path):
    rows = [f"{stamp:%Y-%m-%d %H:%M:%S},FIC101.PV,{50 + k % 7}" for k, stamp in enumerate(STAMPS)]
    first = f"{STAMPS[0] - timedelta(days=3):%Y-%m-%d %H:%M:%S},FIC101.SP,50"
    record = read(save(tmp_path, "\n".join(["time,tag,value", first, *rows]) + "\n"))["FIC101"]
    assert np.all(record.setpoint == record.setpoint[0]) and np.isfinite(record.setpoint[0])
    assert "outside_pv" not in {note.code for note in record.notes}


@pytest.mark.parametrize("names", [
    "Flow SP,Flow PV,Valve OP", "Flow Setpoint,Flow,Valve", "Temperature setpoint (°C),Temperature (°C),Valve (%)",
    "Setpoint,Measured Flow,Valve Demand", "Required flow,Actual flow,Valve position",
    "Consigne débit,Mesure débit,Vanne", "Sollwert Durchfluss,Istwert Durchfluss,Ventil",
    "Consigna,Medida,Salida válvula (%)"])
def test_a_loop_named_in_words_is_called_as_its_file(tmp_path, names):
    header, rest = wide(iso).split("\n", 1)
    columns = header.split(",")
    order = [columns.index(f"FIC101.{role}") for role in ("SP", "PV", "OP")]
    rows = [",".join(np.array(line.split(","))[[0, *order]]) for line in rest.splitlines()]
    record, = read(save(tmp_path, "\n".join([f"Time,{names}", *rows]) + "\n", "FIC101.csv"))
    assert record.loop == "FIC101" and record.output is not None and np.isfinite(record.setpoint).all()
    equals_the_recording(record)


def test_two_loops_in_words_stay_two_loops(tmp_path):
    rows = [f"{stamp:%Y-%m-%d %H:%M:%S},50,{50 + k % 7},40,60,{60 + k % 5},30" for k, stamp in enumerate(STAMPS)]
    names = "Flow SP,Flow PV,Flow OP,Level SP,Level PV,Level OP"
    assert {r.loop for r in read(save(tmp_path, "\n".join([f"Time,{names}", *rows]) + "\n"))} == {"Flow", "Level"}


def test_beside_numbers_with_a_decimal_comma_the_day_comes_first(tmp_path):
    """Nobody writes month/day/year beside a decimal comma; it is said, as it may be so all the same."""
    rows = [f"12/03/2026 06:{k // 60:02}:{k % 60:02};50,0;{50 + k % 7 / 8:.3f};{40 + k % 5 / 8:.3f}".replace(".", ",")
            for k in range(400)]
    text = "\n".join(["Time;FIC101.SP;FIC101.PV;FIC101.OP", *rows]) + "\n"
    record = read(save(tmp_path, text))["FIC101"]
    assert record.start == dt.datetime(2026, 3, 12, 6, tzinfo=dt.UTC).timestamp()
    assert any(note.code == "time_format" and "--time-format mdy" in note.message for note in record.notes)
    month_first = read(save(tmp_path, text), options=ReadOptions(time_format="mdy"))["FIC101"]
    assert month_first.start == dt.datetime(2026, 12, 3, 6, tzinfo=dt.UTC).timestamp()
    with pytest.raises(InputError, match="ambiguous"):
        read(save(tmp_path, text.replace(";", "\t").replace(",", ".")))


@pytest.mark.parametrize(("remark", "loop"), [
    ("# loop FIC101, PI controller", "FIC101"), ("# this loop is in automatic", "plant"),
    ("# closed loop data, 3 s", "plant")])
def test_a_remark_on_a_loop_is_no_name(tmp_path, remark, loop):
    rows = [f"{2 * k} 50 {50 + k % 7} {40 + k % 5}" for k in range(400)]
    record, = read(save(tmp_path, "\n".join([remark, "# t_s SP PV OP", *rows]) + "\n", "plant.txt"))
    assert record.loop == loop


@pytest.mark.parametrize("change", [
    lambda text: "".join(f"> {line}\n" for line in text.splitlines()),
    lambda text: "".join(f"{key}\t{key}\n" for key in ("Name", *(f"Key{k}" for k in range(9))))
    + text.replace(",", "\t")], ids=["quoted in a mail", "ten lines of keys"])
def test_what_stands_around_a_table_does_not_hide_it(tmp_path, change):
    equals_the_recording(read(save(tmp_path, change(wide(iso))))["FIC101"])


def test_settings_of_a_loop_are_those_of_its_block_though_other_tags_stand_below_it(tmp_path):
    """DeltaV: FIC101/PID1/PV.CV, and GAIN.CV, which is no output."""
    head, *rows = wide(iso).splitlines()
    head = re.sub(r"FIC101\.(\w+)", r"FIC101/PID1/\1.CV", head)
    text = "\n".join([f"{head},FIC101/PID1/GAIN.CV", *(f"{row},0.57" for row in rows)]) + "\n"
    (tmp_path / "plant.csv").write_text(text)
    (tmp_path / "loops.toml").write_text(SETTINGS)
    record = read(tmp_path / "plant.csv")["FIC101"]
    assert record.settings.source["K"] == "metadata" and "not_in_metadata" not in codes(record.notes)


def test_a_measurement_outside_its_range_gives_no_verdict(tmp_path):
    path = save(tmp_path, wide(iso))
    (tmp_path / "loops.toml").write_text(re.sub(r"pv_range = .*", "pv_range = [600, 900]", SETTINGS))
    report = scan(read(path)["FIC101"])
    assert report.verdict is Verdict.CANNOT_TELL and "measurement_outside" in codes(report.reasons)


def test_an_open_quotation_mark_that_takes_in_all_rows_is_named(tmp_path):
    head, first, *rows = wide(iso).splitlines()
    with pytest.raises(InputError, match="a quotation mark is not closed"):
        read(save(tmp_path, "\n".join([head, first.replace(",", ',"', 1), *rows]) + "\n"))


def test_a_table_of_which_nothing_is_left_is_refused_in_one_message(tmp_path):
    """Every row repeats what stands above it, as a header that comes again; the real one ran into the first row."""
    rows = [f"2026-03-17T23:55:{k},405.00,{410 + k % 9}.5" for k in range(10, 41)]
    text = ["times26-03-17T23:55:07,405.00,417.92", *rows, "2026-03-17tamp,FIC101.SP,FIC101.PV"]
    with pytest.raises(InputError, match="no rows of data"):
        read(save(tmp_path, "\n".join(text)))


LOOPS, ROLES = ("FIC101", "PIC303"), ("SP", "PV", "OP")
EACH, ALL = [loop for loop in LOOPS for _ in ROLES], [role for _ in LOOPS for role in ROLES]
UNITS = ["m3/h", "m3/h", "%", "bar", "bar", "%"]


def twice(cells, second=""):
    return [cell for one in cells for cell in (one, one if second is None else second)]


@pytest.mark.parametrize("rows", [
    [["Object", *EACH], ["Property", *ALL], ["Timestamp", *["Value"] * 6]],
    [["", *EACH], ["", *ALL], ["Time", *UNITS]],
    [["Loop", *EACH], ["Signal", *ALL], ["Time", *UNITS]],
    [["", *twice(("FIC101", "", "", "PIC303", "", ""))], ["", *twice(ALL)], ["Time", *["Value", "Quality"] * 6]],
    [["Loop", *twice(EACH, None)], ["Signal", *twice(ALL, None)], ["Time", *["Value", "Quality"] * 6]],
], ids=["values", "units", "labels", "merged", "repeated"])
def test_loop_signal_and_what_a_cell_is_in_a_line_each(tmp_path, rows):
    marked = len(rows[0]) > 7
    body = [re.sub(r",([^,\n]+)", r",\1,Good", row) if marked else row for row in wide(iso).splitlines()[1:]]
    plant = read(save(tmp_path, "\n".join([*map(",".join, rows), *body])))
    assert [record.loop for record in plant] == [*LOOPS]
    for loop, span in (("FIC101", 900.0), ("PIC303", 16.0)):
        equals_the_recording(plant[loop], loop, span)
        np.testing.assert_allclose(100.0 * plant[loop].output, SIGNALS[f"{loop}.OP"], atol=1e-6)


@pytest.mark.parametrize("form", ["wide", "wide, stamps last", "long"])
def test_days_and_hours_of_partitions_beside_whole_stamps(tmp_path, form):
    head, *rows = wide(iso).splitlines()
    if form == "long":
        text = long(lambda tag, stamp, value: f"{stamp:%Y-%m-%d},{stamp.hour},{tag},{iso(stamp)},{value}",
                    "date,hour,tag,timestamp,value")
    else:
        rows = [row.split(",", 1) for row in rows]
        rows = [(stamp, f"{stamp[:10]},{int(stamp[11:13])}", cells) for stamp, cells in rows]
        first = [head.replace("timestamp", "timestamp,date,hour", 1), *map(",".join, rows)]
        last = [head.replace("timestamp,", "date,hour,", 1) + ",timestamp", *(f"{b},{c},{a}" for a, b, c in rows)]
        text = "\n".join(first if form == "wide" else last)
    equals_the_recording(read(save(tmp_path, text))["FIC101"])


def test_stamps_that_a_spreadsheet_has_rounded_are_refused(tmp_path):
    text = re.sub(r"(?m)^\d[^,]*", "2.02603E+13", wide(iso))
    with pytest.raises(InputError, match=r"no readable time stamps.*spreadsheet has spoiled"):
        read(save(tmp_path, text))


def test_a_damaged_small_file_in_an_archive_costs_itself_only(tmp_path):
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w") as archive:
        archive.writestr("plant.csv", wide(iso))
        archive.writestr("other.csv", "a,b\n1,2\n")
    spoilt = whole.getvalue().replace(b"a,b\n1,2\n", b"a,b\n1,3\n")
    plant = read(save(tmp_path, spoilt, "plant.zip"))
    equals_the_recording(plant["FIC101"])
    assert any("other.csv" in str(failure) for failure in plant.failures)


@pytest.mark.parametrize("signal", ["SP", "OP", "MODE"])
def test_files_that_agree_in_the_measurement_alone_are_refused(tmp_path, signal):
    """The same hour exported twice, once with another setpoint, output or mode."""
    header, *rows = wide().splitlines()
    rows = [f"{row},AUTO" for row in rows]
    at = [*header.split(","), "FIC101.MODE"].index(f"FIC101.{signal}")
    other = [",".join([*(cells := row.split(","))[:at], "MAN" if signal == "MODE" else str(100 - float(cells[at])),
                       *cells[at + 1 :]]) for row in rows]
    for name, lines in (("a.csv", rows), ("b.csv", other)):
        save(tmp_path, "\n".join([f"{header},FIC101.MODE", *lines]), name)
    plant = read(tmp_path)
    (lost,) = plant.failures
    assert lost.code == "files_differ" and f"FIC101.{signal}: two files give different values" in lost.message
    assert [record.loop for record in plant] == ["PIC303"]


def test_rows_of_a_long_file_without_a_readable_time_are_told(tmp_path):
    text = long(lambda tag, stamp, value: f"{tag},{stamp},{value}", "tag,time,value")
    plant = read(save(tmp_path, text + "<html>504 Gateway,Time-out,sorry</html>\n"))
    assert ["1 rows" in note.message for note in plant["FIC101"].notes if note.code == "unreadable_times"] == [True]
    equals_the_recording(plant["FIC101"])
    again = read(save(tmp_path, text + "tag,time,value\n" + "\n".join(text.splitlines()[1:200:2]) + "\n"))  # a header
    assert "unreadable_times" not in codes(again["FIC101"].notes)


def test_a_long_file_that_is_cut_off_in_its_last_line_says_so(tmp_path):
    text = long(lambda tag, stamp, value: f"{tag},{stamp},{value}", "tag,time,value")
    plant = read(save(tmp_path, text + "FIC101.PV,2026-03-18T00:0"))
    assert {"ragged_rows"} <= codes(plant.warnings) and "passed_over" not in codes(plant.warnings)
    equals_the_recording(plant["FIC101"])


def test_a_pattern_that_fits_no_stamp_is_named_beside_one(tmp_path):
    with pytest.raises(InputError, match=r"for example '2026-03-17T23:55:00'\) that fit --time-format '%d\.%m\.%Y'"):
        read(save(tmp_path, wide()), options=ReadOptions(time_format="%d.%m.%Y"))


@pytest.mark.parametrize("span", ["[0, 1e308]", "[-1e308, 1e308]", "[0, 1e16]"])
def test_a_span_that_no_signal_has_is_refused(tmp_path, span):
    path = save(tmp_path, wide())
    (tmp_path / "loops.toml").write_text(f"[loops.FIC101]\nK = 0.9\nTi = 20.0\npv_range = {span}\n", encoding="utf-8")
    (lost,) = read(path).failures
    assert "is too wide" in lost.message and "loops.toml from line 1 on" in lost.message


@pytest.mark.parametrize("form", [
    "{:%Y_%m_%d_%H_%M_%S}", "LDT#{:%Y-%m-%d-%H:%M:%S.000000000}", "{0:%Y/%m/%d}(火) {0:%H:%M:%S}"])
def test_stamps_as_controllers_and_recorders_write_them(tmp_path, form):
    record = read(save(tmp_path, wide(form.format)))["FIC101"]
    assert record.start == STAMPS[0].replace(tzinfo=dt.UTC).timestamp()
    equals_the_recording(record)


@pytest.mark.parametrize("names", [
    ("FIC101Sp", "FIC101Pv", "FIC101Out"), ("FIC101Setpoint", "FIC101ProcessValue", "FIC101ControllerOutput"),
    ("FIC101设定值SV", "FIC101测量值PV", "FIC101输出值MV"), ("FIC101.SP_REAL", "FIC101.PV_REAL", "FIC101.OP_REAL"),
    ("Valor Deseado FIC101", "Valor de Proceso FIC101", "Salida FIC101")])
def test_signals_are_known_by_further_names(tmp_path, names):
    called = dict(zip(("FIC101.SP", "FIC101.PV", "FIC101.OP"), names, strict=True))
    (record,) = (one for one in read(save(tmp_path, wide(name=lambda n: called.get(n, n)))) if one.loop == "FIC101")
    equals_the_recording(record)
    assert np.isfinite(record.setpoint).all() and np.isfinite(record.output).all()


def test_japanese_text_of_unix_and_numbers_of_modes_with_their_words(tmp_path):
    called = {"SP": "設定値", "PV": "測定値", "OP": "操作量"}
    header, *rows = wide(name=lambda n: f"{n[:-2]}{called[n[-2:]]}").splitlines()
    rows = [f"{row},{'3 (MAN)' if 100 <= k < 140 else '4 (AUTO)'}" for k, row in enumerate(rows)]
    text = "\n".join(["日時" + header[header.index(",") :] + ",FIC101.運転モード", *rows])
    plant = read(save(tmp_path, text.encode("euc_jp")))
    assert any("euc_jp" in note.message for note in plant.warnings if note.code == "encoding")
    equals_the_recording(plant["FIC101"])
    assert np.flatnonzero(plant["FIC101"].state == SampleState.MANUAL).tolist() == [*range(100, 140)]


def test_a_quality_called_after_its_signal_alone_is_that_of_the_column_before_it(tmp_path):
    header, *rows = wide().splitlines()
    at = header.split(",").index("FIC101.PV") + 1
    lines = [header.split(","), *(row.split(",") for row in rows)]
    lines = [[*cells[:at], "PV Status" if k == 0 else "Bad" if k - 1 in SPOILT else "Good", *cells[at:]]
             for k, cells in enumerate(lines)]
    record = read(save(tmp_path, "\n".join(map(",".join, lines))))["FIC101"]
    assert not record.usable[[*SPOILT]].any() or (record.state[[*SPOILT]] == SampleState.FILLED).all()
    assert any(note.code == "bad_quality" for note in record.notes)


@pytest.mark.parametrize("above", ["# FIC101_{}\n", "Tag: FIC101_{}\n", "\n"])
def test_whole_numbers_behind_a_time_are_no_decimals_of_its_seconds(tmp_path, above):
    for signal in ("SP", "PV", "OP"):
        values = SIGNALS[f"FIC101.{signal}"]
        rows = "".join(f"{t:%Y-%m-%d %H:%M:%S},{v:.0f}\n" for t, v in zip(STAMPS, values, strict=True))
        save(tmp_path, above.format(signal) + rows, f"FIC101_{signal}.csv")
    record = read(tmp_path)["FIC101"]
    equals_the_recording(record, near=0.51 / 900.0)
    assert np.isfinite(record.setpoint).all() and np.isfinite(record.output).all()


@pytest.mark.parametrize("kind", [pa.binary(), pa.large_binary(), pa.dictionary(pa.int32(), pa.binary())])
def test_tags_that_a_table_keeps_as_bytes_are_texts(tmp_path, kind):
    """Hive and Impala write text without saying that it is one."""
    tags = [tag.encode() for tag in SIGNALS for _ in STAMPS]
    table = pa.table({"tag": pa.array(tags).cast(kind) if not pa.types.is_dictionary(kind) else pa.array(
        tags).dictionary_encode(), "time": STAMPS * len(SIGNALS), "value": np.concatenate([*SIGNALS.values()])})
    pq.write_table(table, tmp_path / "plant.parquet")
    (tmp_path / "loops.toml").write_text(SETTINGS, encoding="utf-8")
    plant = read(tmp_path / "plant.parquet")
    assert [record.loop for record in plant] == ["FIC101", "PIC303"]
    equals_the_recording(plant["FIC101"])


@pytest.mark.parametrize(("usual", "other"), [
    ("SP", "Reference"), ("PV", "Present Value"), ("PV", "Measurements"), ("OP", "Control Signal"), ("OP", "VOUT")])
def test_of_several_names_for_one_signal_the_usual_one_is_taken(tmp_path, usual, other):
    header, *rows = wide().splitlines()
    first = header.index(",") + 1  # the other stands before it
    lines = [f"{header[:first]}FIC101.{other},{header[first:]}",
             *(f"{row[: row.index(',')]},7{row[row.index(',') :]}" for row in rows)]
    plant = read(save(tmp_path, "\n".join(lines)))
    usual_one = read(save(tmp_path, wide(), "usual.csv"))["FIC101"]
    for name in ("setpoint", "measurement", "output"):
        np.testing.assert_array_equal(getattr(plant["FIC101"], name), getattr(usual_one, name))
    told = [note.message for note in plant["FIC101"].notes if note.code == "several_columns"]
    assert f"FIC101.{usual} is used" in " ".join(told)


def test_times_of_day_far_from_a_start_are_of_the_clock(tmp_path):
    """Start 22:00: rows that begin at 06:00 are no elapsed times, which begin at about 0."""
    text = wide(lambda t: f"{dt.datetime(2000, 1, 1, 6) + (t - STAMPS[0]):%H:%M:%S}")
    record = read(save(tmp_path, f"Start time,2026-03-14 22:00:00\n\n{text}"))["FIC101"]
    assert record.start == dt.datetime(2026, 3, 14, 6, tzinfo=dt.UTC).timestamp()


@pytest.mark.parametrize("header", ["Millitm", "ms", "Millisekunden"])
def test_milliseconds_in_a_column_beside_date_and_time(tmp_path, header):
    """As SCADA systems keep them: whole seconds, and beside them the milliseconds."""
    half = [STAMPS[0] + timedelta(milliseconds=2500 * i + 250) for i in range(ROWS)]
    first, *rows = wide().splitlines()
    lines = [first.replace("timestamp", f"DateAndTime,{header}"), *(
        f"{t:%Y-%m-%d %H:%M:%S},{t.microsecond // 1000},{row.partition(',')[2]}"
        for t, row in zip(half, rows, strict=True))]
    record = read(save(tmp_path, "\n".join(lines)))["FIC101"]
    assert record.interval == 2.5 and len(record) == ROWS
    assert record.start == half[0].replace(tzinfo=dt.UTC).timestamp()
    equals_the_recording(record)


def test_milliseconds_of_stamps_that_have_their_own_are_not_added(tmp_path):
    half = [STAMPS[0] + timedelta(milliseconds=2500 * i) for i in range(ROWS)]
    first, *rows = wide().splitlines()
    lines = [first.replace("timestamp", "DateAndTime,ms"), *(
        f"{t:%Y-%m-%d %H:%M:%S.%f},{t.microsecond // 1000},{row.partition(',')[2]}"
        for t, row in zip(half, rows, strict=True))]
    record = read(save(tmp_path, "\n".join(lines)))["FIC101"]
    assert record.interval == 2.5 and len(record) == ROWS


@pytest.mark.parametrize("names", [
    ("Setpoint", "反馈值", "阀位输出"), ("Завдання", "Виміряне значення", "Вихід"), ("Val_SP", "Val_PV", "Val_CV"),
    ("SP.rValue", "PV.rValue", "CV.rValue"), ("Main.SP,Trend1", "Main.PV,Trend1", "Main.Out,Trend1")])
def test_signals_under_names_of_more_systems(tmp_path, names):
    text = wide().replace(",", ";")
    for old, new in zip(("SP", "PV", "OP"), names, strict=True):
        text = text.replace(f".{old}", f":{new}" if "," in new else f".{new}")
    (record,) = [record for record in read(save(tmp_path, text)) if record.loop.startswith("FIC101")]
    equals_the_recording(record)
    assert np.isfinite(record.output).all() and np.isfinite(record.setpoint).all()


@pytest.mark.parametrize(("header", "manual", "automatic"), [("SWM", "1", "0"), ("MODE.TARGET", "MAN", "AUTO")])
def test_modes_under_names_of_more_systems(tmp_path, header, manual, automatic):
    first, *rows = wide().splitlines()
    words = [manual if 100 <= i < 200 else automatic for i in range(ROWS)]
    lines = [f"{first},FIC101.{header}", *(f"{row},{word}" for row, word in zip(rows, words, strict=True))]
    state = read(save(tmp_path, "\n".join(lines)))["FIC101"].state
    assert (state[100:200] == SampleState.MANUAL).all() and (state[200:] != SampleState.MANUAL).all()


def test_points_that_lines_above_name_with_a_colon(tmp_path):
    first, *rows = wide().splitlines()
    tags = first.split(",")[1:]
    above = "".join(f'"Point_{k}:","{tag}","","1 sec"\n' for k, tag in enumerate(tags, 1))
    header = ",".join(["Date", *(f"Point_{k}" for k in range(1, len(tags) + 1))])
    equals_the_recording(read(save(tmp_path, "\n".join([above + header, *rows])))["FIC101"])


def test_remarks_and_lists_of_tags_beside_the_exports_are_no_exports(tmp_path):
    path = save(tmp_path, wide())
    (tmp_path / "notes.txt").write_text("FIC101 valve was repaired.\n")
    (tmp_path / "TagList.csv").write_text("Tag,Description\nFIC101.PV,Feed flow\n")
    plant = read(tmp_path)
    assert not plant.failures and [r.loop for r in plant] == [r.loop for r in read(path)]


def test_a_header_row_of_numbers_is_refused(tmp_path):
    with pytest.raises(BacklashError, match="line 3 cannot be the header: it is empty, or holds numbers"):
        read(save(tmp_path, wide()), options=ReadOptions(header_row=3))


def test_the_line_from_which_on_rows_have_other_cells_is_named(tmp_path):
    first, *rows = wide().splitlines()
    lines = [first, *rows[:200], *(row.rpartition(",")[0].rpartition(",")[0] for row in rows[200:])]
    with pytest.raises(BacklashError, match=r"plant\.csv \(from line 202 on rows have 5 cells\)"):
        read(save(tmp_path, "\n".join(lines)))


def test_an_archive_in_an_archive_is_refused(tmp_path):
    inner = io.BytesIO()
    with zipfile.ZipFile(inner, "w") as archive:
        archive.writestr("plant.csv", wide())
    with zipfile.ZipFile(tmp_path / "plant.zip", "w") as archive:
        archive.writestr("in.zip", inner.getvalue())
    with pytest.raises(BacklashError, match=r"in\.zip: Archive file inside a compressed file or an archive"):
        read(tmp_path / "plant.zip")


def test_a_zone_that_the_header_names_and_an_option_overrules_is_told(tmp_path):
    text = wide(lambda t: f"{t:%Y-%m-%d %H:%M:%S}").replace("timestamp", "Time (UTC+05:00)")
    notes = {zone: [n.message for n in read(save(tmp_path, text), options=ReadOptions(timezone=zone))["FIC101"].notes
                    if n.code == "zone_overruled"] for zone in ("Europe/Berlin", None)}
    assert notes == {"Europe/Berlin": [
        "the file names the zone UTC+05:00, and --timezone Europe/Berlin, which is used"], None: []}


def test_rows_dated_far_in_the_future_are_told(tmp_path):
    late = [t.replace(year=2062) if 100 <= i < 300 else t for i, t in enumerate(STAMPS)]
    first, *rows = wide().splitlines()
    text = "\n".join([first, *(f"{iso(t)},{row.partition(',')[2]}" for t, row in zip(late, rows, strict=True))])
    assert "unlikely_dates" in codes(read(save(tmp_path, text))["FIC101"].notes)


@pytest.mark.parametrize("head", [
    "{}", "[{}]", "# {}", "{}:", "# tag: {}", r"\\PISRV\{}", 'Series: "{}" (%)\nTime,Value'])
def test_tables_of_one_tag_each_below_a_line_that_names_it(tmp_path, head):
    blocks = ["\n".join([head.format(tag), *(f"{iso(t)},{x}" for t, x in zip(STAMPS, values, strict=True))])
              for tag, values in SIGNALS.items()]
    plant = read(save(tmp_path, "\n\n".join(blocks) + "\n"))
    assert [record.loop for record in plant] == ["FIC101", "PIC303"]
    for record in plant:
        np.testing.assert_allclose(record.measurement * record.settings.pv_range[1], SIGNALS[f"{record.loop}.PV"])
        assert np.isfinite(record.setpoint).all() and np.isfinite(record.output).all()


def test_the_state_of_a_compact_controller_tells_its_mode(tmp_path):
    """Siemens' PID_Compact: state 3 is automatic, 4 manual."""
    first, *rows = wide().splitlines()
    states = [4 if 100 <= i < 200 else 3 for i in range(ROWS)]
    header = f"{first},FIC101.State".replace("FIC101", "PID_Compact_1")
    state = read(save(tmp_path, "\n".join([header, *(f"{row},{s}" for row, s in zip(rows, states, strict=True))])))[
        "PID_Compact_1"].state
    assert (state[100:200] == SampleState.MANUAL).all() and (state[200:] != SampleState.MANUAL).all()


@pytest.mark.parametrize("footer", [
    "(600 rows)", "600 rows selected.", "(600 rows affected)", "600 rows in set (0.02 sec)"])
def test_what_a_data_base_says_below_its_rows_is_no_lost_row(tmp_path, footer):
    plant = read(save(tmp_path, f"{wide()}\n{footer}\n"))
    assert "ragged_rows" not in codes(plant.warnings) and len(plant["FIC101"]) == ROWS
    assert "ragged_rows" in codes(read(save(tmp_path, f"{wide()}\n600,rows\n")).warnings)


def test_a_part_of_an_output_far_outside_its_range_is_told(tmp_path):
    first, *rows = wide().splitlines()
    place = first.split(",").index("FIC101.OP")
    cells = [row.split(",") for row in rows]
    for row in cells[300:400]:
        row[place] = f"{10 * float(row[place]):g}"
    record = read(save(tmp_path, "\n".join([first, *map(",".join, cells)])))["FIC101"]
    (told,) = [note for note in record.notes if note.code == "op_beyond"]
    assert told.values == {"samples": 100.0, "effect": "limits"}


def test_an_order_that_is_stated_for_dates_that_are_turned_on_the_way_is_doubted(tmp_path):
    """The 3rd of May as month and day, and the 4th, from midnight on, as day and month."""
    clocks = iter([dt.datetime(2026, 5, 4) + timedelta(seconds=i - ROWS // 2) for i in range(ROWS)])
    text = wide(lambda t: (at := next(clocks)).strftime(f"{'%m/%d' if at.day == 3 else '%d/%m'}/%Y %H:%M:%S"))
    plant = read(save(tmp_path, text), options=ReadOptions(time_format="mdy"))
    assert "dates_turned" in codes(plant["FIC101"].notes)


def test_two_files_that_contradict_each_other_where_they_overlap_are_refused(tmp_path):
    first, *rows = wide().splitlines()
    place = first.split(",").index("FIC101.PV")
    cells = [row.split(",") for row in rows]
    save(tmp_path, "\n".join([first, *map(",".join, cells[:400])]), "day1.csv")
    for row in cells[300:]:
        row[place] = f"{float(row[place]) + 20:g}"
    save(tmp_path, "\n".join([first, *map(",".join, cells[300:])]), "day2.csv")
    plant = read(tmp_path)
    assert [record.loop for record in plant] == ["PIC303"]
    assert [note.code for note in plant.failures] == ["files_differ"]


@pytest.mark.parametrize("times", ["numbers", "stamps"])
def test_times_that_bring_no_order_into_the_rows_are_refused(tmp_path, times):
    """Numbers of something else, or stamps that stand beside the rows of others; rows out of order alone are sorted."""
    rng = np.random.default_rng(4)
    rows = [f"{50 + 20 * np.sin(i / 40):.3f},{40 + 10 * np.cos(i / 40):.3f}" for i in range(600)]
    stamps = [f"2026-03-17T08:{i // 60:02}:{i % 60:02}" for i in range(600)]
    turn = rng.permutation(600)
    wrong = [f"{x:.6f}" for x in 1000.0 * rng.random(600)] if times == "numbers" else [stamps[i] for i in turn]
    for name, lines in (("wrong", zip(wrong, rows, strict=True)), ("turned", ((stamps[i], rows[i]) for i in turn))):
        (tmp_path / f"{name}.csv").write_text("Time,F.PV,F.OP\n" + "".join(f"{t},{row}\n" for t, row in lines))
    with pytest.raises(BacklashError, match="the time column is no time"):
        read(tmp_path / "wrong.csv")
    record = next(iter(read(tmp_path / "turned.csv")))
    assert np.corrcoef(record.measurement, [float(row.split(",")[0]) for row in rows])[0, 1] > 0.999999
