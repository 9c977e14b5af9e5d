"""However a file is cut into blocks, and whatever of it stays in memory, the records are the same.

Chunks of a long loop put together are its record. Exports of every kind are read both ways where they are listed.
"""

import gc
import os
import pickle
import resource
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from backlash_cli import scratch
from backlash_cli.api import scan_files
from backlash_cli.errors import BacklashError
from backlash_cli.loaders import Plant, ReadOptions, clean, opening, read, signals, tables
from backlash_cli.loaders.plant import open_plant
from backlash_cli.loaders.signals import Store
from backlash_cli.record import SampleState, failure
from backlash_cli.scanning import ScanOptions
from backlash_cli.scratch import Room
from tests.small_plant import records, write_plant

START = np.datetime64("2026-10-25T00:00:00", "ms")
LOOPS = "[defaults]\nK = 0.6\nTi = 8\npv_range = [0, 1]\nop_range = [0, 1]\n"
FORMS = {
    "iso": lambda t: t.strftime("%Y-%m-%dT%H:%M:%S"), "zoned": lambda t: t.strftime("%Y-%m-%d %H:%M:%SZ"),
    "german": lambda t: t.strftime("%d.%m.%Y %H:%M:%S"), "american": lambda t: t.strftime("%m/%d/%Y %I:%M:%S %p"),
    "parts": lambda t: t.strftime("%Y-%m-%d %H:%M:%S.%f").str[:-3],
    "epoch": lambda t: (t.as_unit("ms").asi8 // 1000).astype(str),
    "millis": lambda t: t.as_unit("ms").asi8.astype(str), "digits": lambda t: t.strftime("%Y%m%d%H%M%S"),
    "relative": lambda t: ((t.as_unit("ms").asi8 - START.astype(int)) / 1000.0).astype(str),
}
WORDS = ["", " ", "Bad", "I/O Timeout", "nan", "inf", "1,5", "AUTO", "MAN", "1e-3", "+2.5", "12 m3/h", '"3.5"', "-0.0"]
RANGES = "pv_range = [0, 1]\nop_range = [0, 1]\n"
SETTINGS = "K = 1.1\nTi = 12.0\n"
quick = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def read_in(path, options=None, room=0, block=3001, head=400):
    """Read a plant in small blocks, with so much room in memory."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(opening, "BLOCK", max(block, 1000))
        patch.setattr(opening, "CHUNK", block)
        patch.setattr(opening, "HEAD_LINES", head)
        patch.setattr(opening, "JOINED", min(opening.JOINED, head // 2))
        patch.setattr(opening, "HEAD_SIZE", 1)
        patch.setattr(tables, "TOGETHER", 5 * block)  # some blocks are stored as one piece
        opened = open_plant(path, options=options, room=Room(room))
        found, lost = [], []
        for recipe in opened.recipes:
            try:
                found.append(recipe.record())
            except BacklashError as error:
                lost.append(failure(error, loop=recipe.loop))
    lost = opened.all_lost(lost, read=len(found))
    return Plant(tuple(found), opened.warnings, (*opened.failures, *lost), opened.inputs)


def outcome(reader, *args):
    try:
        return reader(*args)
    except BacklashError as error:
        return str(error)


def assert_same(whole, lazy):
    """Only the line of the first bad row may be unknown in blocks."""
    if isinstance(whole, str) or isinstance(lazy, str):
        assert whole == lazy
        return
    assert [r.loop for r in whole] == [r.loop for r in lazy]
    assert [n.code for n in whole.warnings] == [n.code for n in lazy.warnings] and whole.failures == lazy.failures
    for a, b in zip(whole, lazy, strict=True):
        assert (a.start, a.interval, a.settings, a.notes) == (b.start, b.interval, b.settings, b.notes)
        for name in ("index", "setpoint", "measurement", "output", "state"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=f"{a.loop} {name}")


@st.composite
def csv_text(draw):
    """A wide CSV of two loops with now and then a cell, a row or a stamp that is out of the ordinary."""
    rows = draw(st.integers(12, 120))
    seed = draw(st.integers(0, 2**32 - 1))
    random = np.random.default_rng(seed)
    values = np.round(random.uniform(0.2, 0.8, (rows, 6)), draw(st.sampled_from([2, 4, 17])))
    cells = [[repr(v) for v in row] for row in values.tolist()]
    for row, column, word in draw(st.lists(st.tuples(st.integers(0, rows - 1), st.integers(0, 5),
                                                     st.sampled_from(WORDS)), max_size=6)):
        cells[row][column] = word
    seconds = np.arange(rows)
    at = draw(st.integers(1, rows - 1))
    seconds[at:] += draw(st.sampled_from([0, 0, -1, 1, 30, 4000]))
    form = draw(st.sampled_from(["s", "ms", "epoch"]))
    stamps = (np.datetime64("2026-03-17T08:00:00", "ms") + 1000 * seconds).astype("datetime64[ms]")
    times = [str(s) if form == "epoch" else str(t) for s, t in
             zip(1773734400 + seconds, np.datetime_as_string(stamps, unit="s" if form == "s" else "ms"), strict=True)]
    lines = ["time,A.SP,A.PV,A.OP,B.SP,B.PV,B.OP", *(",".join([t, *row]) for t, row in zip(times, cells, strict=True))]
    for place in draw(st.lists(st.integers(10, rows), max_size=2)):
        lines.insert(place, draw(st.sampled_from(["", "1,2,3", lines[0], "," * 9])))
    return draw(st.sampled_from(["\n", "\r\n"])).join(lines) + draw(st.sampled_from(["", "\n"]))


@quick
@given(text=csv_text(), size=st.integers(60, 4000), memory=st.sampled_from([0, 1000, 1 << 30]))
def test_blocks_of_any_size_give_the_records_of_the_whole_file(tmp_path, text, size, memory):
    path = tmp_path / "plant.csv"
    path.write_text(text, encoding="utf-8", newline="")
    (tmp_path / "loops.toml").write_text(LOOPS)
    assert_same(outcome(read, path), outcome(lambda: read_in(path, None, memory, size, 20)))


def test_what_is_said_of_a_loop_does_not_hang_on_the_loop_read_before(tmp_path):
    """Two rows have one stamp; PV differs there in one loop and not in the other."""
    rows = [f"2026-03-17T08:00:{max(k - 1, 0):02d},1,{k % 7},2,1,{max(k - 1, 0) % 5},2" for k in range(30)]
    path = tmp_path / "plant.csv"
    path.write_text("\n".join(["time,A.SP,A.PV,A.OP,B.SP,B.PV,B.OP", *rows]))
    plant = read(path)
    told = {loop: next(n for n in plant[loop].notes if n.code == "duplicate_times").values for loop in ("A", "B")}
    assert told == {"A": {"rows": 1.0, "conflicts": 1.0}, "B": {"rows": 1.0, "conflicts": 0.0}}


@st.composite
def long_text(draw):
    """A long CSV of two loops, in time order or tag by tag, with now and then a cell or a stamp out of the ordinary."""
    rows = draw(st.integers(30, 120))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    tags = draw(st.sampled_from([["A.SP", "A.PV", "A.OP", "B.SP", "B.PV", "B.OP"], ["A.SP", "A.PV", "A.OP", "A.MODE"],
                                 ["A.PV", "A.SP", "B.PV", "one"]]))
    seconds = np.arange(rows)
    seconds += draw(st.sampled_from([0, 0, 7150, 10_750, 86_350]))  # the hour that occurs twice begins at 7200
    at = draw(st.integers(1, rows - 1))
    seconds[at:] += draw(st.sampled_from([0, 0, 0, -1, -3600, -3600, 30, 4000]))
    form = draw(st.sampled_from(list(FORMS)))
    stamps = pd.DatetimeIndex(START + 1000 * seconds)
    apart = draw(st.sampled_from(["", "", "%Y-%m-%d", "%d.%m.%Y", "%m/%d/%Y"]))
    clock = draw(st.sampled_from(["%H:%M:%S", "%I:%M:%S %p"]))
    times = {"date": stamps.strftime(apart), "time": stamps.strftime(clock)} if apart else {"time": FORMS[form](stamps)}
    frame = pd.DataFrame({
        "tag": np.tile(tags, rows),
        **{name: np.repeat(np.asarray(cells), len(tags)) for name, cells in times.items()},
        "value": np.round(random.uniform(0.2, 0.8, rows * len(tags)), draw(st.sampled_from([2, 4, 17]))).astype(str),
    })
    mode = (frame["tag"] == "A.MODE").to_numpy()
    frame.loc[mode, "value"] = random.choice(["AUTO", "AUTO", "MAN"], mode.sum())
    if draw(st.booleans()):
        usual, other = draw(st.sampled_from([("Good", "Bad"), ("192", "0"), ("Good", ""), ("", "Bad")]))
        frame["quality"] = usual
        frame.loc[random.choice(len(frame), 5), "quality"] = other
    for column, words in (("value", WORDS), ("time", ["", "time", "never"]), ("tag", ["", "NA", "A.PV ", "C.PV"])):
        for row, word in draw(st.lists(st.tuples(st.integers(10, len(frame) - 1), st.sampled_from(words)), max_size=3)
                              if draw(st.booleans()) else st.just([])):
            frame.loc[row, column] = word
    if draw(st.booleans()):
        frame = frame.sort_values("tag", kind="stable")
    if draw(st.booleans()):
        frame = frame.drop(index=random.choice(len(frame), 7))
    lines = [",".join(frame.columns), *(",".join(row) for row in frame.to_numpy().tolist())]
    for place in draw(st.lists(st.integers(10, len(lines) - 1), max_size=1)):
        lines.insert(place, draw(st.sampled_from(["", "1,2", lines[0], "," * 9])))
    return "\n".join(lines) + draw(st.sampled_from(["", "\n"]))


@quick
@given(text=long_text(), size=st.integers(60, 4000), memory=st.sampled_from([0, 1000, 1 << 30]),
       options=st.sampled_from([{}, {}, {"since": "20s"}, {"only_loops": ("A",)}, {"timezone": "Europe/Berlin"}]))
def test_rows_of_tags_in_blocks_of_any_size_give_the_records_of_the_whole_file(tmp_path, text, size, memory, options):
    path = tmp_path / "plant.csv"
    path.write_text(text, encoding="utf-8", newline="")
    (tmp_path / "loops.toml").write_text(LOOPS)
    reading = ReadOptions(**options)
    assert_same(outcome(lambda: read(path, options=reading)),
                outcome(lambda: read_in(path, reading, memory, size, 20)))


def loop_export(folder, suffix="csv", loops=f"[defaults]\n{SETTINGS}{RANGES}", **changed):
    """One loop of the small plant; `changed` replaces some cells of a signal."""
    record = records()[0]
    columns = {"SP": record.setpoint, "PV": np.round(record.measurement, 5), "OP": np.round(record.output, 5)}
    for role, change in changed.items():
        columns[role] = change(columns[role].copy())
    start = np.datetime64("2026-03-17T08:00:00", "s")
    table = pa.table({"time": pa.array(start + np.arange(len(record)))}
                     | {f"FIC101.{role}": values for role, values in columns.items()})
    path = folder / f"plant.{suffix}"
    if suffix == "csv":
        pa_csv.write_csv(table, path)
    else:
        pa_parquet.write_table(table, path, row_group_size=900)
    (folder / "loops.toml").write_text(loops, "utf-8")
    return path


def put(first, last, value):
    def change(values):
        values[first:last] = value
        return values
    return change


def holes(values):
    values = values.copy()
    values[[100, 101, 102, 800, 6000]] = np.nan
    values[3000:3040] = np.nan
    return values


def noisy(values):
    return np.round(values + 0.01 * np.random.default_rng(8).standard_normal(len(values)), 5)


CHANGES = {
    "plain": {}, "at the limit": {"OP": put(695, 705, 1.0)}, "nearly": {"OP": put(699, 701, 0.0)},
    "still for a while": {"PV": put(695, 702, 0.5)}, "blank": {"PV": put(800, 802, np.nan), "OP": holes, "SP": holes},
    "mostly blank OP": {"OP": put(100, 4000, np.nan)}, "no output": {"OP": put(0, None, np.nan)},
    "frozen": {"PV": put(600, 2800, 0.5)}, "frozen at the end": {"PV": put(5000, None, 0.5)},
    "frozen for a while": {"PV": lambda x: put(690, 760, 0.5)(noisy(x))},
    "late": {"SP": put(0, 1900, np.nan), "OP": put(0, 1900, np.nan)}, "late PV": {"PV": put(0, 1900, np.nan)},
    "spike": {"PV": put(50, 51, 7.0)}, "spikes": {"PV": put(695, 705, 7.0)}, "far outside": {"PV": put(0, 5000, 7.0)},
}


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
@pytest.mark.parametrize("name", CHANGES)
def test_chunks_put_together_are_the_record(tmp_path, monkeypatch, suffix, name):
    monkeypatch.setattr(clean, "CHUNK", 1500)
    monkeypatch.setattr(clean, "MARGIN", 200)
    monkeypatch.setattr(signals, "PIECE", 700)
    recipe = open_plant(loop_export(tmp_path, suffix, **CHANGES[name])).recipes[0]
    whole, parts = recipe.record(), list(recipe.chunks())
    assert recipe.is_long() and len(parts) == 5
    together = {field: None if parts[0].output is None and field == "output" else
                np.concatenate([getattr(part, field) for part in parts])
                for field in ("index", "setpoint", "measurement", "output", "state")}
    assert np.array_equal(together["index"], whole.index) and parts[0].settings == whole.settings
    if name == "frozen for a while":  # noise is judged chunk by chunk
        return
    for field, values in together.items():
        want = getattr(whole, field)
        if field == "state" and name.startswith("frozen"):
            # whether a signal without noise stands still is judged chunk by chunk
            assert np.mean(values != want) < 0.35 and np.any(values == SampleState.FROZEN)
            continue
        if want is not None and values is not None:
            np.testing.assert_array_equal(values, want, err_msg=field)
    assert not any(part.notes for part in parts[:-1])
    if not name.startswith("frozen"):
        assert {n.code: n.message for n in parts[-1].notes} == {n.code: n.message for n in whole.notes}


@pytest.mark.parametrize("hours", [600, 1700])
def test_chunks_over_many_files_are_the_record(tmp_path, monkeypatch, hours):
    """A file for each part of the time, and SP in files of its own that are far between; few rows of few files are
    looked at for a chunk."""
    whole_file = loop_export(tmp_path, "csv")
    rows = pd.read_csv(whole_file, dtype=str)
    (folder := tmp_path / "set").mkdir()
    time, sp = rows.columns[0], next(name for name in rows.columns if name.endswith("SP"))
    for first in range(0, len(rows), hours):
        rows[first : first + hours].drop(columns=sp).to_csv(folder / f"{first:05}.csv", index=False)
    for first in range(0, len(rows), 3 * hours):
        rows[first : first + 3 * hours : 40][[time, sp]].to_csv(folder / f"sp{first:05}.csv", index=False)
    monkeypatch.setattr(clean, "CHUNK", 1500)
    monkeypatch.setattr(clean, "MARGIN", 200)
    recipe = open_plant(folder, loops=tmp_path / "loops.toml").recipes[0]
    assert recipe.is_long()
    read, usual = [], signals.Axis.cells
    monkeypatch.setattr(signals.Axis, "cells", lambda axis, column: read.append(len(axis)) or usual(axis, column))
    parts = list(recipe.chunks())
    assert 1 < len(parts) < 8 and sum(read) < 4 * len(rows)
    for field in ("index", "setpoint", "measurement", "output"):
        np.testing.assert_array_equal(np.concatenate([getattr(part, field) for part in parts]),
                                      getattr(recipe.record(), field), err_msg=field)


@pytest.mark.parametrize("bad, codes", [((3000, 4300), [1, 0]), ((-1, 1200), [7, 3])])
def test_what_is_recorded_seldom_holds_from_chunk_to_chunk(tmp_path, monkeypatch, bad, codes):
    """A setpoint and a mode written on change; a status of 0 and 1 that is bad for most of a later chunk, and one whose
    code is another in the first chunk than in all others."""
    record = records()[0]
    rows = len(record)
    status = np.where((np.arange(rows) > bad[0]) & (np.arange(rows) < bad[1]), codes[1], codes[0])
    mode, setpoint = np.full(rows, ""), np.full(rows, "")
    mode[[0, 2000, 5500]] = ["AUTO", "MAN", "AUTO"]
    setpoint[[0, 2500]] = ["0.5", "0.6"]
    pd.DataFrame({"time": np.datetime64("2026-03-17T08:00:00", "s") + np.arange(rows), "A.SP": setpoint,
                  "A.PV": np.round(record.measurement, 5), "A.PV.Status": status, "A.OP": np.round(record.output, 5),
                  "A.MODE": mode}).to_csv(tmp_path / "plant.csv", index=False)
    (tmp_path / "loops.toml").write_text(LOOPS)
    monkeypatch.setattr(clean, "CHUNK", 1000)
    monkeypatch.setattr(clean, "MARGIN", 100)
    recipe = open_plant(tmp_path / "plant.csv").recipes[0]
    whole, parts = recipe.record(), list(recipe.chunks())
    for field in ("index", "setpoint", "measurement", "output", "state"):
        np.testing.assert_array_equal(np.concatenate([getattr(part, field) for part in parts]), getattr(whole, field),
                                      err_msg=field)
    assert {n.code: n.message for n in parts[-1].notes} == {n.code: n.message for n in whole.notes}
    assert np.array_equal(np.unique(whole.state), [SampleState.GOOD, SampleState.MISSING, SampleState.MANUAL])


def jittered(seconds, random):
    return seconds + 0.06 * random.standard_normal(len(seconds))


def compressed(seconds, random):
    return seconds[random.random(len(seconds)) < 0.4]


def with_gaps(seconds, random):
    return seconds[(seconds % 900 > 20) & ((seconds < 3000) | (seconds > 3300))]


def drifting(seconds, random):
    return 1.0003 * seconds


@pytest.mark.parametrize("change", [jittered, compressed, with_gaps, drifting])
@pytest.mark.parametrize("layout", ["wide", "long"])
def test_chunks_of_irregular_stamps_are_the_record(tmp_path, monkeypatch, change, layout):
    random = np.random.default_rng(5)
    seconds = np.round(np.sort(change(np.arange(7000.0), random)), 3)
    record = records()[0]
    stamps = np.datetime64("2026-03-17T08:00:00", "ms") + np.round(1000 * seconds).astype(int)
    rows = np.clip(seconds.astype(int), 0, len(record) - 1)
    frame = pd.DataFrame({"time": stamps, "A.SP": record.setpoint[rows], "A.PV": record.measurement[rows],
                          "A.OP": record.output[rows]})
    if layout == "long":
        frame = frame.melt("time", var_name="tag").sort_values("time", kind="stable")
        frame = frame[(frame["tag"] != "A.SP") | (np.arange(len(frame)) % 50 < 3)]
    frame.to_csv(tmp_path / "plant.csv", index=False)
    (tmp_path / "loops.toml").write_text(LOOPS)
    monkeypatch.setattr(clean, "CHUNK", 1500)
    monkeypatch.setattr(clean, "MARGIN", 200)
    recipe = open_plant(tmp_path / "plant.csv").recipes[0]
    assert recipe.is_long()
    whole, parts = recipe.record(), list(recipe.chunks())
    for field in ("index", "setpoint", "measurement", "output"):
        np.testing.assert_allclose(np.concatenate([getattr(part, field) for part in parts]), getattr(whole, field),
                                   rtol=1e-12, err_msg=field)


def test_the_report_of_a_loop_in_chunks_is_that_of_the_whole(tmp_path, monkeypatch):
    path = loop_export(tmp_path)
    want = scan_files(path, options=ScanOptions(confirm=False), jobs=1).loops[0]
    monkeypatch.setattr(clean, "CHUNK", 1500)
    found = scan_files(path, options=ScanOptions(confirm=False), jobs=1).loops[0]
    assert (found.verdict, found.half_periods, found.detections) == (want.verdict, want.half_periods, want.detections)
    assert found.samples == want.samples and found.warnings == want.warnings


def scratch_files():
    """Those of this process that are open; libraries open files and pipes of their own when they please."""
    links = [os.readlink(link) for link in Path("/proc/self/fd").iterdir() if link.is_symlink()]
    return [link for link in links if link.startswith(tempfile.gettempdir()) and link.endswith("(deleted)")]


def test_what_does_not_fit_goes_to_one_file_that_leaves_nothing_behind(tmp_path):
    gc.collect()
    before = len(scratch_files())
    opened = open_plant(write_plant(tmp_path), room=Room(0))
    assert len(scratch_files()) == before + 1
    sent = pickle.loads(pickle.dumps(opened.recipes))
    for own, other in zip(opened.recipes, sent, strict=True):
        assert np.array_equal(own.record().measurement, other.record().measurement)
    del opened, sent, own, other
    gc.collect()
    assert len(scratch_files()) == before


def test_where_a_file_needs_a_name_it_is_gone_with_the_plant(tmp_path, monkeypatch):
    there = scratch.os.path.isdir  # as where no /proc is
    monkeypatch.setattr(scratch.os.path, "isdir", lambda path: not str(path).startswith("/proc") and there(path))
    monkeypatch.setattr(scratch.tempfile, "tempdir", str(tmp_path))
    (tmp_path / "plant").mkdir()
    want = read(write_plant(tmp_path / "plant"))
    opened = open_plant(tmp_path / "plant", room=Room(0))
    assert len(list(tmp_path.glob("backlash-*"))) == 1
    for recipe in pickle.loads(pickle.dumps(opened.recipes)):
        assert np.array_equal(recipe.record().measurement, want[recipe.loop].measurement)
    del opened, recipe
    gc.collect()
    assert not list(tmp_path.glob("backlash-*"))


def test_what_is_in_memory_can_be_sent_to_another_process(tmp_path):
    recipes = open_plant(write_plant(tmp_path)).recipes
    want = [recipe.record().measurement.copy() for recipe in recipes]
    sent = pickle.loads(pickle.dumps(recipes))
    assert all(np.array_equal(a, recipe.record().measurement) for a, recipe in zip(want, sent, strict=True))


def test_a_folder_of_more_files_than_may_be_open_is_read(tmp_path):
    stamps = np.datetime_as_string(np.datetime64("2026-03-17T08:00:00", "s") + np.arange(30))
    for k in range(80):
        rows = "".join(f"{t},0.5,{(k + i) % 7 / 10},{i % 5 / 10}\n" for i, t in enumerate(stamps.tolist()))
        (tmp_path / f"L{k}.csv").write_text(f"time,L{k}.SP,L{k}.PV,L{k}.OP\n{rows}")
    whole = read(tmp_path)
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) + 30, limits[1]))
    try:
        found = read_in(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert_same(whole, found)


def test_a_full_disk_is_one_message(monkeypatch):
    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(scratch.tempfile, "TemporaryFile", full)
    with pytest.raises(BacklashError, match="No space left"):
        Room(0).spilled(np.ones(3))


@given(rows=st.lists(st.integers(0, 5), max_size=200), size=st.integers(1, 200), memory=st.sampled_from([0, 500]))
def test_a_store_gives_each_group_its_rows_in_order(rows, size, memory):
    store = Store(Room(memory), grouped=True)
    numbers = np.array(rows, np.int32)
    for first in range(0, len(rows), size):
        part = slice(first, first + size)
        store.add({"group": numbers[part], "x": np.arange(len(rows), dtype=float)[part]})
    for group in range(6):
        want = np.flatnonzero(numbers == group)
        assert store.rows(group).sum() == len(want)
        assert np.array_equal(store.read("x", 0, len(rows), group), want)
        assert np.array_equal(store.read("x", 2, 5, group), want[2:5])


def test_only_columns_of_wanted_loops_are_kept(tmp_path):
    path, room = write_plant(tmp_path), Room(1 << 30)
    opened = open_plant(path, options=ReadOptions(only_loops=("FIC*",)), room=room)
    assert [recipe.loop for recipe in opened.recipes] == ["FIC101"]
    assert (1 << 30) - room.left == 4 * 8 * 7200  # stamps and three signals


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16-le", "utf-16-be", "utf-32-le"])
def test_other_encodings_are_read_in_blocks(tmp_path, encoding):
    path = write_plant(tmp_path)
    plain = read(path)
    lines = path.read_text("utf-8").splitlines()
    lines = [line + (",Gerät" if k == 0 else ",°C" if k == 5000 else ",C") for k, line in enumerate(lines)]
    path.write_bytes(("\ufeff" * encoding.startswith("utf") + "\n".join(lines) + "\n").encode(encoding))
    found = read_in(path, block=100_000)
    assert any(note.code == "encoding" for note in found.warnings) == (encoding == "cp1252")
    for a, b in zip(plain, found, strict=True):
        assert np.array_equal(a.measurement, b.measurement)


@pytest.mark.parametrize("since", ["1min", "5min", "299s", "300s", "29min"])
def test_any_moment_of_a_parquet_gives_what_a_text_gives(tmp_path, since):
    source = write_plant(tmp_path, hours=0.5)
    pa_parquet.write_table(pa_csv.read_csv(source), tmp_path / "plant.parquet", row_group_size=300)
    a, b = (read(path, options=ReadOptions(since=since)) for path in (source, tmp_path / "plant.parquet"))
    assert_same(a, Plant(b.records, b.warnings, b.failures, a.inputs))


def test_a_header_again_among_epochs_and_blank_tags_begins_no_other_table(tmp_path):
    lines = ["tag,time,value", *(f"{loop}.{role},{1792886400 + k},{0.4 + 0.01 * (k % 7):.2f}" for k in range(30)
                                 for loop in "AB" for role in ("SP", "PV", "OP"))]
    lines[11], lines[90] = (line[line.index(",") :] for line in (lines[11], lines[90]))
    (tmp_path / "plant.csv").write_text("\n".join([*lines[:13], lines[0], *lines[13:]]))
    plant = read(tmp_path / "plant.csv")
    assert [(loop.loop, len(loop)) for loop in plant] == [("A", 30), ("B", 30)]
    assert not plant.failures and "passed_over" not in {note.code for note in plant.warnings}


@pytest.mark.parametrize("end", ["\n", ""])
@pytest.mark.parametrize("place", [0, 100, 30_000, 59_999])
def test_a_line_longer_than_what_is_parsed_at_once(tmp_path, place, end):
    lines = [f"2026-03-17 {k // 3600:02d}:{k // 60 % 60:02d}:{k % 60:02d},50,{50 + k % 7 / 10},{40 + k % 11}," for k in
             range(60_000)]
    lines[place] += 3_000_000 * "x"
    (tmp_path / "plant.csv").write_text("\n".join(["time,FIC101.SP,FIC101.PV,FIC101.OP,Remark", *lines]) + end)
    (loop,) = read(tmp_path / "plant.csv")
    assert np.array_equal(loop.index, np.arange(60_000))


def test_blocks_of_long_lines_hold_more_of_them(monkeypatch):
    monkeypatch.setattr(opening, "BLOCK", 1 << 16)
    for line, rows in ((100, 2000), (1000, 262), (10_000, 26)):
        blocks = [*opening.lines_together([(line - 1) * b"x" + b"\n"] * 4000)]
        counts = [block.count(b"\n") for block in blocks]
        assert sum(counts) == 4000 and rows <= counts[1] <= 2 + rows, (line, counts[:3])
