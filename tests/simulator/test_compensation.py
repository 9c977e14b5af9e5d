"""Compensation before and after: process fit, noise, trials, choice of the gain, outputs."""

import json
from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.commands.options import dead_band
from backlash_cli.errors import LoopError, MetadataError, UsageError
from backlash_cli.model.problem import noise_floor
from backlash_cli.record import Note, record_from_arrays
from backlash_cli.reporter.advice import ADVICE, compensation
from backlash_cli.simulator import Controller, Process, Scenario, Signal, simulate, trace, use
from backlash_cli.simulator.compensation import (
    MARGIN,
    CompensationStudy,
    choose,
    compensate,
    contradiction,
    density_of,
    gain_margin,
    goes_on_oscillating,
    noise_gains,
    study,
    typical_load,
)
from backlash_cli.simulator.process_fit import fit_process
from backlash_cli.simulator.scenario_file import load_scenarios, parse_process, with_dead_band

FLOW = Process(gain=1.3, lags=(20.0, 4.0), dead_time=3.0)
PI = Controller(K=0.6, Ti=28.0)
D = 0.03


def recording(d=D, *, process=FLOW, controller=PI, noise=4e-7, hours=2.0, seed=3):
    random = np.random.default_rng(seed)
    duration = 3600.0 * hours
    n = int(8 * hours)
    moves = use("load_step", times=(duration * (np.arange(n) + 0.5) / n).tolist(),
                sizes=(random.uniform(0.03, 0.06, n) * np.where(np.arange(n) % 2, -1, 1)).tolist())
    effects = (use("backlash", d=d), use("random_load", sd=0.01, time_constant=300.0),
               use("measurement_noise", density=noise))
    record = simulate(Scenario(controller, process, duration, 0.5, effects, Signal(0.5, (moves,)), 0.5,
                               record_interval=1.0, seed=seed, name="FIC1"))
    return replace(record, settings=replace(record.settings, Kp=None, theta=None))


def known(**changes):
    values = {"controller": PI, "process": FLOW, "d": D, "interval": (0.025, 0.035), "density": 4e-7, "load": 0.05,
              "hysteresis": 0.0003, "rule_gain": 0.02, "reason": "the rule", "loop": "FIC1", "d_source": "given",
              "output_noise": 0.001}
    return CompensationStudy(**{**values, **changes})


@pytest.fixture(scope="module")
def advice():
    return compensate(recording(), dead_band=D)


# noise


@pytest.mark.parametrize("controller", [Controller(K=0.8, Ti=1e7, Tf=2.0), Controller(K=0.8, Ti=1e7, Td=5.0, Tf=1.0)])
def test_noise_on_the_output_follows_the_closed_form(controller):
    density = 1e-5
    idle = Process(gain=1e-9, lags=(1.0,))
    noise = (use("measurement_noise", density=density),)
    run = trace(Scenario(controller, idle, 4000.0, 0.05, noise, seed=1))
    filtered, output = noise_gains(controller)
    assert np.std(run.error) == pytest.approx(filtered * np.sqrt(density), rel=0.06)
    assert np.std(run.output) == pytest.approx(output * np.sqrt(density), rel=0.06)


def test_white_noise_is_seen_under_steps_trends_and_curves():
    random = np.random.default_rng(0)
    index = np.arange(5000.0)
    slow = np.sin(index / 200) + 0.001 * index + (index > 2500)
    assert noise_floor(slow + 0.01 * random.standard_normal(5000)) == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize("controller", [PI, replace(PI, Td=6.0)])
def test_noise_density_of_a_record(controller):
    """The controller samples twice as fast as the historian; OP tells what it sees."""
    record = recording(noise=1e-6, controller=controller)
    assert density_of(record, controller) == pytest.approx(1e-6, rel=0.3)
    rounded = replace(record, output=np.round(record.output, 2))
    assert 1e-6 < density_of(rounded, controller) < 2.6e-6


def test_typical_load_lies_between_the_dead_band_and_a_fifth_of_the_span():
    quiet = record_from_arrays(0.5, np.full(100, 0.5), np.full(100, 0.4), interval=1.0)
    wild = record_from_arrays(0.5, np.full(100, 0.5), np.linspace(0, 1, 100), interval=1.0)
    assert typical_load(quiet, 0.02) == pytest.approx(0.03)
    assert typical_load(wild, 0.02) == pytest.approx(0.2)
    assert typical_load(replace(quiet, output=None), 0.02) == pytest.approx(0.06)


# process fit


@pytest.mark.parametrize(("process", "gain"), [(FLOW, None), (FLOW, 1.3), (Process(0.7, (40.0,), 15.0), None),
                                               (Process(2.0, (15.0, 15.0, 15.0)), None)])
