from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.estimator.identify import identify
from backlash_cli.record import LoopSettings, Note, Record, SampleState, record_from_arrays
from tests.shared_data import shared_data

from .closed_loop import Loop, exception_reporting, load_steps, run


def identified(record: Record):
    found = identify(record)
    assert not isinstance(found, Note), found
    return found


@pytest.mark.parametrize(
    "loop",
    [
        Loop(),
        Loop(dead_band=0.03),
        Loop(K=0.4, Ti=60, lag=40, delay=12),
        Loop(K=-0.6, gain=-1.0),
        Loop(Ti=6, lag=4, delay=1),
    ],
    ids=["plain", "dead band", "slow", "direct action", "fast"],
)
def test_a_logged_pi_loop_gives_back_its_settings(loop: Loop) -> None:
    found = identified(run(loop, 5000, load=load_steps(5000)))
    blur = 0.25 / loop.Ti  # which sample the integral has taken in already
    assert found.K.value == pytest.approx(loop.K, rel=0.02 + blur)
    assert found.Ti.value == pytest.approx(loop.Ti, rel=0.02 + blur)
    assert found.ratio.value == pytest.approx(loop.K / loop.Ti, rel=0.005)
    assert found.form == "ideal PI" and found.Td.value == 0.0
    for value, truth in ((found.K, loop.K), (found.Ti, loop.Ti), (found.ratio, loop.K / loop.Ti)):
        assert value.ci95[0] <= truth <= value.ci95[1]
    assert found.separate


def test_a_derivative_part_is_found_with_its_time() -> None:
    loop = Loop(K=0.8, Ti=30, Td=8)
    found = identified(run(loop, 5000, load=load_steps(5000)))
    assert found.form == "ideal PID"
    assert found.Td.value == pytest.approx(8.0, rel=0.05)
    assert found.K.value == pytest.approx(0.8, rel=0.02)


@pytest.mark.parametrize("weight", [0.0, 0.7, 1.0])
def test_the_setpoint_weight_is_read_where_the_setpoint_moves(weight: float) -> None:
    setpoint = 0.5 + load_steps(5000, 0.05, 250, seed=4)
    found = identified(run(Loop(b=weight), 5000, setpoint=setpoint))
    assert found.b is not None and found.b.value == pytest.approx(weight, abs=0.02)


def test_no_setpoint_weight_where_the_setpoint_stands_still() -> None:
    assert identified(run(Loop(), 4000, load=load_steps(4000))).b is None


@pytest.mark.parametrize("recorder", ["output to 0.1 %", "measurement by exception 0.2 %", "means of five seconds"])
def test_what_the_recorder_does_stays_within_the_interval(recorder: str) -> None:
    loop = Loop()
    record = run(loop, 6000, load=load_steps(6000, 0.1))
    output = record.output
    assert output is not None
    if recorder == "output to 0.1 %":
        record = replace(record, output=np.round(output, 3))
    elif recorder == "measurement by exception 0.2 %":
        record = replace(record, measurement=exception_reporting(record.measurement, 0.002))
    else:
        means = [x.reshape(-1, 5).mean(1) for x in (record.setpoint, record.measurement, output)]
        record = record_from_arrays(*means, interval=5.0)
    found = identified(record)
    assert found.ratio.value == pytest.approx(loop.K / loop.Ti, rel=0.03)
    assert found.K.ci95[0] <= loop.K <= found.K.ci95[1]
    assert found.Ti.ci95[0] <= loop.Ti <= found.Ti.ci95[1]


def test_manual_periods_and_gaps_are_left_out() -> None:
    record = run(Loop(), 6000, load=load_steps(6000))
    assert record.output is not None
    output, state = record.output.copy(), record.state.copy()
    output[2000:2400] = 0.9
    state[2000:2400] = SampleState.MANUAL
    keep = np.r_[0:3500, 4200:6000]
    index = np.arange(6000)[keep]
    part = replace(
        record,
        index=index,
        setpoint=record.setpoint[keep],
        measurement=record.measurement[keep],
        output=output[keep],
        state=state[keep],
    )
    found = identified(part)
    assert found.K.value == pytest.approx(0.6, rel=0.01)
    assert found.Ti.value == pytest.approx(20.0, rel=0.01)


def test_units_scale_the_gain_and_nothing_else() -> None:
    record = run(Loop(), 4000, load=load_steps(4000))
    assert record.output is not None
    scaled = record_from_arrays(900 * record.setpoint, 900 * record.measurement, 100 * record.output, interval=1.0)
    a, b = identified(record), identified(scaled)
    assert b.K.value * 9 == pytest.approx(a.K.value, rel=1e-6)
    assert b.Ti.value == pytest.approx(a.Ti.value, rel=1e-6)


