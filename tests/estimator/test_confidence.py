"""The stated confidence is how often verdicts are right, within chance, on a few fixed loops of the benchmark."""

from __future__ import annotations

import pytest
from scipy.stats import binom

from backlash_cli.scanning import scan
from tests.benchmarks.detect_benchmark import is_right, reliability
from tests.benchmarks.random_loops import draw


def test_verdicts_are_right_as_often_as_they_say() -> None:
    stated = []
    for seed in range(60000, 60040):
        loop = draw(seed, samples=4000)
        report = scan(loop.record)
        right = is_right(report, loop.d)
        if right is not None:
            stated.append((report.confidence, right))
    assert len(stated) > 15
    for _, _, n, mean, share in reliability(stated):
        assert binom.ppf(0.005, n, mean) <= round(share * n) <= binom.ppf(0.9995, n, mean)


def test_the_table_counts_every_verdict_once() -> None:
    rows = reliability([(0.5, True), (0.6, False), (0.97, True), (0.97, False), (1.0, True)])
    assert [row[2] for row in rows] == [1, 1, 2, 1]
    assert rows[2][3:] == pytest.approx((0.97, 0.5))
