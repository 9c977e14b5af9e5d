"""Partitioned Parquet folders of every usual kind give the plant of the one file they were cut from."""

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from backlash_cli.loaders import read
from tests.small_plant import TRUTH, write_plant

LOOPS = sorted(TRUTH)


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    path = write_plant(tmp_path_factory.mktemp("plant"), hours=0.2)
    return path, pyarrow.csv.read_csv(path)


def single(table, loop):
    names = ["time", *(f"{loop}.{signal}" for signal in ("SP", "PV", "OP"))]
    return table.select(names).rename_columns(["time", "SP", "PV", "OP"])


def pieces(table, count=3):
    size = -(-len(table) // count)
    return [table.slice(k * size, size) for k in range(count)]


def singles(table):
    return [(x, k, p) for x in LOOPS for k, p in enumerate(pieces(single(table, x)))]


def long(table):
    parts = [pa.table({"tag": pa.array([name] * len(table)), "time": table["time"], "value": table[name]})
             for name in table.column_names[1:]]
    return pa.concat_tables(parts)


LAYOUTS = {
    "loop=FIC101/part-0.parquet": lambda t: {
        f"loop={x}/part-{k}.parquet": p for x, k, p in singles(t)},
    "date=2026-01-01/part-0.parquet, wide": lambda t: {
        f"date=2026-03-{k + 1:02}/part-0.parquet": p for k, p in enumerate(pieces(t))},
    "date=.../loop=.../part": lambda t: {
        f"date=2026-03-{k + 1:02}/loop={x}/part-0.parquet": p for x, k, p in singles(t)},
    "loop=.../date=.../part": lambda t: {
        f"loop={x}/date=2026-03-{k + 1:02}/part-0.parquet": p for x, k, p in singles(t)},
    "tag=FIC101.PV/part": lambda t: {
        f"tag={name}/part-0.parquet": t.select(["time", name]).rename_columns(["time", "value"])
        for name in t.column_names[1:]},
    "plain parts, wide": lambda t: {f"part-{k}.parquet": p for k, p in enumerate(pieces(t))},
    "plain parts, long": lambda t: {f"part.{k}.parquet": p for k, p in enumerate(pieces(long(t), 5))},
    "date=.../part, long": lambda t: {
        f"date=2026-03-{k + 1:02}/part-0.parquet": long(p) for k, p in enumerate(pieces(t))},
    "a file per loop": lambda t: {f"{x}.parquet": single(t, x) for x in LOOPS},
    "a folder per loop": lambda t: {
        f"{x}/part-0000{k}-3f2a.snappy.parquet": p for x, k, p in singles(t)},
    "a folder per loop and day": lambda t: {
        f"{x}/2026/03/0{k + 1}/data_0.parquet": p for x, k, p in singles(t)},
    "areas": lambda t: {f"area{k % 2}/{x}.parquet": single(t, x) for k, x in enumerate(LOOPS)},
}


def write(folder, parts):
    for name, table in parts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(table, folder / name, row_group_size=100)
    (folder / "_SUCCESS").touch()
    (folder / "_metadata").write_bytes(b"PAR1")


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_folder_gives_the_plant_of_the_one_file(plant, tmp_path, layout):
    path, table = plant
    write(tmp_path / "plant", LAYOUTS[layout](table))
    found, want = read(tmp_path / "plant", loops=path.parent / "plant.loops.toml"), read(path)
    assert [r.loop for r in found] == LOOPS and not found.failures and not found.warnings
    for one, other in zip(found, want, strict=True):
        assert one.settings == other.settings
        for name in ("time", "setpoint", "measurement", "output", "state"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_settings_lie_beside_the_folder_or_in_it(plant, tmp_path):
    path, table = plant
    write(tmp_path / "plant", LAYOUTS["loop=FIC101/part-0.parquet"](table))
    for place in (tmp_path / "plant.loops.toml", tmp_path / "loops.toml", tmp_path / "plant" / "loops.toml"):
        place.write_bytes((path.parent / "plant.loops.toml").read_bytes())
        assert read(tmp_path / "plant")["FIC101"].settings.K == 1.1
        place.unlink()


def test_the_folder_of_a_single_loop_names_it(plant, tmp_path):
    path, table = plant
    write(tmp_path / "FIC101", {f"part-{k}.parquet": p for k, p in enumerate(pieces(single(table, "FIC101")))})
    found = read(tmp_path / "FIC101", loops=path.parent / "plant.loops.toml")
    assert [r.loop for r in found] == ["FIC101"] and len(found["FIC101"]) == len(table)
