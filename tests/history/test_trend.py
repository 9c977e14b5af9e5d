"""Wear from sixty nights: slope, date of the limit, repairs, gaps, nights below the limit of detection."""

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.history.limits import read_limits
from backlash_cli.history.store import night_of, night_row
from backlash_cli.history.trend import wear
from backlash_cli.reporter.templates import sentence
from backlash_cli.results import Verdict
from backlash_cli.results.history import Limit, Repair, day_of
from tests.history.nights import DAY, MARCH, growing, made

LIMIT = Limit(0.03, "no_positioner", "test")
TRUE = 0.03 / 59


def nights(reports):
    return [night_of({**night_row(r), "travel": None}) for r in reports]


def of(reports, marked=(), limit=LIMIT):
    return wear("FIC101", nights(reports), marked, limit)


@pytest.mark.parametrize("seed", range(5))
def test_sixty_nights_give_slope_and_date(seed):
    reports = growing(60, noise=0.08, seed=seed)
    full = of(reports)
    assert full.state == "growing" and len(full.segments) == 1 and not full.repairs
    assert full.now.slope == pytest.approx(TRUE, rel=0.15)
    assert full.now.slope_ci95[0] < TRUE < full.now.slope_ci95[1]
    truth = MARCH + DAY * (0.5 + (0.03 - 0.01) / TRUE)
    for n in range(40, 61, 4):
        value, early, late = (full if n == 60 else of(reports[:n])).limit_date
        assert abs(value - truth) < 10 * DAY
        assert early < value < late


def test_the_order_of_the_nights_does_not_matter():
    reports = growing(40, seed=1)
    assert of(reports) == of(reports[::-1])


@pytest.mark.parametrize("after", [0.005, 0.01])
def test_a_repair_nobody_marked_is_found_and_splits_the_trend(after):
    found = of(growing(60, repair=30, after=after, seed=2))
    assert [r.found for r in found.repairs] == [True]
    assert day_of(found.repairs[0].time) == "2026-03-31"
    assert [s.nights for s in found.segments] == [30, 30]
    for segment in found.segments:
        assert segment.slope == pytest.approx(TRUE, rel=0.25)
    assert "fell from 2." in found.repairs[0].note


def test_a_marked_repair_splits_even_without_a_drop_and_is_not_found_twice():
    mark = Repair("FIC101", MARCH + 30 * DAY, "new packing")
    smooth = of(growing(60, seed=3), [mark])
    assert [s.nights for s in smooth.segments] == [30, 30]
    dropped = of(growing(60, repair=30, seed=3), [Repair("FIC101", MARCH + 32 * DAY, "entered late")])
    assert len(dropped.repairs) == 1 and len(dropped.segments) == 2


def test_after_a_fresh_repair_no_old_slope_speaks_for_the_valve():
    reports = growing(33, repair=30, seed=4)
    fresh = of(reports, [Repair("FIC101", MARCH + 30 * DAY)])
    assert fresh.state == "too_few_nights" and fresh.limit_date is None and "needs 5" in sentence("outlook", fresh)
    none = of(reports, [Repair("FIC101", MARCH + 90 * DAY)])
    assert none.state == "no_estimate" and none.limit_date is None


def test_no_growth_is_no_trend():
    steady = of(growing(60, first=0.02, last=0.02, seed=5))
    assert steady.state == "no_trend" and steady.limit_date is None and "no trend" in sentence("outlook", steady)
    high = of(growing(60, first=0.05, last=0.05, seed=5))
    assert high.state == "no_trend" and "above the limit" in sentence("outlook", high)


