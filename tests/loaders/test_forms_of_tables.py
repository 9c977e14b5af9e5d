"""Forms of tables that products write, each with the same samples in it: read to the same loop."""

import numpy as np
import pytest

from backlash_cli import read
from backlash_cli.loaders import ReadOptions
from backlash_cli.record import SampleState

ROWS = 300
K = np.arange(ROWS)
STAMPS = [f"2026-03-17 08:{k // 60:02d}:{k % 60:02d}" for k in K]
SIGNALS = {"SP": np.full(ROWS, 50.0), "PV": np.round(50 + np.sin(K / 7), 3), "OP": np.round(40 + np.cos(K / 7), 3)}


def long(widths, right="", tails=("", "", "")):
    """A row per sample, in columns of full width with one blank between them and dashes below their names."""
    rows = [(s, f"FIC101.{role}", f"{v:g}") for k, s in enumerate(STAMPS) for role, v in zip(
        SIGNALS, (x[k] for x in SIGNALS.values()), strict=True)]
    cells = [("DateTime", "TagName", "Value"), tuple("-" * w for w in widths), *rows]
    return "".join(" ".join(c.rjust(w) if i == 2 and right else c.ljust(w) for i, (c, w) in enumerate(
        zip(row, widths, strict=True))) + tails[min(k, 2)] + "\n" for k, row in enumerate(cells))


def wide(*heads, role_of=tuple(SIGNALS), extra=lambda k: ()):
    return "\n".join([*heads, *(",".join([STAMPS[k], *(f"{SIGNALS[r][k]:g}" for r in role_of), *extra(k)])
                                for k in K)]) + "\n"


def boxed(*heads):
    """A table with lines around its cells, as the shells of SQLite and DuckDB draw it."""
    widths = (19, 9, 9, 9)
    ends = [lines[0] + lines[1].join("─" * (w + 2) for w in widths) + lines[2] for lines in ("┌┬┐", "├┼┤", "└┴┘")]
    rows = [("ts", *(f"FIC101_{role}" for role in SIGNALS)), *heads,
            *((STAMPS[k], *(f"{x[k]:g}" for x in SIGNALS.values())) for k in K)]
    text = ["│ " + " │ ".join(f"{cell:^{w}}" for cell, w in zip(row, widths, strict=True)) + " │" for row in rows]
    return "\n".join([ends[0], *text[: 1 + len(heads)], ends[1], *text[1 + len(heads) :], ends[2]]) + "\n"


