"""One promise for all effects: neutral is the identity, sample by sample equals the whole, blocks equal the whole."""

import math

import numpy as np
import pytest

from backlash_cli.effects import EFFECTS, Stage
from backlash_cli.effects.shape import compiled
from backlash_cli.errors import MetadataError

INTERVAL = 0.7
ACTIVE = {
    "rate_limit": {"rate": 0.05},
    "unequal_speed": {"opening": 0.08, "closing": 0.02},
    "backlash": {"d": 0.1, "position": 0.4},
    "stiction": {"S": 0.12, "J": 0.05, "position": -0.3},
    "saturation": {"low": 0.3, "high": 0.6},
    "valve_characteristic": {"curvature": 2.5},
    "dead_time": {"theta": 3.3},
    "second_lag": {"tau2": 4.0},
    "gain_drift": {"growth": 3.0, "pivot": 0.4},
    "load_step": {"times": [20.0, 91.0], "sizes": [0.1, -0.3]},
    "load_drift": {"slope": 20.0},
    "external_oscillation": {"period": 12.0, "amplitude": 0.1, "phase": 0.5},
    "measured_disturbance": {"gain": 0.2},
    "random_load": {"sd": 0.1, "time_constant": 5.0},
    "sensor_hysteresis": {"w": 0.05, "position": 0.2},
    "sensor_curve": {"curvature": 0.6},
    "measurement_noise": {"density": 1e-4, "bandwidth": 3.0},
    "quantization": {"step": 0.03},
    "exception_compression": {"deviation": 0.05},
}
each_effect = pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.name)


def signal(n=300):
    walk = 0.45 + 0.02 * np.random.default_rng(7).standard_normal(n).cumsum()
    walk[5:9] = walk[5]  # rests
    walk[20], walk[21] = 0.0, -0.0
    return walk


def series_for(effect, n, seed=3):
    size = n if effect.column else effect.draws * (n + 1)
    return np.random.default_rng(seed).standard_normal(size) if size else np.empty(0)


@each_effect
def test_neutral_is_the_identity_bit_for_bit(effect):
    u = signal()
    out = effect.apply(u, effect.neutral, INTERVAL, series=series_for(effect, u.size))
    assert out.tobytes() == u.tobytes()


@each_effect
def test_plain_python_steps_equal_the_compiled_array(effect):
    u, p = signal(), effect.pack(ACTIVE[effect.name])
    series = series_for(effect, u.size)
    whole = effect.apply(u, p, INTERVAL, series=series)
    state = effect.begin(p, INTERVAL, u[0], series)
    one_by_one = np.array([effect.step(state, value, p) for value in u])
    # the compiler may use the machine's own exp and sin, which differ in the last bit
    np.testing.assert_allclose(one_by_one, whole, rtol=0, atol=1e-15)
    assert not np.array_equal(whole, u), "the test must use parameters at which the effect acts"


@each_effect
def test_a_faster_way_over_the_whole_array_equals_step(effect):
    if effect.fitting.whole is None:
        return
    u, p = signal(), effect.pack(ACTIVE[effect.name])
    np.testing.assert_allclose(effect.fitting.whole(u, p, INTERVAL), effect.apply(u, p, INTERVAL), rtol=0, atol=1e-13)


@each_effect
def test_blocks_equal_the_whole(effect):
    u, p = signal(), effect.pack(ACTIVE[effect.name])
    series = series_for(effect, u.size)
    state = effect.begin(p, INTERVAL, u[0], series)
    parts = [effect.run(state, block, p) for block in np.split(u, [1, 17, 18, 200])]
    assert np.concatenate(parts).tobytes() == effect.apply(u, p, INTERVAL, series=series).tobytes()


@each_effect
def test_a_second_run_starts_afresh(effect):
    u, p = signal(), effect.pack(ACTIVE[effect.name])
    series = series_for(effect, u.size)
    first = effect.apply(u, p, INTERVAL, series=series)
    assert first.tobytes() == effect.apply(u, p, INTERVAL, series=series).tobytes()


@each_effect
def test_effect_is_described_and_compiles(effect):
    assert compiled(effect.step) is not None
    assert effect.sentence.endswith(".") and 40 < len(effect.sentence) < 130
    assert len(effect.source) > 20
    assert effect.parameters
    for q in effect.parameters:
        assert q.unit and q.meaning
        assert q.many or q.low <= q.neutral <= q.high
        assert all(q.low <= s <= q.high for s in q.start)
    assert math.isfinite(effect.begin(effect.neutral, INTERVAL, 0.5).size)


@each_effect
def test_wrong_parameters_are_refused_with_the_nearest_name(effect):
    with pytest.raises(MetadataError, match="no parameter 'nonsense'"):
        effect.pack(nonsense=1.0)
    name = effect.parameters[0].name
    with pytest.raises(MetadataError, match="not a number"):
        effect.pack({name: "wide"})
    with pytest.raises(MetadataError, match="not possible"):
        effect.pack({name: math.nan})


def test_effects_are_listed_in_the_order_a_signal_meets_them():
    order = list(Stage)
    places = [order.index(effect.stage) for effect in EFFECTS]
    assert places == sorted(places)
    assert len({effect.name for effect in EFFECTS}) == len(EFFECTS)


def test_every_effect_has_active_parameters_in_this_test():
    assert set(ACTIVE) == {effect.name for effect in EFFECTS}
