"""The sample plant in the repository is what its scenario makes, in three layouts, and stays small."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from backlash_cli.simulator import simulate
from backlash_cli.simulator.scenario import truth_rows
from backlash_cli.simulator.scenario_file import load_scenarios

FOLDER = Path(__file__).resolve().parents[2] / "sample_data"
LOOPS = {s.name: s for s in load_scenarios("sample-plant")}
FIRST = 1800


@pytest.fixture(scope="module")
def wide():
    return pd.read_csv(FOLDER / "plant.csv")


@pytest.mark.parametrize("name", LOOPS)
def test_sample_is_what_the_scenario_makes(name, wide):
    record = simulate(replace(LOOPS[name], duration=float(FIRST)))
    for values, tag, (low, high) in (
        (record.setpoint, "SP", record.settings.pv_range),
        (record.measurement, "PV", record.settings.pv_range),
        (record.output, "OP", record.settings.op_range),
    ):
        written = (wide[f"{name}.{tag}"].to_numpy()[:FIRST] - low) / (high - low)
        np.testing.assert_allclose(written, values, atol=2e-5)


def test_long_and_parquet_hold_the_same(wide):
    parquet = pd.read_parquet(FOLDER / "plant.parquet")
    long = pd.read_csv(FOLDER / "plant_long.csv.gz", dtype={"value": str})
    assert list(parquet.columns) == list(wide.columns)
    assert set(long["tag"]) == set(wide.columns) - {"timestamp"}
    for tag, part in long.groupby("tag"):
        values = part["value"].to_numpy()
        if tag.endswith(".MODE"):
            assert list(values) == list(wide[tag]) == list(parquet[tag])
        else:
            np.testing.assert_array_equal(values.astype(float), wide[tag].to_numpy())
            np.testing.assert_array_equal(parquet[tag].to_numpy(), wide[tag].to_numpy())
    assert list(part["timestamp"]) == list(wide["timestamp"])


def test_settings_truth_and_size():
    assert (FOLDER / "plant.loops.toml").read_bytes() == (FOLDER / "plant_long.loops.toml").read_bytes()
    written = pd.read_csv(FOLDER / "truth.csv", dtype=str, keep_default_na=False).to_numpy().tolist()
    assert written == [list(row) for row in truth_rows(LOOPS.values())]
    assert sum(f.stat().st_size for f in FOLDER.iterdir()) < 10e6


def test_sample_covers_what_a_plant_shows(wide):
    truth = {name: dict((r[1] + "." + r[2], r[3]) for r in truth_rows([s])) for name, s in LOOPS.items()}
    gaps = {name: float(t.get("backlash.d", 0.0)) for name, t in truth.items()}
    assert len(LOOPS) == 12 and sum(d == 0.0 for d in gaps.values()) >= 4 and len(set(gaps.values())) >= 6
    assert truth["LIC404"]["process.integrating"] == "1"
    assert (wide["TIC206.MODE"] == "MAN").sum() == 1800
    assert "setpoint:external_oscillation.period" in truth["FIC105"]
    assert "AIC501.DV1" in wide.columns
