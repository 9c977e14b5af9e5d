"""Describing function and limit cycle against the Fourier integral, the paper and the simulated loop."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.errors import UsageError
from backlash_cli.kernels import play
from backlash_cli.simulator import Controller, Process, Scenario, Signal, trace, use
from backlash_cli.simulator.limit_cycle import describing_function, limit_cycle

P1 = Process(lags=(0.8,), dead_time=0.2, integrating=True)
C1 = Controller(K=1.9, Ti=2.4, Td=0.67)
P2 = Process(lags=(1.0, 1.0, 1.0, 1.0))
C2 = Controller(K=1.2, Ti=2.2, Td=1.2)


@given(st.floats(0.01, 1.98))
@settings(max_examples=25, deadline=None)
def test_describing_function_equals_the_fourier_integral(ratio):
    n = 20_000
    angle = 2 * np.pi * np.arange(3 * n) / n
    x = play(np.sin(angle), ratio, 0.0)[-n:]
    brute = 2 * np.mean(x * np.exp(-1j * angle[-n:])) / -1j
    assert abs(describing_function(ratio) - brute) < 2e-4


def test_describing_function_at_its_ends():
    assert describing_function(0.0) == pytest.approx(1.0)
    assert abs(describing_function(2.0)) == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(UsageError, match=r"0\.\.2"):
        describing_function(2.1)


def test_example_1_of_the_paper():
    """7.7 s and 4.4 %; the amplitude is the one at the controller output, at the measurement it is 2.34 %."""
    cycle = limit_cycle(C1, P1, 0.05)
    assert cycle is not None
    assert cycle.period == pytest.approx(7.71, abs=0.01)
    assert cycle.amplitude_u == pytest.approx(0.0440, abs=1e-4)
    assert cycle.amplitude_y == pytest.approx(0.0234, abs=1e-4)


def test_example_2_of_the_paper_has_no_limit_cycle():
    assert limit_cycle(C2, P2, 0.05) is None
    assert limit_cycle(C1, P1, 0.0) is None


@given(st.floats(0.001, 0.2))
@settings(max_examples=10, deadline=None)
def test_period_does_not_depend_on_d_and_amplitude_is_proportional(d):
    cycle, unit = limit_cycle(C1, P1, d), limit_cycle(C1, P1, 1.0)
    assert cycle.period == pytest.approx(unit.period)
    assert cycle.amplitude_u == pytest.approx(d * unit.amplitude_u)
    assert cycle.amplitude_y == pytest.approx(d * unit.amplitude_y)


def simulated(controller, process, d, periods=12):
    cycle = limit_cycle(controller, process, d)
    duration = (3 + periods) * 4 * cycle.period
    step = cycle.period / 1000
    kick = use("load_step", times=[0.0], sizes=[2.0 * d])
    run = trace(Scenario(controller, process, duration, step, (use("backlash", d=d), kick), Signal(0.5), 0.5))
    tail = run.time > duration - periods * cycle.period
    y, u = run.process_output[tail] - 0.5, run.output[tail]
    rises = np.flatnonzero((y[:-1] < 0) & (y[1:] >= 0))
    return cycle, np.mean(np.diff(rises)) * step, np.ptp(u) / 2, np.ptp(y) / 2


@pytest.mark.parametrize(
    ("controller", "process", "tolerance"),
    [
        (C1, P1, 0.05),
        (Controller(K=2.0, Ti=30.0), Process(gain=0.02, lags=(5.0,), integrating=True), 0.05),
        (Controller(K=-2.0, Ti=30.0), Process(gain=-0.02, lags=(5.0,), integrating=True), 0.05),
        (Controller(K=4.0, Ti=5.0), Process(lags=(50.0,), dead_time=1.0), 0.15),
    ],
)
def test_simulated_limit_cycle_agrees(controller, process, tolerance):
    """The describing function neglects harmonics, so it is right to a few percent."""
    cycle, period, at_u, at_y = simulated(controller, process, 0.05)
    assert period == pytest.approx(cycle.period, rel=tolerance)
    assert at_u == pytest.approx(cycle.amplitude_u, rel=tolerance)
    assert at_y == pytest.approx(cycle.amplitude_y, rel=tolerance)


def test_simulated_limit_cycle_scales_with_the_dead_band():
    """Period independent of d, amplitude proportional to d: exact for the simulated loop too."""
    _, period, at_u, at_y = simulated(C1, P1, 0.03)
    _, period_2, at_u_2, at_y_2 = simulated(C1, P1, 0.06)
    assert period_2 == pytest.approx(period, rel=1e-3)
    assert at_u_2 == pytest.approx(2 * at_u, rel=1e-3)
    assert at_y_2 == pytest.approx(2 * at_y, rel=1e-3)


def test_no_limit_cycle_predicted_none_simulated():
    effects = (use("backlash", d=0.05), use("load_step", times=[0.0], sizes=[0.1]))
    run = trace(Scenario(C2, P2, 300.0, 0.02, effects, Signal(0.5)))
    late = run.process_output[run.time > 200.0]
    # what is left is the slow drift of the output through the gap, far from an oscillation of amplitude ~ d
    assert np.ptp(late) < 0.01
