from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backlash_cli.kernels import play
from backlash_cli.record import LoopSettings, Record, record_from_arrays
from backlash_cli.reporter.figures import (
    close_look,
    flanks,
    known_part,
    means,
    shown,
    stands_still,
    stem_of,
    trend,
)
from backlash_cli.reporter.scan_report import draw
from backlash_cli.reporter.still import loop_figure, write_still
from backlash_cli.results import Cluster, Confirmation, Estimate, LoopReport, ScanResult, Verdict

N = 6000
SETTINGS = LoopSettings(K=0.6, Ti=28.0, pv_range=(0.0, 900.0), op_range=(0.0, 100.0))
PROFILE = tuple((0.002 * 1.2**k, 40.0 - (k - 14) ** 2) for k in range(24))


def record(name: str = "FIC101", *, output: bool = True, start: float = 1.7e9) -> Record:
    rng = np.random.default_rng(0)
    op = 0.5 + 0.06 * np.sin(np.arange(N) / 200.0)
    pv = play(op, 0.03, 0.5) + 0.002 * rng.normal(size=N)
    return record_from_arrays(
        0.5, pv, op if output else None, interval=1.0, loop=name, start=start, settings=SETTINGS
    )


def report(name: str = "FIC101", *, start: float = 1.7e9, estimates: int = 8) -> LoopReport:
    made = tuple(
        Estimate(at, at + 500, 500.0, 0.01, 0.015, 0.029 + 0.001 * (k % 3), 1 - 2 * (k % 2), k != 3)
        for k, at in enumerate(start + 700.0 * np.arange(estimates))
    )
    return LoopReport(
        name,
        Verdict.BACKLASH,
        estimates=made,
        cluster=Cluster(0.03, (0.028, 0.032), 0.1, estimates, 1.0),
        confirmation=Confirmation(0.031, (0.029, 0.033), 0.4, 60.0, profile=PROFILE),
    )


def texts(figure) -> str:
    from matplotlib.text import Text

    return " | ".join(t.get_text() for t in figure.findobj(Text))


