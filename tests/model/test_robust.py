"""The same sticking valve, found again through what exports do to a record."""

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli import explain, read
from backlash_cli.model.problem import between_steps, step_of
from backlash_cli.record import LoopSettings, SampleState, record_from_arrays
from tests.benchmarks.hidden_effects import draw

FRICTION = {"backlash", "stiction"}


@pytest.fixture(scope="module")
def case():
    """Return a simulated loop with a sticking valve, S and J known."""
    return draw(1203, "clean", "stiction")


def held(found, case) -> None:
    """The valve's friction is the only effect of the valve, and its interval holds the truth."""
    effect = next(e for e in found.effects if e.effect in FRICTION)
    width = effect.parameters["S" if effect.effect == "stiction" else "d"]
    low, high = width.ci95
    true = float(case.truth["stiction"]["S"])
    assert low <= true <= high
    assert high - low < 0.6 * true
    assert [e.effect for e in found.effects if e.stage == "valve"] == [effect.effect]


def as_csv(record, path, times, *, pv=lambda v: v, op=lambda v: v):
    """Write a record as a single-loop CSV with given times [s] and read it again."""
    stamps = (np.datetime64("2026-03-02T06:00:00") + (1e6 * times).astype("timedelta64[us]")).astype(str)
    rows = zip(stamps, pv(record.setpoint), pv(record.measurement), op(record.output), strict=True)
    path.write_text("time,SP,PV,OP\n" + "\n".join(f"{t}Z,{a:.6f},{b:.6f},{c:.6f}" for t, a, b, c in rows) + "\n")
    return next(iter(read(path)))


def settings_beside(path, settings, extra: str = "", sign: float = 1.0) -> None:
    """Write the controller's settings beside a file."""
    text = f"[loops.{path.stem}]\nK = {sign * settings.K}\nTi = {settings.Ti}\nTd = {settings.Td}\n{extra}"
    (path.parent / f"{path.stem}.loops.toml").write_text(text)


def test_op_recorded_in_steps_of_half_a_percent(case):
    coarse = np.round(case.record.output / 0.005) * 0.005
    held(explain(replace(case.record, output=coarse)), case)


def test_engineering_units_a_negative_gain_and_time_stamps_that_jitter(case, tmp_path):
    record = case.record
    path = tmp_path / "V2.csv"
    settings_beside(path, record.settings, "pv_range = [0, 400]\nop_range = [0, 100]\n", sign=-1.0)
    jitter = np.random.default_rng(1).uniform(-0.25, 0.25, len(record)) * record.interval
    held(explain(as_csv(record, path, record.time - record.time[0] + jitter, pv=lambda v: 400.0 * (1.0 - v),
                        op=lambda v: 100.0 * v)), case)


def test_gaps_bad_samples_manual_stretches_and_no_settings(case):
    record = case.record
    random = np.random.default_rng(2)
    keep = np.ones(len(record), dtype=bool)
    for a in random.integers(200, len(record) - 200, 4):
        keep[a : a + 60] = False
    rows = np.flatnonzero(keep)
    state = record.state[rows].copy()
    state[random.choice(len(rows), 20, replace=False)] = SampleState.MISSING
    state[500:600] = SampleState.MANUAL
    cut = replace(record, index=record.index[rows], setpoint=record.setpoint[rows], output=record.output[rows],
                  measurement=record.measurement[rows], state=state, settings=LoopSettings())
    held(explain(cut), case)


def test_rows_left_out_at_random(case, tmp_path):
    record = case.record
    path = tmp_path / "V3.csv"
    settings_beside(path, record.settings)
    keep = np.random.default_rng(3).random(len(record)) > 0.2
    keep[[0, -1]] = True
    cut = replace(record, setpoint=record.setpoint[keep], measurement=record.measurement[keep],
                  output=record.output[keep], index=record.index[keep])
    found = explain(as_csv(cut, path, cut.time))
    effect = next(e for e in found.effects if e.effect in FRICTION)
    width = effect.parameters["S" if effect.effect == "stiction" else "d"].value
    assert width == pytest.approx(float(case.truth["stiction"]["S"]), rel=0.1)


def test_a_slow_signal_comes_back_from_its_rounded_record():
    t = np.arange(2000)
    true = 0.5 + 0.05 * np.sin(t / 90.0)
    rounded = np.round(true / 0.005) * 0.005
    step = step_of(rounded)
    assert step == pytest.approx(0.005)
    back = between_steps(rounded, step)
    assert np.std(back - true) < 0.35 * np.std(rounded - true)
    assert np.max(np.abs(back - rounded)) <= 0.5 * step + 1e-12


@pytest.mark.parametrize(
    "output",
    [
        np.repeat(np.random.default_rng(4).choice([0.4, 0.45, 0.5, 0.6], 40), 50),  # an operator's moves
        0.5 + 0.01 * np.random.default_rng(5).standard_normal(2000),  # recorded finely
        np.full(2000, 0.5),
    ],
)
def test_output_that_was_not_rounded_is_left_alone(output):
    assert step_of(output) == 0.0


def test_a_gain_of_the_wrong_sign_is_no_model():
    from backlash_cli.model.candidates import Judge
    from backlash_cli.model.problem import problem_from_record
    from backlash_cli.model.search import baseline

    # OP answers to a load only: PV against OP slopes the wrong way, which is the controller and not the process
    random = np.random.default_rng(6)
    n, x, load, i = 3000, 0.0, 0.0, 0.0
    pv, op = np.empty(n), np.empty(n)
    for k in range(n):
        load = 0.99 * load + 0.003 * random.standard_normal()
        pv[k] = 0.5 + x + 0.0005 * random.standard_normal()
        i += 0.8 * (0.5 - pv[k]) / 15.0
        op[k] = 0.5 + 0.8 * (0.5 - pv[k]) + i
        x += (1.0 - np.exp(-1.0 / 20.0)) * (1.2 * (op[k] - 0.5) + load - x)
    record = record_from_arrays(0.5, pv, op, interval=1.0, settings=LoopSettings(K=0.8, Ti=15.0))
    problem = problem_from_record(record)
    assert problem.by_load
    found = baseline(problem)
    assert found.gain > 0.0
    judge, mirrored = Judge(problem, 20.0), replace(found, coefficients=-found.coefficients)
    assert judge.score(found) < judge.score(mirrored)
