"""The closed loop against closed forms, scipy and invariants."""

import math
import statistics
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal as ss

from backlash_cli.effects import Effect, Stage, backlash
from backlash_cli.effects.shape import compiled
from backlash_cli.errors import LoopError, MetadataError
from backlash_cli.record import SampleState
from backlash_cli.simulator import (
    Compensator,
    Controller,
    Manual,
    Process,
    Recorder,
    Scenario,
    Scheme,
    Signal,
    simulate,
    trace,
    use,
)

P2 = Process(lags=(1.0, 1.0, 1.0, 1.0))
C2 = Controller(K=1.2, Ti=2.2, Td=1.2)
STEP_UP = Signal(0.0, (use("load_step", times=[0.0], sizes=[0.4]),))


def example_2(d=0.05, **changes):
    values = {
        "controller": C2,
        "process": P2,
        "duration": 200.0,
        "step": 0.01,
        "setpoint": STEP_UP,
        "effects": (
            use("backlash", d=d),
            use("load_step", times=[100.0], sizes=[0.2]),
            use("measurement_noise", density=4e-8),
        ),
    }
    return Scenario(**{**values, **changes})


def test_linear_loop_equals_the_transfer_function():
    """Without nonlinearity the response to a load step is the closed loop's P / (1 + P C)."""
    load = use("load_step", times=[0.0], sizes=[0.2])
    run = trace(example_2(effects=(load,), setpoint=Signal(), duration=40.0, step=0.002))
    filt = np.polymul([C2.filter_time, 1.0], [C2.filter_time, 1.0])
    c_num, c_den = C2.K * np.array([C2.Ti * C2.Td, C2.Ti, 1.0]), np.polymul([C2.Ti, 0.0], filt)
    p_den = np.poly1d([1.0, 1.0]) ** 4
    closed = (c_den, np.polyadd(np.polymul(c_den, p_den.coeffs), c_num))
    _, y = ss.step(closed, T=run.time)
    np.testing.assert_allclose(run.process_output, 0.2 * y, atol=5e-5)


def test_setpoint_weights_equal_the_transfer_function():
    pid = Controller(K=0.8, Ti=3.0, Td=0.5, Tf=0.2, b=1.0, c=0.0)
    process = Process(gain=2.0, lags=(4.0,))
    unit_step = Signal(0.0, (use("load_step", times=[0.0], sizes=[1.0]),))
    run = trace(Scenario(pid, process, 30.0, 0.001, setpoint=unit_step))
    filt = np.poly1d([0.2, 1.0]) ** 2
    p_den, back = np.poly1d([4.0, 1.0]), 0.8 * np.poly1d([1.5, 3.0, 1.0])
    forward = 0.8 * np.poly1d([3.0, 1.0])  # K (b + 1/(s Ti)) times s Ti
    den = np.poly1d([3.0, 0.0]) * filt * p_den + 2.0 * back
    _, y = ss.step(((2.0 * forward * filt).coeffs, den.coeffs), T=run.time)
    np.testing.assert_allclose(run.process_output, y, atol=1e-3)


@pytest.mark.parametrize("dead_time", [0.0, 0.03, 0.1, 0.137])
def test_sampled_process_is_exact_for_held_input(dead_time):
    """A step in manual gives the analytic step response, fractional dead time included."""
    process = Process(gain=1.5, lags=(2.0, 2.0), dead_time=dead_time)
    run = trace(Scenario(Controller(1.0, 5.0), process, 20.0, 0.1, manual=(Manual(0.0, 20.0, 0.3),)))
    t = np.maximum(run.time - dead_time, 0.0) / 2.0
    np.testing.assert_allclose(run.process_output, 0.45 * (1.0 - (1.0 + t) * np.exp(-t)), atol=1e-12)


def test_integrating_process_ramps():
    process = Process(gain=0.5, integrating=True, dead_time=0.25)
    run = trace(Scenario(Controller(1.0, 5.0), process, 5.0, 0.1, manual=(Manual(0.0, 5.0, 0.2),), output=0.1))
    np.testing.assert_allclose(run.process_output, 0.5 * 0.1 * np.maximum(run.time - 0.25, 0.0), atol=1e-12)


