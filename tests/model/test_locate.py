"""Where a model fails: shares of the squared error, on which side, and frequency bands that add up."""

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.model.locate import regions
from backlash_cli.model.pipeline import Shape
from backlash_cli.model.problem import problem_from_record
from backlash_cli.record import record_from_arrays


@pytest.fixture(scope="module")
def problem():
    t = np.arange(2000.0)
    output = 0.4 + 0.1 * np.abs((t % 400) / 200 - 1)  # turns up at 200, 600 ..., down at 400, 800 ...
    noise = 1e-4 * np.random.default_rng(0).standard_normal(2000)
    return problem_from_record(record_from_arrays(0.5, output + noise, output, interval=2.0))


def found(problem, error):
    return {r.region: r for r in regions(replace(problem, start=1000.0), error, Shape(10.0, 0.0))}


def test_an_error_after_upward_turns_is_placed_there_and_has_a_side(problem):
    error = np.full(2000, 0.001)
    for turn in range(200, 2000, 400):
        error[turn : turn + 10] = -0.02
    worst = found(problem, error)["after output reversals, upwards"]
    # three lags of 10 s are 15 samples of 2 s, of which 10 hold the large error
    assert worst.samples == 75 and worst.expected == pytest.approx(75 / 2000)
    inside = 5 * (10 * 0.02**2 + 5 * 0.001**2)
    assert worst.share == pytest.approx(inside / float(np.sum(error**2)))
    assert worst.rmse == pytest.approx(np.sqrt(inside / 75))
    assert "1.3 % of span below the prediction" in worst.sentence
    assert worst.stretches[0] == (1000.0 + 2 * 200, 1000.0 + 2 * 214)


def test_time_blocks_and_frequency_bands_share_out_all_of_the_error(problem):
    error = 0.01 * np.random.default_rng(1).standard_normal(2000)
    parts = regions(problem, error, Shape(10.0, 0.0))
    assert sum(r.share for r in parts if r.kind == "time") == pytest.approx(1.0)
    assert sum(r.share for r in parts if r.kind == "frequency") == pytest.approx(1.0)
    assert all("average" not in r.sentence for r in parts if r.kind == "time")
    assert "3.33 min" in found(problem, error)["slow changes"].sentence
