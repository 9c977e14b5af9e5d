"""Every effect against a closed form, its published figure, or an independent computation."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.effects import EFFECTS
from backlash_cli.effects.registry import all_effects, load_effect
from backlash_cli.errors import MetadataError
from backlash_cli.kernels import play


def apply(name, values, interval=1.0, first=None, series=(), **parameters):
    effect = load_effect(name)
    return effect.apply(values, effect.pack(parameters), interval, first=first, series=series)


def walk(n=2000, seed=1, size=0.01):
    return 0.5 + size * np.random.default_rng(seed).standard_normal(n).cumsum()


# backlash and stiction


def test_backlash_loop_has_the_width_of_the_dead_band():
    """Fig. 2 of Haegglund (2007): rising and falling branches are d apart, flat in between."""
    up = np.linspace(0.2, 0.8, 601)
    u = np.concatenate([up, up[::-1], up])
    x = apply("backlash", u, d=0.1)
    rising, falling = x[1202:], x[601:1202][::-1]
    inside = (up > 0.31) & (up < 0.69)
    np.testing.assert_allclose(falling[inside] - rising[inside], 0.1, atol=1e-12)
    assert np.all(x[601:700] == x[601])


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=60), st.floats(0.001, 0.5), st.floats(-1.0, 1.0))
@settings(max_examples=60, deadline=None)
def test_backlash_equals_the_play_operator_and_stays_within_half_a_gap(values, d, position):
    u = np.array(values)
    x = apply("backlash", u, d=d, position=position)
    np.testing.assert_array_equal(x, play(u, d, u[0] + 0.5 * d * position))
    assert np.all(np.abs(x - u) <= 0.5 * d + 1e-12)


def kano(u, S, J):
    """The published flow chart, with its own variables: command when stopped u_s, flag stp, direction d."""
    us, stp, d, y, last, before = u[0], True, 1.0, u[0] - 0.5 * (S - J), u[0], 0.0
    out = []
    for value in u:
        du = value - last
        if not stp and du * before <= 0.0:
            us, stp = last, True
        if stp:
            if -d * (value - us) > S:
                d, stp = -d, False
            elif d * (value - us) > J:
                stp = False
        if not stp:
            y = value - 0.5 * d * (S - J)
        out.append(y)
        last, before = value, du
    return np.array(out)


def he(u, fs, fd):
    """He's model: the force builds up with the command; over fs the stem slips until only fd is left."""
    uv, residual, last, out = u[0], 0.0, u[0], []
    for value in u:
        force = residual + value - last
        if abs(force) > fs:
            residual = math.copysign(fd, force)
            uv += force - residual
        else:
            residual = force
        last = value
        out.append(uv)
    return np.array(out)


@pytest.mark.parametrize(("S", "J"), [(0.05, 0.02), (0.04, 0.04), (0.03, 0.05), (0.06, 0.001)])
def test_stiction_equals_the_published_flow_chart(S, J):
    u = walk()
    position = -(S - J) / (S + J)
    np.testing.assert_allclose(apply("stiction", u, S=S, J=J, position=position), kano(u, S, J), atol=1e-12)


@pytest.mark.parametrize(("S", "J"), [(0.05, 0.02), (0.04, 0.04)])
def test_stiction_that_sticks_again_equals_he(S, J):
    u = walk()
    np.testing.assert_allclose(
        apply("stiction", u, S=S, J=J, restick=1), he(u, 0.5 * (S + J), 0.5 * (S - J)), atol=1e-12
    )


def test_stiction_shows_the_published_figure():
    """After a reversal: dead band plus stick band S, slip jump J, then the moving phase with slope 1."""
    S, J, step = 0.2, 0.05, 1e-4
    up = np.arange(0.0, 1.0, step)
    u = np.concatenate([up, up[::-1]])
    x = apply("stiction", u, S=S, J=J)[up.size :]
    jump = np.flatnonzero(np.diff(x))[0]
    assert up[-1] - u[up.size + jump] == pytest.approx(S, abs=2 * step)
    assert x[jump] - x[jump + 1] == pytest.approx(J, abs=2 * step)
    np.testing.assert_allclose(np.diff(x[jump + 1 :]), -step, atol=1e-12)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=60), st.floats(0.001, 0.3), st.floats(-1.0, 1.0))
@settings(max_examples=60, deadline=None)
def test_stiction_without_jump_is_backlash(values, S, position):
    np.testing.assert_allclose(
        apply("stiction", values, S=S, J=0.0, position=position),
        apply("backlash", values, d=S, position=position),
        atol=1e-12,
    )


