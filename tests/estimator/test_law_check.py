"""The quick look passes right settings, and nothing that the full comparison would blame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.estimator.identify import identify
from backlash_cli.estimator.settings_check import check_settings, follows
from backlash_cli.record import LoopSettings, SampleState

from .closed_loop import Loop, load_steps, run

GIVEN = LoopSettings(K=0.6, Ti=20.0, pv_range=(0.0, 150.0), op_range=(0.0, 100.0),
                     source={"K": "metadata", "Ti": "metadata"})
RECORD = run(Loop(), 9000, load=load_steps(9000, 0.1))


def test_right_settings_pass() -> None:
    assert follows(RECORD, GIVEN)


def test_right_settings_pass_with_a_moving_setpoint_and_with_rounded_values() -> None:
    steps = 0.5 + 0.05 * (np.arange(9000) // 900 % 2)
    moved = run(Loop(), 9000, setpoint=steps)
    assert moved.output is not None
    assert follows(moved, GIVEN)
    assert follows(replace(moved, output=np.round(moved.output, 3)), GIVEN)


@pytest.mark.parametrize(
    "wrong",
    [
        {"Ti": 20.0 / 60.0},
        {"Ti": 1200.0},
        {"K": 100 / 0.6},
        {"K": 0.6 * 100 / 150},
        {"K": 1.2, "Ti": 40.0},
        {"K": -0.6},
        {"Ti": 26.0},
        {"Td": 10.0},
    ],
)
def test_wrong_settings_do_not(wrong: dict[str, float]) -> None:
    assert not follows(RECORD, replace(GIVEN, **wrong))


def test_a_derivative_part_that_is_not_given_does_not_pass() -> None:
    record = run(Loop(Td=4.0), 9000, load=load_steps(9000, 0.1))
    assert not follows(record, GIVEN)
    assert follows(record, replace(GIVEN, Td=4.0))


def test_an_output_that_something_else_moves_does_not_pass() -> None:
    assert RECORD.output is not None
    other = replace(RECORD, output=RECORD.output + 0.05 * np.sin(np.arange(9000) / 37.0))
    assert not follows(other, GIVEN)


def test_without_output_or_with_too_little_of_it_nothing_passes() -> None:
    assert not follows(replace(RECORD, output=None), GIVEN)
    assert not follows(RECORD.slice(0, 50), GIVEN)
    manual = np.full(9000, SampleState.MANUAL, dtype=np.uint8)
    assert not follows(replace(RECORD, state=manual), GIVEN)


@pytest.mark.parametrize("Ti", [20.0, 21.0, 19.0])
def test_what_passes_has_nothing_to_answer_for(Ti: float) -> None:
    settings = replace(GIVEN, Ti=Ti)
    assert follows(RECORD, settings) and check_settings(settings, identify(RECORD)) == ()
