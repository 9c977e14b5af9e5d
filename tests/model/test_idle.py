"""An effect whose numbers went back to where it does nothing is no effect."""

from backlash_cli.effects.registry import load_effect
from backlash_cli.model.pipeline import Part
from backlash_cli.model.search import idle


def test_neutral_numbers_are_idle_and_others_are_not():
    lag, gap, step = load_effect("second_lag"), load_effect("backlash"), load_effect("load_step")
    assert idle(Part(lag, {"tau2": 0.0}))
    assert not idle(Part(lag, {"tau2": 0.5}))
    assert not idle(Part(gap, {"d": 0.01, "position": 0.0}))
    assert idle(Part(gap, {"d": 0.0, "position": 0.7}))
    # sizes of columns are solved for, not searched: the zeros that stand for them here say nothing
    assert not idle(Part(step, {"times": (100.0,), "sizes": (0.0,)}))
