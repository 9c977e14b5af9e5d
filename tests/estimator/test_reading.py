"""The reading of half periods on top of the publication's gates: setpoint moves, noise, groups, directions."""

from __future__ import annotations

import numpy as np
import pytest

from backlash_cli.estimator.haegglund import OK, TOO_SHORT, WHY, error_scanner, estimate
from backlash_cli.estimator.quality import data_quality
from backlash_cli.estimator.reading import densest, filtered_noise, gathered, output_noise, read_half_periods
from backlash_cli.half_periods import double_lag
from backlash_cli.record import LoopSettings, Note
from backlash_cli.results import Cluster, Estimates
from backlash_cli.simulator import Controller, Process, Scenario, Signal, simulate, use

SETTINGS = LoopSettings(K=0.6, Ti=20.0, Kp=1.3)


def read(d: list[float], *, dy: float = 0.004, moves: list[float] | None = None,
         noise: float = 0.0) -> tuple[Cluster | None, tuple[Note, ...]]:
    """What half periods of 200 s with such estimates say, of alternating direction, all accepted by the paper."""
    n = len(d)
    h = Estimates(0.0, 200.0 * np.arange(n), np.full(n, 200.0), np.full(n, dy), np.full(n, 1.2 * dy), np.array(d),
                  np.where(np.arange(n) % 2, -1, 1).astype(np.int8), np.full(n, OK, np.uint8), WHY)
    return read_half_periods(h, np.array(moves or [0.0] * n), SETTINGS, 1.0, noise)


def test_a_half_period_with_a_setpoint_move_says_nothing() -> None:
    cluster, notes = read([0.03, 0.029, 0.03, 0.031], moves=[0.0, 0.02, 0.0, 0.001])
    assert cluster is not None and (cluster.n, cluster.d) == (3, 0.03)
    assert [note.code for note in notes] == ["half_periods_set_aside"]
    assert notes[0].values == {"setpoint_move": 1.0, "below_noise": 0.0}


def test_a_short_half_period_passes_its_setpoint_move_on() -> None:
    for apart, counted in ((0.0, False), (1.0, True)):
        h = Estimates(0.0, np.array([0.0, 30.0 + apart]), np.array([30.0, 200.0]), np.full(2, 0.004),
                      np.full(2, 0.005), np.full(2, 0.03), np.array([1, -1], np.int8),
                      np.array([TOO_SHORT, OK], np.uint8), WHY)
        cluster, notes = read_half_periods(h, np.array([0.02, 0.0]), SETTINGS, 1.0, 0.0)
        assert (cluster is not None, not notes) == (counted, counted)


def test_noise_behind_the_estimators_filter() -> None:
    rng = np.random.default_rng(0)
    lag = double_lag(SETTINGS.Ti / 2.0, 1.0)  # type: ignore[operator]
    out, _ = lag.run(0.01 * rng.normal(size=200_000), lag.settled(0.0))
    assert filtered_noise(0.01, 1.0, 20.0) == pytest.approx(out[1000:].std(), rel=0.05)
    cluster, (note,) = read([0.03] * 4, noise=0.01)
    assert cluster is None and note.values["below_noise"] == 4.0


@pytest.mark.parametrize("Td", [0.0, 4.0])
def test_noise_on_the_output_as_the_controller_makes_it(Td: float) -> None:
    settings = LoopSettings(K=1.2, Ti=20.0, Td=Td, Tf=2.0)
    rng = np.random.default_rng(0)
    lag = double_lag(2.0, 0.1)
    smooth, _ = lag.run(0.01 * rng.normal(size=200_000), lag.settled(0.0))
    out = 1.2 * (smooth[1:] + Td * np.diff(smooth) / 0.1)
    assert output_noise(0.01, 0.1, settings) == pytest.approx(out[1000:].std(), rel=0.1)


@pytest.mark.parametrize("d, density", [(0.03, 4e-8), (0.05, 1e-7), (0.05, 4e-7), (0.1, 1e-6)])
def test_the_dither_of_noise_is_given_back(d: float, density: float) -> None:
    """The publication's second example: noise lowers the estimates by 10 to 26 %, the centre is right within 8 %."""
    rng = np.random.default_rng(0)
    loads = use("load_step", times=np.cumsum(rng.uniform(60, 140, 7)), sizes=rng.uniform(-0.2, 0.2, 7))
    record = simulate(Scenario(
        Controller(K=1.2, Ti=2.2, Td=1.2), Process(lags=(1.0,) * 4), duration=750.0, step=0.05, output=0.5,
        effects=(use("backlash", d=d), loads, use("measurement_noise", density=density)), setpoint=Signal(0.5, ()),
        seed=0, name="second",
    ))
    scanner = error_scanner(record.settings, record.interval)
    scanner.update(record)
    found = estimate(scanner.smooth.finish(), record.interval, record.settings)
    plain = densest(found.d[found.why == OK])
    noise = data_quality(record, 2.2).pv.noise
    cluster, _ = read_half_periods(found, np.zeros(len(found)), record.settings, record.interval, noise)
    assert plain is not None and cluster is not None
    assert plain.d < 0.96 * d
    assert cluster.d == pytest.approx(d, rel=0.08)
    assert cluster.limit_of_detection is not None and cluster.limit_of_detection < d


def test_two_regimes_are_two_groups() -> None:
    d = [0.02, 0.021, 0.019, 0.02, 0.05, 0.052, 0.049, 0.051, 0.2]
    assert [round(c.d, 3) for c in gathered(np.array(d))] == [0.02, 0.05] or len(gathered(np.array(d))) == 2
    assert sum(c.n for c in gathered(np.array(d))) == 8
    _, notes = read(d)
    assert [note.code for note in notes][:1] == ["several_groups"]
    assert len(gathered(np.array([0.02, 0.021, 0.019, 0.02]))) == 1
    assert gathered(np.array([0.0])) == []


def test_two_directions_are_told_apart() -> None:
    d = [0.02, 0.03] * 8
    _, notes = read(d)
    assert [note.code for note in notes] == ["directions_differ"]
    assert notes[0].values == {"above": 0.02, "below": 0.03}
    rng = np.random.default_rng(1)
    same = (0.03 + 0.002 * rng.normal(size=20)).tolist()
    assert read(same)[1] == ()