FORMS = {
    "box of SQLite": boxed(), "box of DuckDB": boxed(("timestamp", "double", "double", "double")),
    "columns of the shell of InfluxDB": "\n".join([
        "name: FIC101", f"{'time':20}op   pv     sp", f"{'----':20}--   --     --", *(
        f"{1773734400 + k}{'0' * 9} {SIGNALS['OP'][k]:<7g} {SIGNALS['PV'][k]:<7g} {SIGNALS['SP'][k]:g}" for k in K)]),
    "text of a query": long((19, 9, 8)),
    "text of a query, numbers to the right": long((19, 9, 8), "yes", (" STATUS", " ------", " Good  ")),
    "text of a query, with its count": long((19, 9, 8)) + "\n(900 rows affected)\n",
    "descriptions below tags": wide(
        ",FIC101.SP,FIC101.PV,FIC101.OP", "Description,Feed flow SP,Feed flow PV,Feed flow OP", "Units,t/h,t/h,%"),
    "average, least and most of each": wide(
        "Time," + ",".join(f"FIC101.{s} ({what})" for s in SIGNALS for what in ("Min", "Avg", "Max")),
        role_of=("OP", "SP", "OP", "SP", "PV", "SP", "PV", "OP", "PV")),
    "a constant measurement beside the loop": wide(
        "_time,SP,PV,OP,_measurement,loop", extra=lambda k: ("pid", "FIC101")),
    "intervals": wide("Start Time,SP,PV,OP,End Time", extra=lambda k: (STAMPS[min(k + 1, ROWS - 1)],)),
    "a date in its first row alone": wide("Date,Time,FIC101.SP,FIC101.PV,FIC101.OP").replace(
        "2026-03-17 ", ",").replace("\n,", "\n17.03.2026,", 1),
    "valve demand": wide("Time,FIC101.LSP,FIC101.PV,FIC101.DEMAND"),
    "numbers beside texts": "\n".join(["timestamp,tag_name,value_num,value_txt", *(
        f"{s},FIC101.{role},{values[k]:g}," for k, s in enumerate(STAMPS) for role, values in SIGNALS.items())]),
    "polish months": wide("Time,FIC101.SP,FIC101.PV,FIC101.OP").replace("2026-03-17", "17-paź-2026"),
    "a remark that has no cells": wide("Time,FIC101_SP,FIC101_PV,FIC101_OP,Comment"),
    "labels of metrics": wide("Time," + ",".join(
        f'"pid_{s}{{instance=""plc1:9100"", job=""opc"", loop=""FIC101""}}"' for s in ("sp", "pv", "op"))),
    "metrics named in their labels": wide("Time," + ",".join(
        f'"{{__name__=""pid_{s}"", tag=""FIC101""}}"' for s in ("sp", "pv", "op"))),
    "labels beside whole tags": wide("Time," + ",".join(f'"FIC101.{s} {{host: srv1, area: 7}}"' for s in SIGNALS)),
    "two names of the value behind the signal": wide("Time," + ",".join(f"FIC101_{s}.F_CV.Value" for s in SIGNALS)),
    "measured value and output": wide("Time,FIC101/SP,FIC101/MV,FIC101/OUT"),
    "controlled and manipulated variable": wide("Time,FIC101/SP,FIC101/CV,FIC101/MV"),
    "controlled variable and output": wide("Time,FIC101/SP,FIC101/CV,FIC101/OUT"),
    "valve position": wide("Time,FIC101 Set Point,FIC101 Process Variable,FIC101 Valve Position"),
    "the tag with its unit is the measurement": wide("Time,FIC101.SP (t/h),FIC101 (t/h),FIC101.OP (%)"),
    "signals in rows of the file of a loop": "signal,time,value\n" + "\n".join(
        f"{role},{s},{x[k]:g}" for role, x in SIGNALS.items() for k, s in enumerate(STAMPS)),
    "statistics below each tag": "\n".join([
        ",".join(["", *(f"FIC101.{s},," for s in SIGNALS)]), "Time" + ",Min,Max,Avg" * 3, *(
            ",".join([s, *(f"{x[k] - 2:g},{x[k] + 2:g},{x[k]:g}" for x in SIGNALS.values())])
            for k, s in enumerate(STAMPS))]),
    "modes at the end, between tabs": "Tag\tTime\tValue\n" + "\n".join(
        f"FIC101:{role}\t17.03.2026 {s[11:]}\t{x[k]}" for role, x in {**SIGNALS, "MODE": ["AUTO"] * ROWS}.items()
        for k, s in enumerate(STAMPS)),
    "an empty column between pairs": "\n".join([",".join(f"FIC101.{s},," for s in SIGNALS), "Timestamp,Value,," * 3, *(
        ",".join(f"{s},{x[k]:g}," for x in SIGNALS.values()) for k, s in enumerate(STAMPS))]),
    "ticks": "\n".join(["TagName,Ticks,Value,IsGood", *(
        f"FIC101.{role},{639093312000000000 + 10_000_000 * k},{values[k]:g},True"
        for role, values in SIGNALS.items() for k in K)])}


@pytest.mark.parametrize("form", FORMS)
def test_the_samples_are_read(tmp_path, form):
    path = tmp_path / "FIC101.csv"
    path.write_text(FORMS[form], encoding="utf-8")
    (record,) = read(path)
    assert record.loop == "FIC101" and len(record) == ROWS and record.interval == pytest.approx(1.0)
    low, high = record.settings.pv_range
    np.testing.assert_allclose(low + (high - low) * record.setpoint, SIGNALS["SP"])
    np.testing.assert_allclose(low + (high - low) * record.measurement, SIGNALS["PV"])
    np.testing.assert_allclose(100 * record.output, SIGNALS["OP"])


def test_tags_that_are_numbers_are_named_by_the_loops_file(tmp_path):
    path, loops = tmp_path / "history.csv", tmp_path / "loops.toml"
    path.write_text("tagid,floatvalue,t_stamp\n" + "".join(
        f"{number},{values[k]:g},{1773734400000 + 1000 * k}\n" for number, values in zip(
            (1011, 1012, 1013), SIGNALS.values(), strict=True) for k in K))
    loops.write_text('[loops.FIC101]\nsp = "1011"\npv = "1012"\nop = "1013"\npv_range = [0, 100]\n')
    (record,) = read(path, loops=loops)
    np.testing.assert_allclose(100 * record.measurement, SIGNALS["PV"])
    np.testing.assert_allclose(100 * record.output, SIGNALS["OP"])