# other valve effects


def test_rate_limit_is_the_mean_of_the_moving_position():
    u, h, rate, sub = walk(200, size=0.05), 0.5, 0.08, 1000
    position, means = u[0], []
    for target in u:
        path = position + np.sign(target - position) * np.minimum(
            rate * h * (np.arange(sub) + 0.5) / sub, abs(target - position)
        )
        means.append(path.mean())
        position += np.sign(target - position) * min(rate * h, abs(target - position))
    np.testing.assert_allclose(apply("rate_limit", u, interval=h, rate=rate), means, atol=1e-7)


@given(st.floats(-6.0, 6.0), st.floats(0.0, 1.0))
def test_valve_characteristic_keeps_the_ends_and_mirrors(curvature, x):
    f = apply("valve_characteristic", [0.0, x, 1.0], curvature=curvature)
    mirrored = apply("valve_characteristic", [1.0 - x], curvature=-curvature)[0]
    assert f[0] == pytest.approx(0.0) and f[2] == pytest.approx(1.0)
    assert f[1] == pytest.approx(1.0 - mirrored, abs=1e-9)


def test_valve_characteristic_is_equal_percentage():
    """Equal steps of travel multiply the slope by equal factors; rangeability exp(curvature)."""
    slope = np.gradient(apply("valve_characteristic", np.linspace(0, 1, 1001), curvature=math.log(50.0)), 1e-3)[1:-1]
    np.testing.assert_allclose(slope[100:] / slope[:-100], 50.0**0.1, rtol=1e-4)


# process


@pytest.mark.parametrize("theta", [0.3, 0.7, 1.0, 1.4, 2.8])
def test_dead_time_moves_the_area_by_theta(theta):
    """The delayed signal has the same mean and its centre of gravity lies exactly theta later."""
    h = 0.7
    u = np.zeros(40)
    u[5:9] = [0.3, 1.0, 0.2, 0.1]
    y = apply("dead_time", u, interval=h, theta=theta)
    t = np.arange(u.size) * h
    assert y.sum() == pytest.approx(u.sum())
    assert t @ y / y.sum() - t @ u / u.sum() == pytest.approx(theta)


def test_second_lag_is_the_mean_of_the_exact_lag():
    u, h, tau, sub = walk(50, size=0.1), 0.8, 2.5, 2000
    x, means = u[0], []
    for value in u:
        t = (np.arange(sub) + 0.5) / sub * h
        means.append((value + (x - value) * np.exp(-t / tau)).mean())
        x = value + (x - value) * np.exp(-h / tau)
    np.testing.assert_allclose(apply("second_lag", u, interval=h, tau2=tau), means, atol=1e-8)


# loads


def test_loads_add_up():
    t = np.arange(100) * 2.0
    zero = np.zeros(100)
    steps = apply("load_step", zero, interval=2.0, times=[10.0, 30.5], sizes=[0.1, -0.3])
    np.testing.assert_allclose(steps, 0.1 * (t >= 10.0) - 0.3 * (t >= 30.5))
    np.testing.assert_allclose(apply("load_drift", zero, interval=2.0, slope=0.5), 0.5 * t / 3600.0, atol=1e-15)
    swing = apply("external_oscillation", zero, interval=2.0, period=17.0, amplitude=0.02, phase=0.4)
    np.testing.assert_allclose(swing, 0.02 * np.sin(2 * np.pi * t / 17.0 + 0.4), atol=1e-14)
    column = np.random.default_rng(0).normal(size=100)
    np.testing.assert_allclose(apply("measured_disturbance", zero, series=column, gain=-0.3), -0.3 * column)


@pytest.mark.parametrize("interval", [0.05, 1.0, 30.0])
def test_random_load_has_the_variance_and_memory_of_its_process(interval):
    """Means over the interval of dx = -x/T dt + ... : closed-form variance and lag-one covariance."""
    sd, T, n = 0.02, 10.0, 200_000
    x = apply(
        "random_load",
        np.zeros(n),
        interval=interval,
        series=np.random.default_rng(5).standard_normal(2 * n + 2),
        sd=sd,
        time_constant=T,
    )
    r = interval / T
    variance = 2 * sd**2 / r**2 * (r - 1 + math.exp(-r))
    covariance = sd**2 / r**2 * (1 - math.exp(-r)) ** 2
    # sampling error of a variance from n r / (2 + r) independent values, five standard deviations
    tolerance = 5 * sd**2 * math.sqrt(2 * (2 + r) / (n * r))
    assert np.mean(x**2) == pytest.approx(variance, abs=tolerance)
    assert np.mean(x[1:] * x[:-1]) == pytest.approx(covariance, abs=tolerance)


