"""What is not computed: by time, by name, by drawing; the same choice every time, and everything left out is said."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backlash_cli.errors import BacklashError, InputError, UsageError
from backlash_cli.loaders import ReadOptions, read
from backlash_cli.selection import choose, parse_since, sample_size
from tests.small_plant import write_plant

NAMES = [f"FIC{k}" for k in range(100, 140)] + [f"TIC{k}" for k in range(200, 210)]
HOUR = 3_600_000_000


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    return write_plant(tmp_path_factory.mktemp("plant"), hours=0.5)


def test_a_sample_is_the_same_for_the_same_names_in_any_order_and_differs_with_the_seed():
    first, notes = choose(NAMES, sample="10%")
    assert len(first) == 5 and first == choose(NAMES[::-1], sample="5")[0]
    assert first != choose(NAMES, sample="5", seed=1)[0]
    note = notes[0]
    assert note.code == "sampled" and note.values["loops"] == 45.0 and "45 were not computed" in note.message
    assert note.values["drawn"] == ", ".join(first)


@given(st.sets(st.text(min_size=1, max_size=6), min_size=1, max_size=30), st.integers(1, 40), st.text(min_size=1))
def test_one_more_loop_changes_a_sample_by_one_loop_at_most(names, count, new):
    before, after = (set(choose(all_names, sample=str(count))[0]) for all_names in (names, {*names, new}))
    assert len(before) == min(count, len(names)) and len(before - after) <= 1 and after - before <= {new}


def test_samples_are_drawn_evenly():
    """Each of 50 loops in about a tenth of 2,000 samples of 5: within 5 standard deviations of 200."""
    counts = dict.fromkeys(NAMES, 0)
    for seed in range(2000):
        for name in choose(NAMES, sample="5", seed=seed)[0]:
            counts[name] += 1
    assert max(abs(n - 200) for n in counts.values()) < 5 * np.sqrt(2000 * 0.1 * 0.9)


@pytest.mark.parametrize(("text", "size"), [("20", 20), ("5%", 3), ("0.1%", 1), ("100%", 50), ("1000", 50), ("2%", 1)])
def test_sizes_of_samples(text, size):
    assert sample_size(text, 50) == size


@pytest.mark.parametrize("text", ["0", "0%", "-3", "101%", "1.5", "half", "", "%", "nan"])
def test_what_is_no_size_of_a_sample_is_refused(text):
    with pytest.raises(UsageError, match="no size of a sample"):
        ReadOptions(sample=text)


def test_patterns_are_wildcards_or_regular_expressions():
    assert len(choose(NAMES, matching=["fic*"])[0]) == 40
    assert choose(NAMES, matching=["/FIC10[12]$/", "TIC209"])[0] == ["FIC101", "FIC102", "TIC209"]
    assert choose(NAMES, matching=["FIC10?", "nothing"])[1][0].values["loops"] == 40.0
    assert not choose(NAMES, matching=["*"])[1]
    with pytest.raises(UsageError, match="none of 50 loops") as caught:
        choose(NAMES, matching=["FID101"])
    assert "FIC101" in caught.value.remedy
    for wrong in ("/(/", "", "/*/"):
        with pytest.raises(UsageError, match="--loops-matching"):
            ReadOptions(loops_matching=(wrong,))


@pytest.mark.parametrize(("text", "zone", "moment"), [
    ("1970-01-02", None, 24 * HOUR), ("1970-01-02T06:00", None, 30 * HOUR), ("1970-01-02 06:00+01:00", None, 29 * HOUR),
    ("1970-01-02", "Asia/Tokyo", 15 * HOUR), ("1970-01-01T00:00:00.5Z", None, 500_000),
])
def test_moments(text, zone, moment):
    assert parse_since(text, zone) == (moment, 0)


@pytest.mark.parametrize(("text", "age"), [("3d", 72 * HOUR), ("12h", 12 * HOUR), ("90 min", 1.5 * HOUR),
                                           ("1.5h", 1.5 * HOUR), ("2w", 14 * 24 * HOUR), ("10s", HOUR / 360)])
def test_ages(text, age):
    assert parse_since(text) == (None, age)


@pytest.mark.parametrize("text", ["yesterday", "0d", "-3d", "3 weeks", "2026-13-01", "", "1e9d", "99999999999d"])
def test_what_is_no_time_is_refused(text):
    with pytest.raises(UsageError, match="is no time"):
        ReadOptions(since=text)


def test_since_reads_as_if_the_export_began_there(plant, tmp_path):
    whole = read(plant)
    last = whole["FIC101"].time[-1]
    recent = read(plant, options=ReadOptions(since="10min"))
    record = recent["FIC101"]
    assert record.time[0] == last - 600.0 and record.time[-1] == last and len(record) == 601
    head, *rows = plant.read_text().splitlines()
    (tmp_path / "plant.csv").write_text("\n".join([head, *rows[-601:]]) + "\n")
    short = read(tmp_path / "plant.csv", loops=plant.parent / "plant.loops.toml")
    for name in ("setpoint", "measurement", "output", "state"):
        np.testing.assert_array_equal(getattr(record, name), getattr(short["FIC101"], name))
    stamp = np.datetime_as_string(np.datetime64(round(last - 600), "s"))
    absolute = read(plant, options=ReadOptions(since=str(stamp)))
    np.testing.assert_array_equal(absolute["FIC101"].measurement, record.measurement)
    assert [n.code for n in recent.warnings] == ["since"] and str(stamp).replace("T", " ") in recent.warnings[0].message


def test_an_age_is_not_counted_from_a_stray_stamp(plant, tmp_path):
    head, *rows = plant.read_text().splitlines()
    rows[len(rows) // 2] = "2087-01-01 00:00:00" + rows[len(rows) // 2][19:]
    (tmp_path / "plant.csv").write_text("\n".join([head, *rows]) + "\n")
    recent = read(tmp_path / "plant.csv", loops=plant.parent / "plant.loops.toml", options=ReadOptions(since="10min"))
    assert len(recent["FIC101"]) == 601 and "time_outliers" in {note.code for note in recent["FIC101"].notes}


def test_a_loop_without_recent_data_is_counted_and_a_held_setpoint_still_holds(tmp_path):
    rows = ["tag,time,value", "FIC1.SP,2026-03-01 00:00:00,50", "FIC1.SP,2026-03-01 00:00:30,60"]
    for tag, end in (("FIC1.PV", 600), ("FIC1.OP", 600), ("FIC2.PV", 200), ("FIC2.SP", 200)):
        rows += [f"{tag},2026-03-01 00:{s // 60:02}:{s % 60:02},{50 + s % 7}" for s in range(end)]
    (tmp_path / "long.csv").write_text("\n".join(rows) + "\n")
    found = read(tmp_path / "long.csv", options=ReadOptions(since="5min"))
    assert [r.loop for r in found] == ["FIC1"] and len(found["FIC1"]) == 301
    assert np.all(found["FIC1"].setpoint == found["FIC1"].setpoint[0])
    assert found["FIC1"].setpoint[0] * (found["FIC1"].settings.pv_range[1]) == pytest.approx(60.0)
    note = next(n for n in found.warnings if n.code == "nothing_since")
    assert "1 of 2 loops" in note.message and note.values["names"] == "FIC2"


def test_nothing_since_then_is_an_error_that_says_where_the_data_end(plant):
    with pytest.raises(InputError, match="the data end at 2026-03-17 08:29:59 UTC"):
        read(plant, options=ReadOptions(since="2030-01-01"))


def test_a_date_does_not_fit_times_from_an_unknown_start(tmp_path):
    (tmp_path / "a.csv").write_text("seconds,SP,PV\n" + "".join(f"{s},5,{5 + s % 3}\n" for s in range(400)))
    with pytest.raises(BacklashError, match="the data end at 1970-01-01"):
        read(tmp_path / "a.csv", options=ReadOptions(since="2026-01-01"))
    assert len(read(tmp_path / "a.csv", options=ReadOptions(since="100s"))["a"]) == 101


def test_the_truth_beside_simulated_recordings_is_no_export(tmp_path):
    data = write_plant(tmp_path, hours=0.5)
    data.with_name("plant.truth.csv").write_text("loop,dead_band\nFIC101,0.03\n", encoding="utf-8")
    assert not read(tmp_path).failures