@pytest.mark.parametrize(("names", "good", "poor"), [
    ([f"Quality FIC101.{s}" for s in SIGNALS], "Good", "Bad"), (["Q1", "Q2", "Q3"], "192", "28"),
    (["Status"] * 3, "Good", "Bad"), (["Quality", "Quality.1", "Quality.2"], "192", "0")])
def test_a_block_of_qualities_behind_the_signals_marks_them(tmp_path, names, good, poor):
    heads = ",".join(["Time", *(f"FIC101.{s}" for s in SIGNALS), *names])
    path = tmp_path / "history.csv"
    path.write_text(wide(heads, extra=lambda k: (good, poor if 100 <= k < 140 else good, good)))
    (record,) = read(path)
    (bad,) = (note.message for note in record.notes if note.code == "bad_quality")
    assert bad.startswith("40 samples of FIC101.PV") and not record.usable[100:140].any()


def test_numbered_qualities_stand_beside_their_signals(tmp_path):
    path = tmp_path / "history.csv"
    path.write_text("Time,FIC101.SP,Q1,FIC101.PV,Q2,FIC101.OP,Q3\n" + "".join(
        f"{s},{SIGNALS['SP'][k]},192,{SIGNALS['PV'][k]},{28 if k < 40 else 192},{SIGNALS['OP'][k]},192\n"
        for k, s in enumerate(STAMPS)))
    (record,) = read(path)
    assert not record.usable[:40].any() and record.usable[40:].all()


def test_qualities_that_mark_nothing_are_said(tmp_path):
    path = tmp_path / "history.csv"
    path.write_text(wide("Time,FIC101.SP,FIC101.PV,FIC101.OP,Status,Status", extra=lambda k: ("Good", "Bad")))
    assert any(note.code == "single_signals" and "Status" in note.message for note in read(path).warnings)


@pytest.mark.parametrize(("names", "marks"), [
    ("Good,Questionable", lambda bad: f"{not bad},False"), ("Good,Questionable", lambda bad: f"True,{bad}"),
    ("Questionable,Good", lambda bad: f"False,{not bad}"), ("Questionable,IsGood", lambda bad: f"0,{int(not bad)}"),
    ("Status,Quality", lambda bad: f"OK,{'Bad' if bad else 'Good'}"),
    ("Status,Quality", lambda bad: f"Snapshot,{'Bad' if bad else 'Good'}"),
    ("Quality,OPCQuality", lambda bad: f"{133 * bad},{24 if bad else 192}")])
def test_what_one_of_several_qualities_calls_bad_is_not_used(tmp_path, names, marks):
    path = tmp_path / "history.csv"
    path.write_text(f"Name,Timestamp,Value,{names}\n" + "".join(
        f"FIC101.{s},{t},{x[k]},{marks(s == 'PV' and 100 <= k < 140)}\n"
        for s, x in SIGNALS.items() for k, t in enumerate(STAMPS)))
    (record,) = read(path)
    assert not record.usable[100:140].any() and record.usable[:100].all() and record.usable[140:].all()


@pytest.mark.parametrize("head", ["Time,SP,PV,OP,Status,Quality", "Time,FIC101.SP,FIC101.PV,FIC101.OP,Status,Quality",
                                  "Time,SP,PV,OP,Status,Quality,loop"])
def test_what_one_of_several_qualities_of_the_row_calls_bad_is_not_used(tmp_path, head):
    path = tmp_path / "FIC101.csv"
    path.write_text(wide(head, extra=lambda k: ("OK", "Bad" if 100 <= k < 140 else "Good", "FIC101")[
        : head.count(",") - 3]))
    (record,) = read(path)
    assert record.loop == "FIC101" and not record.usable[100:140].any() and record.usable[140:].all()


@pytest.mark.parametrize("name", ["FIC101 Auto/Manual", "FIC101.Auto/Man Status", "FIC101 Loop Status",
                                  "FIC101.MODE_STS"])
