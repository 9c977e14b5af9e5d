"""Long records made piece by piece are those made in one go: samples, states, notes and reports."""

import contextlib
import re

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from backlash_cli.api import open_files, scan
from backlash_cli.errors import BacklashError
from backlash_cli.loaders import ReadOptions, even, long_records, pieces, states, tag_store
from backlash_cli.loaders.long_records import long_record
from backlash_cli.record import SampleState
from backlash_cli.scan import ScanOptions
from tests.small_plant import records

SETTINGS = "K = 1.1\nTi = 12.0\n"
RANGES = "pv_range = [0, 1]\nop_range = [0, 1]\n"


@pytest.fixture(autouse=True)
def short_is_long(monkeypatch):
    monkeypatch.setattr(long_records, "LONG", 1000)
    monkeypatch.setattr(even, "LONG", 1000)
    monkeypatch.setattr(pieces, "PIECE", 700)


def export(folder, suffix="csv", loops=f"[defaults]\n{SETTINGS}{RANGES}", **changed):
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
    "spike": {"PV": put(50, 51, 7.0)}, "spikes": {"PV": put(695, 705, 7.0)}, "far outside": {"PV": put(0, 5000, 7.0)},
}


def assert_long(recipe, sizes=(500,)):
    """The record in blocks is the whole record; both are refused for the same reason."""
    try:
        whole = recipe.record()
    except BacklashError as error:
        with pytest.raises(type(error), match=re.escape(str(error))):
            long_record(recipe)
        return None
    long = long_record(recipe)
    assert long is not None
    for size in sizes:
        blocks = list(long.blocks(size))
        assert all(len(block) == size for block in blocks[:-1])
        for block in blocks:
            assert (block.loop, block.start, block.interval, block.settings) == (
                whole.loop, whole.start, whole.interval, whole.settings)
            assert block.notes == whole.notes
            assert (block.output is None) == (whole.output is None)
        for field in ("index", "setpoint", "measurement", "output", "state"):
            if getattr(whole, field) is not None:
                np.testing.assert_array_equal(np.concatenate([getattr(b, field) for b in blocks]),
                                              getattr(whole, field), err_msg=field)
    return whole


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
@pytest.mark.parametrize("name", CHANGES)
def test_a_long_record_is_the_whole_record(tmp_path, suffix, name):
    recipe = open_files(export(tmp_path, suffix, **CHANGES[name])).recipes[0]
    whole = assert_long(recipe, (500, 7200))
    if name == "at the limit":
        assert np.any(whole.state == SampleState.SATURATED)
    if name.startswith("frozen"):
        assert np.any(whole.state == SampleState.FROZEN)


@pytest.mark.parametrize("loops", ["[defaults]\nTi = 12.0\n", f"[defaults]\n{SETTINGS}", "", 'x = 1',
                                   f'[defaults]\n{SETTINGS}units = "engineering"\n'])
@pytest.mark.parametrize("scale", [1.0, 0.999, 100.0, 730.0])
def test_spans_are_guessed_alike(tmp_path, loops, scale):
    def spread(values):
        values = scale * values
        values[5000:5003] = 40.0 * scale
        return values

    path = export(tmp_path, loops=loops if loops != "x = 1" else "", PV=spread, SP=lambda x: scale * x,
                  OP=lambda x: (1.0 if loops == "x = 1" else 100.0) * x)
    assert_long(open_files(path).recipes[0])


@pytest.mark.parametrize("loops", [f"[defaults]\n{SETTINGS}{RANGES}", f"[defaults]\n{RANGES}"])
@pytest.mark.parametrize("confirm", [False, True])
def test_reports_of_long_and_whole_records_are_the_same(tmp_path, monkeypatch, loops, confirm):
    opened = open_files(export(tmp_path, loops=loops, OP=put(700, 790, 1.0), PV=put(300, 303, np.nan)))
    options = ScanOptions(confirm=confirm)
    assert long_record(opened.recipes[0]) is not None
    long = scan(opened, options, jobs=1)
    monkeypatch.setattr(long_records, "LONG", 1 << 20)
    assert long_record(opened.recipes[0]) is None
    assert long == scan(opened, options, jobs=1)


