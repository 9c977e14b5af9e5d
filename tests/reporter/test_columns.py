"""Half periods written column by column: the same as written one by one, for any numbers and times."""

import csv
import io
import json
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.reporter.json_report import iso_time, json_parts, loop, strict, to_json
from backlash_cli.reporter.tables import csv_parts, to_dataframe
from backlash_cli.results import Estimate, LoopReport, ScanResult, Verdict
from backlash_cli.results.scan import Estimates

ANY = st.floats(-1e300, 1e300) | st.sampled_from([float("nan"), float("inf"), -float("inf")])
DATES = st.integers(-10**12, 4 * 10**12).map(lambda ms: ms / 1000.0)


@given(st.lists(DATES | st.sampled_from([float("nan"), float("inf"), 1e12, 1e300]), max_size=30))
def test_times_are_utc_to_the_millisecond(values):
    for value in values:
        stamp = iso_time(value)
        if not abs(value) < 2e11:
            assert stamp is None or 2e11 <= abs(value) < 3e11
        elif value > -6e10:
            at = datetime.fromtimestamp(round(value, 3), UTC)
            assert datetime.fromisoformat(stamp) == at and stamp.endswith("Z")


@st.composite
def found_half_periods(draw: st.DrawFn) -> Estimates:
    n = draw(st.integers(0, 6))
    floats = [np.array(draw(st.lists(ANY, min_size=n, max_size=n)), dtype=float) for _ in range(4)]
    codes = ("ok", "shape", 'a "quoted", code')
    why = np.array(draw(st.lists(st.integers(0, 2), min_size=n, max_size=n)), dtype=np.uint8)
    begin = 60.25 * np.arange(n)
    floats[0] = np.where(np.isfinite(floats[0]), np.clip(floats[0], 0.0, 1e6), 1.0)
    sign = np.array(draw(st.lists(st.sampled_from([-1, 1]), min_size=n, max_size=n)), dtype=np.int8)
    return Estimates(1.7e9, begin, *floats, sign, why, codes)


def one_by_one(e: Estimate) -> dict[str, object]:
    return {"start": iso_time(e.start), "end": iso_time(e.end), "dt_s": e.dt_s, "dy": e.dy, "e_max": e.e_max, "d": e.d,
            "direction": e.direction, "accepted": e.accepted, "why": e.why}


@given(found_half_periods())
@settings(deadline=None)  # imports pandas
def test_json_csv_and_frame_are_those_of_the_rows(found):
    expected = strict([one_by_one(e) for e in found])
    assert loop(LoopReport("FIC1", Verdict.BACKLASH, estimates=found))["estimates"] == expected
    names = ("FIC1", '=a",\n"b')
    result = ScanResult(tuple(LoopReport(name, Verdict.BACKLASH, estimates=found) for name in names))
    told = [{"loop": name, **row} for name in names for row in expected]
    lines = list(csv.reader(io.StringIO("".join(csv_parts(result, "estimates")))))
    assert len(lines) == 1 + len(told)
    for line, row in zip(lines[1:], told, strict=True):
        assert line[0] == row["loop"].replace("=", "'=")
        assert line[1:3] == [row["start"], row["end"]] and line[-1] == row["why"]
        assert line[3:7] == ["" if row[n] is None else repr(row[n]) for n in ("dt_s", "dy", "e_max", "d")]
    frame = to_dataframe(result, "estimates")
    assert frame["d"].tolist() == pytest.approx([np.nan if r["d"] is None else r["d"] for r in told], nan_ok=True)
    assert frame["accepted"].tolist() == [r["accepted"] for r in told]


def test_estimates_given_one_by_one_are_told_alike():
    found = [Estimate(1.7e9 + 90.5 * k, 1.7e9 + 90.5 * (k + 1), 90.5, 0.01, 0.02, 0.1, (-1) ** k, k > 1,
                      "ok" if k > 1 else "shape") for k in range(4)]
    assert strict(found) == [one_by_one(e) for e in found]


def test_pieces_are_the_text_and_a_loop_may_be_called_after_a_field():
    one = Estimate(0.0, 9.0, 9.0, 0.1, 0.2, 0.3, 1, True)
    report = LoopReport('"estimates": []', Verdict.BACKLASH, estimates=[one])
    result = ScanResult((report, replace(report, loop="b")))
    assert "".join(json_parts(result)) == to_json(result) and len(list(csv_parts(result))) == 3
    loops = json.loads(to_json(result))["loops"]
    assert [loop["loop"] for loop in loops] == ['"estimates": []', "b"]
    assert [len(loop["estimates"]) for loop in loops] == [1, 1]
    assert json.loads(to_json(ScanResult(())))["loops"] == []