def test_fit_finds_the_process_in_closed_loop(process, gain):
    """Gain within 25 %, and the 63 % time of the step response within 25 %."""
    controller = Controller(K=0.5 / process.gain, Ti=30.0)
    found = fit_process(recording(process=process, controller=controller), D, gain)
    assert found.gain == pytest.approx(process.gain, rel=0.25 if gain is None else 1e-12)
    reach = process.dead_time + sum(process.lags)
    assert found.dead_time + sum(found.lags) == pytest.approx(reach, rel=0.25)
    assert found.source == "fitted"


def test_fit_with_reverse_action():
    record = recording(process=replace(FLOW, gain=-1.3), controller=replace(PI, K=-0.6))
    assert fit_process(record, D).gain == pytest.approx(-1.3, rel=0.3)


def test_fit_goes_over_gaps():
    record = recording()
    keep = (np.arange(len(record)) % 2500) > 200
    cut = replace(record, index=record.index[keep], setpoint=record.setpoint[keep], state=record.state[keep],
                  measurement=record.measurement[keep], output=record.output[keep])
    assert fit_process(cut, D).gain == pytest.approx(1.3, rel=0.3)


def test_too_large_a_dead_band_contradicts_the_record():
    low, best = contradiction(fit_process(recording(), 2 * D))
    assert low <= best
    assert best == pytest.approx(D, rel=0.25)
    assert contradiction(fit_process(recording(), D)) is None


def test_fit_refuses_with_a_code():
    record = recording(hours=0.5)
    with pytest.raises(LoopError) as error:
        fit_process(replace(record, output=None), D)
    assert error.value.code == "no_output"
    with pytest.raises(LoopError) as error:
        fit_process(record.slice(0, 300), D)
    assert error.value.code == "insufficient_data"
    with pytest.raises(LoopError) as error:
        fit_process(replace(record, output=np.full(len(record), 0.4)), D)
    assert error.value.code == "constant_signal"
    noise = np.random.default_rng(1).standard_normal(len(record))
    with pytest.raises(LoopError) as error:
        fit_process(replace(record, measurement=0.5 + 0.01 * noise), D)
    assert error.value.code in ("no_process", "integrating")


def test_gain_margin_of_a_known_loop():
    """K / (s Ti) with dead time L crosses -180 degrees at w = pi / (2 L): margin pi Ti / (2 K L)."""
    controller = Controller(K=0.5, Ti=20.0, Tf=1e-6)
    process = Process(gain=1.0, lags=(20.0,), dead_time=10.0)  # PI zero cancels the lag
    assert gain_margin(controller, process) == pytest.approx(np.pi * 20.0 / (2 * 0.5 * 10.0), rel=0.01)


# trials and choice


def test_limit_cycles_of_the_papers_examples():
    for name, expected in (("example-1", True), ("example-2", False)):
        s = with_dead_band(load_scenarios(name), 0.05)[0]
        case = known(controller=s.controller, process=s.process, d=0.05, hysteresis=0.0)
        assert goes_on_oscillating(case, 0.0) is expected


def test_a_good_gain_lowers_the_error_and_spares_the_valve():
    found = study(known())
    best = found.trial(found.recommended)
    assert found.recommended == 0.02
    assert best.iae < 0.85 * found.base.iae
    assert best.valve_travel_per_hour < 1.3 * found.base.valve_travel_per_hour
    assert not best.limit_cycle
    assert any(t.gain == pytest.approx(MARGIN * 0.02) for t in found.trials)
    assert found.trial(1.2 * D).valve_travel_per_hour > 1.3 * found.base.valve_travel_per_hour


def test_too_large_a_gain_is_stepped_back():
    found = study(known(rule_gain=0.034))
    assert found.recommended == pytest.approx(0.75 * 0.034) or found.recommended == pytest.approx(0.5 * 0.034)
    assert found.refusals
    assert "because at more" in found.reason


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"process": Process(gain=0.02, lags=(5.0,), integrating=True), "controller": Controller(K=2.0, Ti=30.0)},
         "integrating"),
        ({"process": Process(lags=(50.0,), dead_time=1.0), "controller": Controller(K=4.0, Ti=5.0)}, "limit_cycle"),
        ({"rule_gain": 0.0, "reason": "noise"}, "noisy_output"),
    ],
)
def test_refusals(changes, code):
    case = known(**changes)
    found = study(case)
    assert found.recommended is None
    assert found.after is None
    assert found.refusals[0].code == code
    assert "no compensator" in compensation(found).text()


def test_objections_name_travel_and_lack_of_improvement():
    s = known()
    base = study(s).base
    far = 2 * base.valve_travel_per_hour
    worn = {g: replace(base, gain=g, valve_travel_per_hour=far, iae=0.5 * base.iae) for g in gains_of(s)}
    dull = {g: replace(base, gain=g) for g in gains_of(s)}
    for trials, code in ((worn, "valve_travel"), (dull, "no_improvement")):
        gain, _, notes = choose(s, {**trials, 0.0: base})
        assert gain is None
        assert {n.code for n in notes} == {code}


