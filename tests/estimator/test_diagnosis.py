from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from backlash_cli.estimator.diagnosis import diagnose
from backlash_cli.estimator.wave import find_period, mean_cycle, sustained
from backlash_cli.record import Record, record_from_arrays
from tests.benchmarks.cycling_loops import draw
from tests.benchmarks.diagnosis_benchmark import judged
from tests.shared_data import shared_data

from .closed_loop import Loop, run

TIME = np.arange(6000)
KICK = np.where(TIME > 50, 0.07, 0.0)
INTEGRATING = Loop(K=0.5, Ti=40, lag=40, delay=2, integrating=True, dead_band=0.04, noise=0.0005)


def sticking(seed: int = 0) -> Record:
    return run(Loop(K=0.6, Ti=12, lag=6, delay=4, stick=0.03, noise=0.0005), 6000, load=KICK, seed=seed)


@pytest.mark.parametrize("seed", range(3))
def test_a_sticking_valve_is_seen(seed: int) -> None:
    found = diagnose(sticking(seed))
    assert found.kind == "stiction"
    assert found.grounds["mean_cycle"] < 0.6 and found.grounds["symmetry"] == 1.0
    assert "is backlash plus stiction band" in found.statement


@pytest.mark.parametrize("seed", range(3))
def test_backlash_in_an_integrating_loop_is_found_with_its_size(seed: int) -> None:
    found = diagnose(run(INTEGRATING, 6000, load=0.2 * KICK, seed=seed))
    assert found.kind == "backlash_integrating"
    assert found.d == pytest.approx(0.04, rel=0.25)
    assert "is backlash plus stiction band" in found.statement


@pytest.mark.parametrize("period", [70, 200, 500])
def test_a_sine_from_outside_is_not_blamed_on_the_valve(period: int) -> None:
    found = diagnose(run(Loop(), 6000, load=0.03 * np.sin(2 * np.pi * TIME / period)))
    assert found.kind == "external"
    assert found.period == pytest.approx(period, rel=0.01)
    assert found.d is None


def test_a_square_load_is_not_blamed_on_the_valve() -> None:
    found = diagnose(run(Loop(), 6000, load=0.03 * np.sign(np.sin(2 * np.pi * TIME / 300))))
    assert found.kind in ("external", "unclear")


def test_an_oscillating_setpoint_is_named() -> None:
    found = diagnose(run(Loop(), 6000, setpoint=0.5 + 0.03 * np.sin(2 * np.pi * TIME / 300)))
    assert found.kind == "setpoint"


def test_a_loop_near_its_limit_forgets_its_phase() -> None:
    load = np.cumsum(np.random.default_rng(3).normal(size=6000)) * 0.002
    found = diagnose(run(Loop(K=2.6, Ti=12, lag=12, delay=4), 6000, load=load))
    assert found.kind == "aggressive_tuning"


def test_a_quiet_loop_does_not_oscillate() -> None:
    assert diagnose(run(Loop(), 4000)).kind == "none"
    assert diagnose(record_from_arrays(0.5, np.full(300, 0.5), interval=1.0)).kind == "none"
    assert diagnose(record_from_arrays(0.5, np.full(3, 0.5), interval=1.0)).period is None


def test_without_output_nothing_is_said_of_the_valve() -> None:
    record = sticking()
    found = diagnose(record_from_arrays(record.setpoint, record.measurement, interval=1.0))
    assert found.kind in ("external", "unclear") and found.d is None


def test_a_direct_acting_loop_looks_the_same() -> None:
    record = sticking()
    assert record.output is not None
    turned = record_from_arrays(record.setpoint, record.measurement, 1.0 - record.output, interval=1.0)
    assert diagnose(turned).kind == diagnose(record).kind


@pytest.mark.parametrize("period", [12.0, 40.5, 333.3])
def test_the_period_of_a_noisy_sine(period: float) -> None:
    values = np.sin(2 * np.pi * TIME / period) + 0.3 * np.random.default_rng(0).normal(size=6000)
    found, height = find_period(values)
    assert found == pytest.approx(period, rel=0.02)
    assert height == pytest.approx(0.5 / 0.59, abs=0.03)
    assert sustained(values, found, height) > 0.8


def test_the_mean_cycle_of_a_linear_process_needs_no_gap() -> None:
    op = np.sin(2 * np.pi * TIME / 100) + 0.2 * np.sin(6 * np.pi * TIME / 100)
    pv = np.zeros(6000)
    for k in range(1, 6000):
        pv[k] = pv[k - 1] + (op[k - 1] - pv[k - 1]) / 20
    noise = 0.01 * np.random.default_rng(1).normal(size=6000)
    test = mean_cycle(pv + noise, op, 100.0)
    assert test is not None and test.misfit < 2.0 and test.evidence < 10.0


def test_the_controllers_own_law_does_not_pass_for_a_process() -> None:
    """PV = -OP / K is exact in every loop with P action; as a process it would have the wrong sign."""
    op = np.sin(2 * np.pi * TIME / 100) + 0.3 * np.sin(4 * np.pi * TIME / 100 + 1.0)
    noise = 0.01 * np.random.default_rng(1).normal(size=6000)
    pv = np.zeros(6000)
    for k in range(1, 6000):
        pv[k] = pv[k - 1] + (-op[k - 1] / 2.0 - pv[k - 1]) / 4.0
    backwards = mean_cycle(pv + noise, op, 100.0)
    forwards = mean_cycle(pv + noise, op, 100.0, action=-1.0)
    assert backwards is not None and backwards.misfit > 10.0
    assert forwards is not None and forwards.misfit < 2.0


@pytest.mark.parametrize("cause", ["stick", "level, gap", "sine", "square", "sawtooth", "tight"])
def test_what_is_said_of_drawn_loops_is_right_or_nothing(cause: str) -> None:
    """Few of the loops of the benchmark, which plays 600: there 5 of 100 statements may be wrong, none was."""
    said = [judged(cause, diagnose(draw(seed, cause).record).kind) for seed in range(9000, 9008)]
    assert "wrong" not in said
    assert said.count("right") >= (0 if cause in ("sawtooth", "tight") else 4)


@pytest.mark.parametrize("loop", ["CHEM1", "CHEM10", "CHEM13", "CHEM2", "CHEM23", "PAP2", "PAP4", "PAP7"])
def test_recordings_of_the_stiction_data_base(loop: str) -> None:
    folder = shared_data("isdb")
    about = json.loads((folder / "labels.json").read_text())[loop]
    with open(folder / f"{loop}.csv", newline="") as file:
        rows = np.array([[float(x) for x in row] for row in list(csv.reader(file))[1:]])
    found = diagnose(record_from_arrays(rows[:, 1].mean(), rows[:, 1], rows[:, 2], interval=about["interval_s"]))
    print(loop, about["label"], found.kind, found.grounds)
    if not about["label"].startswith("stiction"):
        assert found.kind not in ("stiction", "backlash_integrating")
    elif found.kind != "none":
        assert found.kind == "stiction"
