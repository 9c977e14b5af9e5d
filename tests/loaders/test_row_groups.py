"""What is read of a Parquet file: the columns of the wanted loops, and only the row groups that --since leaves."""

import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from backlash_cli.api import scan_files, scan_part
from backlash_cli.loaders import ReadOptions
from backlash_cli.loaders.parquet_columns import ParquetFileColumns
from backlash_cli.loaders.remote import place
from backlash_cli.reporter.json_report import to_json
from tests.engines.parts import QUICK, plan_of
from tests.small_plant import write_plant


@pytest.fixture(params=["local", "remote"])
def export(request, tmp_path):
    """A wide file of three loops in row groups of five minutes, here or at an address."""
    source = write_plant(tmp_path, hours=0.5)
    path = tmp_path / "groups.parquet"
    pq.write_table(pyarrow.csv.read_csv(source), path, row_group_size=300)
    (tmp_path / "loops.toml").write_bytes((tmp_path / "plant.loops.toml").read_bytes())
    source.unlink()
    return path if request.param == "local" else place(f"file://{path}")


@pytest.fixture
def read(monkeypatch):
    """(row groups, columns) that are read of loops' signals."""
    seen = []
    real = ParquetFileColumns.file.func

    class Reader:
        def __init__(self, reader):
            self.reader = reader

        def read_row_groups(self, groups, column_indices, **options):
            seen.append((list(groups), list(column_indices)))
            return self.reader.read_row_groups(groups, column_indices=column_indices, **options)

    class File:
        def __init__(self, file):
            self.file, self.reader = file, Reader(file.reader)

        def __getattr__(self, name):
            return getattr(self.file, name)

    def opened(self):
        if "opened" not in self.__dict__:
            self.opened = File(real(self))
        return self.opened

    monkeypatch.setattr(ParquetFileColumns, "file", property(opened))
    return seen


def test_a_part_reads_its_columns_of_the_groups_since_then(export, read):
    whole = scan_files([export], reading=ReadOptions(only_loops=("PIC303",), since="8min"), options=QUICK, jobs=1)
    plan = plan_of([export], ReadOptions(since="8min"))
    names = pq.ParquetFile(str(export).removeprefix("file://")).schema_arrow.names
    read.clear()
    found = scan_part(plan.part(["PIC303"]), QUICK)
    assert to_json(found)[:9] and found.loops == whole.loops
    of_loops = [(groups, columns) for groups, columns in read if columns != [names.index("time")]]
    assert {names[c] for _, columns in of_loops for c in columns} == {"PIC303.SP", "PIC303.PV", "PIC303.OP"}
    assert all(groups == [4, 5] for groups, _ in of_loops) and len(of_loops) == 1


@pytest.mark.parametrize("since", ["1min", "5min", "299s", "300s", "29min", "1d"])
def test_any_moment_gives_what_reading_all_gives(export, since):
    reading = ReadOptions(since=since)
    lazily = to_json(scan_files([export], reading=reading, options=QUICK, jobs=1))
    from backlash_cli.api import scan
    from backlash_cli.loaders import read as read_all

    assert lazily == to_json(scan(read_all([export], options=reading), QUICK, jobs=1))