STAMPS = {
    "even": lambda t, r: t, "holes": lambda t, r: np.delete(t, r.choice(len(t), 200)),
    "gaps": lambda t, r: t + 5000 * (t > 1234) + 77 * (t > 3500),
    "jitter": lambda t, r: t + np.round(r.uniform(0.0, 0.4, len(t)), 3),
    "jitter and gaps": lambda t, r: t + np.round(r.uniform(0.0, 0.4, len(t)), 3) + 900.0 * (t > 2800),
    "compressed": lambda t, r: np.sort(r.choice(t, len(t) // 3, replace=False)),
    "from 5 to 1 s": lambda t, r: np.cumsum(np.where(t < 2000, 5, 1)),
}
QUALITIES = {"": ("", "", 0.0), "words": ("Good", "Bad", 0.01), "codes": ("192", "0", 0.01),
             "faults": ("", "Bad", 0.01), "changes": ("", "Good", 0.05)}
MODES = {"": "", "words": "AUTO MAN CAS", "numbers": "0 1", "fieldbus": "16 8", "odd": "AUTO 7 what", "blank": " "}


@st.composite
def loop_tables(draw):
    """One loop with everything that may be odd about it, as (form, columns of texts, stamps in seconds)."""
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    record = records()[0]
    seconds = STAMPS[draw(st.sampled_from(list(STAMPS)))](np.arange(4000.0), random)
    rows = len(seconds)
    scale = draw(st.sampled_from([1.0, 100.0]))
    columns = {"SP": record.setpoint, "PV": np.round(record.measurement, 5), "OP": np.round(record.output, 5)}
    columns = {role: np.char.mod("%.10g", scale * values[:rows]) for role, values in columns.items()}
    for role in draw(st.lists(st.sampled_from(["SP", "PV", "OP"]), unique=True)):
        at = draw(st.integers(0, rows - 1))
        values = columns[role] = columns[role].astype("U20")
        word = draw(st.sampled_from(["", "Bad Input", "0.5", "7000", "12 %"]))
        values[at : at + draw(st.sampled_from([1, 3, 30, 900]))] = word
        if draw(st.booleans()):
            share = draw(st.sampled_from([0.01, 0.4, 0.95]))
            values[random.random(rows) < share] = draw(st.sampled_from(["", "I/O Timeout"]))
    for role in draw(st.lists(st.sampled_from(["SP", "OP"]), max_size=1)):
        del columns[role]
    modes = MODES[draw(st.sampled_from(list(MODES)))]
    if modes:
        changes = np.cumsum(random.random(rows) < 0.002)
        columns["MODE"] = random.choice(modes.split() or [""], changes[-1] + 1)[changes].astype("U5")
        columns["MODE"][: draw(st.sampled_from([0, 50]))] = ""
        if draw(st.booleans()):
            columns["MODE"][np.flatnonzero(np.diff(changes, prepend=0) == 0)] = ""
    usual, other, share = QUALITIES[draw(st.sampled_from(list(QUALITIES)))]
    if share:
        columns["PV.STATUS"] = np.where(random.random(rows) < share, other, usual)
    return draw(st.sampled_from(["wide", "long", "parquet"])), columns, seconds


def write_table(folder, form, columns, seconds):
    stamps = np.datetime64("2026-03-17T08:00:00", "ms") + np.round(1000 * seconds).astype(int)
    path = folder / ("plant.parquet" if form == "parquet" else "plant.csv")
    if form == "parquet":
        table = {"time": pa.array(stamps)}
        for name, texts in columns.items():
            array = pa.array(texts.tolist(), pa.string())
            array = pc.if_else(pc.equal(array, ""), None, array)
            with contextlib.suppress(pa.ArrowInvalid):
                array = array.cast(pa.float64())
            table[f"A.{name}"] = array
        pa_parquet.write_table(pa.table(table), path, row_group_size=900)
    elif form == "wide":
        lines = [",".join(["time", *(f"A.{name}" for name in columns)])]
        lines += map(",".join, zip(np.datetime_as_string(stamps), *(x.tolist() for x in columns.values()), strict=True))
        path.write_text("\n".join(lines))
    else:
        names = [name for name in columns if name != "PV.STATUS"]
        marks = columns.get("PV.STATUS", np.full(len(stamps), ""))
        rows = [(f"A.{name}", t, value, mark) for t, mark, *values in
                zip(np.datetime_as_string(stamps), marks.tolist(), *(columns[n].tolist() for n in names), strict=True)
                for name, value in zip(names, values, strict=True) if value or name == "PV"]
        path.write_text("\n".join(["tag,time,value,quality", *map(",".join, rows)]))
    return path


@pytest.mark.parametrize("first", [1, 2000, 3999])
def test_a_setpoint_may_be_recorded_once(tmp_path, first):
    record = records()[0].slice(0, 4000)
    columns = {"SP": record.setpoint, "PV": record.measurement, "OP": record.output}
    columns = {role: np.char.mod("%.5f", values).astype("U20") for role, values in columns.items()}
    columns["SP"][:first] = ""
    path = write_table(tmp_path, "long", columns, np.arange(4000.0))
    (tmp_path / "loops.toml").write_text(f"[defaults]\n{SETTINGS}{RANGES}")
    assert_long(open_files(path).recipes[0])


@given(table=loop_tables(), interpolation=st.sampled_from([None, None, "hold", "linear"]),
       since=st.sampled_from([None, None, "3000s"]), ranges=st.booleans(), size=st.sampled_from([333, 5000]),
       constant=st.booleans(), gathered=st.sampled_from([2500, 1 << 20]))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_a_long_loop_holds_its_blocks_are_the_whole_record(
    tmp_path, table, interpolation, since, ranges, size, constant, gathered
):
    path = write_table(tmp_path, *table)
    spans = "pv_range = [0, 100]\nop_range = [0, 100]\n" if ranges else ""
    (tmp_path / "loops.toml").write_text(f"[defaults]\nTi = 8\n{spans}{'sp = 0.5' if constant else ''}\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tag_store, "GATHERED", gathered)
        try:
            opened = open_files(path, reading=ReadOptions(interpolation=interpolation, since=since))
        except BacklashError:
            return
        for recipe in opened.recipes:
            if recipe.rows > 1000:
                assert_long(recipe, (size,))


@given(st.lists(st.integers(1, 12), min_size=30, max_size=80), st.integers(1, 90), st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_repeats_are_counted_alike_in_pieces(lengths, size, random):
    values = np.repeat(np.cumsum([random.choice([-1.0, 1.0, 2.0]) for _ in lengths]), lengths)
    values = np.concatenate([values, np.arange(100.0) % 7])
    counted = states.Repeats()
    for first in range(0, len(values), size):
        counted.add(values[first : first + size])
    starts, ends = states.runs(values[1:] == values[:-1])
    found = (counted.samples, counted.stretches, counted.total, counted.longest)
    assert found == (len(values), len(starts), int((ends - starts).sum()), int((ends - starts).max(initial=0)))
    if states.frozen(values) is not None:
        assert counted.may_be_frozen()


@pytest.mark.parametrize("form", ["wide", "long", "parquet"])
@pytest.mark.parametrize("later", [0.0, 40.0, 5000.0])
def test_a_loop_of_several_files_is_made_in_pieces_too(tmp_path, form, later):
    record = records()[0]
    columns = {"SP": record.setpoint, "PV": noisy(record.measurement), "OP": record.output}
    columns = {role: np.char.mod("%.6g", values).astype("U20") for role, values in columns.items()}
    columns["PV"][4000:4100] = "Bad Input"
    columns["MODE"] = np.where(np.arange(7200) // 1000 % 3 == 1, "MAN", "AUTO").astype("U5")
    seconds = np.arange(7200.0)
    seconds[3000:] += later
    for name, rows in (("2", slice(0, 3000)), ("1", slice(3000, None))):
        folder = tmp_path / name
        folder.mkdir()
        write_table(folder, form, {role: values[rows] for role, values in columns.items()}, seconds[rows])
    (tmp_path / "loops.toml").write_text(f"[defaults]\n{SETTINGS}{RANGES}")
    files = sorted(path for path in tmp_path.glob("*/plant*") if path.suffix != ".toml")
    names = [path.rename(tmp_path / f"{path.parent.name}{path.suffix}") for path in files]
    recipe = open_files(names, loops=tmp_path / "loops.toml").recipes[0]
    if form == "wide" and later == 40.0:
        assert {type(axis).__name__ for axis in recipe.axes()} == {"EvenAxis"}
    assert len(assert_long(recipe)) >= 7200
