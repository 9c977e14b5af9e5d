"""Files read block by block and a loop at a time give the same records, notes and messages as files read whole."""

import gzip
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pa_parquet
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from backlash_cli.errors import BacklashError
from backlash_cli.loaders import Plant, ReadOptions, lazy_tables, plain_csv, read
from backlash_cli.loaders.file_signals import failure
from backlash_cli.loaders.lazy_tables import Lazily, lazy_table
from backlash_cli.loaders.parquet_columns import ParquetFileColumns
from backlash_cli.loaders.plant import no_loop_read, open_plant
from backlash_cli.loaders.store import Room
from tests.shared_data import shared_data
from tests.small_plant import write_plant

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"


def read_lazily(path, options=None, lazily=None) -> Plant:
    opened = open_plant(path, options=options, lazily=lazily or Lazily())
    records, lost = [], []
    for recipe in opened.recipes:
        try:
            records.append(recipe.record())
        except BacklashError as error:
            lost.append(failure(error, loop=recipe.loop))
    if not records and (opened.lost or lost):
        raise no_loop_read([*opened.lost, *lost])
    return Plant(tuple(records), opened.warnings, (*opened.failures, *lost), opened.inputs)


def outcome(reader, *args):
    try:
        return reader(*args)
    except BacklashError as error:
        return str(error)


def assert_same(whole, lazy):
    if isinstance(whole, str) or isinstance(lazy, str):
        assert whole == lazy
        return
    assert [r.loop for r in whole] == [r.loop for r in lazy]
    assert whole.warnings == lazy.warnings and whole.failures == lazy.failures
    for a, b in zip(whole, lazy, strict=True):
        assert (a.start, a.interval, a.settings, a.notes) == (b.start, b.interval, b.settings, b.notes)
        for name in ("index", "setpoint", "measurement", "output", "state"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=f"{a.loop} {name}")


def small_blocks(monkeypatch, size):
    """Blocks of a few lines; the layout is found from the first lines as usual."""
    monkeypatch.setattr(lazy_tables, "HEAD", 60_000)
    monkeypatch.setattr(lazy_tables, "BLOCK", size)
    monkeypatch.setattr(plain_csv, "LEAST", 0)


def exports(folder: Path) -> list[Path]:
    return [p for p in sorted(folder.rglob("*")) if not p.name.startswith(".") and "loops" not in p.name
            and p.suffix not in (".md", ".json", ".toml")]


def test_the_sample_plant_is_read_alike_in_all_its_forms():
    for path in exports(SAMPLES):
        assert_same(outcome(read, path), outcome(read_lazily, path))


@pytest.mark.parametrize("size", [None, 3001])
def test_real_formats_are_read_alike(monkeypatch, size):
    folder = shared_data("formats")
    if size:
        small_blocks(monkeypatch, size)
    for path in exports(folder):
        assert_same(outcome(read, path), outcome(read_lazily, path))


WORDS = ["", " ", "Bad", "I/O Timeout", "nan", "inf", "1,5", "AUTO", "MAN", "1e-3", "+2.5", "12 m3/h", '"3.5"', "-0.0"]


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


@given(text=csv_text(), size=st.integers(60, 4000), memory=st.sampled_from([0, 1000, 1 << 30]),
       compiled=st.sampled_from([0, 0, 1 << 30]))
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_blocks_of_any_size_give_the_records_of_the_whole_file(tmp_path, text, size, memory, compiled):
    path = tmp_path / "plant.csv"
    path.write_text(text, encoding="utf-8", newline="")
    (tmp_path / "loops.toml").write_text("[defaults]\nK = 0.6\nTi = 8\npv_range = [0, 1]\nop_range = [0, 1]\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lazy_tables, "BLOCK", size)
        patch.setattr(lazy_tables, "HEAD", 1000)
        patch.setattr(plain_csv, "LEAST", compiled)
        assert_same(outcome(read, path), outcome(read_lazily, path, None, Lazily(room=Room(memory))))


def test_a_bad_line_in_the_middle_is_named_by_its_number(tmp_path, monkeypatch):
    path = write_plant(tmp_path)
    lines = path.read_text("utf-8").splitlines()
    lines.insert(3000, "what is this,1,2")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    small_blocks(monkeypatch, 5000)
    whole, lazy = read(path), read_lazily(path, None, Lazily(threads=3))
    assert_same(whole, lazy)
    assert "line 3001" in lazy.warnings[0].message


def test_compressed_text_is_read_block_by_block_too(tmp_path, monkeypatch):
    path = write_plant(tmp_path)
    packed = tmp_path / "plant.csv.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    small_blocks(monkeypatch, 5000)
    assert lazy_table(packed, ReadOptions(), {}, Lazily()) is not None
    whole = read(packed)
    path.unlink()
    assert_same(whole, read_lazily(packed))


def test_a_damaged_compressed_file_is_left_to_the_whole_read(tmp_path):
    packed = tmp_path / "plant.csv.gz"
    packed.write_bytes(gzip.compress(write_plant(tmp_path).read_bytes())[:-2000])
    assert lazy_table(packed, ReadOptions(), {}, Lazily()) is None
    assert_same(read(packed), read_lazily(packed))


def test_only_columns_of_wanted_loops_are_kept(tmp_path):
    path = write_plant(tmp_path)
    options = ReadOptions(only_loops=("FIC*",))
    room = Room(1 << 30)
    assert_same(read(path, options=options), read_lazily(path, options, Lazily(room=room)))
    assert (1 << 30) - room.left == 3 * 8 * 7200


def test_every_column_of_a_parquet_is_decoded_once(tmp_path, monkeypatch):
    rows, names = 50, [f"F{k}.{role}" for k in range(7) for role in ("SP", "PV", "OP")]
    columns = {"time": pa.array(np.datetime64("2026-03-17", "s") + np.arange(rows))}
    columns |= {name: np.sin(np.arange(rows) + k) for k, name in enumerate(names)}
    pa_parquet.write_table(pa.table(columns), tmp_path / "plant.parquet")
    monkeypatch.setattr(ParquetFileColumns, "BATCH", 8 * rows * 5)
    read_columns = []

    class Counted:
        def __init__(self, file):
            self.metadata, self._file = file.metadata, file
            self.schema_arrow, self.iter_batches, self.reader = file.schema_arrow, file.iter_batches, self

        def read_row_groups(self, groups, column_indices, use_threads):
            read_columns.extend(column_indices)
            return self._file.reader.read_row_groups(groups, column_indices=column_indices, use_threads=use_threads)

    make = pa_parquet.ParquetFile
    monkeypatch.setattr(pa_parquet, "ParquetFile", lambda source, **how: Counted(make(source, **how)))
    assert len(read_lazily(tmp_path / "plant.parquet")) == 7
    assert sorted(read_columns) == list(range(1 + len(names)))