def gains_of(s):
    return [back * s.rule_gain * margin for back in (1.0, 0.75, 0.5) for margin in (1.0, MARGIN)]


def test_same_seed_same_study():
    first, second = (study(known()) for _ in range(2))
    assert first.trials == second.trials


# from record to advice


def test_advice_from_a_record(advice):
    assert advice.recommended is not None
    assert 0.4 * D < advice.recommended <= 0.8 * D
    assert advice.process.source == "fitted"
    assert advice.trial(advice.recommended).iae < advice.base.iae
    assert not advice.trial(advice.recommended).limit_cycle


def test_a_given_process_is_used(advice):
    found = compensate(recording(), dead_band=D, process=FLOW)
    assert found.process.source == "given"
    assert found.process.gain == 1.3
    assert found.recommended == pytest.approx(advice.recommended, rel=0.3)


def test_positive_feedback_is_refused():
    with pytest.raises(LoopError, match="positive feedback"):
        compensate(recording(), dead_band=D, process=replace(FLOW, gain=-1.0))


def test_a_valve_test_that_overstates_the_dead_band_is_noticed():
    found = compensate(recording(), dead_band=2 * D)
    assert found.d == pytest.approx(D, rel=0.25)
    assert "smaller_dead_band" in {n.code for n in found.warnings}


def test_no_backlash_no_advice():
    with pytest.raises(LoopError) as error:
        compensate(recording(d=0.0))
    assert error.value.code == "no_dead_band"
    assert "--dead-band" in error.value.remedy


def test_settings_that_did_not_make_the_record_are_refused():
    """Simulated with Ti in minutes taken for seconds, the advice would be for another loop."""
    record = recording()
    with pytest.raises(LoopError) as error:
        compensate(replace(record, settings=replace(record.settings, Ti=record.settings.Ti / 60.0)), dead_band=D)
    assert error.value.code == "wrong_settings" and "minutes" in str(error.value)


def test_settings_that_can_hardly_be_are_refused():
    doubt = Note("settings_doubtful", "Tf = 5000 can hardly be beside K = 0.6 and Ti = 28 s")
    with pytest.raises(LoopError, match="Tf = 5000 can hardly be") as error:
        compensate(replace(recording(), notes=(doubt,)), dead_band=D)
    assert error.value.code == "wrong_settings"


def test_a_dead_band_that_is_not_there_is_refused():
    """Either nothing fits better, or only a gap too small to compensate."""
    try:
        found = compensate(recording(d=0.0), dead_band=0.06)
    except LoopError as error:
        assert error.code == "no_dead_band"
    else:
        assert found.d <= 0.01
        assert "smaller_dead_band" in {n.code for n in found.warnings}


def test_outputs(advice):
    text = compensation(advice).text()
    assert max(map(len, text.splitlines())) <= 100
    assert ADVICE[:30] in text
    document = json.loads(compensation(advice).json())
    assert document["recommended"]["gain"] == advice.recommended
    assert len(document["trials"]) == len(advice.trials)
    html = compensation(advice).page()
    assert "advice to a person" in html


def test_names_from_the_plant_cannot_become_markup(advice):
    assert "<script>alert" not in compensation(replace(advice, loop="<script>alert(1)</script>")).page()


# what a person writes


def test_process_text_and_file(tmp_path):
    assert parse_process("Kp=1.3,T=20s,L=2") == Process(gain=1.3, lags=(20.0,), dead_time=2.0)
    assert parse_process("T1=20;T2=3") == Process(lags=(20.0, 3.0))
    file = tmp_path / "p.toml"
    file.write_text("[process]\ngain = 1.3\nlags = [20.0, 3.0]\ndead_time = 2.0\n")
    assert parse_process(str(file)) == Process(1.3, (20.0, 3.0), 2.0)


@pytest.mark.parametrize("text", ["K=1.3", "T=x", "T=-3", "Q=3,T=1", "T", "T=1,T=2", "K=0,T=1", "L=-1,T=2"])
def test_process_text_that_cannot_be(text):
    with pytest.raises(MetadataError):
        parse_process(text)


@pytest.mark.parametrize("content", ["gain = [", "gian = 1.0", 'lags = "a"', "process = 3", "lags = 3", "lags = [-1]"])
def test_process_file_that_cannot_be(tmp_path, content):
    file = tmp_path / "p.toml"
    file.write_text(content)
    with pytest.raises(MetadataError):
        parse_process(str(file))
    with pytest.raises(MetadataError, match="cannot be read"):
        parse_process(str(tmp_path / "none.toml"))


@pytest.mark.parametrize("text", ["x", "0", "-0.1", "0.8", "60%", "nan", ""])
def test_dead_band_that_cannot_be(text):
    with pytest.raises(UsageError, match="--dead-band"):
        dead_band(text)