def test_a_record_without_output_says_so() -> None:
    found = identify(record_from_arrays(0.5, np.zeros(500), interval=1.0))
    assert isinstance(found, Note) and found.code == "no_output"


def test_a_constant_output_says_so() -> None:
    pv = np.random.default_rng(0).normal(size=500)
    found = identify(record_from_arrays(0.5, pv, np.full(500, 0.4), interval=1.0))
    assert isinstance(found, Note) and found.code == "output_constant"


def test_a_short_record_says_so() -> None:
    record = run(Loop(), 40, load=load_steps(40))
    found = identify(record)
    assert isinstance(found, Note) and found.code == "too_short"


def test_an_output_made_by_something_else_is_refused() -> None:
    rng = np.random.default_rng(2)
    pv, op = np.cumsum(rng.normal(size=(2, 4000)), axis=1) * 0.001
    found = identify(record_from_arrays(0.0, pv, op, interval=1.0))
    assert isinstance(found, Note) and found.code == "not_this_controller"


@pytest.mark.parametrize("decimals", [3, 9])
def test_a_proportional_controller_says_that_no_integral_part_is_seen(decimals: int) -> None:
    pv = 0.5 + 0.01 * np.cumsum(np.random.default_rng(8).normal(size=4000)) / 8.0
    record = record_from_arrays(0.5, pv, np.round(0.4 - 0.3 * (pv - 0.5), decimals), interval=1.0)
    found = identify(record)
    assert isinstance(found, Note) and found.code == "integral_part_unseen"


def test_coarse_samples_leave_only_the_quotient() -> None:
    loop = Loop(noise=0.003)
    record = run(loop, 14_000, load=load_steps(14_000, 0.1))
    assert record.output is not None
    thin = record_from_arrays(
        record.setpoint[::15], record.measurement[::15], record.output[::15], interval=15.0, settings=LoopSettings()
    )
    found = identified(thin)
    assert not found.separate
    assert found.ratio.ci95[0] <= loop.K / loop.Ti <= found.ratio.ci95[1]
    assert found.K.ci95[0] <= loop.K <= found.K.ci95[1]


def test_missing_settings_are_filled_in_and_named() -> None:
    found = identified(run(Loop(), 4000, load=load_steps(4000)))
    filled = found.settings(LoopSettings(Ti=21.0, source={"Ti": "metadata"}))
    assert filled.Ti == 21.0 and float(f"{found.K.value:.6g}") == filled.K
    assert filled.source == {"Ti": "metadata", "K": "identified"}


def test_mostly_interpolated_samples_leave_only_the_quotient() -> None:
    record = run(Loop(), 4000, load=load_steps(4000))
    state = record.state.copy()
    state[::3] = SampleState.FILLED
    found = identified(replace(record, state=state))
    assert [note.code for note in found.notes] == ["interpolated"] and not found.separate


def test_a_setpoint_that_moved_between_the_windows_only_is_no_term() -> None:
    record = run(Loop(), 4000, load=load_steps(4000))
    setpoint, keep = record.setpoint.copy(), np.r_[0:2000, 2200:4000]
    setpoint[2100:] += 0.1
    assert record.output is not None
    part = replace(
        record,
        index=record.index[keep],
        setpoint=setpoint[keep],
        measurement=record.measurement[keep] + 0.1 * (keep >= 2100),
        output=record.output[keep],
        state=record.state[keep],
    )
    found = identified(part)
    assert found.K.value == pytest.approx(0.6, rel=0.02) and found.b is None


def test_one_real_valve_has_the_same_settings_in_every_recording() -> None:
    files = sorted(shared_data("plant").glob("2411FIC20102_*.csv"))
    ratios = []
    for path in files:
        with open(path, newline="") as file:
            rows = list(csv.reader(file))
        names = {name.split(".")[-1]: k for k, name in enumerate(rows[0])}
        sp, pv, op = (np.array([float(row[names[n]]) for row in rows[1:]]) for n in ("SV", "PV", "MV"))
        found = identified(record_from_arrays(sp, pv, op, interval=10.0))
        print(path.stem, found.K, found.Ti, found.ratio)
        assert found.ratio.value == pytest.approx(0.117 / 41.0, rel=0.1)  # "about", published with the data
        ratios.append(found.ratio.value)
    assert len(files) == 9 and np.ptp(ratios) < 0.12 * np.mean(ratios)
