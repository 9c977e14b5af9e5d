"""Long files read block by block through the store give the records, notes and messages of long files read whole."""

import pickle
import threading

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from backlash_cli.api import open_files, scan
from backlash_cli.loaders import ReadOptions, fast_csv, lazy_tables, long_files, plain_csv, read, tag_store
from backlash_cli.loaders.lazy_tables import Lazily, lazy_table
from backlash_cli.loaders.long_tables import LongReader, LongTable
from backlash_cli.loaders.sources import find_sources
from backlash_cli.loaders.store import Room
from backlash_cli.loaders.survey import survey
from backlash_cli.loaders.tag_store import TagStore
from backlash_cli.scan import ScanOptions
from tests.loaders.test_lazy import assert_same, outcome, read_lazily
from tests.small_plant import records, write_plant

START = np.datetime64("2026-10-25T00:00:00", "ms")
SETTINGS = "[defaults]\nK = 0.6\nTi = 8\npv_range = [0, 1]\nop_range = [0, 1]\n"
FORMS = {
    "iso": lambda t: t.strftime("%Y-%m-%dT%H:%M:%S"), "zoned": lambda t: t.strftime("%Y-%m-%d %H:%M:%SZ"),
    "german": lambda t: t.strftime("%d.%m.%Y %H:%M:%S"), "american": lambda t: t.strftime("%m/%d/%Y %I:%M:%S %p"),
    "parts": lambda t: t.strftime("%Y-%m-%d %H:%M:%S.%f").str[:-3],
    "epoch": lambda t: (t.as_unit("ms").asi8 // 1000).astype(str),
    "millis": lambda t: t.as_unit("ms").asi8.astype(str), "digits": lambda t: t.strftime("%Y%m%d%H%M%S"),
    "relative": lambda t: ((t.as_unit("ms").asi8 - START.astype(int)) / 1000.0).astype(str),
}
WORDS = ["", " ", "Bad", "I/O Timeout", "nan", "inf", "1,5", "1e-3", "+2.5", "12 m3/h", '"3.5"', "-0.0", "AUTO"]


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


@given(text=long_text(), size=st.integers(60, 4000), memory=st.sampled_from([0, 1000, 1 << 30]),
       gathered=st.sampled_from([1, 50, 1 << 20]), compiled=st.sampled_from([0, 0, 1 << 30]),
       options=st.sampled_from([{}, {}, {"since": "20s"}, {"only_loops": ("A",)}, {"timezone": "Europe/Berlin"},
                                {"timezone": "Europe/Berlin"}]))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_blocks_of_any_size_give_the_records_of_the_whole_file(
    tmp_path, text, size, memory, gathered, compiled, options
):
    path = tmp_path / "plant.csv"
    path.write_text(text, encoding="utf-8", newline="")
    (tmp_path / "loops.toml").write_text(SETTINGS)
    reading = ReadOptions(**options)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lazy_tables, "BLOCK", size)
        patch.setattr(lazy_tables, "HEAD", 1000)
        patch.setattr(plain_csv, "LEAST", compiled)
        patch.setattr(tag_store, "GATHERED", gathered)
        assert_same(outcome(lambda: read(path, options=reading)),
                    outcome(read_lazily, path, reading, Lazily(room=Room(memory))))


def long_frame(**columns):
    """The first loops of the small plant as rows of tag, time and value, in time order."""
    made = records()[:2]
    values = {f"{r.loop}.{role}": x for r in made
              for role, x in (("SP", r.setpoint), ("PV", r.measurement), ("OP", r.output)) if x is not None}
    rows = len(made[0])
    table = {"tag": np.tile(list(values), rows),
             "time": np.repeat(np.datetime64("2026-03-17T08:00:00", "s") + np.arange(rows), len(values)),
             "value": np.round(np.column_stack(list(values.values())).ravel(), 6)}
    return pd.DataFrame(table | columns)


def write(path, frame):
    table = pa.Table.from_pandas(frame, preserve_index=False)
    if path.suffix == ".csv":
        pa_csv.write_csv(table, path)
    else:
        pa_parquet.write_table(table, path, row_group_size=9000)
    path.with_name("loops.toml").write_text(SETTINGS)
    return path


def lazily_long(path, options=None):
    found = lazy_table(path, options or ReadOptions(), {}, Lazily())
    assert isinstance(found, LongTable)
    return found


