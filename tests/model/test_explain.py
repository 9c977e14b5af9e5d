"""Finding what is missing: the hidden effect, nothing at all, look-alikes, the user's own choice."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backlash_cli import read
from backlash_cli.effects import Effect, Parameter, Stage
from backlash_cli.errors import MetadataError, UsageError
from backlash_cli.model import explain
from backlash_cli.model.search import Found
from backlash_cli.record import FloatArray, LoopSettings, Record, record_from_arrays
from backlash_cli.reporter.json_report import fields_of, judged, strict
from backlash_cli.results import Explanation

from .loops import gap, loop, process, steps


def with_play() -> Record:
    """Return a loop whose valve has 3 % of play."""
    return loop(d=0.03, noise=0.0005, load=0.001)


@cache
def explained_play() -> Explanation:
    """Return what is found in it."""
    return explain(with_play())


def test_a_gap_is_found_with_its_size_and_the_error_falls_to_the_noise() -> None:
    found = explained_play()
    assert found.missing_effect == "backlash"
    assert [e.effect for e in found.effects] == ["backlash"]
    d = found.effects[0].parameters["d"]
    assert d.value == pytest.approx(0.03, rel=0.05)
    assert isinstance(d.ci95, tuple) and isinstance(d.value, float)
    # a 95 % interval misses once in twenty loops; how often it does is the benchmark's matter
    half = 0.5 * (float(d.ci95[1]) - float(d.ci95[0]))  # type: ignore[arg-type]
    assert abs(d.value - 0.03) < 1.5 * half < 0.004
    assert found.steps[-1].rmse_holdout < 0.6 * found.steps[0].rmse_holdout
    assert found.unexplained is not None and found.unexplained < 0.3


def test_effects_that_show_only_together_are_found_together() -> None:
    # play, a second lag and two load steps: none of them alone gains anything where the lag has made up for the others
    found = explain(read(Path(__file__).parents[2] / "sample_data" / "plant.csv")["TIC202"])
    assert {e.effect for e in found.effects} == {"backlash", "second_lag", "load_step"}
    sizes = {e.effect: e.parameters["d"].value for e in found.effects if "d" in e.parameters}
    assert sizes["backlash"] == pytest.approx(0.05, rel=0.05)
    assert found.steps[-1].rmse_holdout < 0.3 * found.steps[0].rmse_holdout


def test_nothing_is_missing_where_nothing_is_missing() -> None:
    found = explain(loop(d=0.0, noise=0.001, load=0.002))
    assert found.missing_effect is None
    assert found.effects == () and len(found.steps) == 1
    assert len(found.candidates) >= 8


def test_dead_time_of_the_settings_is_part_of_the_baseline() -> None:
    record = loop(delay=6, noise=0.0005, load=0.001)
    assert explain(record).missing_effect == "dead_time"
    known = loop(delay=6, noise=0.0005, load=0.001, settings=LoopSettings(Ti=20.0, theta=11.0))
    found = explain(known)
    assert found.missing_effect is None
    assert found.baseline.parameters["theta"].value == pytest.approx(12.0, abs=0.4)


def test_an_irrelevant_column_is_not_accepted_and_a_relevant_one_is() -> None:
    random = np.random.default_rng(3)
    n, h = 1500, 2.0
    u = steps(n)
    column = np.convolve(random.standard_normal(n + 40), np.ones(40) / 6.0, "valid")[:n]
    quiet = process(u, h, 1.2, 20.0, -0.1) + 0.001 * random.standard_normal(n)
    pushed = process(u + 0.02 * column, h, 1.2, 20.0, -0.1) + 0.001 * random.standard_normal(n)
    for pv, expected in ((quiet, None), (pushed, "measured_disturbance")):
        told = LoopSettings(Ti=20.0)
        record = record_from_arrays(0.5, pv, u, interval=h, settings=told, disturbances={"DV1": column})
        found = explain(record)
        assert found.missing_effect == expected
        if expected:
            assert found.effects[0].column == "DV1"
            assert found.effects[0].parameters["gain"].value == pytest.approx(0.02, rel=0.05)


def test_rounding_is_seen_and_allowed_for() -> None:
    record = loop(noise=0.001)
    rounded = record_from_arrays(
        0.5, np.round(record.measurement / 0.01) * 0.01, record.output, interval=2.0, settings=LoopSettings(Ti=20.0)
    )
    found = explain(rounded)
    assert found.missing_effect == "quantization"
    assert found.effects[0].parameters["step"].value == pytest.approx(0.01)
    assert found.steps[1].rmse_holdout < 0.5 * found.steps[0].rmse_holdout


def test_the_users_choice_replaces_the_search() -> None:
    found = explain(loop(d=0.03, noise=0.0005), add=("second_lag", "backlash"))
    assert {e.effect for e in found.effects} == {"second_lag", "backlash"}
    assert [s.chosen for s in found.steps[1:]] == ["user", "user"]


def test_going_on_from_a_model_keeps_its_effects() -> None:
    record = loop(d=0.03, delay=6, noise=0.0005)
    first = explain(record, add=("dead_time",))
    found = explain(record, first.model)
    assert {e.effect for e in found.effects} == {"dead_time", "backlash"}


def test_unknown_effects_and_columns_that_are_not_there_are_refused() -> None:
    with pytest.raises(MetadataError, match="backlsh"):
        explain(loop(), add=("backlsh",))
    with pytest.raises(UsageError, match="measured column"):
        explain(loop(), add=("measured_disturbance",))


def test_too_little_motion_is_said() -> None:
    random = np.random.default_rng(0)
    u = 0.5 + 1e-5 * random.standard_normal(800)
    found = explain(record_from_arrays(0.5, 0.5 + 0.001 * random.standard_normal(800), u, interval=1.0))
    assert found.missing_effect is None
    assert [n.code for n in found.reasons] == ["too_little_motion"]


def test_same_record_same_answer_and_no_infinite_number() -> None:
    one, two = judged(explained_play()), judged(explain(with_play()))
    assert strict(one) == strict(two)
    assert all(math.isfinite(x) for x in numbers({k: v for k, v in one.items() if k != "details"}))


def numbers(value: object) -> Iterator[float]:
    """Return all numbers of a nested document, those of the results in it as well."""
    if isinstance(value, float):
        yield value
    elif is_dataclass(value):
        yield from numbers(fields_of(value))
    elif isinstance(value, dict):
        for v in value.values():
            yield from numbers(v)
    elif isinstance(value, list | tuple):
        for v in value:
            yield from numbers(v)


def squared_step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the flow of a valve whose gain falls at both ends."""
    return value + p[0] * (value - 0.5) ** 3


