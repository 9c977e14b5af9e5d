"""Valves with physical friction (Karnopp, LuGre) of a simulator that shares nothing with the workbench."""

import pytest

import backlash_cli
from backlash_cli.model import explain
from tests.benchmarks.hidden_strangers import write


@pytest.mark.parametrize("friction", ["karnopp", "lugre"])
def test_a_valve_with_friction_is_never_play_for_sure(tmp_path, friction):
    write(tmp_path, 1, seed=5, only=friction)
    whole = backlash_cli.read(tmp_path / "s000_d1.csv.gz")["L1"]
    record = whole.slice(len(whole) // 2, len(whole))  # tells as much, in a third of the time
    # the valve of the simulator follows OP, late as it may be
    assert record.measurement.std() > 0.8 * record.setpoint.std()
    found = explain(record)
    named = {effect.effect for effect in found.effects}
    assert named & {"backlash", "stiction"}
    assert "stiction" in named or ("backlash", "stiction") in found.look_alikes