def test_a_column_of_modes_is_that_of_its_loop_whatever_it_is_called(tmp_path, name):
    path = tmp_path / "history.csv"
    path.write_text(wide(f"Time,FIC101.SP,FIC101.PV,FIC101.OP,{name}",
                         extra=lambda k: ("MANUAL" if 100 <= k < 140 else "AUTO",)))
    (record,) = read(path)
    assert np.array_equal(np.flatnonzero(record.state == SampleState.MANUAL), np.arange(100, 140))
    np.testing.assert_allclose(100 * record.output, SIGNALS["OP"])


def test_a_status_of_auto_and_manual_is_the_mode_of_rows_per_loop(tmp_path):
    path = tmp_path / "history.csv"
    path.write_text(wide("Time,SP,PV,OP,loop,status",
                         extra=lambda k: ("FIC101", "MANUAL" if 100 <= k < 140 else "AUTO")))
    (record,) = read(path)
    assert np.array_equal(np.flatnonzero(record.state == SampleState.MANUAL), np.arange(100, 140))


def test_a_folder_names_the_loop_of_data(tmp_path):
    for loop in LOOPS:
        (tmp_path / "plant" / loop).mkdir(parents=True)
        (tmp_path / "plant" / loop / "data.csv").write_text(wide("Time,SP,PV,OP"))
    assert [record.loop for record in read(tmp_path / "plant")] == [*LOOPS]


def test_number_value_time_and_quality_of_each_tag(tmp_path):
    path = tmp_path / "history.csv"
    path.write_text(",".join(f"FIC101_{s}_NUMERICID,FIC101_{s}_VALUE,FIC101_{s}_TIMESTAMP,FIC101_{s}_QUALITY"
                             for s in SIGNALS) + "\n" + "".join(",".join(
        f"0,{x[k]},{t},{0 if s == 'PV' and k < 40 else 192}" for s, x in SIGNALS.items()) + "\n"
        for k, t in enumerate(STAMPS)))
    (record,) = read(path)
    assert not record.usable[:40].any() and record.usable[40:].all()


@pytest.mark.parametrize(("good", "poor"), [("192 (Good)", "0 (Bad)"), ("S_OK", "E_FAIL")])
def test_words_of_qualities(tmp_path, good, poor):
    path = tmp_path / "history.csv"
    path.write_text("tag;time;value;quality\n" + "".join(
        f"FIC101.{s};{t};{x[k]};{poor if s == 'PV' and k < 40 else good}\n"
        for s, x in SIGNALS.items() for k, t in enumerate(STAMPS)))
    (record,) = read(path)
    assert not record.usable[:40].any() and record.usable[40:].all()


def test_the_word_of_a_mode_stands_in_a_column_of_its_own(tmp_path):
    path = tmp_path / "history.csv"
    path.write_text("tag_name,sample_time,value_num,value_txt\n" + "".join(
        f"FIC101.{s},{t},{x[k]},\n" for s, x in SIGNALS.items() for k, t in enumerate(STAMPS)) + "".join(
        f"FIC101.MODE,{t},,{'MAN' if 100 <= k < 140 else 'AUTO'}\n" for k, t in enumerate(STAMPS)))
    (record,) = read(path)
    assert np.array_equal(np.flatnonzero(record.state == SampleState.MANUAL), np.arange(100, 140))


LOOPS = ("FIC101", "FIC102")


@pytest.mark.parametrize(("head", "rows", "loops"), [
    ("timestamp,__name__,loop,value", [f"{1773734400 + k},pid_{s.lower()},{loop},{x[k]}" for loop in LOOPS
                                       for s, x in SIGNALS.items() for k in K], [*LOOPS]),
    ("asset,time,setpoint,process_value,output", [
        ",".join([loop, s, *(str(x[k]) for x in SIGNALS.values())]) for k, s in enumerate(STAMPS) for loop in LOOPS],
     [*LOOPS]),
    ("Id,LoopId,SampleTime,SP,PV,OP", [
        ",".join([f"{2 * k + loop},{loop}", s, *(str(x[k]) for x in SIGNALS.values())])
        for k, s in enumerate(STAMPS) for loop in (101, 102)], ["101", "102"]),
    (",SP,,PV,,OP,\nTime" + ",FIC101,FIC102" * 3, [
        ",".join([s, *(f"{x[k]},{x[k]}" for x in SIGNALS.values())]) for k, s in enumerate(STAMPS)], [*LOOPS])])
