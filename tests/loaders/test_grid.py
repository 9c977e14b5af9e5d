"""Time stamps to a uniform grid: order, repeats, gaps, jitter, compression."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli import read
from backlash_cli.errors import LoopError
from backlash_cli.loaders import ReadOptions
from backlash_cli.loaders.grid import MAX_HOLE, SECOND, make_grid
from backlash_cli.loaders.grid import ordered as ordered_by
from backlash_cli.record import NAT

T0 = 1_773_734_400 * SECOND


def stamps(seconds: object) -> np.ndarray:
    return T0 + np.rint(np.asarray(seconds, float) * SECOND).astype(np.int64)


def ordered(micros: np.ndarray, probe: np.ndarray | None = None, **more: object):
    return ordered_by(micros, np.full(len(micros), np.nan) if probe is None else probe, **more)


def codes(thing) -> list[str]:
    return [note.code for note in thing.notes]


def test_uniform_stamps_need_nothing():
    order = ordered(stamps(np.arange(100)))
    grid = make_grid(order)
    assert order.rows is None and grid.rows is None and grid.step == 1_000_000 and not grid.notes


def test_short_holes_get_rows_and_gaps_jump():
    seconds = np.delete(np.arange(200), [10, 11, *range(50, 150)])
    grid = make_grid(ordered(stamps(seconds)))
    assert grid.kind == "regular"
    assert np.array_equal(np.flatnonzero(grid.rows < 0), [10, 11])
    assert np.array_equal(grid.index, np.delete(np.arange(200), np.arange(50, 150)))
    assert codes(grid) == ["gaps", "missing_rows"]


def test_months_between_two_recordings_take_no_memory():
    grid = make_grid(ordered(stamps(np.concatenate([np.arange(1000), 1e8 + np.arange(1000)]))))
    assert len(grid.index) == 2000
    assert grid.index[-1] == 100_000_999


def test_a_far_off_stamp_is_dropped():
    micros = stamps(np.arange(500))
    micros[[7, 300]] = 0
    micros[400] = 253_402_300_799 * SECOND
    order = ordered(micros)
    assert codes(order) == ["time_outliers"]
    assert len(make_grid(order).index) == 500  # the three become short holes


def test_unreadable_stamps_name_the_line():
    micros = stamps(np.arange(100))
    micros[3] = NAT
    order = ordered(micros, line=2)
    assert "line 5" in order.notes[0].message


def test_shuffled_and_repeated_rows():
    rng = np.random.default_rng(1)
    values = rng.standard_normal(300)
    rows = rng.permutation(np.concatenate([np.arange(300), np.arange(0, 300, 30)]))
    order = ordered(stamps(rows), values[rows])
    assert codes(order) == ["unsorted", "duplicate_times"]
    assert np.array_equal(values[rows][order.rows], values)


def test_rows_in_reverse():
    order = ordered(stamps(np.arange(100)[::-1]), np.arange(100.0))
    assert np.array_equal(order.rows, np.arange(100)[::-1])


@pytest.mark.parametrize(("back", "code"), [(3600, "dst_repeated_hour"), (600, "clock_set_back")])
def test_clock_set_back_keeps_the_file_order(back, code):
    seconds = np.arange(9000.0)
    seconds[5000:] -= back
    values = np.random.default_rng(2).standard_normal(9000)
    order = ordered(stamps(seconds), values)
    assert codes(order) == [code]
    grid = make_grid(order)
    assert np.array_equal(grid.index, np.arange(9000))


def test_the_same_hour_exported_twice_is_no_clock_change():
    values = np.random.default_rng(2).standard_normal(6000)
    rows = np.concatenate([np.arange(4000), np.arange(3000, 6000)])
    order = ordered(stamps(rows), values[rows], files=((0, "a.csv"), (4000, "b.csv")))
    assert codes(order) == ["unsorted", "duplicate_times"]
    assert len(order.stamps) == 6000


def test_stamps_to_the_minute_are_spread():
    seconds = np.arange(37, 37 + 1200)
    order = ordered(stamps(seconds // 60 * 60), np.random.default_rng(0).standard_normal(1200))
    assert codes(order) == ["coarse_stamps"]
    grid = make_grid(order)
    assert grid.step == 1_000_000 and np.array_equal(grid.index, np.arange(1200))
    assert grid.start == T0 + 37 * SECOND


@pytest.mark.parametrize(("noise", "late"), [(0.15, 0), (0.25, 0), (0.0, 30), (0.1, 30)])
def test_two_sources_in_turn_are_no_coarse_stamps(noise, late):
    """A second server has each sample as well, a little other, or half a minute late."""
    rng = np.random.default_rng(5)
    moves = 0.1 * np.cumsum(rng.standard_normal(7200)) + 0.5 * rng.standard_normal(7200)
    assert codes(ordered(stamps(np.repeat(np.arange(3600.0), 2)), moves)) == ["coarse_stamps"]  # two rows a second
    second = np.roll(moves, late) + noise * rng.standard_normal(7200)
    with pytest.raises(LoopError, match="of two sources of a tag"):
        ordered(stamps(np.repeat(np.arange(7200.0), 2)), np.column_stack([moves, second]).ravel())


@pytest.mark.parametrize("seconds", [np.zeros(50), np.repeat([0.0, 1.0], 200)])
def test_no_time_passes(seconds):
    with pytest.raises(LoopError) as caught:
        make_grid(ordered(stamps(seconds), np.random.default_rng(0).standard_normal(len(seconds))))
    assert caught.value.code in ("constant_time", "too_few_samples")


@pytest.mark.parametrize(("reach", "absent"), [(0.3, 60), (0.37, 0), (0.35, 30), (0.1, 200)])
def test_jitter_is_resampled(reach, absent):
    rng = np.random.default_rng(3)
    seconds = np.sort(np.arange(2000) + rng.uniform(-reach, reach, 2000))
    seconds = np.delete(seconds, rng.choice(2000, absent, replace=False))
    grid = make_grid(ordered(stamps(seconds)))
    assert grid.kind == "jitter" and grid.step == 1_000_000 and codes(grid) == ["resampled"]
    assert np.array_equal(grid.index, np.arange(len(grid.index)))
    assert abs(len(grid.index) - 2000) <= 2


def test_slow_drift_of_the_scan_time_keeps_the_clock():
    grid = make_grid(ordered(stamps(np.arange(20_000) * 1.0003 + 0.002 * np.sin(np.arange(20_000)))))
    assert grid.step == 1_000_000
    assert abs(grid.index[-1] - 20_000 * 1.0003) <= 2


def test_a_spacing_that_is_usual_and_is_not_the_mean_one_makes_no_clock():
    """1.997 s from row to row, as a rule, and 2.007 s at times: 2 s, and no row is lost."""
    grid = make_grid(ordered(stamps(2.0 * np.arange(5400) + np.resize([0, 7, 4, 1, 8, 5, 2, 9, 6, 3], 5400) / 1e3)))
    assert grid.kind == "regular" and grid.step == 2 * SECOND and len(grid.index) == 5400 and not grid.notes


def test_scan_time_that_is_no_round_number():
    grid = make_grid(ordered(stamps(np.round(np.arange(5000) * 2.4))))
    assert grid.step == pytest.approx(2_400_000)
    assert grid.kind == "jitter"


def test_compressed_recording():
    rng = np.random.default_rng(4)
    seconds = np.cumsum(rng.geometric(0.2, 1500))
    grid = make_grid(ordered(stamps(seconds)))
    assert grid.kind == "compressed" and grid.step == 1_000_000
    assert grid.recorded.mean() == pytest.approx(0.2, abs=0.03)
    seconds[700:] += 7200
    assert "gaps" in codes(make_grid(ordered(stamps(seconds))))


def test_far_too_irregular_is_refused():
    seconds = np.cumsum(np.exp(np.random.default_rng(5).normal(0, 6, 400)))
    try:
        grid = make_grid(ordered(stamps(seconds)))
    except LoopError as error:
        assert error.code == "irregular"
    else:
        assert len(grid.index) <= 200 * 400


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(-(10**15), 10**15), min_size=1, max_size=200), st.integers(0, 3))
def test_any_stamps_give_an_increasing_bounded_grid_or_a_refusal(values, repeats):
    micros = np.array(values * (repeats + 1), np.int64)
    try:
        grid = make_grid(ordered(micros, np.arange(len(micros), dtype=float)))
    except LoopError:
        return
    assert np.all(np.diff(grid.index) > 0)
    assert len(grid.index) <= 200 * len(micros) + (MAX_HOLE + 1) * len(micros)


def test_of_rows_with_one_stamp_the_first_that_holds_a_value_is_kept():
    stamps = np.array([0, 1, 1, 1, 2, 2, 3, 4], np.int64) * SECOND
    found = ordered(stamps, np.array([5.0, np.nan, np.nan, 7.0, 8.0, 8.001, 9.0, 3.0]))
    assert found.rows.tolist() == [0, 3, 4, 6, 7] and found.stamps.tolist() == [k * SECOND for k in range(5)]


@pytest.mark.parametrize(("begin", "told"), [
    ("1601-01-01T08", True), ("9999-12-30T08", True), ("1970-06-01T00", True), ("1970-01-01T00", True), ("", False),
    ("2026-03-17T08", False)])
def test_dates_that_no_recorder_has_are_told(tmp_path, begin, told):
    """A clock that was never set begins in 1970; times that count from the beginning of the record are shown so."""
    rows = [f"{np.datetime64(begin, 's') + k if begin else k},50,{50 + k % 7},{40 + k % 5}" for k in range(300)]
    (tmp_path / "FIC101.csv").write_text("\n".join(["time,SP,PV,OP", *rows]))
    (record,) = read(tmp_path / "FIC101.csv")
    notes = [note.code for note in record.notes]
    assert ("unlikely_dates" in notes) is told and ("relative_time" in notes) is (not begin)


def test_dates_that_no_calendar_has_are_told(tmp_path):
    rows = [f"{-2 * 10**12 + 10**9 * k},50,{50 + k % 7},{40 + k % 5}" for k in range(50)]
    (tmp_path / "FIC101.csv").write_text("\n".join(["time,SP,PV,OP", *rows]))
    (record,) = read(tmp_path / "FIC101.csv", options=ReadOptions(time_format="epoch_s"))
    assert "unlikely_dates" in [note.code for note in record.notes]


def test_an_interval_that_changes_is_told():
    grid = make_grid(ordered(stamps([*range(300), *range(300, 9300, 30)])))
    assert "every 1 s at first and every 30 s at the end" in " ".join(note.message for note in grid.notes)
    assert "interval_changes" not in codes(make_grid(ordered(stamps([*range(300), *range(400, 700)]))))