def test_the_picture_says_what_was_found_and_where() -> None:
    figure = loop_figure(record(), report())
    said = texts(figure)
    assert "FIC101: backlash, dead band 3.00 % of the output span" in said
    for words in ("2.9 %", "SP, PV [span 0 to 900]", "OP [%]", "size found: 3.10 %",
                  "half periods used, median: 3.00 %"):
        assert words in said, words
    assert "valve opening" in said and "valve closing" in said


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_the_file_is_a_picture_and_the_same_each_time(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"FIC101{suffix}"
    write_still(path, loop_figure(record(), report()))
    data = path.read_bytes()
    assert len(list(tmp_path.iterdir())) == 1
    if suffix == ".png":
        assert data.startswith(b"\x89PNG")
        write_still(path, loop_figure(record(), report()))
        assert path.read_bytes() == data
    else:
        assert ET.fromstring(data).tag.endswith("svg")


@pytest.mark.parametrize("name", ["../../etc/x", "$\\frac{1}$ $x\n", "流量 Ö1", "x" * 300])
def test_no_name_leaves_the_folder_or_breaks_the_picture(tmp_path: Path, name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = replace(report(name), samples=N)
        assert draw(ScanResult((found,)), {name: record(name)}, tmp_path / "plots") == 1
    assert [path.suffix for path in tmp_path.rglob("*") if path.is_file()] == [".png"]
    assert len(list((tmp_path / "plots").iterdir())) == 1


def test_without_output_or_confirmation_the_estimates_are_the_evidence() -> None:
    said = texts(loop_figure(record(output=False), replace(report(), confirmation=None)))
    assert "sizes from half periods" in said and "PV against OP" not in said


def test_what_is_too_small_to_see_is_shaded_below_the_size_found() -> None:
    found = report().confirmation
    assert found is not None
    below = replace(report(), confirmation=replace(found, limit_of_detection=0.01))
    assert "too small to see" in texts(loop_figure(record(), below))
    above = replace(report(), confirmation=replace(found, limit_of_detection=0.05))
    assert "too small to see" not in texts(loop_figure(record(), above))


def test_no_dead_band_is_drawn_where_none_is_claimed() -> None:
    said = texts(loop_figure(record(), replace(report(), verdict=Verdict.NO_BACKLASH)))
    assert "valve opening" not in said and "dead band 3.00 %" not in said


def test_without_estimates_the_trend_is_still_drawn() -> None:
    bare = LoopReport("FIC101", Verdict.CANNOT_TELL)
    said = texts(loop_figure(record(), bare))
    assert "FIC101: cannot tell" in said and "no half period was long enough" in said


def test_gaps_and_missing_numbers_break_the_line() -> None:
    whole = record()
    assert whole.output is not None
    keep = np.r_[0:2000, 4000:N]
    pv = whole.measurement[keep].copy()
    pv[100:200] = np.nan
    part = replace(
        whole,
        index=whole.index[keep],
        setpoint=whole.setpoint[keep],
        measurement=pv,
        output=whole.output[keep],
        state=whole.state[keep],
    )
    figure = loop_figure(part, report())
    line = figure.axes[0].lines[1]
    assert np.isnan(np.asarray(line.get_ydata(), dtype=float)).any()


@pytest.mark.parametrize("samples", [1, 30])
def test_short_records_are_drawn(tmp_path: Path, samples: int) -> None:
    write_still(tmp_path / "short.png", loop_figure(record().slice(0, samples), report()))
    assert (tmp_path / "short.png").is_file()


def test_estimates_are_thinned_before_they_hide_each_other() -> None:
    long = replace(report(), estimates=report(estimates=8).estimates * 20)
    top = loop_figure(record(), long).axes[0]
    places = sorted(text.get_position()[0] for text in top.texts)
    assert 3 <= len(places) <= 8 and np.diff(places).min() > 0


def test_flanks_lie_a_dead_band_apart() -> None:
    lines = flanks(record(), 0.03)
    assert lines is not None
    (op, up), (_, down) = lines
    slope = (up[1] - up[0]) / (op[1] - op[0])
    assert slope == pytest.approx(1.0, rel=0.05)
    assert (down - up)[0] / slope == pytest.approx(0.03, rel=1e-9)


def test_the_stem_stands_still_for_as_long_as_op_needs_to_cross_the_gap() -> None:
    slope, d = 1e-4, 0.03  # [1/sample]: after every turn of a triangle the stem waits for d / slope samples
    wave = 0.5 + slope * np.abs((np.arange(8000.0) % 2000) - 1000)
    stem = stem_of(wave, d)
    found = stands_still(wave, stem, d)[1:]  # the first begins at half the gap: nobody knows where the stem was
    assert [first for first, _ in found] == pytest.approx([1000, 2000, 3000, 4000, 5000, 6000, 7000], abs=2)
    assert [last - first for first, last in found] == pytest.approx([d / slope] * 7, abs=3)
    assert not stands_still(wave, stem_of(wave, 0.0), 0.0)
    flat = np.where(np.arange(8000) > 100, np.nan, wave)
    assert np.isfinite(stem_of(flat, d)).all() and stands_still(flat[200:], stem_of(flat, d)[200:], d) == []


def test_the_close_look_shows_the_stem_and_where_it_stands_still() -> None:
    whole = record()
    window = close_look(whole, report())
    figure = trend(whole, report(), window)
    stem = figure["data"][-1]
    assert stem["name"] == "stem: OP through 3.00 % of play" and stem["yaxis"] == "y2"
    shades = figure["layout"]["shapes"]
    assert 4 <= len(shades) <= 12 and [s["showlegend"] for s in shades] == [True] + [False] * (len(shades) - 1)
    assert whole.output is not None
    for shade in shades:  # OP crosses most of the gap while the stem stays where it is
        inside = (1000 * whole.time >= shade["x0"]) & (1000 * whole.time <= shade["x1"])
        assert np.ptp(whole.output[inside]) >= 0.015 and np.ptp(stem_of(whole.output, 0.03)[inside]) == 0.0
    none = trend(whole, replace(report(), verdict=Verdict.NO_BACKLASH), window)
    assert "shapes" not in none["layout"] and none["data"][-1]["name"] == "OP"


def test_no_flanks_where_pv_does_not_follow_the_valve() -> None:
    noise = np.random.default_rng(1).normal(size=N)
    assert flanks(replace(record(), measurement=0.5 + 0.01 * noise), 0.03) is None
    assert flanks(record().slice(0, 10), 0.03) is None


def test_what_is_not_recorded_is_not_drawn() -> None:
    whole = record()
    pv = whole.measurement.copy()
    pv[4000:] = np.nan
    part = known_part(replace(whole, measurement=pv))
    assert len(part) == 4000
    assert len(known_part(replace(whole, measurement=np.full(N, np.nan)))) == N
    assert close_look(whole, LoopReport("x", Verdict.CANNOT_TELL)) == slice(2700, 3300)


def test_units_and_means() -> None:
    assert shown((0.0, 1.0)) == ((0.0, 100.0), "%") and shown((0.0, 900.0))[0] == (0.0, 900.0)
    assert means(np.arange(10.0), 5).tolist() == [0.5, 2.5, 4.5, 6.5, 8.5]
    assert means(np.arange(3.0), 5).tolist() == [0.0, 1.0, 2.0]