def test_an_effect_from_outside_takes_part_like_the_rest() -> None:
    mine = Effect(
        name="s_curve", stage=Stage.VALVE, sentence="The gain changes away from the middle.", source="this test",
        parameters=(Parameter("bend", "1", "cubic part", 0.0, -20.0, 20.0, (-8.0, -2.0, 2.0, 8.0)),),
        start=lambda p, interval, first: np.empty(0), step=squared_step,
    )  # fmt: skip
    random = np.random.default_rng(5)
    u = steps(1500, low=0.1, high=0.9)
    pv = process(u + 6.0 * (u - 0.5) ** 3, 2.0, 1.0, 20.0, 0.0) + 0.001 * random.standard_normal(1500)
    found = explain(record_from_arrays(0.5, pv, u, interval=2.0, settings=LoopSettings(Ti=20.0)), effects=(mine,))
    assert found.missing_effect == "s_curve"
    assert found.effects[0].parameters["bend"].value == pytest.approx(6.0, rel=0.05)


def test_the_fast_gap_equals_its_steps() -> None:
    from backlash_cli.effects import backlash

    u, p = steps(400), backlash.EFFECT.pack(d=0.05, position=0.3)
    assert backlash.EFFECT.fitting.whole is not None
    assert backlash.EFFECT.fitting.whole(u, p, 1.0) == pytest.approx(backlash.EFFECT.apply(u, p, 1.0), abs=1e-15)
    assert backlash.EFFECT.apply(u, backlash.EFFECT.pack(d=0.05), 1.0) == pytest.approx(gap(u, 0.05))


def test_an_effect_that_was_not_asked_without_it_is_worth_nothing_known() -> None:
    nothing: Any = None
    assert Found(nothing, {}, nothing, {}, nothing, nothing).gain("second_lag") == 0.0
