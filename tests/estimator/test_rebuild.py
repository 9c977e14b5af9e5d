"""The controller output rebuilt from SP, PV, K and Ti, against the one that the controller gave."""

from __future__ import annotations

import numpy as np
import pytest

from backlash_cli.estimator.rebuild import rebuilt_output
from backlash_cli.record import Record
from tests.benchmarks.random_loops import draw


def rebuilt(record: Record) -> np.ndarray:
    return rebuilt_output(record, record.settings, record.usable)


@pytest.mark.parametrize("kind", ["fastsp", "coloured", "steps"])
def test_the_output_of_a_digital_controller_is_rebuilt_but_for_a_constant(kind: str) -> None:
    for seed in (41000, 41001, 41003):  # Ti of 3 to 8 samples: a delay of one of them would show
        record = draw(seed, kind, 0.02).record
        assert record.output is not None
        off = (rebuilt(record) - record.output)[100:]
        assert np.std(off) < 0.001 * np.std(record.output)