def test_several_loops(tmp_path, head, rows, loops):
    path = tmp_path / "history.csv"
    path.write_text("\n".join([head, *rows]))
    plant = read(path)
    assert [record.loop for record in plant] == loops
    for record in plant:
        low, high = record.settings.pv_range
        np.testing.assert_allclose(low + (high - low) * record.measurement, SIGNALS["PV"])
        np.testing.assert_allclose(100 * record.output, SIGNALS["OP"])


def test_a_block_that_is_called_pid_is_one_loop(tmp_path):
    path = tmp_path / "history.csv"
    path.write_text(wide("Time,FIC101/PID/SP.CV,FIC101/PID/PV.CV,FIC101/PID/OUT.CV"))
    (record,) = read(path)
    assert record.loop == "FIC101/PID" and record.output is not None


def one_per_tag(folder, stamp_of):
    folder.mkdir()
    for signal, values in SIGNALS.items():
        (folder / f"FIC101.{signal}.csv").write_text("Time,Value\n" + "".join(
            f"{stamp_of(signal, s)},{values[k]:g}\n" for k, s in enumerate(STAMPS)))
    return folder


def test_files_with_an_offset_and_without_are_said(tmp_path):
    mixed = one_per_tag(tmp_path / "mixed", lambda signal, s: f"{s}+01:00" if signal == "SP" else s)
    assert "mixed_zones" in {note.code for note in read(mixed)["FIC101"].notes}
    known = read(mixed, options=ReadOptions(timezone="Europe/Berlin"))["FIC101"]
    assert "mixed_zones" not in {note.code for note in known.notes} and np.isfinite(known.setpoint).all()
    plain = one_per_tag(tmp_path / "plain", lambda signal, s: s)
    assert "mixed_zones" not in {note.code for note in read(plain)["FIC101"].notes}


def test_what_cannot_be_read_in_a_folder_is_said(tmp_path):
    folder = one_per_tag(tmp_path / "plant", lambda signal, s: s)
    (folder / "FIC102.xls").write_bytes(bytes.fromhex("d0cf11e0a1b11ae1") + bytes(4000))
    (lost,) = read(folder).failures
    assert "FIC102.xls" in lost.message and "Excel workbook of the old kind" in lost.message


