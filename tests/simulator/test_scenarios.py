"""Scenario files: what comes with the tool runs, what is wrong is refused with place and remedy."""

import re
from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.errors import BacklashError, LoopError, MetadataError, UsageError
from backlash_cli.simulator import simulate, trace
from backlash_cli.simulator.scenario import truth_rows
from backlash_cli.simulator.scenario_file import (
    load_scenarios,
    parse_scenarios,
    scenario_names,
    scenario_text,
    with_dead_band,
    with_seed,
)

GOOD = """
[simulation]
duration = 100.0
step = 0.1
seed = 3
start = 2026-03-02T06:00:00Z
[loops.FIC1]
controller = { K = 0.6, Ti = 28.0, b = 1.0 }
process = { gain = 1.3, lags = [20, 2] }
setpoint = { level = 0.4, effects = [{ effect = "load_step", times = [10], sizes = [0.02] }] }
output = 0.3
effects = [{ effect = "backlash", d = 0.03 }, { effect = "measured_disturbance", column = "DV1", gain = 0.01 }]
compensator = { gain = 0.02, scheme = 9, hysteresis = 0.001 }
manual = [{ start = 20, end = 30 }]
columns.DV1 = { level = 5.0, effects = [{ effect = "random_load", sd = 1.0, time_constant = 10 }] }
recorder = [{ effect = "quantization", step = 0.001, signals = ["pv"] }]
record_interval = 1.0
pv_range = [0, 900]
hidden = ["Kp"]
"""


def test_a_full_scenario_file():
    (s,) = parse_scenarios(GOOD)
    record = simulate(s)
    assert (s.name, s.start, len(record), record.interval) == ("FIC1", 1772431200.0, 100, 1.0)
    assert record.settings.pv_range == (0.0, 900.0) and record.settings.Kp is None
    assert record.state[25] != 0 and "DV1" in record.disturbances
    np.testing.assert_allclose(record.measurement / 0.001, np.rint(record.measurement / 0.001), atol=1e-6)


@pytest.mark.parametrize("name", scenario_names())
def test_named_scenarios_run(name):
    for s in load_scenarios(name):
        record = simulate(replace(s, duration=min(s.duration, 600.0)))
        assert np.all(np.isfinite(record.measurement))
        assert record.settings.K == s.controller.K


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("lags = [20, 2]", "lags = [20, -2]", r"loops.FIC1\] process: a lag of -2 s"),
        ("gain = 1.3", "gian = 1.3", r"process: unknown key 'gian' -> did you mean gain"),
        ("output = 0.3", "outptu = 0.3", "unknown key 'outptu' -> did you mean output"),
        ("pv_range = [0, 900]", "pv_range = [900, 0]", r"ranges must be finite, and rise -> low first"),
        ("[simulation]", "[simulations]", "unknown key 'simulations' -> did you mean simulation"),
        ("d = 0.03", "dd = 0.03", "effects: backlash has no parameter 'dd' -> did you mean d"),
        ("d = 0.03", "d = -0.03", "-0.03 is not possible"),
        ('"backlash"', '"backlsh"', "no effect 'backlsh' -> did you mean backlash"),
        ('effect = "backlash", ', "", "names no effect"),
        ("Ti = 28.0, ", "", "controller: needs Ti"),
        ("Ti = 28.0", 'Ti = "fast"', "controller.Ti: 'fast' is not a number"),
        ("duration = 100.0", "", "needs duration"),
        ("duration = 100.0", 'duration = "2 h"', r"\[simulation\] duration: '2 h' is not a number -> without quotes"),
        ("duration = 100.0", "duration = -1.0", r"loops.FIC1\]: duration = -1"),
        ("step = 0.1", "step = 200.0", r"step = 200 s is not possible.*step at most as long"),
        ("step = 0.1", "step = 0.3", "record_interval = 1 s is not a multiple"),
        ("scheme = 9", "scheme = 5", "scheme 5"),
        ("pv_range = [0, 900]", "pv_range = [900, 900]", "not a range"),
        ('column = "DV1"', 'column = "DV2"', "did you mean DV1"),
        ('hidden = ["Kp"]', 'hidden = ["Kpp"]', "cannot be hidden"),
        ('signals = ["pv"]', 'signals = ["pvv"]', "unknown key 'PVV' -> did you mean PV"),
        ("start = 2026-03-02T06:00:00Z", 'start = "yesterday"', "not a time"),
        ("[loops.FIC1]", "[loops.FIC1", "not valid TOML"),
        ("manual = [{ start = 20, end = 30 }]", "manual = [{ start = 30, end = 20 }]", "manual from 30 to 20"),
        ("times = [10], ", "times = [10, 20], ", "times and sizes differ in length"),
        ("lags = [20, 2]", "lags = []", "answers at once"),
        ("K = 0.6", "K = 60.0", "unstable"),
    ],
)
def test_wrong_scenario_files_are_refused(old, new, says):
    assert old in GOOD
    with pytest.raises((MetadataError, LoopError), match=says):
        trace(parse_scenarios(GOOD.replace(old, new, 1))[0])


def test_unknown_scenario_names_the_nearest():
    with pytest.raises(UsageError, match="did you mean example-2"):
        load_scenarios("exmaple-2")
    with pytest.raises(MetadataError, match="cannot be read"):
        load_scenarios("no_such_file.toml")


def test_dead_band_and_seed_can_be_replaced():
    base = load_scenarios("example-2")
    wide = with_dead_band(base, 0.1)
    assert ("EXAMPLE2", "backlash", "d", "0.1", "span") in truth_rows(wide)
    assert sum(row[1] == "backlash" for row in truth_rows(wide)) == 1
    other = with_seed(base, 7)
    assert not np.array_equal(simulate(other[0]).measurement, simulate(base[0]).measurement)
    assert with_seed(with_dead_band(base, None), None) == base


def test_loops_of_one_file_have_their_own_random_numbers():
    loops = scenario_text("example-2") + scenario_text("example-2").split("\n\n", 1)[1].replace("EXAMPLE2", "TWIN")
    one, two = (simulate(s).measurement for s in parse_scenarios(loops))
    assert not np.array_equal(one, two)


ODD = ("nan", "inf", "-inf", "-1", "0", "1e308", "1e-308", '"x"', "[]", "{}", "true", "[1, [2]]", "2026-01-01")
VALUE = r"(\[[^=]*?\](?=[ \n])|\[\{.*\}\]|\{.*\}|[^,\n}]+?)(?=[,\n]| \})"
KEYS = sorted(set(re.findall(r"(\w+) = ", GOOD)))


@pytest.mark.parametrize("key", KEYS)
def test_odd_values_give_a_message_or_a_finite_record(key):
    """Whatever stands behind a key: a clear error, or a record without infinities; never a traceback."""
    for odd in ODD:
        text = re.sub(rf"\b{key} = " + VALUE, f"{key} = {odd}", GOOD, count=1)
        try:
            loops = parse_scenarios(text)
            if max(s.duration / s.step for s in loops) > 1e6:
                continue
            for s in loops:
                record = simulate(s)
                assert np.all(np.isfinite(record.measurement)) and np.all(np.isfinite(record.output)), (key, odd)
        except BacklashError as error:
            assert str(error)