@pytest.mark.parametrize("bandwidth", [math.inf, 200.0, 2.0])
@pytest.mark.parametrize("interval", [0.01, 0.1])
def test_noise_behind_a_filter_depends_on_density_only(bandwidth, interval):
    """White noise of two-sided density S through 1/(1 + s T) has variance S/(2 T), whatever the interval."""
    S, T, n = 4e-8, 5.0, 400_000
    series = np.random.default_rng(9).standard_normal(2 * n + 2)
    noise = apply(
        "measurement_noise", np.zeros(n), interval=interval, series=series, density=S, bandwidth=bandwidth
    )
    filtered = apply("second_lag", noise, interval=interval, tau2=T)
    limited = S / (2 * T) if bandwidth == math.inf else S * bandwidth / 2 / (1 + bandwidth * T)
    tolerance = 5 * limited * math.sqrt(4 * T / (n * interval))
    assert np.var(filtered) == pytest.approx(limited, abs=tolerance)


def test_white_noise_of_example_2():
    n = 100_000
    series = np.random.default_rng(2).standard_normal(2 * n + 2)
    noise = apply("measurement_noise", np.zeros(n), interval=0.01, series=series, density=4e-8)
    assert np.std(noise) == pytest.approx(0.002, rel=0.02)


# recording


def test_quantization_rounds_to_the_step():
    u = walk(500)
    q = apply("quantization", u, step=0.004)
    assert np.max(np.abs(q - u)) <= 0.002 + 1e-12
    np.testing.assert_allclose(q / 0.004, np.rint(q / 0.004), atol=1e-9)


def test_exception_compression_reports_only_larger_moves():
    u = walk(2000, size=0.002)
    x = apply("exception_compression", u, deviation=0.01)
    assert np.max(np.abs(x - u)) <= 0.01
    moves = np.abs(np.diff(x))
    assert np.all(moves[moves > 0] > 0.01) and np.mean(moves > 0) < 0.2


# finding effects


def test_effects_are_found_by_name_and_from_outside(tmp_path, monkeypatch):
    assert load_effect("backlash") in EFFECTS
    (tmp_path / "my_effects.py").write_text(
        "import numpy as np\n"
        "from backlash_cli.effects import Effect, Parameter, Stage\n"
        "LEAK = Effect('leak', Stage.VALVE, 'A leak.', 'own', (Parameter('q', 'span', 'leak', 0.0, 0.0, 1.0),),\n"
        "              lambda p, h, first: np.empty(0), lambda state, value, p: value + p[0])\n"
    )
    monkeypatch.chdir(tmp_path)
    leak = load_effect("my_effects:LEAK")
    np.testing.assert_allclose(leak.apply([0.1, 0.2], leak.pack(q=0.3), 1.0), [0.4, 0.5])
    with pytest.raises(MetadataError, match="did you mean LEAK"):
        load_effect("my_effects:LEEK")
    with pytest.raises(MetadataError, match="cannot load effect"):
        load_effect("no_such_module:X")
    with pytest.raises(MetadataError, match="did you mean stiction"):
        load_effect("sticktion")


def test_effects_of_installed_packages_are_found_by_plain_name(tmp_path, monkeypatch):
    (tmp_path / "their_effects.py").write_text(
        "from dataclasses import replace\n"
        "from backlash_cli.effects.backlash import EFFECT\n"
        "PLAY = replace(EFFECT, name='play')\n"
    )
    folder = tmp_path / "theirs-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text("[backlash.effects]\nplay = their_effects:PLAY\n")
    monkeypatch.syspath_prepend(tmp_path)
    all_effects.cache_clear()
    try:
        assert load_effect("play").name == "play"
        assert [e.name for e in all_effects()][-1] == "play"
    finally:
        all_effects.cache_clear()


def test_play_without_a_gap_is_what_goes_in_holes_as_well() -> None:
    u = np.array([0.0, 1.0, np.nan, 2.0, -0.0, 0.3])
    assert play(u, 0.0, 0.5).tobytes() == u.tobytes()
    assert play(u, 0.5, 0.0).tolist() == [0.0, 0.75, 0.75, 1.75, 0.25, 0.25]