def test_sheets_that_are_not_used_are_said(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.title = "FIC101"
    for line in wide("Time,SP,PV,OP").splitlines():
        book.active.append([float(c) if c.replace(".", "").isdigit() else c for c in line.split(",")])
    book.create_sheet("FIC102")
    for k in range(3):
        book["FIC102"].append(["#" * 8, k, k])
    book.save(tmp_path / "plant.xlsx")
    plant = read(tmp_path / "plant.xlsx")
    assert [record.loop for record in plant] == ["FIC101"]
    assert any(note.code == "passed_over" and "'FIC102'" in note.message for note in plant.warnings)


@pytest.mark.parametrize(("digits", "doubtful"), [(3, True), (2, False)])
def test_a_comma_that_may_separate_thousands_is_said(tmp_path, digits, doubtful):
    path = tmp_path / "history.csv"
    path.write_text("Time;FIC101.SP;FIC101.PV;FIC101.OP\n" + "\n".join(
        ";".join([s, *(f"{x[k]:.{digits}f}".replace(".", ",") for x in SIGNALS.values())])
        for k, s in enumerate(STAMPS)))
    assert doubtful == ("decimal_comma" in {note.code for note in read(path).warnings})
    assert "decimal_comma" not in {note.code for note in read(path, options=ReadOptions(decimal=",")).warnings}


@pytest.mark.parametrize(("header", "spare"), [
    ("Time,Written,FIC101.SP,FIC101.PV,FIC101.OP", "'Written'"), ("Time,tag,value,value", "'value'")])
def test_a_second_column_of_times_or_values_is_told(tmp_path, header, spare):
    rows = [[s, f"2026-04-01 {s[11:]}", *(f"{SIGNALS[r][k]:g}" for r in SIGNALS)] for k, s in enumerate(STAMPS)]
    if "tag" in header:
        rows = [[row[0], f"FIC101.{r}", value, "7"] for row in rows for r, value in zip(SIGNALS, row[2:], strict=True)]
    path = tmp_path / "history.csv"
    path.write_text("\n".join([header, *map(",".join, rows)]))
    plant = read(path)
    assert len(plant.records) == 1
    assert [spare in note.message for note in plant.warnings if note.code == "not_read"] == [True]


def noticed(tmp_path, **changed):
    path = tmp_path / "history.csv"
    values = SIGNALS | changed
    path.write_text("\n".join(["Time,FIC101.SP,FIC101.PV,FIC101.OP", *(
        f"{s}," + ",".join(f"{values[r][k]:g}" for r in SIGNALS) for k, s in enumerate(STAMPS))]))
    (record,) = read(path)
    doubts = {"setpoint_apart", "setpoint_copied", "output_copied", "unit_change", "points_lost", "no_values"}
    return record, {note.code for note in record.notes} & doubts


@pytest.mark.parametrize(("changed", "code"), [
    ({"SP": SIGNALS["SP"] / 100}, "setpoint_apart"), ({"SP": SIGNALS["PV"]}, "setpoint_copied"),
    ({"OP": SIGNALS["PV"]}, "output_copied"), ({"OP": SIGNALS["PV"] / 4 + 3}, "output_copied"),
    ({"PV": 4 * SIGNALS["OP"]}, "output_copied"),
    ({"OP": np.where(K < 200, SIGNALS["OP"], SIGNALS["OP"] / 100)}, "unit_change"),
    ({r: np.where(K < 200, SIGNALS[r], SIGNALS[r] * 4.403) for r in ("SP", "PV")}, "unit_change"),
    ({"PV": np.where(K < 60, SIGNALS["PV"] * 3.6, SIGNALS["PV"])}, "unit_change"),
    ({"PV": np.where(K < 60, 3.6, 1.0) * SIGNALS["PV"] * (1.0 + 0.1 * np.sin(K / 9.0))}, "unit_change"),
    ({"PV": np.where(K % 10 < 9, 1000, 1) * SIGNALS["PV"]}, "points_lost"),
    ({"OP": np.where(K % 7 < 5, 1000, 1) * SIGNALS["OP"]}, "points_lost")])
def test_doubtful_units_are_said(tmp_path, changed, code):
    assert code in noticed(tmp_path, **changed)[1]


@pytest.mark.parametrize("changed", [
    {}, {r: np.where(K < 150, SIGNALS[r] / 4, SIGNALS[r]) + (r == "PV") * np.sin(K) for r in ("SP", "PV")},  # a grade
    {"OP": 90 - SIGNALS["PV"] / 4},  # a P controller
    {"OP": np.where(K < 100, 0.0, SIGNALS["OP"])}, {"PV": SIGNALS["PV"] - 5.0},
    {r: SIGNALS[r] * np.exp(np.clip((K - 150) / 20, 0, 2)) for r in ("SP", "PV")}])  # a start-up
def test_other_moves_are_no_change_of_units(tmp_path, changed):
    assert not noticed(tmp_path, **changed)[1]


@pytest.mark.parametrize(("number", "where"), [(3.402823e38, slice(100, 160)), (-1e30, slice(20, 21)),
                                               (-9999, slice(100, 160)), (9999, slice(0, 3)), (65535, slice(40, 41)),
                                               (-99999, slice(290, 300))])
def test_numbers_that_stand_for_none_are_not_used(tmp_path, number, where):
    values = SIGNALS["SP"].copy()
    values[where] = number
    record, codes = noticed(tmp_path, SP=values)
    assert codes == {"no_values"} and np.nanmax(np.abs(record.setpoint - 0.5)) < 0.4


def test_measurements_that_reach_such_a_number_are_kept(tmp_path):
    values = np.round(9985 + 14 * np.sin(K / 40) ** 2)
    record, codes = noticed(tmp_path, SP=values, PV=values + 1)
    assert "no_values" not in codes and np.isfinite(record.measurement).all()


def test_a_date_that_is_taken_over_is_told_and_a_lost_one_is_not_made_up(tmp_path):
    (tmp_path / "report.csv").write_text(FORMS["a date in its first row alone"])
    assert "named_above" in [note.code for note in read(tmp_path / "report.csv").warnings]
    text = wide("Date,Time,FIC101.SP,FIC101.PV,FIC101.OP").replace("2026-03-17 ", "2026-03-17,")
    (tmp_path / "lost.csv").write_text(text.replace("2026-03-17,08:02:00", ",08:02:00"))
    plant = read(tmp_path / "lost.csv")
    assert "named_above" not in [note.code for note in plant.warnings]
    assert "unreadable_times" in [note.code for note in plant["FIC101"].notes]
