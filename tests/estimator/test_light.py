"""A light look on a part of a long record: it may end the test only where no dead band is to be found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.estimator.confirm import ConfirmationScanner
from backlash_cli.estimator.evidence import Rows, excluding, weigh
from backlash_cli.estimator.light import LIGHT_ROWS, LONG, liveliest, weigh_lightly
from backlash_cli.record import LoopSettings
from backlash_cli.results import Verdict
from backlash_cli.scan import scan
from tests.benchmarks.random_loops import draw
from tests.estimator.closed_loop import Loop, run

SETTINGS = LoopSettings(K=0.6, Ti=20.0, Kp=1.0)
STEPS = np.repeat(np.random.default_rng(5).normal(0.0, 0.03, 10), 1000)


def long_rows(d: float, n: int = 10_000) -> Rows:
    record = replace(run(Loop(dead_band=d), n, load=STEPS[:n]), settings=SETTINGS)
    scanner = ConfirmationScanner(record.settings, record.interval)
    scanner.update(record)
    rows = scanner.rows()
    assert isinstance(rows, Rows)
    return rows


def test_the_stretches_where_op_travels_most_are_taken() -> None:
    n = 2000
    u = 0.001 * np.sin(np.arange(n) / 3.0)
    u[750:1000] *= 20.0
    u[1500:1750] *= 10.0
    first = np.zeros(n, dtype=bool)
    first[0] = True
    none = np.empty((0, n))
    rows = liveliest(Rows(2.0 * u, np.stack([u, u]), np.array([0.01]), first, 4.0, none, np.arange(n)), 500)
    assert rows.at is not None
    np.testing.assert_array_equal(rows.at, np.r_[750:1000, 1500:1750])
    np.testing.assert_array_equal(np.flatnonzero(rows.first), [0, 250])
    np.testing.assert_allclose(rows.x[0, :250], u[750:1000] - u[750])
    np.testing.assert_allclose(rows.y[250:], 2.0 * (u[1500:1750] - u[1500]))


def test_a_healthy_valve_ends_there_with_a_limit_that_the_whole_record_bears_out() -> None:
    rows = long_rows(0.0)
    light, full = weigh_lightly(rows), weigh(rows)
    assert light.rows < LIGHT_ROWS < full.rows
    assert max(v for _, v in light.profile) < -6.0
    assert max(v for _, v in full.profile) < -6.0


def test_a_worn_valve_gets_the_whole_test() -> None:
    rows = long_rows(0.02)
    assert excluding(liveliest(rows, LIGHT_ROWS), 6.0) is None
    assert weigh_lightly(rows) == weigh(rows)


def test_short_records_get_the_whole_test() -> None:
    rows = long_rows(0.0, 5 * (LONG - 20))
    assert weigh_lightly(rows) == weigh(rows)


@pytest.mark.parametrize("seed", range(3))
def test_the_verdict_on_a_healthy_day_names_what_would_have_been_seen(seed: int) -> None:
    report = scan(draw(900 + seed, "cascade", 0.0, samples=40_000).record)
    assert report.verdict is Verdict.NO_BACKLASH
    assert report.confirmation is not None
    assert report.confirmation.details["rows"] < LIGHT_ROWS
    assert 0.0 < (report.confirmation.limit_of_detection or 0.0) < 0.01
