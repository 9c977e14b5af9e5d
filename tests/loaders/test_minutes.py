"""Stamps taken apart at the seconds give the times that each text gives by itself."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from backlash_cli.errors import InputError
from backlash_cli.loaders import ReadOptions, minutes, times
from backlash_cli.loaders.minutes import whole_minutes
from backlash_cli.loaders.times import NAT, to_times

FORMS = ["%d/%m/%Y %H:%M:%S", "%Y-%m-%dT%H:%M:%SZ", "%Y-%m-%d %H:%M:%S.%f", "%m/%d/%Y %I:%M:%S %p", "%H:%M:%S",
         "%d-%b-%y %H:%M:%S,%f", "%Y-%m-%dT%H:%M:%S+0200", "%a %d %b %Y %H:%M:%S", "%Y/%m/%d %H:%M:%S:%f"]


def both(texts, monkeypatch, **options):
    column = pa.chunked_array([pa.array(texts[:700]), pa.array(texts[700:])])
    quick = to_times(column, "time", ReadOptions(**options), "x.csv")
    monkeypatch.setattr(times, "whole_minutes", lambda column: None)
    return quick, to_times(column, "time", ReadOptions(**options), "x.csv")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
def test_times_are_those_of_each_text(monkeypatch, form, zone):
    random = np.random.default_rng(3)
    seconds = np.cumsum(random.choice([1, 1, 1, 2, 5, 0], 9000))
    seconds[4000:] += 86_400 * 6 + 40_000  # into the night in which clocks go forward
    stamps = pd.Timestamp("2026-03-22 21:00:07.250") + pd.to_timedelta(seconds, unit="s")
    texts = stamps.strftime(form).tolist()
    assert whole_minutes(pa.array(texts)) is not None
    quick, slow = both(texts, monkeypatch, timezone=zone)
    np.testing.assert_array_equal(quick.micros, slow.micros)
    assert (quick.absolute, quick.zoned, quick.notes) == (slow.absolute, slow.zoned, slow.notes)


@pytest.mark.parametrize("row", ["31/02/2026 08:00:01", "17/03/2026 08:00:61", "17/03/2026 25:00:01",
                                 "17/03/2026 08:00:0x", "xx/xx/xxxx xx:xx:xx", "17/03/2026 08:00"])
def test_rows_that_cannot_be_read_stay_unreadable(monkeypatch, row):
    stamps = pd.date_range("2026-03-17 08:00", periods=3000, freq="s").strftime("%d/%m/%Y %H:%M:%S").tolist()
    stamps[1500] = row
    quick, slow = both(stamps, monkeypatch)
    np.testing.assert_array_equal(quick.micros, slow.micros)
    if row != "17/03/2026 08:00":
        assert quick.micros[1500] == NAT


def test_what_cannot_be_read_is_shown_as_it_is_written(monkeypatch):
    texts = [f"99/99/2026 08:{k // 60 % 60:02}:{k % 60:02}" for k in range(5, 3000)]
    with pytest.raises(InputError, match="99/99/2026 08:00:05"):
        both(texts, monkeypatch)


def test_few_rows_other_lengths_and_quick_changes_are_left_alone():
    texts = pd.date_range("2026-03-17 08:00", periods=3000, freq="s").strftime("%d/%m/%Y %H:%M:%S").tolist()
    assert whole_minutes(pa.array(texts[: minutes.LEAST - 1])) is None
    assert whole_minutes(pa.array([*texts, "17/03/2026 8:00:00"])) is None
    assert whole_minutes(pa.array([*texts, None])) is None
    hours = pd.date_range("2026-03-17 08:00", periods=3000, freq="h").strftime("%d/%m/%Y %H:%M:%S").tolist()
    assert whole_minutes(pa.array(hours)) is None
