"""A record without a setpoint: taken as constant where the output shows that it was, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backlash_cli.estimator.identify import at_mean, identify, with_constant_setpoint
from backlash_cli.record import LoopSettings, Record
from backlash_cli.scanning import scan
from tests.benchmarks.random_loops import draw


def hidden(record: Record) -> Record:
    """The same without setpoint and settings."""
    return replace(record, setpoint=np.full(len(record), np.nan), settings=LoopSettings())


@pytest.mark.parametrize("kind", ["steps", "coloured", "square"])
def test_a_setpoint_that_stood_still_is_found_again(kind: str) -> None:
    loop = draw(4, kind, 0.04)
    found = with_constant_setpoint(hidden(loop.record))
    assert found.setpoint[0] == pytest.approx(0.5, abs=0.003)
    assert found.notes[-1].code == "assumed_setpoint"
    law = identify(found)
    assert law.ratio.value == pytest.approx(loop.record.settings.K / loop.record.settings.Ti, rel=0.1)


@pytest.mark.parametrize("kind", ["cascade", "fastsp"])
@pytest.mark.parametrize("seed", range(3))
def test_a_setpoint_that_moved_is_not_made_up(kind: str, seed: int) -> None:
    record = hidden(draw(seed, kind, 0.0).record)
    assert with_constant_setpoint(record) is record
    assert scan(record).verdict in ("cannot_tell", "no_backlash", "oscillating")


@pytest.mark.parametrize(("seed", "verdict"), [(2, "backlash"), (4, "suspected"), (6, "backlash")])
def test_the_verdict_is_that_with_the_setpoint(seed: int, verdict: str) -> None:
    loop = draw(seed, "steps", 0.04)
    report, with_setpoint = scan(hidden(loop.record)), scan(loop.record)
    assert report.verdict == with_setpoint.verdict == verdict
    assert report.cluster is not None and with_setpoint.cluster is not None
    assert report.cluster.d == pytest.approx(with_setpoint.cluster.d, rel=0.05)
    assert "assumed_setpoint" in [note.code for note in report.warnings]


def test_a_recorded_setpoint_is_left_alone() -> None:
    record = draw(0, "cascade", 0.0).record
    assert with_constant_setpoint(record) is record
    late = replace(record, setpoint=np.where(np.arange(len(record)) < 10, np.nan, record.setpoint))
    assert with_constant_setpoint(late) is late
    assert at_mean(record.slice(0, 20)) is None
