"""Comparing a model with a record: errors, where it fails, models that are kept, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.errors import LoopError
from backlash_cli.model import compare, explain
from backlash_cli.model.locate import turning_points
from backlash_cli.model.problem import noise_floor, problem_from_record
from backlash_cli.record import LoopSettings, Note, Record, SampleState, record_from_arrays

from ..benchmarks.strange_plant import swinging_door
from ..estimator.closed_loop import Loop, run
from .loops import loop, steps


def test_a_right_model_is_off_by_the_noise_only() -> None:
    found = compare(loop(noise=0.001))
    assert found.fitness.rmse == pytest.approx(0.001, rel=0.05)
    assert found.fitness.rmse_holdout == pytest.approx(0.001, rel=0.06)
    # the answers to steps add a little: a kink is not white noise, and not all of it is left out
    assert found.noise_floor == pytest.approx(0.001, rel=0.12)
    p = found.fitness.parameters
    assert (p["Kp"].value, p["tau"].value, p["offset"].value) == pytest.approx((1.2, 20.0, -0.1), rel=0.02)


def test_negative_gain_and_units_do_not_matter() -> None:
    record = loop(noise=0.001)
    mirrored = replace(record, measurement=1.0 - record.measurement)
    a, b = compare(record).fitness, compare(mirrored).fitness
    assert b.rmse_holdout == pytest.approx(a.rmse_holdout, rel=1e-3)
    assert b.parameters["Kp"].value == pytest.approx(-1.2, rel=0.02)


def test_a_dead_band_shows_after_reversals() -> None:
    found = compare(loop(d=0.04, noise=0.0005))
    kinds = {r.kind for r in found.where}
    assert {"reversal", "setpoint", "output level", "direction", "time", "frequency"} - kinds <= {"setpoint"}
    assert all(0.0 <= r.share <= 1.0 + 1e-9 and r.sentence for r in found.where)
    bands = [r for r in found.where if r.kind == "frequency"]
    assert sum(r.share for r in bands) == pytest.approx(1.0, abs=1e-6)
    blocks = [r for r in found.where if r.kind == "time"]
    assert sum(r.share for r in blocks) == pytest.approx(1.0, abs=1e-6)


def test_what_reading_said_of_the_data_is_said_with_the_model() -> None:
    said = Note("setpoint_apart", "SP and PV lie far apart", {"effect": "blocks"})
    record = replace(loop(noise=0.001), notes=(said,))
    assert said in compare(record).warnings and said in explain(record, add=("backlash",)).warnings


def test_a_kept_model_holds_on_another_day_and_fails_when_the_gap_grows() -> None:
    kept = explain(loop(d=0.03, noise=0.0005), add=("backlash",)).model
    assert kept is not None
    same = compare(later(loop(d=0.03, noise=0.0005, seed=5)), kept)
    worn = compare(later(loop(d=0.06, noise=0.0005, seed=5)), kept)
    assert not same.fitted
    assert same.seen == worn.seen == 0.0
    # all of another day is hold-out; matching offset and start costs next to nothing
    assert same.fitness.rmse <= same.fitness.rmse_holdout < 1.02 * same.fitness.rmse
    assert same.fitness.rmse < 1.2 * 0.0005
    assert worn.fitness.rmse > 4.0 * same.fitness.rmse


def test_the_record_of_the_fit_is_no_hold_out() -> None:
    record = loop(d=0.03, noise=0.0005)
    kept = explain(record, add=("backlash",)).model
    assert kept is not None and kept.rmse_holdout is not None
    own = compare(record, kept)
    assert own.seen == 1.0
    assert own.fitness.rmse_holdout == max(own.fitness.rmse, kept.rmse_holdout)
    # a number changed for the worse is not hidden behind the error in the file
    worse = compare(record, replace(kept, Kp=1.2 * kept.Kp))
    assert worse.fitness.rmse_holdout == worse.fitness.rmse > 2.0 * kept.rmse_holdout
    # of a record that goes on, the new part counts
    middle = replace(kept, end=float(record.time[len(record) // 2]))
    assert compare(record, middle).seen == pytest.approx(0.5, abs=0.01)
    assert compare(record, replace(kept, start=None, end=None)).seen == 0.0


def later(record: Record, days: float = 1.0) -> Record:
    return replace(record, start=record.start + 86400.0 * days)


def test_noise_floor_ignores_the_process() -> None:
    random = np.random.default_rng(0)
    slow = np.sin(np.arange(5000) / 40.0)
    recorded = slow + 0.002 * random.standard_normal(5000)
    recorded[100:140] = np.nan
    assert noise_floor(recorded) == pytest.approx(0.002, rel=0.04)


def test_small_turns_are_no_reversals() -> None:
    values = np.array([0.0, 0.5, 1.0, 0.99, 1.0, 0.5, 0.0, 0.5])
    assert turning_points(values, 0.1) == ([6], [2])


def refused(record: Record) -> LoopError:
    with pytest.raises(LoopError) as error:
        compare(record)
    assert error.value.remedy
    return error.value


def test_refusals_say_why() -> None:
    pv = steps(500)
    assert refused(record_from_arrays(0.5, pv, interval=1.0)).code == "no_output"
    assert refused(record_from_arrays(0.5, pv, np.full(500, 0.4), interval=1.0)).code == "constant_signal"
    assert refused(record_from_arrays(0.5, np.full(500, 0.4), pv, interval=1.0)).code == "constant_signal"
    assert refused(loop(samples=20)).code == "insufficient_data"


def test_holes_bad_samples_and_manual_periods_are_no_obstacle() -> None:
    record = loop(noise=0.001)
    keep = np.ones(len(record), dtype=bool)
    keep[300:320] = keep[700:702] = False
    rows = np.flatnonzero(keep)
    state = record.state[rows].copy()
    state[50:60] = SampleState.MISSING
    state[100:200] = SampleState.MANUAL
    assert record.output is not None
    gapped = replace(
        record, index=record.index[rows], setpoint=record.setpoint[rows], measurement=record.measurement[rows],
        output=record.output[rows], state=state, settings=LoopSettings(),
    )  # fmt: skip
    problem = problem_from_record(gapped)
    assert problem.samples == len(record)
    # two samples are short beside what the process remembers
    assert problem.holes == 1 and not problem.used[300:330].any() and problem.used[705]
    found = compare(gapped)
    assert found.fitness.parameters["tau"].value == pytest.approx(20.0, rel=0.03)
    assert found.fitness.rmse_holdout < 0.00115


def test_few_values_of_the_output_are_completed_before_a_model_is_fitted() -> None:
    """Held from one kept value to the next OP comes late, and the dead band is not found at all."""
    truth, settings = 0.05, LoopSettings(K=0.6, Ti=20.0)
    record = run(Loop(dead_band=truth), 4000, setpoint=0.4 + 0.2 * steps(4000, hold=250))
    assert record.output is not None
    kept = np.where(swinging_door(record.output, 0.008), np.arange(len(record)), 0)
    few = replace(record, output=record.output[np.maximum.accumulate(kept)])
    assert "output_completed" not in [note.code for note in compare(replace(record, settings=settings)).warnings]
    completed, held = (explain(replace(few, settings=own), effects=("backlash",)) for own in (
        settings, replace(settings, K=None)))
    assert [note.code for note in completed.warnings].count("output_completed") == 1
    assert "output_completed" not in [note.code for note in held.warnings]
    assert not held.effects
    found = completed.effects[0].parameters["d"]
    assert found.ci95[0] <= truth <= found.ci95[1] and found.ci95[1] - found.ci95[0] < 0.1 * truth
