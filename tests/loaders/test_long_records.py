"""Long records made piece by piece are those made in one go: samples, states, notes and reports."""


import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.api import open_files, scan
from backlash_cli.loaders import even, long_records, states
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
    monkeypatch.setattr(long_records, "PIECE", 700)


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


LONG_ONES = {"plain": {}, "at the limit": {"OP": put(695, 705, 1.0)}, "nearly": {"OP": put(699, 701, 0.0)},
             "still for a while": {"PV": put(695, 702, 0.5)}}
WHOLE_ONES = {"blank": {"PV": put(800, 802, np.nan)}, "no output": {"OP": put(0, None, np.nan)},
              "frozen": {"PV": put(600, 2800, 0.5)}, "spike": {"PV": put(50, 51, 7.0)}}


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
@pytest.mark.parametrize("name", LONG_ONES)
@pytest.mark.parametrize("size", [500, 7200])
def test_a_long_record_is_the_whole_record(tmp_path, suffix, name, size):
    recipe = open_files(export(tmp_path, suffix, **LONG_ONES[name])).recipes[0]
    whole, long = recipe.record(), long_record(recipe)
    assert long is not None
    blocks = list(long.blocks(size))
    assert all(len(block) == size for block in blocks[:-1])
    for block in blocks:
        assert (block.start, block.interval, block.settings, block.notes) == (
            whole.start, whole.interval, whole.settings, whole.notes)
    for field in ("index", "setpoint", "measurement", "output", "state"):
        np.testing.assert_array_equal(np.concatenate([getattr(b, field) for b in blocks]), getattr(whole, field))
    assert np.any(whole.state == SampleState.SATURATED) == (name == "at the limit")


@pytest.mark.parametrize("name", WHOLE_ONES)
def test_what_has_to_be_seen_as_a_whole_is_read_whole(tmp_path, name):
    recipe = open_files(export(tmp_path, **WHOLE_ONES[name])).recipes[0]
    assert long_record(recipe) is None
    assert len(recipe.record()) == 7200


def test_spans_that_would_be_guessed_need_the_whole_record(tmp_path):
    percent = export(tmp_path, loops="[defaults]\nTi = 12.0\n", PV=lambda x: 100.0 * x)
    assert long_record(open_files(percent).recipes[0]) is None
    plain = export(tmp_path, loops=f"[defaults]\n{SETTINGS}")
    recipe = open_files(plain).recipes[0]
    long = long_record(recipe)
    assert long is not None
    whole = recipe.record()
    assert (long.spans.settings, long.notes) == (whole.settings, whole.notes)


@pytest.mark.parametrize("loops", [f"[defaults]\n{SETTINGS}{RANGES}", f"[defaults]\n{RANGES}"])
@pytest.mark.parametrize("confirm", [False, True])
def test_reports_of_long_and_whole_records_are_the_same(tmp_path, monkeypatch, loops, confirm):
    opened = open_files(export(tmp_path, loops=loops))
    options = ScanOptions(confirm=confirm)
    assert long_record(opened.recipes[0]) is not None
    long = scan(opened, options, jobs=1)
    monkeypatch.setattr(long_records, "LONG", 1 << 20)
    assert long_record(opened.recipes[0]) is None
    assert long == scan(opened, options, jobs=1)


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
