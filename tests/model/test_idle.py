"""An effect whose numbers went back to where it does nothing is no effect."""

import numpy as np
import pytest

from backlash_cli.effects.registry import load_effect
from backlash_cli.model.fit import finished
from backlash_cli.model.noise import Noise
from backlash_cli.model.pipeline import Part, Shape
from backlash_cli.model.problem import problem_from_record
from backlash_cli.model.search import idle

from .loops import loop


@pytest.mark.parametrize(
    ("name", "values", "nothing"),
    [
        ("second_lag", {"tau2": 0.0}, True),
        ("second_lag", {"tau2": 5.0}, False),
        ("backlash", {"d": 0.01, "position": 0.0}, False),
        ("backlash", {"d": 0.0, "position": 0.7}, True),
        ("rate_limit", {"rate": 30.0}, True),
        ("rate_limit", {"rate": 0.002}, False),
        # the sizes of columns are solved for, not searched: their zeros say nothing
        ("load_step", {"times": (100.0,), "sizes": (0.0,)}, False),
    ],
)
def test_an_effect_is_idle_when_pv_is_predicted_the_same_without_it(name, values, nothing):
    problem = problem_from_record(loop())
    part = Part(load_effect(name), values)
    fitted = finished(problem, Shape(20.0, 0.0, (part,)), Noise(0.1, 60.0, 20.0))
    assert np.isfinite(fitted.gain)
    assert idle(problem, fitted, part) is nothing
