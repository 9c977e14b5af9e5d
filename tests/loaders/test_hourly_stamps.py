"""Time stamps understood once an hour are those that are understood row by row."""

from datetime import datetime, timedelta

import numpy as np
import pyarrow as pa
import pytest

from backlash_cli.loaders import ReadOptions, lazy_tables, plain_csv
from backlash_cli.loaders.hourly_stamps import HourlyStamps, Hours, as_written, by_hours
from backlash_cli.loaders.stamp_kernel import NOT_ONE_FORM, copy_cells, hours_apart
from backlash_cli.loaders.text_blocks import PAD
from backlash_cli.loaders.times import to_times
from tests.loaders.test_lazy import assert_same, outcome, read, read_lazily

START = datetime(2026, 3, 16, 22, 30)
FORMS = ("%Y-%m-%d %H:%M:%S", "%Y-%m-%dT%H:%M:%SZ", "%Y-%m-%dT%H:%M:%S.%f", "%Y-%m-%d %H:%M:%S+02:00", "%Y-%m-%d %H:%M",
         "%d.%m.%Y %H:%M:%S", "%m/%d/%Y %I:%M:%S %p", "%d-%b-%y %H:%M:%S", "%d/%m/%Y:%H:%M:%S", "%d.%m.%Y %H:%M:%S,%f",
         "%Y/%m/%d %H:%M:%S.%f", "%H:%M:%S", "%H:%M:%S %d.%m.%Y", "%Y%m%dT%H%M%S", "%A, %d %B %Y %H:%M:%S")
CHANGES = ("none", "gap", "blank", "other form", "back")


def apart(texts, most=None):
    data = "".join(f"{text}\n" for text in texts).encode()
    ends = np.cumsum([len(text) + 1 for text in texts])
    cells = np.column_stack([ends - [len(text) + 1 for text in texts], ends - 1])
    which, nanos = np.zeros(len(texts), np.int64), np.zeros(len(texts), np.int64)
    hours = np.zeros(len(data), np.uint8)
    padded = np.frombuffer(data + bytes(PAD), np.uint8).copy()
    groups, written = hours_apart(padded, cells, len(texts) if most is None else most, which, nanos, hours)
    out = np.zeros(len(data), np.uint8)
    assert bytes(out[: copy_cells(padded, cells[:, None], ord(","), out)]) == data
    return groups, bytes(hours[:written]).decode().splitlines(), which, nanos


def stamps(form, rows, seconds):
    return [(START + timedelta(seconds=k * seconds)).strftime(form) for k in range(rows)]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("seconds", [1, 7.25, 60])
def test_stamps_are_put_together_again_as_they_were(form, seconds):
    texts = stamps(form, 3000, seconds)
    groups, hours, which, nanos = apart(texts)
    if "%H%M" in form:
        assert groups == NOT_ONE_FORM
        return
    column = HourlyStamps([Hours(pa.array(hours), which, nanos)])
    assert column.arrow().to_pylist() == texts
    assert groups == len({(START + timedelta(seconds=k * seconds)).strftime("%d %H") for k in range(3000)})
    options = ReadOptions(time_format="mdy" if form.startswith("%m") else None)
    whole = outcome(to_times, pa.array(texts), "time", options, "")
    apart_again = outcome(to_times, column, "time", options, "")
    assert apart_again == whole if isinstance(whole, str) else np.array_equal(apart_again.micros, whole.micros)


@pytest.mark.parametrize("odd", ["", "08:61:00", "08:00:60", "08:00:0", "8:00", "x", "08:00:00.1234567890", "08:00:001",
                                 "0:00", ":00:00", "99", "08:00-00"])
def test_what_is_no_clock_is_left_to_others(odd):
    texts = ["08:00:00", "08:00:01", odd]
    groups, hours, which, nanos = apart(texts)
    if groups != NOT_ONE_FORM:
        assert HourlyStamps([Hours(pa.array(hours), which, nanos)]).arrow().to_pylist() == texts
    assert apart(["08:00:00", "09:00:00"], most=1)[0] == NOT_ONE_FORM


@pytest.mark.parametrize(("form", "change"),
                         [(form, CHANGES[(k + j) % 5]) for k, form in enumerate(FORMS) for j in (0, 2)])
def test_files_are_read_as_row_by_row(tmp_path, monkeypatch, form, change):
    texts = stamps(form, 4000, 2)
    if change == "gap":
        del texts[1700:2100]
    elif change == "blank":
        texts[2500] = ""
    elif change == "other form":
        texts[2500] = "17. March"
    elif change == "back":
        texts[2000:2300] = texts[1900:2200]
    values = np.random.default_rng(3).uniform(0.4, 0.6, len(texts))
    path = tmp_path / "plant.csv"
    rows = (f"{text};0.5;{x:.4f};{1 - x:.4f}" for text, x in zip(texts, values, strict=True))
    path.write_text("\n".join(["time;A.SP;A.PV;A.OP", *rows]), encoding="utf-8")
    (tmp_path / "loops.toml").write_text("[defaults]\nK = 0.6\nTi = 8\npv_range = [0, 1]\nop_range = [0, 1]\n")
    for name, value in (("BLOCK", 25_000), ("HEAD", 10_000)):
        monkeypatch.setattr(lazy_tables, name, value)
    monkeypatch.setattr(plain_csv, "LEAST", 0)
    options = ReadOptions(time_format="mdy" if form.startswith("%m") else None)
    assert_same(outcome(lambda p: read(p, options=options), path), outcome(read_lazily, path, options))


def test_a_form_says_whether_its_minutes_can_be_found():
    assert by_hours(None) and by_hours("dmy") and by_hours("%d/%m/%Y %H:%M:%S")
    assert not by_hours("%d/%m/%Y %M:%H")


def test_rows_that_were_not_taken_apart_stand_among_the_others():
    column = HourlyStamps([as_written(pa.chunked_array([["17.03.2026 08:59:58", None]])),
                            Hours(pa.array(["17.03.2026 09:00:00"]), np.array([0, 0]), np.array([0, 2_000_000_000]))])
    assert column.arrow().to_pylist() == ["17.03.2026 08:59:58", None, "17.03.2026 09:00:00", "17.03.2026 09:00:02"]
    times = to_times(column, "time", ReadOptions(), "")
    assert np.diff(times.micros[[0, 2, 3]]).tolist() == [2_000_000, 2_000_000] and len(column) == 4
