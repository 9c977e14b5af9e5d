"""Tables in memory: read as a file of the same columns is."""

import numpy as np
import pandas as pd
import pytest

from backlash_cli import read, scan
from backlash_cli.errors import InputError, UsageError
from backlash_cli.settings import parse_toml

from .exports import SETTINGS, wide


@pytest.fixture
def table(tmp_path):
    """The columns of a wide file, times as the index, and the plant that the file gives."""
    path = tmp_path / "plant.csv"
    path.write_text(wide())
    (tmp_path / "loops.toml").write_text(SETTINGS)
    return pd.read_csv(path, index_col=0, parse_dates=True), read(path)


@pytest.mark.parametrize("change", [
    lambda t: t, lambda t: t.reset_index(), lambda t: t.astype(object), lambda t: t.convert_dtypes(),
    lambda t: t.sample(frac=1.0, random_state=0), lambda t: t.melt(ignore_index=False, var_name="tag"),
    lambda t: t.set_axis(pd.MultiIndex.from_tuples([tuple(name.split(".")) for name in t]), axis=1)],
    ids=["index", "column", "objects", "nullable", "unsorted", "long", "two rows of names"])
def test_a_table_is_read_as_its_file(table, change):
    frame, plant = table
    got = read(change(frame), loops=parse_toml(SETTINGS, "loops.toml"))
    assert all(loop in got for loop in ("FIC101", *[r.loop for r in plant])) and "FIC999" not in got
    assert got.inputs == ("DataFrame",) and [r.loop for r in got] == [r.loop for r in plant]
    for one, other in zip(got, plant, strict=True):
        assert one.start == other.start and one.settings == other.settings
        for name in ("setpoint", "measurement", "output", "state"):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name))


def test_words_among_numbers_are_digital_states(table):
    frame = table[0].astype(object)
    frame.iloc[5, frame.columns.get_loc("FIC101.PV")] = "Bad"
    assert {note.code for note in read(frame)["FIC101"].notes} >= {"not_numbers"}


@pytest.mark.parametrize(("change", "words"), [
    (lambda t: t.reset_index(drop=True), "DataFrame: no time column"), (lambda t: t[:0], "DataFrame: no rows"),
    (lambda t: t.set_axis(["FIC101.PV"] * t.shape[1], axis=1), "names of their own"), (lambda t: 5, "DataFrame")])
def test_what_a_table_lacks_is_said(table, change, words):
    with pytest.raises(InputError, match=words):
        read(change(table[0]))


@pytest.mark.parametrize("given", ["plant.csv", ["plant.csv"], pd.DataFrame({"FIC101.PV": [1.0]}), 5])
def test_what_cannot_be_scanned_names_the_way(given):
    with pytest.raises(UsageError, match=r"scan_files\(path\)"):
        scan(given)