@pytest.mark.parametrize(
    ("process", "same"),
    [
        (Process(lags=(1.0, 2.0)), Process(denominator=(2.0, 3.0, 1.0))),
        (
            Process(gain=3.0, numerator=(-0.5, 1.0), lags=(1.0, 2.0)),
            Process(gain=3.0, numerator=(-0.5, 1.0), denominator=(2.0, 3.0, 1.0)),
        ),
        (
            Process(numerator=(0.4, 1.0), denominator=(2.0, 1.0), lags=(1.0,)),
            Process(numerator=(0.4, 1.0), denominator=(2.0, 3.0, 1.0)),
        ),
        (Process(gain=0.1, lags=(2.0,), integrating=True), Process(0.1, (), 0.0, False, (1.0,), (2.0, 1.0, 0.0))),
        (Process(numerator=(2.0,), denominator=(4.0,), lags=(1.0,)), Process(gain=0.5, lags=(1.0,))),
    ],
)
def test_ways_to_write_one_process_agree(process, same):
    omega = np.logspace(-2, 2, 20)
    np.testing.assert_allclose(process.response(omega), same.response(omega), rtol=1e-10)
    runs = [trace(Scenario(Controller(0.2, 9.0), p, 20.0, 0.1, manual=(Manual(0, 20, 0.3),))) for p in (process, same)]
    np.testing.assert_allclose(runs[0].process_output, runs[1].process_output, atol=1e-10)


def test_the_loop_starts_at_rest_and_stays_there():
    effects = (
        use("valve_characteristic", curvature=1.5),
        use("backlash", d=0.05),
        use("dead_time", theta=0.35),
        use("second_lag", tau2=0.5),
        use("saturation", low=0.05, high=0.9),
        use("rate_limit", rate=0.1),
    )
    run = trace(example_2(effects=effects, setpoint=Signal(0.6), output=0.4, step=0.1))
    np.testing.assert_allclose(run.measurement, 0.6, atol=1e-12)
    np.testing.assert_allclose(run.output, 0.4, atol=1e-12)


def test_backlash_sits_between_output_and_valve():
    run = trace(example_2(d=0.05))
    np.testing.assert_array_equal(
        run.valve, use("backlash", d=0.05).effect.apply(run.output, use("backlash", d=0.05).p, 0.01, first=0.0)
    )


def test_noise_is_repeatable_and_follows_the_seed():
    same, again, other = (simulate(example_2(seed=s)).measurement for s in (1, 1, 2))
    np.testing.assert_array_equal(same, again)
    assert np.corrcoef(same - other, other)[0, 1] < 0.9


@pytest.mark.parametrize("step", [0.01, 0.04])
def test_filtered_noise_does_not_depend_on_the_inner_step(step):
    """Noise of density S through (3) has variance S/(4 Tf); here in open loop (manual)."""
    tf = 0.4
    pid = Controller(K=1.0, Ti=10.0, Tf=tf)
    s = Scenario(pid, P2, 4000.0, step, (use("measurement_noise", density=4e-8),), manual=(Manual(0.0, 4000.0),))
    assert np.std(trace(s).error[1000:]) == pytest.approx(math.sqrt(4e-8 / (4.0 * tf)), rel=0.05)


def test_sample_time_apart_from_inner_step():
    run = trace(example_2(step=0.01, sample_time=0.1, duration=20.0))
    assert np.all(run.output.reshape(-1, 10) == run.output.reshape(-1, 10)[:, :1])
    assert np.unique(run.output).size > 100


def test_output_limits_and_anti_windup():
    """A setpoint out of reach for a while: the output leaves the limit soon after the setpoint returns."""
    sp = Signal(0.0, (use("load_step", times=[0.0, 50.0], sizes=[0.8, -0.5]),))
    pid = Controller(K=0.5, Ti=2.8, low=0.0, high=0.5)
    record = simulate(Scenario(pid, P2, 100.0, 0.05, setpoint=sp))
    assert record.output.max() == 0.5 and np.any(record.state == SampleState.SATURATED)
    after = record.index * record.interval > 50.0
    left = np.flatnonzero(after & (record.output < 0.5))[0] * record.interval - 50.0
    # without tracking the integral part would have to come back from 3 spans, which takes longer than 15 s
    assert left < 2.0 * pid.Ti
    assert record.measurement[-1] == pytest.approx(0.3, abs=1e-3)


