"""Long records whose stamps do not rise are made piece by piece, and are those made in one go."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from backlash_cli.api import open_files
from backlash_cli.errors import BacklashError
from backlash_cli.loaders import ReadOptions, tag_store
from backlash_cli.loaders.long_records import long_record
from tests.loaders.test_long_records import (
    RANGES,
    SETTINGS,
    assert_long,
    loop_tables,
    noisy,
    short_is_long,  # noqa: F401
    write_table,
)
from tests.small_plant import records

DAY = 86_400.0


def nothing(rows, seconds, random):
    return rows, seconds


def days_mixed(rows, seconds, random):
    """Pieces of the file in any order."""
    parts = np.array_split(rows, 7)
    turned = np.concatenate([parts[k] for k in random.permutation(7)])
    return turned, seconds[turned]


def newest_first(rows, seconds, random):
    return rows[::-1], seconds[::-1]


def shuffled(rows, seconds, random):
    turned = random.permutation(rows)
    return turned, seconds[turned]


def some_late(rows, seconds, random):
    """Single rows that came later than others."""
    places = np.argsort(np.arange(len(rows)) + np.where(random.random(len(rows)) < 0.1, random.integers(0, 9), 0))
    return rows[places], seconds[rows[places]]


def overlapping(rows, seconds, random):
    """Parts of the file stand twice."""
    turned = np.concatenate([rows[:2500], rows[1800:]])
    return turned, seconds[turned]


def each_twice(rows, seconds, random):
    """Some rows stand twice, in order."""
    turned = np.sort(np.concatenate([rows, random.choice(rows, 50)]))
    return turned, seconds[turned]


def set_back(by):
    def change(rows, seconds, random):
        return rows, seconds - by * (rows >= 2600)
    return change


def set_back_twice(rows, seconds, random):
    return rows, seconds - 90.0 * (rows >= 1700) - 30.0 * (rows >= 3100)


def far_off(rows, seconds, random):
    seconds = seconds.copy()
    seconds[random.choice(len(rows), 3, replace=False)] = [-3000 * DAY, 4000 * DAY, 4001 * DAY]
    return rows, seconds


def far_and_mixed(rows, seconds, random):
    return far_off(*days_mixed(rows, seconds, random), random)


def two_years_apart(rows, seconds, random):
    """Too many to be mistakes."""
    return rows, seconds + 700 * DAY * (rows > 3900)


CHANGES = (nothing, days_mixed, newest_first, shuffled, some_late, overlapping, each_twice, set_back(3600.0),
           set_back(200.0), set_back_twice, far_off, far_and_mixed, two_years_apart)


def changed(folder, form, columns, seconds, change, seed=1, blanks=0):
    """Write a loop whose rows were changed; so many stamps are missing."""
    random = np.random.default_rng(seed)
    rows, seconds = change(np.arange(len(seconds)), seconds, random)
    path = write_table(folder, form, {name: cells[rows] for name, cells in columns.items()}, seconds)
    if blanks and form != "parquet":
        lines = path.read_text().split("\n")
        for place in random.integers(1000, len(lines), blanks).tolist():
            cells = lines[place].split(",")
            cells[0 if form == "wide" else 1] = ""
            lines[place] = ",".join(cells)
        path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("form", ["wide", "long", "parquet"])
@pytest.mark.parametrize("change", CHANGES)
def test_rows_in_any_order_are_made_in_pieces(tmp_path, form, change):
    record = records()[0].slice(0, 4000)
    columns = {"SP": record.setpoint, "PV": noisy(record.measurement), "OP": record.output}
    columns = {role: np.char.mod("%.5f", values).astype("U20") for role, values in columns.items()}
    columns["MODE"] = np.where(np.arange(4000) // 1000 % 3 == 1, "MAN", "AUTO").astype("U5")
    path = changed(tmp_path, form, columns, np.arange(4000.0), change)
    (tmp_path / "loops.toml").write_text(f"[defaults]\n{SETTINGS}{RANGES}")
    whole = assert_long(open_files(path).recipes[0])
    codes = {note.code for note in whole.notes}
    if change in (days_mixed, newest_first, shuffled):
        assert "unsorted" in codes
    if change in CHANGES[7:10]:
        assert codes & {"dst_repeated_hour", "clock_set_back"}
    if change in (overlapping, each_twice):
        assert "duplicate_times" in codes
    assert ("time_outliers" in codes) == (change in (far_off, far_and_mixed))


@given(table=loop_tables(), change=st.sampled_from(CHANGES), seed=st.integers(0, 99), blanks=st.sampled_from([0, 0, 9]),
       interpolation=st.sampled_from([None, None, "hold", "linear"]), gathered=st.sampled_from([2500, 1 << 20]),
       ranges=st.booleans())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_a_loop_out_of_order_holds_its_blocks_are_the_whole_record(
    tmp_path, table, change, seed, blanks, interpolation, gathered, ranges
):
    form, columns, seconds = table
    path = changed(tmp_path, form, columns, seconds, change, seed, blanks)
    spans = "pv_range = [0, 100]\nop_range = [0, 100]\n" if ranges else ""
    (tmp_path / "loops.toml").write_text(f"[defaults]\nTi = 8\n{spans}\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tag_store, "GATHERED", gathered)
        try:
            opened = open_files(path, reading=ReadOptions(interpolation=interpolation))
        except BacklashError:
            return
        for recipe in opened.recipes:
            if recipe.rows > 1000:
                same_or_whole(recipe)


def same_or_whole(recipe):
    """The record in pieces is the whole one, unless it has to be seen as a whole."""
    try:
        if long_record(recipe) is None:
            return
    except BacklashError:
        pass
    assert_long(recipe)


@pytest.mark.parametrize("form", ["wide", "long", "parquet"])
@pytest.mark.parametrize("change", [nothing, days_mixed, overlapping, set_back(3600.0)])
def test_several_files_out_of_order_are_made_in_pieces(tmp_path, form, change):
    record = records()[0]
    columns = {"SP": record.setpoint, "PV": noisy(record.measurement), "OP": record.output}
    columns = {role: np.char.mod("%.6g", values).astype("U20") for role, values in columns.items()}
    for name, rows in (("2", slice(0, 4000)), ("1", slice(3500, None))):  # some rows stand in both
        folder = tmp_path / name
        folder.mkdir()
        part = {role: values[rows] for role, values in columns.items()}
        changed(folder, form, part, np.arange(7200.0)[rows], change)
    (tmp_path / "loops.toml").write_text(f"[defaults]\n{SETTINGS}{RANGES}")
    files = sorted(path for path in tmp_path.glob("*/plant*") if path.suffix != ".toml")
    names = [path.rename(tmp_path / f"{path.parent.name}{path.suffix}") for path in files]
    recipe = open_files(names, loops=tmp_path / "loops.toml").recipes[0]
    codes = {note.code for note in assert_long(recipe).notes}
    assert codes & ({"duplicate_times"} if change in (nothing, days_mixed, overlapping) else {"dst_repeated_hour"})