@pytest.mark.parametrize("form", FORMS)
def test_stamps_of_every_kind_are_read_block_by_block(tmp_path, monkeypatch, form):
    frame = long_frame()
    frame["time"] = np.asarray(FORMS[form](pd.DatetimeIndex(frame["time"])))
    path = write(tmp_path / "plant.csv", frame)
    monkeypatch.setattr(lazy_tables, "BLOCK", 100_000)
    monkeypatch.setattr(tag_store, "GATHERED", 10_000)
    lazily_long(path)
    assert_same(read(path), read_lazily(path))


@pytest.mark.parametrize("change", ["", "words", "quality", "numbers", "tags by category", "parts of names", "zone"])
def test_long_parquet_is_read_block_by_block(tmp_path, monkeypatch, change):
    frame = long_frame()
    random = np.random.default_rng(3)
    if change == "words":
        frame["value"] = frame["value"].astype(str).where(random.random(len(frame)) > 0.001, "Bad Input")
    elif change == "quality":
        frame["quality"] = random.choice(["Good", "Bad"], len(frame), p=[0.999, 0.001])
    elif change == "numbers":
        frame["value"], frame["quality"] = frame["value"].astype(np.float32), 192
    elif change == "tags by category":
        frame["tag"] = frame["tag"].astype("category")
    elif change == "parts of names":
        frame["loop"], frame["signal"] = frame["tag"].str.split(".").str[0], frame["tag"].str.split(".").str[1]
        del frame["tag"]
    elif change == "zone":
        frame["time"] = pd.DatetimeIndex(frame["time"]).tz_localize("Europe/Berlin")
    path = write(tmp_path / "plant.parquet", frame)
    monkeypatch.setattr(long_files, "BATCH_ROWS", 7001)
    monkeypatch.setattr(tag_store, "GATHERED", 10_000)
    lazily_long(path)
    assert_same(read(path), read_lazily(path))


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_rows_of_loops_are_read_block_by_block(tmp_path, monkeypatch, suffix):
    frames = [pd.DataFrame({"loop": r.loop, "time": np.datetime64("2026-03-17T08:00:00", "s") + np.arange(len(r)),
                            "SP": r.setpoint, "PV": r.measurement, "OP": r.output, "DV1": np.nan})
              for r in records()[:3]]
    path = write(tmp_path / f"plant.{suffix}", pd.concat(frames).sort_values("time", kind="stable"))
    monkeypatch.setattr(lazy_tables, "BLOCK", 100_000)
    monkeypatch.setattr(long_files, "BATCH_ROWS", 7001)
    lazily_long(path)
    assert_same(read(path), read_lazily(path))


@pytest.mark.parametrize("wrong", [False, True])
def test_a_header_between_the_rows_of_loops_is_no_loop(tmp_path, monkeypatch, wrong):
    frames = [pd.DataFrame({"loop": r.loop, "time": np.datetime64("2026-03-17T08:00:00", "s") + np.arange(len(r)),
                            "SP": r.setpoint, "PV": r.measurement, "OP": r.output}) for r in records()[:3]]
    path = write(tmp_path / "plant.csv", pd.concat(frames).sort_values("time", kind="stable"))
    lines = path.read_text("utf-8").splitlines()
    for place in (9000, 3000, 30):
        lines.insert(place, lines[0])
    if wrong:
        lines[5000] = lines[5000].split(",")[0] + ",never,1,2,3"
    path.write_text("\n".join(lines), encoding="utf-8")
    blocks_of(monkeypatch, 100_000)
    whole = read(path)
    assert (lazy_table(path, ReadOptions(), {}, Lazily()) is None) == wrong and not whole.failures
    assert_same(whole, read_lazily(path))
    assert sorted({item.loop for item in survey(find_sources(path)[0], ReadOptions()).series}) == [
        record.loop for record in whole]