def test_manual_holds_and_returns_without_a_bump():
    run = trace(example_2(d=0.0, manual=(Manual(40.0, 60.0, 0.45),), step=0.05))
    inside = (run.time >= 40.0) & (run.time < 60.0)
    assert np.all(run.output[inside] == 0.45)
    back = np.flatnonzero(inside)[-1]
    assert abs(run.output[back + 1] - run.output[back]) < 0.01
    record = simulate(example_2(manual=(Manual(40.0, 60.0),), record_interval=1.0))
    assert np.array_equal(np.flatnonzero(record.state == SampleState.MANUAL), np.arange(40, 60))


def test_record_reads_like_an_export():
    record = simulate(example_2(record_interval=0.1, name="FIC101", start=1e9))
    assert (record.loop, record.interval, len(record), record.time[1]) == ("FIC101", 0.1, 2000, 1e9 + 0.1)
    s = record.settings
    assert (s.K, s.Ti, s.Td, s.Kp) == (1.2, 2.2, 1.2, 1.0)
    assert s.filter_time == pytest.approx(0.24)


def test_measured_columns_push_the_process_and_are_recorded():
    column = Signal(20.0, (use("load_step", times=[10.0], sizes=[5.0]),))
    push = use("measured_disturbance", column="DV1", gain=0.01)
    run = trace(example_2(effects=(push,), setpoint=Signal(), columns={"DV1": column}, duration=300.0))
    # the feedback takes the constant load away: output ends where it cancels the column
    assert run.output[-1] == pytest.approx(-0.25, abs=1e-6)
    assert set(simulate(run.scenario).disturbances) == {"DV1"}
    with pytest.raises(MetadataError, match=r"DV2.*did you mean DV1"):
        trace(example_2(effects=(use("measured_disturbance", column="DV2", gain=1.0),), columns={"DV1": column}))


@pytest.mark.parametrize("scheme", [Scheme.OUTPUT, Scheme.FILTERED_OUTPUT])
def test_ideal_compensation_undoes_backlash(scheme):
    """Example 3: integrating process, no noise, gain equal to the dead band: hardly any limit cycle is left."""
    process, pid = Process(lags=(0.8,), dead_time=0.2, integrating=True), Controller(K=1.9, Ti=2.4, Td=0.67)
    base = Scenario(pid, process, 100.0, 0.01, (use("backlash", d=0.05),), STEP_UP)
    with_gap = np.ptp(trace(base).process_output[5000:])
    fixed = Scenario(pid, process, 100.0, 0.01, base.effects, STEP_UP, compensator=Compensator(0.05, scheme))
    assert np.ptp(trace(fixed).process_output[5000:]) < 0.15 * with_gap


def test_error_scheme_adds_half_the_gain_with_the_sign_of_the_error():
    base = example_2(d=0.0, effects=(use("load_step", times=[30.0], sizes=[0.2]),), setpoint=Signal())
    helper = Compensator(0.04, Scheme.ERROR, hysteresis=0.001)
    run = trace(Scenario(C2, P2, 34.0, 0.01, base.effects, compensator=helper))
    plain = trace(Scenario(C2, P2, 34.0, 0.01, base.effects))
    jump = np.flatnonzero(np.abs(np.diff(run.output)) > 0.019)
    assert len(jump) == 1 and run.error[jump[0] + 1] < -0.001 <= run.error[jump[0]]
    assert run.output[jump[0] + 1] - plain.output[jump[0] + 1] == pytest.approx(-0.02)


