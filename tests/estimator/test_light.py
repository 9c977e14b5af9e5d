"""Parts of a long record: they may end the test only where they exclude a dead band, or show one beyond doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.estimator.evidence import weigh
from backlash_cli.estimator.light import LONG, PARTS, excludes, shows, weigh_lightly
from backlash_cli.estimator.rows import Rows, liveliest, part_of
from backlash_cli.record import LoopSettings
from backlash_cli.results import Verdict
from backlash_cli.scan import scan
from tests.benchmarks.random_loops import draw
from tests.estimator.closed_loop import Loop, rows_of, run, slow_loop

SETTINGS = LoopSettings(K=0.6, Ti=20.0, Kp=1.0)
STEPS = np.repeat(np.random.default_rng(5).normal(0.0, 0.03, 10), 1000)


def long_rows(d: float, n: int = 10_000) -> Rows:
    return rows_of(replace(run(Loop(dead_band=d), n, load=STEPS[:n]), settings=SETTINGS))


def test_the_stretches_where_op_travels_most_are_taken() -> None:
    n = 2000
    u = 0.001 * np.sin(np.arange(n) / 3.0)
    u[750:1000] *= 20.0
    u[1500:1750] *= 10.0
    first = np.zeros(n, dtype=bool)
    first[0] = True
    none = np.empty((0, n))
    whole = Rows(2.0 * u, np.stack([u, u]), np.array([0.01]), first, 4.0, none, np.arange(n))
    use = liveliest(whole, 500)
    np.testing.assert_array_equal(use, np.r_[750:1000, 1500:1750])
    rows = part_of(whole, use)
    np.testing.assert_array_equal(rows.at, use)
    np.testing.assert_array_equal(np.flatnonzero(rows.first), [0, 250])
    np.testing.assert_allclose(rows.x[0, :250], u[750:1000] - u[750])
    np.testing.assert_allclose(rows.y[250:], 2.0 * (u[1500:1750] - u[1500]))


def test_a_healthy_valve_ends_there_with_a_limit_that_the_whole_record_bears_out() -> None:
    rows = long_rows(0.0)
    light, full = weigh_lightly(rows), weigh(rows)
    assert light.rows < PARTS[0] < full.rows
    assert excludes(light)
    assert excludes(full)


def test_a_worn_valve_that_shows_beyond_doubt_is_sized_from_a_part_of_them_as_from_all() -> None:
    rows = long_rows(0.02)
    some, full = weigh_lightly(rows), weigh(rows)
    assert PARTS[0] < some.rows < PARTS[1] < full.rows
    assert shows(some)
    assert some.d == pytest.approx(full.d, rel=0.08)
    assert some.d == pytest.approx(0.02, rel=0.08)


def test_a_dead_band_that_a_part_leaves_in_doubt_gets_the_whole_test() -> None:
    rows = long_rows(0.002)
    assert weigh_lightly(rows).rows == weigh(rows).rows


@pytest.mark.parametrize(("change", "still"), [
    ({}, True), ({"gain": 17.0}, False), ({"half": 61.0}, False), ({"interval": (0.016, 0.0205)}, False),
])
def test_what_shows_beyond_doubt(change: dict[str, object], still: bool) -> None:
    e = replace(weigh(long_rows(0.02)), d=0.02, gain=60.0, half=3.0, steps=1, interval=(0.0195, 0.0205))
    assert shows(replace(e, **change)) is still


def test_short_records_get_the_whole_test() -> None:
    rows = long_rows(0.0, 5 * (LONG - 20))
    assert weigh_lightly(rows) == weigh(rows)


@pytest.mark.parametrize("seed", range(3))
def test_the_verdict_on_a_healthy_day_names_what_would_have_been_seen(seed: int) -> None:
    report = scan(draw(900 + seed, "cascade", 0.0, samples=40_000).record)
    assert report.verdict is Verdict.NO_BACKLASH
    assert report.confirmation is not None
    assert report.confirmation.details["rows"] < PARTS[0]
    assert 0.0 < (report.confirmation.limit_of_detection or 0.0) < 0.01


def test_a_limit_cycle_is_not_taken_for_a_smooth_load_because_a_part_allows_it() -> None:
    """Without a dead band such a part asks for a load whose moves last; with one there are half a dozen load steps."""
    evidence = [weigh_lightly(rows_of(slow_loop(seed=seed))).gain for seed in range(1, 13)]
    assert sum(gain > 30.0 for gain in evidence) >= 11
    assert min(evidence) > -6.0