def test_a_clock_that_was_set_back_goes_back_for_all_tags(tmp_path, monkeypatch):
    frame = long_frame()
    stamps = frame["time"].to_numpy().copy()
    stamps[len(frame) // 2 :] -= np.timedelta64(1800, "s")
    frame["time"] = stamps
    path = write(tmp_path / "plant.csv", frame)
    monkeypatch.setattr(lazy_tables, "BLOCK", 100_000)
    lazily_long(path)
    whole, lazy = read(path), read_lazily(path)
    assert_same(whole, lazy)
    assert any(note.code == "clock_set_back" for note in lazy.records[0].notes)
    since = ReadOptions(since="600s")
    assert_same(read(path, options=since), read_lazily(path, since))


def test_rows_of_tags_that_nobody_wants_are_not_stored(tmp_path):
    path = write(tmp_path / "plant.csv", long_frame())
    names = [record.loop for record in records()[:2]]
    options, room = ReadOptions(only_loops=(names[0],)), Room(1 << 30)
    assert_same(read(path, options=options), read_lazily(path, options, Lazily(room=room)))
    assert (1 << 30) - room.left == 3 * 7200 * 2 * 8


def test_what_only_the_whole_table_tells_is_left_to_the_whole_read(tmp_path):
    frame = long_frame()
    frame["time"] = frame["time"].astype(str)
    frame.loc[20_000, "time"] = "time 2"
    assert lazy_table(write(tmp_path / "plant.csv", frame), ReadOptions(), {}, Lazily()) is None


def blocks_of(monkeypatch, size):
    """Blocks of some lines, of files whose layout is found from few lines too."""
    monkeypatch.setattr(lazy_tables, "HEAD", min(size, 60_000))
    monkeypatch.setattr(lazy_tables, "BLOCK", size)
    monkeypatch.setattr(tag_store, "GATHERED", 10_000)


@pytest.mark.parametrize("often", [3, 9000])
@pytest.mark.parametrize("form", FORMS)
def test_a_header_may_stand_between_the_rows(tmp_path, monkeypatch, form, often):
    frame = long_frame()
    frame["time"] = np.asarray(FORMS[form](pd.DatetimeIndex(frame["time"])))
    path = write(tmp_path / "plant.csv", frame)
    lines = path.read_text("utf-8").splitlines()
    spots = range(1, 30_000, often) if often > 3 else range(40, 60, often)
    for place in reversed(spots):
        lines.insert(place, lines[0])
    path.write_text("\n".join(lines), encoding="utf-8")
    blocks_of(monkeypatch, 100_000)
    if form not in ("digits", "relative"):  # as texts these are something else
        lazily_long(path)
    assert_same(read(path), read_lazily(path))


@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
@pytest.mark.parametrize("header", [False, True])
@pytest.mark.parametrize("date", ["%Y-%m-%d", "%d.%m.%Y", "%m/%d/%Y"])
def test_dates_and_times_of_day_in_two_columns_are_read_block_by_block(tmp_path, monkeypatch, date, header, zone):
    frame = long_frame()
    stamps = pd.DatetimeIndex(frame.pop("time")) + pd.Timedelta(hours=15)  # past midnight
    frame.insert(0, "date", stamps.strftime(date))
    frame.insert(1, "time", stamps.strftime("%H:%M:%S"))
    path = write(tmp_path / "plant.csv", frame)
    if header:
        lines = path.read_text("utf-8").splitlines()
        path.write_text("\n".join([*lines[:20_000], lines[0], *lines[20_000:]]), encoding="utf-8")
    blocks_of(monkeypatch, 100_000)
    options = ReadOptions(timezone=zone)
    lazily_long(path, options)
    whole = read(path, options=options)
    assert_same(whole, read_lazily(path, options))
    assert whole.records[0].start == np.datetime64("2026-03-17T23:00:00", "s").astype(float) - (3600.0 if zone else 0.0)


def test_dates_and_times_of_day_of_a_parquet_are_read_block_by_block(tmp_path, monkeypatch):
    frame = long_frame()
    stamps = pd.DatetimeIndex(frame.pop("time"))
    frame["date"], frame["time"] = stamps.date, stamps.time
    monkeypatch.setattr(long_files, "BATCH_ROWS", 7001)
    path = write(tmp_path / "plant.parquet", frame)
    lazily_long(path)
    assert_same(read(path), read_lazily(path))


@pytest.mark.parametrize("sort", ["time", "tag"])
@pytest.mark.parametrize("form", FORMS)
def test_the_hour_that_occurs_twice_is_read_block_by_block(tmp_path, monkeypatch, form, sort):
    frame = long_frame()
    seconds = np.repeat(np.arange(7200), len(frame) // 7200)
    local = np.datetime64("2026-10-25T01:30:00", "s") + np.where(seconds < 5400, seconds, seconds - 3600)
    frame["time"] = np.asarray(FORMS[form](pd.DatetimeIndex(local)))
    path = write(tmp_path / "plant.csv", frame if sort == "time" else frame.sort_values("tag", kind="stable"))
    blocks_of(monkeypatch, 100_000)
    options = ReadOptions(timezone="Europe/Berlin")
    lazily_long(path, options)
    whole = read(path, options=options)
    assert_same(whole, read_lazily(path, options))
    if form in ("iso", "german", "american", "parts", "digits"):
        assert "dst_repeated_hour" in {note.code for note in whole.records[0].notes}
        assert len(whole.records[0]) == 7200


@pytest.mark.parametrize("form", FORMS)
def test_stamps_of_a_zone_are_read_block_by_block(tmp_path, form):
    frame = long_frame()
    frame["time"] = np.asarray(FORMS[form](pd.DatetimeIndex(frame["time"])))
    path = write(tmp_path / "plant.csv", frame)
    options = ReadOptions(timezone="America/Chicago")
    lazily_long(path, options)
    assert_same(read(path, options=options), read_lazily(path, options))


def test_loops_of_a_long_file_are_analysed_alike_in_several_processes(tmp_path):
    opened = open_files(write(tmp_path / "plant.csv", long_frame()))
    recipe = pickle.loads(pickle.dumps(opened.recipes[0]))
    np.testing.assert_array_equal(recipe.record().measurement, opened.recipes[0].record().measurement)
    options = ScanOptions(confirm=False)
    assert scan(opened, options, jobs=2) == scan(opened, options, jobs=1)


def test_stamps_are_given_back_after_each_loop(tmp_path):
    opened = open_files(write(tmp_path / "plant.csv", long_frame()))
    scan(opened, jobs=1)
    assert all(axis._order is None and axis._grid is None for recipe in opened.recipes for axis in recipe.axes())


@given(st.lists(st.tuples(st.integers(-1, 9), st.integers(0, 99)), max_size=60), st.integers(1, 20), st.integers(1, 30),
       st.sampled_from([0, 200, 1 << 20]))
@settings(max_examples=60, deadline=None)
def test_a_tag_store_gives_each_tag_its_rows_in_order(rows, size, gathered, memory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tag_store, "GATHERED", gathered)
        store = TagStore(Room(memory))
        codes, values = (np.array([row[k] for row in rows], kind) for k, kind in ((0, np.int32), (1, float)))
        for first in range(0, len(rows), size):
            cut = slice(first, first + size)
            store.add(codes[cut], [values[cut], -values[cut]])
        store.cut()
        for code in range(10):
            found = pickle.loads(pickle.dumps(store.tag(code)))
            assert found.rows == np.count_nonzero(codes == code)
            np.testing.assert_array_equal(found.column(0), values[codes == code])
            np.testing.assert_array_equal(found.column(1), -values[codes == code])


def test_the_next_batch_of_a_parquet_is_decoded_while_one_is_taken(tmp_path, monkeypatch):
    path = write(tmp_path / "plant.parquet", long_frame())
    monkeypatch.setattr(long_files, "BATCH_ROWS", 7001)
    decoded, taken = [], []
    make, take = pa_parquet.ParquetFile.iter_batches, LongReader.take
    following = threading.Condition()

    def batches(file, size, **kwargs):
        for batch in make(file, size, **kwargs):
            with following:
                decoded.append((size, threading.get_ident()))
                following.notify()
            yield batch

    def taking(reader, *args):
        taken.append(threading.get_ident())
        with following:  # the next one is decoded meanwhile
            assert following.wait_for(lambda: of_size() > min(len(taken), 6), 20.0)
        take(reader, *args)

    def of_size():
        return sum(size == 7001 for size, _ in decoded)

    expected = read(path)
    monkeypatch.setattr(pa_parquet.ParquetFile, "iter_batches", batches)
    monkeypatch.setattr(LongReader, "take", taking)
    assert_same(expected, read_lazily(path, None, Lazily(threads=2)))
    assert len(taken) == of_size() == 7 and set(taken) == {threading.get_ident()}
    assert {thread for size, thread in decoded if size == 7001}.isdisjoint(taken)


@pytest.mark.parametrize("layout", ["wide", "long"])
def test_two_blocks_of_a_csv_are_parsed_at_once_while_others_are_taken(tmp_path, monkeypatch, layout):
    path = write_plant(tmp_path) if layout == "wide" else write(tmp_path / "plant.csv", long_frame())
    monkeypatch.setattr(lazy_tables, "HEAD", 60_000)
    monkeypatch.setattr(lazy_tables, "BLOCK", 60_000)
    both, real, met = threading.Barrier(2), fast_csv.Layout.parse, []

    def parse(self, text):
        if not met:
            both.wait(20.0)  # goes on when a second block is being parsed
            met.append(True)
        return real(self, text)

    expected = read(path)
    monkeypatch.setattr(fast_csv.Layout, "parse", parse)
    assert_same(expected, read_lazily(path, None, Lazily(threads=2)))
    assert met
