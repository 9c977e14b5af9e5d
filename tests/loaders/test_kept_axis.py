"""Stamps of wide files of many rows are understood some rows at a time, and are those of the file read whole."""

import pickle

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pa_parquet
import pytest

from backlash_cli.loaders import ReadOptions, kept_axis, lazy_tables, plain_csv, read, timecolumns
from backlash_cli.loaders.lazy_tables import Lazily, lazy_table
from backlash_cli.loaders.plant import open_plant
from backlash_cli.loaders.series import EvenAxis, LazyAxis
from tests.loaders.test_lazy import assert_same, read_lazily
from tests.loaders.test_long_tables import FORMS

ROWS = 7000
SETTINGS = "[defaults]\nK = 0.6\nTi = 8\npv_range = [0, 1]\nop_range = [0, 1]\n"
EXCEL = "excel"
APART = {"iso dates": ("%Y-%m-%d", "%H:%M:%S"), "german dates": ("%d.%m.%Y", "%H:%M:%S")}


@pytest.fixture(autouse=True)
def short_is_long(monkeypatch):
    monkeypatch.setattr(timecolumns, "LONG", 1000)
    monkeypatch.setattr(kept_axis, "PIECE", 900)
    monkeypatch.setattr(lazy_tables, "BLOCK", 40_000)
    monkeypatch.setattr(lazy_tables, "HEAD", 20_000)


def frame_of(form, change):
    """One loop over the hour that occurs twice in Berlin, written in one of many ways."""
    seconds = np.arange(ROWS) + np.where(np.arange(ROWS) >= 5400, -3600, 0)
    if change == "gap":
        seconds = np.delete(seconds, slice(3000, 3100))
    stamps = pd.DatetimeIndex(np.datetime64("2026-10-25T01:30:00", "s") + seconds)
    if form in APART:
        cells = {name: stamps.strftime(kind) for name, kind in zip(("date", "time"), APART[form], strict=True)}
    elif form == EXCEL:
        days = (stamps - pd.Timestamp("1899-12-30")) / pd.Timedelta(days=1)
        cells = {"time": [repr(day) for day in days]}
    else:
        cells = {"time": np.asarray(FORMS[form](stamps))}
    frame = pd.DataFrame(cells)
    if change == "blank":
        frame.loc[4000, "time"] = ""
    random = np.random.default_rng(2)
    for role in ("SP", "PV", "OP"):
        frame[f"A.{role}"] = np.char.mod("%.4f", random.uniform(0.4, 0.6, len(frame)))
    return frame


@pytest.mark.parametrize(("form", "change", "least"), [
    (form, change, (k + j) % 2 << 30) for k, form in enumerate((*FORMS, *APART, EXCEL))
    for j, change in enumerate(("", "gap", "blank", "header"))])
def test_stamps_of_long_files_are_those_of_the_file_read_whole(tmp_path, monkeypatch, form, change, least):
    monkeypatch.setattr(plain_csv, "LEAST", least)
    path = tmp_path / "plant.csv"
    lines = [";".join(row) for row in frame_of(form, change).to_numpy().tolist()]
    header = ";".join(frame_of(form, "").columns)
    if change == "header":
        lines.insert(5000, header)
    path.write_text("\n".join([header, *lines]), "utf-8")
    (tmp_path / "loops.toml").write_text(SETTINGS)
    for zone in ("Europe/Berlin", None):
        options = ReadOptions(timezone=zone, time_format="mdy" if form == "american" else None)
        assert_same(read(path, options=options), read_lazily(path, options))
        since = ReadOptions(timezone=zone, time_format=options.time_format, since="20min")
        assert_same(read(path, options=since), read_lazily(path, since))
        opened = open_plant(path, options=options, lazily=Lazily())
        axis = opened.recipes[0].series.roles["pv"][0].axis
        stays = isinstance(axis, (LazyAxis, EvenAxis))
        # numbers and dates with times of day apart are left to the whole read where a header stands between them
        assert stays or (change == "header" and form in ("epoch", "millis", "digits", "relative", EXCEL, *APART)) or (
            form in APART and (form == "german dates" or change == "blank"))


@pytest.mark.parametrize("form", ["iso", "german", "epoch", "iso dates"])
def test_another_process_reads_the_stamps_that_were_kept(tmp_path, form):
    path = tmp_path / "plant.csv"
    frame = frame_of(form, "gap")
    path.write_text("\n".join([";".join(frame.columns), *map(";".join, frame.to_numpy().tolist())]), "utf-8")
    (tmp_path / "loops.toml").write_text(SETTINGS)
    recipe = open_plant(path, options=ReadOptions(timezone="Europe/Berlin"), lazily=Lazily()).recipes[0]
    axis = recipe.axes()[0]
    assert isinstance(axis, LazyAxis)
    there = pickle.loads(pickle.dumps(axis))
    np.testing.assert_array_equal(there.micros, axis.micros)
    assert there.last() == axis.last() and there.notes == axis.notes


@pytest.mark.parametrize("zone", ["Europe/Berlin", "UTC", None])
@pytest.mark.parametrize("form", ["stamps", "even", "epoch", "floats"])
def test_stamps_of_long_parquet_files_are_read_by_row_groups(tmp_path, form, zone):
    seconds = np.arange(ROWS) + (0 if form == "even" else np.where(np.arange(ROWS) >= 5400, -3600, 0))
    stamps = np.datetime64("2026-10-25T01:30:00", "s") + seconds
    columns = {"time": stamps if form in ("stamps", "even") else stamps.astype(np.int64)}
    if form == "floats":
        columns["time"] = columns["time"].astype(float)
        columns["time"][5000] = np.nan
    random = np.random.default_rng(2)
    columns |= {f"A.{role}": random.uniform(0.4, 0.6, ROWS) for role in ("SP", "PV", "OP")}
    path = tmp_path / "plant.parquet"
    pa_parquet.write_table(pa.table(columns), path, row_group_size=900)
    (tmp_path / "loops.toml").write_text(SETTINGS)
    options = ReadOptions(timezone=zone)
    assert lazy_table(path, options, {}, Lazily()) is not None
    whole = read(path, options=options)
    assert_same(whole, read_lazily(path, options))
    local = zone == "Europe/Berlin" and form in ("stamps", "even")
    assert any(note.code == "dst_repeated_hour" for note in whole.records[0].notes) == (local or form != "even")


def test_numbers_whose_unit_is_not_clear_are_seen_as_a_whole(tmp_path):
    steps = np.where(np.arange(ROWS) < 3000, 1.0, 5e8)  # seconds that come to look like those since 1970
    path = tmp_path / "plant.csv"
    rows = "".join(f"{t!r},0.5,{k % 7 / 10},{k % 5 / 10}\n" for k, t in enumerate(np.cumsum(steps).tolist()))
    path.write_text("seconds,A.SP,A.PV,A.OP\n" + rows, "utf-8")
    (tmp_path / "loops.toml").write_text(SETTINGS)
    opened = open_plant(path, lazily=Lazily())
    assert type(opened.recipes[0].series.roles["pv"][0].axis).__name__ == "Axis"
