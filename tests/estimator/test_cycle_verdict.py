"""What an oscillation adds to the verdict, on drawn loops and on recordings with a published diagnosis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from backlash_cli import read
from backlash_cli.estimator.diagnosis import with_oscillation
from backlash_cli.record import LoopSettings, Note, record_from_arrays
from backlash_cli.results import LoopReport, Verdict
from backlash_cli.scanning import scan
from tests.benchmarks.cycling_loops import draw
from tests.shared_data import shared_data

STICKS = 9002  # a seed whose valve makes the loop cycle
TOO_SHORT = (Note("short_record", "only 40 blocks"),)


def codes(report: LoopReport) -> list[str]:
    return [reason.code for reason in report.reasons]


def test_a_sticking_valve_is_suspected_where_ti_allows_no_test() -> None:
    report = with_oscillation(LoopReport("L", Verdict.INSUFFICIENT_DATA, TOO_SHORT, 0.0), draw(STICKS, "stick").record)
    assert report.verdict is Verdict.SUSPECTED
    assert codes(report) == ["looks_like_stiction", "oscillation", "short_record"]


def test_without_a_setpoint_the_valve_is_not_accused() -> None:
    """A setpoint that switches to and fro makes the same cycles."""
    loop = draw(STICKS, "stick").record
    bare = replace(loop, setpoint=np.full(len(loop), np.nan), settings=LoopSettings())
    report = with_oscillation(LoopReport("L", Verdict.CANNOT_TELL, (Note("missing_settings", ""),), 0.0), bare)
    assert report.verdict is Verdict.OSCILLATING
    assert "setpoint, which was not recorded" in report.reasons[1].message


def test_a_swing_from_outside_is_an_oscillation_and_no_suspicion() -> None:
    loop = draw(9001, "sine").record
    report = with_oscillation(LoopReport("L", Verdict.INSUFFICIENT_DATA, TOO_SHORT, 0.0), loop)
    assert report.verdict is Verdict.OSCILLATING
    assert codes(report) == ["oscillation", "looks_like_external", "short_record"]


@pytest.mark.parametrize("verdict", [Verdict.BACKLASH, Verdict.NO_BACKLASH, Verdict.SUSPECTED])
def test_another_verdict_stands(verdict: Verdict) -> None:
    loop = draw(STICKS, "stick").record
    assert with_oscillation(LoopReport("L", verdict, TOO_SHORT, 0.7), loop).reasons == TOO_SHORT
    swings = (Note("oscillation", ""),)
    report = with_oscillation(LoopReport("L", verdict, swings, 0.7), loop)
    assert (report.verdict, codes(report)) == (verdict, ["oscillation", "looks_like_stiction"])


def test_what_blocks_a_verdict_is_not_talked_away() -> None:
    loop = draw(STICKS, "stick").record
    report = LoopReport("L", Verdict.CANNOT_TELL, (Note("compressed_linear", ""),), 0.0)
    assert with_oscillation(report, loop) is report


PUBLISHED = {
    "PAP4": {"suspected", "backlash"},  # dead zone and tight tuning
    "PAP2": {"suspected", "backlash"},
    "CHEM10": {"suspected", "backlash", "cannot_tell"},  # stiction; all that explains it is as wide as OP moves
    "CHEM23": {"suspected", "backlash", "cannot_tell"},  # stiction, one sample per integral time
    "CHEM1": {"suspected", "backlash", "oscillating"},  # stiction, a setpoint that may have moved
    "CHEM2": {"suspected", "backlash", "cannot_tell"},  # stiction, four cycles
    "CHEM13": {"oscillating", "cannot_tell", "no_backlash"},  # a faulty sensor elsewhere
    "PAP7": {"oscillating", "cannot_tell", "no_backlash"},  # a disturbance from outside
}


@pytest.mark.parametrize("loop", PUBLISHED)
def test_recordings_of_the_stiction_data_base(loop: str) -> None:
    path = shared_data("isdb", f"{loop}.csv")
    assert str(scan(read(path)[loop]).verdict) in PUBLISHED[loop]


@pytest.mark.parametrize("memory", [0.0, 10.0, 30.0])
def test_noise_is_no_oscillation(memory: float) -> None:
    """White, or of some samples' memory: it crosses the setpoint often enough, but nothing repeats."""
    rng = np.random.default_rng(round(memory))
    kept = np.exp(-1.0 / memory) if memory else 0.0
    pv, op = (0.5 + 0.02 * lfilter([np.sqrt(1 - kept**2)], [1.0, -kept], rng.normal(size=14_400)) for _ in range(2))
    settings = LoopSettings(K=0.6, Ti=25.0, Kp=1.0, source={"K": "metadata", "Ti": "metadata"})
    report = scan(record_from_arrays(0.5, pv, op, interval=1.0, settings=settings))
    assert report.verdict is Verdict.CANNOT_TELL and "oscillation" not in {note.code for note in report.reasons}