def test_an_unstable_loop_is_an_error_and_gives_no_record():
    with pytest.raises(LoopError, match="unstable") as caught:
        simulate(example_2(controller=Controller(K=20.0, Ti=2.2)))
    assert caught.value.code == "unstable_loop"
    with pytest.raises(LoopError, match="unstable"):
        simulate(example_2(controller=Controller(K=-1.2, Ti=2.2)))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Process(lags=(1.0, -2.0)), "lag of -2 s"),
        (lambda: Process(lags=(1.0,), dead_time=-1.0), "dead time of -1"),
        (lambda: Process(gain=2.0), "answers at once"),
        (lambda: Process(gain=0.0, lags=(1.0,)), "gain"),
        (lambda: Process(lags=("fast",)), "list of numbers"),
        (lambda: Controller(K=1.0, Ti=0.0), "Ti = 0"),
        (lambda: Controller(K=0.0, Ti=1.0), "K = 0"),
        (lambda: Controller(K=1.0, Ti=1.0, low=1.0, high=0.0), "no room"),
        (lambda: Compensator(gain=-0.1), "gain = -0.1"),
        (lambda: Compensator(gain=0.1, scheme=3), "scheme 3"),
        (lambda: example_2(step=0.01, sample_time=0.015), "not a multiple"),
        (lambda: example_2(duration=-1.0), "duration"),
        (lambda: use("backlsh", d=0.1), "did you mean backlash"),
        (lambda: use("backlash", dd=0.1), "no parameter 'dd'"),
    ],
)
def test_impossible_descriptions_are_refused(make, says):
    with pytest.raises(MetadataError, match=says):
        make()


def test_recorder_holds_or_draws_lines():
    hold = Recorder(use("exception_compression", deviation=0.01), ("PV",))
    lines = Recorder(hold.applied, ("PV",), lines=True)
    plain, held, drawn = (
        simulate(example_2(recorder=r, record_interval=0.1)) for r in ((), (hold,), (lines,))
    )
    assert np.max(np.abs(held.measurement - plain.measurement)) <= 0.01
    assert np.max(np.abs(drawn.measurement - plain.measurement)) <= 0.02
    assert np.mean(np.diff(held.measurement) == 0.0) > 0.8
    assert np.mean(np.diff(drawn.measurement) == 0.0) < 0.8
    np.testing.assert_array_equal(held.output, plain.output)


def test_an_effect_in_plain_python_runs_in_the_loop_and_equals_the_compiled_one():
    mine = Effect("my_gap", Stage.VALVE, "", "", backlash.EFFECT.parameters, backlash.start, gap_in_plain_python)
    assert compiled(mine.step) is None
    noise = use("measurement_noise", density=4e-8)
    plain = trace(example_2(duration=5.0, effects=(use(mine, d=0.05), noise)))
    fast = trace(example_2(duration=5.0, effects=(use("backlash", d=0.05), noise)))
    np.testing.assert_allclose(plain.output, fast.output, atol=1e-12)


def gap_in_plain_python(state, value, p):
    """Play written with a module that is beyond numba."""
    state[0] = statistics.median([state[0], value - 0.5 * p[0], value + 0.5 * p[0]])
    return state[0]


def test_example_2_takes_less_than_a_fifth_of_a_second():
    trace(example_2())
    times = []
    for seed in range(3):
        begin = time.perf_counter()
        simulate(example_2(seed=seed))
        times.append(time.perf_counter() - begin)
    assert min(times) < 0.2


@given(st.floats(0.1, 3.0), st.booleans())
@settings(max_examples=10, deadline=None)
def test_the_loop_scales_and_mirrors(scale, mirror):
    """Dead band, load and setpoint times s give every signal times s; both gains negative mirror the output."""
    sign = -1.0 if mirror else 1.0

    def run(s, sign):
        effects = (use("backlash", d=0.04 * s), use("load_step", times=[15.0], sizes=[sign * 0.1 * s]))
        setpoint = Signal(0.0, (use("load_step", times=[0.0], sizes=[0.3 * s]),))
        pid, process = Controller(K=sign * 1.2, Ti=2.2, Td=1.2), Process(gain=sign, lags=(1.0,) * 4)
        return trace(Scenario(pid, process, 40.0, 0.05, effects, setpoint, compensator=Compensator(0.01 * s, 7)))

    base, other = run(1.0, 1.0), run(scale, sign)
    np.testing.assert_allclose(other.process_output, scale * base.process_output, atol=1e-9)
    np.testing.assert_allclose(other.output, sign * scale * base.output, atol=1e-9)
