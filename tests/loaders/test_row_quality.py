"""One quality for a whole row of signals: a bad row is bad for all of them."""

import numpy as np
import pytest

from backlash_cli import read
from backlash_cli.record import SampleState

HEADS = ("Time,SP,PV,OP,Quality", "Time,Quality,SP,PV,OP", "Time,Loop,SP,PV,OP,Status", "Time,SP,PV,OP,Quality,MODE",
         "Time,FIC101.SP,FIC101.PV,FIC101.OP,FIC102.SP,FIC102.PV,FIC102.OP,OPCQuality")


def signals(k):
    """SP, PV and OP of a row."""
    return f"50,{50 + np.sin(k / 7):.3f},{40 + np.cos(k / 7):.3f}"


def written(tmp_path, head, cells, name="plant.csv"):
    """Write 300 rows, a second apart: the stamp, and what `cells` says of the row."""
    rows = [f"2026-03-17 08:{k // 60:02d}:{k % 60:02d},{cells(k)}" for k in range(300)]
    (tmp_path / name).write_text("\n".join([head, *rows]) + "\n")
    return tmp_path / name


@pytest.mark.parametrize("head", HEADS)
def test_a_quality_of_the_row_marks_every_signal(tmp_path, head):
    def cells(k):
        known = {"Loop": "FIC101", "MODE": "AUTO", **dict(zip(("SP", "PV", "OP"), signals(k).split(","), strict=True))}
        mark = "Bad" if 100 <= k < 120 else "Good"
        return ",".join(known.get(name.split(".")[-1], mark) for name in head.split(",")[1:])

    for record in read(written(tmp_path, head, cells, "FIC101.csv")):
        assert not record.usable[record.index == 110].any(), record.loop
        assert np.count_nonzero(record.state == SampleState.GOOD) == 280


@pytest.mark.parametrize("head", ["Time,SP,OP,PV,PV.Quality", "Time,FIC101.SP,FIC101.OP,FIC101.PV,FIC101.PV.Quality"])
def test_a_quality_of_one_signal_marks_that_alone(tmp_path, head):
    def cells(k):
        sp, pv, op = signals(k).split(",")
        return f"{sp},{op},{pv},{'Bad' if k == 110 else 'Good'}"

    (record,) = read(written(tmp_path, head, cells, "FIC101.csv"))
    (bad,) = (note.message for note in record.notes if note.code == "bad_quality")
    assert "PV" in bad and "OP" not in bad and "SP" not in bad
    assert record.state[record.index == 110] != SampleState.GOOD


def test_a_quality_of_one_signal_counts_beside_that_of_the_row(tmp_path):
    def cells(k):
        sp, pv, op = signals(k).split(",")
        return f"{sp},{pv},{'Bad' if k == 110 else 'Good'},{op},{'Bad' if k == 210 else 'Good'}"

    head = "Time,FIC101.SP,FIC101.PV,FIC101.PV.Quality,FIC101.OP,Quality"
    (record,) = read(written(tmp_path, head, cells, "FIC101.csv"))
    told = [note.message for note in record.notes if note.code == "bad_quality"]
    assert any("PV" in message for message in told) and any("OP" in message for message in told)
    assert (record.state[np.isin(record.index, (110, 210))] != SampleState.GOOD).all()


def test_modes_called_status_are_no_quality(tmp_path):
    (record,) = read(written(tmp_path, "Time,SP,PV,OP,Status", lambda k: (
        f"{signals(k)},{'MANUAL' if 100 <= k < 130 else 'AUTO'}"), "FIC101.csv"))
    assert "bad_quality" not in [note.code for note in record.notes]
    assert np.count_nonzero(record.state == SampleState.MANUAL) == 30


@pytest.mark.parametrize("name", ["dataintegrity", "sample_code"])  # of Ignition; known by its content alone
def test_codes_of_a_product_s_own_beside_those_of_opc_mark_what_is_bad(tmp_path, name):
    lines = [f"tagpath,floatvalue,{name},t_stamp"]
    for k in range(300):
        for role, usual in (("sp", 50.0), ("pv", 50 + np.sin(k / 7)), ("op", 40 + np.cos(k / 7))):
            code = {110: 256, 120: 500, 130: 0}.get(k, 192) if role == "pv" else 192
            value, stamp = usual if code == 192 else 0.0, 1_787_234_400_000 + 1000 * k
            lines.append(f"area1/fic101/{role},{value:.3f},{code},{stamp}")
    path = tmp_path / "sqlth.csv"
    path.write_text("\n".join(lines) + "\n")
    (record,) = read(path)
    (bad,) = (note.message for note in record.notes if note.code == "bad_quality")
    assert "3 samples of area1/fic101/pv" in bad
    assert (record.state[np.isin(record.index, (110, 120, 130))] != SampleState.GOOD).all()


@pytest.mark.parametrize(("value", "quality"), [
    ("value_{}", "quality_{}"), ("Value {}", "Quality {}"), ("val:{}", "q:{}"), ("avg_{}", "status_{}"),
    ("('value', '{}')", "('quality', '{}')"), ("{}", "{} (Quality)"), ("{}", "{}_ERR"), ("{}", "{}_FAULT")])
def test_a_quality_is_told_by_what_stands_before_or_behind_its_signal(tmp_path, value, quality):
    fault = quality.endswith(("ERR", "FAULT"))
    words = ("0", "1" if quality.endswith("ERR") else "207") if fault else ("Good", "Bad")
    names = ["FIC101.SP", "FIC101.PV", "FIC101.OP"]
    head = ",".join(f'"{one}"' for one in (
        "Time", *(value.format(name) for name in names), *(quality.format(name) for name in names)))
    (record,) = read(written(tmp_path, head, lambda k: f"{signals(k)},{words[0]},{words[k == 110]},{words[0]}"))
    assert record.loop == "FIC101" and record.state[record.index == 110] != SampleState.GOOD
    assert [note.code for note in record.notes if "quality" in note.code] == ["bad_quality"]


def test_the_control_error_is_no_flag_of_a_fault(tmp_path):
    (record,) = read(written(tmp_path, "Time,FIC101.SP,FIC101.PV,FIC101.OP,FIC101.ERR", lambda k: (
        f"{signals(k)},{-np.sin(k / 7):.3f}")))
    assert record.usable.all() and not [note for note in record.notes if "quality" in note.code]


def test_a_quality_of_no_signal_is_told(tmp_path):
    plant = read(written(tmp_path, "Time,FIC101.SP,FIC101.PV,FIC101.OP,TI5.Quality", lambda k: (
        f"{signals(k)},{'Bad' if k == 110 else 'Good'}")))
    assert plant["FIC101"].usable.all()
    assert ["'TI5.Quality'" in note.message for note in plant.warnings if note.code == "quality_unused"] == [True]


def test_faults_in_a_column_of_any_name_are_bad_samples(tmp_path):
    words = {110: "Bad Input", 111: "Comm Fail", 112: "I/O Timeout"}
    rows = [f"2026-03-17 08:{k // 60:02d}:{k % 60:02d},FIC101.{role},{value},{words.get(k, '') if role == 'PV' else ''}"
            for k in range(300) for role, value in zip(("SP", "PV", "OP"), signals(k).split(","), strict=True)]
    (tmp_path / "plant.csv").write_text("\n".join(["time,tag,value,bad_reason", *rows]) + "\n")
    (record,) = read(tmp_path / "plant.csv")
    assert record.index[record.state != SampleState.GOOD].tolist() == [*words]
