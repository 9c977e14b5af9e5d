"""The corpus of export formats beside the checkout: good files give their loops, bad ones a message."""

import json
from pathlib import Path

import numpy as np
import pytest

from backlash_cli.errors import BacklashError
from backlash_cli.loaders import ReadOptions, read
from backlash_cli.loaders.sources import read_metadata
from tests.shared_data import shared_data, shared_root


def entries(kind: str) -> list[dict]:
    path = shared_root() / "data" / "formats" / kind / "expect.json"
    return json.loads(path.read_text("utf-8")) if path.exists() else [{"id": "absent"}]


def inputs_of(folder: Path, entry: dict) -> list[Path]:
    given = entry["file"]
    return [folder / name for name in ([given] if isinstance(given, str) else given)]


@pytest.mark.parametrize("entry", entries("good"), ids=lambda entry: entry["id"])
def test_every_good_export_gives_its_loops(entry):
    folder = shared_data("formats", "good")
    loops = None if entry.get("auto_loops") else folder / entry["loops_file"]
    plant = read(inputs_of(folder, entry), loops=loops, options=ReadOptions(timezone=entry.get("timezone")))
    assert set(entry["loops"]) <= {record.loop for record in plant} and not plant.failures
    for name in entry["loops"]:
        assert np.isfinite(plant[name].measurement).mean() > 0.8 and plant[name].interval > 0.0


@pytest.mark.parametrize("entry", entries("bad"), ids=lambda entry: entry["id"])
def test_every_bad_export_gives_a_message_or_its_loops(entry):
    folder = shared_data("formats", "bad")
    loops = entry.get("loops_file")
    try:
        metadata = None if loops is None else read_metadata(folder / loops)
        plant = read(inputs_of(folder, entry), loops=metadata)
    except BacklashError as error:
        assert "error" in entry["expect"] or "warning" in entry["expect"]
        assert len(str(error)) > 20
    else:
        said = [*plant.failures, *plant.warnings, *(note for record in plant for note in record.notes)]
        assert said or "ok" in entry["expect"] or entry["loops"]