def test_without_a_date_the_day_is_said_before_which_the_limit_is_not_reached():
    rng = np.random.default_rng(3)
    sizes = (0.01 + 0.03 * (1 - np.exp(-np.arange(60) / 15))) * (1 + 0.01 * rng.standard_normal(60))
    ended = of([made(k, float(d), error=0.01) for k, d in enumerate(sizes)], limit=Limit(0.06, "a", "test"))
    steady = of(growing(30, first=0.02, last=0.02), limit=Limit(0.022, "a", "test"))
    for found in (ended, steady):
        assert found.limit_date is None and found.earliest > found.nights[-1].time
        assert f"before {day_of(found.earliest)} it is not reached" in sentence("outlook", found)
    worn = of(growing(30, first=0.04, last=0.04))
    assert worn.limit_date is None and worn.earliest is None  # it is above the limit
    risen = of(growing(20) + [made(k, d=0.04 + 0.0005 * (-1) ** k) for k in range(20, 60)])
    value, early, late = risen.limit_date
    assert risen.state == "no_trend" and "was reached about" in sentence("outlook", risen)
    assert early < MARCH + 13.2 * DAY < late and early < value < late


def test_nights_without_a_size_are_named_gaps_not_zeros():
    reports = growing(60, noise=0.03, seed=6)
    for k in range(0, 60, 3):
        reports[k] = made(k, None, verdict=Verdict.CANNOT_TELL, lod=None)
    del reports[10:13]
    found = of(reports)
    assert found.now.slope == pytest.approx(TRUE, rel=0.15)
    assert len(found.gaps) == 19 and found.gaps[0] == ("2026-03-01", "made")
    assert found.missing_days == ("2026-03-11", "2026-03-12", "2026-03-13")


def test_nights_below_detection_hold_the_early_slope():
    truth = 0.002 + 0.0005 * np.arange(60)
    rng = np.random.default_rng(7)
    shown = truth * (1 + 0.05 * rng.normal(size=60))
    reports = [made(k, d) if d > 0.012 else made(k, None, verdict=Verdict.NO_BACKLASH, lod=0.012)
               for k, d in enumerate(shown)]
    found = of(reports)
    assert found.now.below == pytest.approx(20, abs=2)
    assert found.now.slope == pytest.approx(0.0005, rel=0.1)


def test_a_wide_interval_or_a_suspicion_weighs_less():
    reports = growing(30, noise=0.02, seed=8)
    for k in range(22, 30):
        reports[k] = replace(made(k, 0.06, error=1.0), verdict=Verdict.SUSPECTED)
    heavy = growing(30, noise=0.02, seed=8)[:22] + [made(k, 0.06, error=0.02) for k in range(22, 30)]
    assert of(reports).now.slope < of(heavy).now.slope


def test_two_kinds_of_estimate_are_never_mixed():
    reports = growing(30, noise=0.0, seed=9)
    for k in (3, 9, 12, 25):
        reports[k] = replace(reports[k], confirmation=None)
    found = of(reports)
    assert found.now.nights == 26 and [code for _, code in found.gaps] == ["no_size"] * 4
    reports = [replace(r, confirmation=None) if k % 3 else r for k, r in enumerate(reports)]
    by_cluster = of(reports)
    assert by_cluster.now.nights == 30 and by_cluster.now.slope == pytest.approx(0.9 * 0.03 / 29, rel=1e-3)


def test_years_of_nights_are_pooled_and_give_the_same_wear():
    reports = growing(1200, last=0.08, noise=0.1, seed=10)
    found = of(reports)
    assert found.now.nights == 1200
    assert found.now.slope == pytest.approx(0.07 / 1199, rel=0.03)
    assert found.now.level == pytest.approx(0.08, rel=0.03)


def test_one_night_and_no_night():
    assert of([made(0, 0.02)]).state == "too_few_nights"
    assert of([]).state == "no_estimate" and not of([]).nights
    assert of([made(0, None, verdict=Verdict.CANNOT_TELL)]).state == "no_estimate"


def test_the_day_of_a_limit_date_is_utc():
    assert day_of(MARCH) == "2026-03-01"


def test_limits_of_the_shipped_profile():
    limits = read_limits()
    assert limits.of("ANY").value == 0.03
    assert {k: v.value for k, v in limits.classes.items()} == {
        "no_positioner": 0.03, "positioner": 0.01, "nominal": 0.02, "fine": 0.01}
    assert all(limit.source != "not given" for limit in limits.classes.values())
