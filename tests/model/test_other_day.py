"""A kept model on another day: loads of its day are left out, guessed ranges follow, and why it does not hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.model import compare, explain
from backlash_cli.model.saved_model import in_ranges_of, model_text, parse_model
from backlash_cli.record import LoopSettings, Note, Record
from backlash_cli.results import Model, ModelEffect

from .loops import loop, process

DAY = 86400.0
PLAY = ModelEffect("backlash", {"d": 0.03, "position": 0.0})
# the true model of `loop(d=0.03)`, fitted the day before
KEPT = Model("TIC1", 1.2, 20.0, -0.1, effects=(PLAY,), start=-DAY, end=-DAY + 3000.0, rmse_holdout=0.0005)


def codes(notes: tuple[Note, ...]) -> set[str]:
    return {note.code for note in notes}


def test_a_model_that_holds_needs_no_reason() -> None:
    found = compare(loop(d=0.03, noise=0.0005), KEPT)
    assert found.fitness.rmse_holdout < 0.4 * found.baseline.rmse_holdout and found.reasons == ()


def test_another_gain_of_the_process_is_told_from_another_valve() -> None:
    (reason,) = compare(loop(d=0.03, noise=0.0005, gain=2.4), KEPT).reasons
    assert reason.code == "process_changed" and "backlash as kept" in reason.message
    assert reason.values["Kp"] == pytest.approx(2.4, rel=0.02) and reason.values["tau"] == pytest.approx(20.0, rel=0.1)
    worn = compare(loop(d=0.12, noise=0.0005), KEPT)
    (reason,) = worn.reasons
    assert reason.code == "numbers_changed" and "backlash d = 12 % (kept: 3 %)" in reason.message
    assert "gain" not in reason.message and "time constant" not in reason.message


def test_an_effect_that_is_gone_and_another_operating_point_are_named() -> None:
    found = compare(loop(noise=0.0005), replace(KEPT, output=(0.05, 0.2)))
    assert codes(found.reasons) >= {"effect_not_here", "other_operating_point"}
    assert codes(compare(loop(noise=0.0005), replace(KEPT, output=(0.3, 0.7))).reasons) >= {"effect_not_here"}
    assert "other_operating_point" not in codes(compare(loop(noise=0.0005), replace(KEPT, output=(0.3, 0.7))).reasons)


def test_a_day_without_motion_judges_nothing() -> None:
    record = loop(noise=0.001)
    random = np.random.default_rng(0)
    u, noise = 0.5 + 0.0003 * random.standard_normal(len(record)), 0.001 * random.standard_normal(len(record))
    still = replace(record, output=u, measurement=process(u, 2.0, 1.2, 20.0, -0.1) + noise)
    assert "too_little_motion" in codes(compare(still, KEPT).reasons)


def test_loads_of_another_day_are_left_out_and_those_of_this_one_are_kept() -> None:
    record = loop(noise=0.001)
    step = ModelEffect("load_step", {"times": (100.0, 1000.0), "sizes": (0.05, -0.1)})
    drift = ModelEffect("load_drift", {"slope": 0.2, "length": 3000.0})
    found = compare(record, replace(KEPT, effects=(step, drift)))
    assert found.effects == () and "loads_of_another_day" in codes(found.warnings)
    assert found.fitness.rmse_holdout == pytest.approx(0.001, rel=0.1)
    same_day = compare(record, replace(KEPT, effects=(step,), start=0.0, end=3000.0))
    assert [e.effect for e in same_day.effects] == ["load_step"] and "loads_of_another_day" not in codes(
        same_day.warnings)
    # going on from the model on another day does not take them along either
    again = explain(record, replace(KEPT, effects=(step, PLAY)))
    assert [e.effect for e in again.effects] == ["backlash"] and "loads_of_another_day" in codes(again.warnings)


def test_the_phase_of_a_swing_is_matched_to_the_day() -> None:
    record = loop(noise=0.001)
    t = record.interval * np.arange(len(record))
    swinging = replace(record, measurement=record.measurement + _answer(0.03 * np.sin(2 * np.pi * t / 230.0 + 2.0)))
    swing = ModelEffect("external_oscillation", {"period": 230.0, "amplitude": 0.03, "phase": -1.0})
    model = replace(KEPT, effects=(swing,))
    found = compare(swinging, model)
    assert found.fitness.rmse_holdout < 0.5 * found.baseline.rmse_holdout and "swing_matched" in codes(found.warnings)
    # on its own day the phase is part of the model
    assert compare(swinging, replace(model, start=0.0, end=3000.0)).fitness.rmse > 0.004


def _answer(load: np.ndarray) -> np.ndarray:
    return process(load, 2.0, 1.2, 20.0, 0.0)


def in_units(record: Record, pv: tuple[float, float], guessed: bool) -> Record:
    """The same record read with another range of PV."""
    low, high = pv
    s = LoopSettings(Ti=20.0, K=0.5, pv_range=pv, source={"pv_range": "data" if guessed else "metadata"})
    return replace(record, measurement=(record.measurement - low) / (high - low), settings=s,
                   setpoint=(record.setpoint - low) / (high - low), notes=(Note("guessed_pv_range", "guessed"),))


def test_a_guessed_range_follows_the_model() -> None:
    record = loop(d=0.03, noise=0.0005)
    kept = replace(KEPT, pv_range=(0.0, 1.0), op_range=(0.0, 1.0))
    guessed = in_units(record, (-0.5, 1.5), guessed=True)
    moved = in_ranges_of(guessed, kept)
    np.testing.assert_allclose(moved.measurement, record.measurement, atol=1e-12)
    np.testing.assert_allclose(moved.setpoint, record.setpoint, atol=1e-12)
    assert moved.settings.pv_range == (0.0, 1.0) and not moved.notes
    assert moved.settings.K is not None and abs(moved.settings.K - 0.25) < 1e-9
    assert compare(guessed, kept).fitness.rmse == pytest.approx(compare(record, kept).fitness.rmse, rel=1e-6)
    given = in_units(record, (-0.5, 1.5), guessed=False)
    assert in_ranges_of(given, kept) is given


def test_where_op_was_is_kept_in_the_file() -> None:
    record = loop(d=0.03, noise=0.0005)
    assert record.output is not None
    model = explain(record, add=("backlash",)).model
    assert model is not None and model.output == pytest.approx(tuple(np.quantile(record.output, [0.01, 0.99])))
    assert parse_model(model_text(model)).output == pytest.approx(model.output)
    still = replace(record, output=np.where(np.arange(len(record)) == 700, 0.6, 0.5))
    none = compare(replace(still, measurement=record.measurement)).model
    assert none is not None and none.output is None and parse_model(model_text(none)).output is None
