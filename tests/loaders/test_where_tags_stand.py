"""Tags told apart by what stands beside them, tags without a signal, and files of one loop by day."""

from functools import cache

import numpy as np
import pytest

from backlash_cli import read
from backlash_cli.errors import InputError, LoopError
from backlash_cli.loaders.names import undated

ROWS = 400
K = np.arange(ROWS)
STAMPS = [f"2026-03-17 08:{k // 60:02d}:{k % 60:02d}" for k in K]


@cache
def signals(seed):
    rng = np.random.default_rng(seed)
    pv = 50 + 5 * seed + np.sin(K / 7) + 0.1 * rng.normal(size=ROWS)
    return {"SP": np.full(ROWS, 50.0 + 5 * seed), "PV": pv.round(3), "OP": (40 + 3 * np.cos(K / 9)).round(2)}


def is_read(record, seed):
    for name, values, (low, high) in (("PV", record.measurement, record.settings.pv_range),
                                      ("SP", record.setpoint, record.settings.pv_range),
                                      ("OP", record.output, record.settings.op_range)):
        assert np.allclose(low + values * (high - low), signals(seed)[name], atol=1e-9), name
    return True


def cells(k, seed=0):
    """SP, PV and OP of one row of a wide file."""
    return ",".join(f"{x[k]:g}" for x in signals(seed).values())


def columns(tmp_path, head, more=(), stamps=STAMPS, name="FIC7.csv"):
    """A file of one loop: time, SP, PV, OP and what else stands beside them."""
    extra = [[x if isinstance(x, str) else f"{x:g}" for x in column] for column in more]
    rows = [",".join([s, cells(k), *(column[k] for column in extra)]) for k, s in enumerate(stamps)]
    (tmp_path / name).write_text("\n".join([head, *rows]) + "\n")
    return read(tmp_path / name)


def are_read(plant, loops):
    """Each of the loops, in this order, has the signals of its place."""
    assert [r.loop for r in plant] == loops
    return all(is_read(plant[loop], seed) for seed, loop in enumerate(loops))


def long(path, head, row, places):
    """A row per sample: the signals of one tag in each of several places."""
    rows = [row(place, role).format(t=s, v=f"{x[k]:g}")
            for k, s in enumerate(STAMPS) for seed, place in enumerate(places) for role, x in signals(seed).items()]
    path.write_text("\n".join([head, *rows]) + "\n")


@pytest.mark.parametrize("header", ["Module", "Tag", "TagName", "Point", "Object", "Name", "Entity", "Asset"])
@pytest.mark.parametrize("parameter", ["PID1/{}.CV", "{}.CV", "PIDA.{}", "{}"])
@pytest.mark.parametrize("modules", [("FIC-902", "TIC-903"), ("FIC-902",)])
def test_the_module_of_a_block_names_the_loop(tmp_path, header, parameter, modules):
    long(tmp_path / "plant.csv", f"{header},Parameter,Time,Value",
         lambda module, role: f"{module},{parameter.format(role)},{{t}},{{v}}", modules)
    plant = read(tmp_path / "plant.csv")
    assert len(plant) == len(modules)
    for seed, module in enumerate(modules):
        (record,) = (r for r in plant if r.loop.startswith(module))
        assert is_read(record, seed)


@pytest.mark.parametrize("header", ["Unit", "Area", "Site"])
def test_a_unit_tells_alike_tags_apart(tmp_path, header):
    long(tmp_path / "plant.csv", f"{header},Tag,Time,Value", lambda unit, role: f"{unit},FIC121.{role},{{t}},{{v}}",
         ("U1", "U2"))
    assert are_read(read(tmp_path / "plant.csv"), ["U1.FIC121", "U2.FIC121"])


def test_a_unit_tells_alike_loops_apart_where_each_row_holds_one(tmp_path):
    rows = [f"{s},U{seed + 1},FIC121,{cells(k, seed)}" for k, s in enumerate(STAMPS) for seed in (0, 1)]
    (tmp_path / "plant.csv").write_text("\n".join(["Time,Unit,Loop,SP,PV,OP", *rows]) + "\n")
    assert are_read(read(tmp_path / "plant.csv"), ["U1.FIC121", "U2.FIC121"])


@pytest.mark.parametrize("places", [("U1",), ("",), ("t/h",)])
def test_what_tells_no_tags_apart_is_no_part_of_their_names(tmp_path, places):
    """One unit for all, none, or the unit of measurement, which is missing in some rows."""
    unit = places[0]
    long(tmp_path / "plant.csv", "Unit,Tag,Time,Value", lambda place, role: (
        f"{'%' if unit == 't/h' and role == 'OP' else place},FIC121.{role},{{t}},{{v}}"), places)
    if unit == "t/h":
        text = (tmp_path / "plant.csv").read_text().splitlines()
        (tmp_path / "plant.csv").write_text("\n".join(
            line.replace("t/h,", ",") if k % 7 == 0 else line for k, line in enumerate(text)) + "\n")
    (record,) = read(tmp_path / "plant.csv")
    assert record.loop == "FIC121" and is_read(record, 0)


@pytest.mark.parametrize("tag", [
    "10-FIC-101", "FIC-3", "FIC_2", "Area1.FIC109", "Plant/FIC5", "Tank 5", "Reactor Temp", "Drum Level"])
@pytest.mark.parametrize("form", ["wide", "long"])
def test_a_bare_tag_is_the_measurement_whatever_parts_it_has(tmp_path, tag, form):
    if form == "wide":
        (record,) = columns(tmp_path, f"Time,{tag}.SP,{tag},{tag}.OP", name="plant.csv")
    else:
        long(tmp_path / "plant.csv", "Tag,Time,Value", lambda name, role: (
            name + f".{role}" * (role != "PV") + ",{t},{v}"), (tag,))
        (record,) = read(tmp_path / "plant.csv")
    assert record.loop == tag and is_read(record, 0)
    assert "bare_pv" in {note.code for note in record.notes}


def test_a_bare_tag_of_a_loop_that_the_settings_spell_in_another_way(tmp_path):
    (tmp_path / "loops.toml").write_text("[loops.FIC5]\nTi = 20.0\n")
    (record,) = columns(tmp_path, "Time,Plant/FIC5/SP,Plant/FIC5,Plant/FIC5/OUT", name="plant.csv")
    assert record.loop == "FIC5" and is_read(record, 0)


@pytest.mark.parametrize("names", [
    ("FIC9 Setpoint", "FIC9 Flow", "FIC9 Output"), ("TIC_Oven_Setpoint", "TIC_Oven_Temperature", "TIC_Oven_Output"),
    ("TIC5.SP", "TIC5.Temp", "TIC5.OP")])
def test_a_quantity_beside_setpoint_and_output_is_the_measurement(tmp_path, names):
    plant = columns(tmp_path, f"Time,{','.join(names)},XY1.PV", [np.full(ROWS, 1.5)], name="plant.csv")
    assert is_read(plant.records[0], 0)


def test_of_two_quantities_none_is_taken(tmp_path):
    with pytest.raises(LoopError, match=r"no measurement \(PV\) column"):
        columns(tmp_path, "Time,TIC5.SP,TIC5.Temp,TIC5.OP,TIC5.Pressure", [np.full(ROWS, 1.5)], name="plant.csv")


@pytest.mark.parametrize("stem", [
    "FIC719 22-Jul-2024", "FIC719_22Jul24", "FIC719_22_Jul_2024", "22-Jul-2024 FIC719", "FIC719_07-22-2024",
    "07-22-2024 FIC719", "FIC719_2024-07", "FIC719 Jul 22", "FIC719-July22", "FIC719_Jul222024", "FIC719_22_Juli_2024",
    "FIC719_2024072216", "FIC719_part1", "FIC719_day2", "FIC719_wk30", "FIC719 July 2024", "FIC719_20240722_160000",
    "FIC719_20240722_01", "FIC719_2024.07.22"])
def test_days_in_the_names_of_files(stem):
    assert undated(stem) == "FIC719"


@pytest.mark.parametrize("stem", ["FIC-2001-01", "TAG 5", "P_2024-13", "FIC719-2026", "PIC_day", "LIC_5", "FIC-12",
                                  "FIC-1-12-2012", "FIC719_decanter", "FIC719_marine", "22.07.2024"])
def test_names_of_files_without_a_day(stem):
    assert undated(stem) == stem


def test_a_loop_in_files_of_days_with_words_for_months(tmp_path):
    for day in (22, 23):
        columns(tmp_path, "Time,SP,PV,OP", stamps=[s.replace("2026-03-17", f"2024-07-{day}") for s in STAMPS],
                name=f"FIC719 {day}-Jul-2024.csv")
    (tmp_path / "loops.toml").write_text("[loops.FIC719]\nTi = 20.0\n")
    (record,) = read(tmp_path)
    assert record.loop == "FIC719" and len(record) == 2 * ROWS and record.settings.Ti == 20.0


@pytest.mark.parametrize("date", ["06/06/2024", "11-11-2024", "8/8/2024"])
def test_a_day_that_is_its_month_is_one_day_either_way(tmp_path, date):
    stamps = [f"{date} {s[11:]}" for s in STAMPS]
    (record,) = columns(tmp_path, "Time,FIC1.SP,FIC1.PV,FIC1.OP", stamps=stamps, name="plant.csv")
    day, _, year = date.replace("-", "/").split("/")
    assert record.start == np.datetime64(f"{year}-{int(day):02d}-{int(day):02d}T08:00:00").astype(int)


def test_the_attribute_of_a_mode_is_no_mode(tmp_path):
    (record,) = columns(tmp_path, "Time,FIC1.SP,FIC1.PV,FIC1.OP,FIC1.MODE,FIC1.MODATTR",
                        [["AUTO"] * ROWS, ["OPERATOR"] * ROWS])
    assert record.usable.all() and is_read(record, 0)


@pytest.mark.parametrize("block", [1 << 12, 1 << 22])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("ends", [3, 50, 390])
def test_rows_of_pairs_that_end_behind_the_last_cell(tmp_path, monkeypatch, block, delimiter, ends):
    """A spreadsheet leaves out the blank cells at the end of a row: here those of a setpoint that was stored rarely."""
    monkeypatch.setattr("backlash_cli.loaders.opening.BLOCK", block)
    monkeypatch.setattr("backlash_cli.loaders.opening.CHUNK", 1 << 10)
    rows = []
    for k, s in enumerate(STAMPS):
        cells = [s, f"{signals(0)['PV'][k]:g}", s, f"{signals(0)['OP'][k]:g}"]
        rows.append(delimiter.join([*cells, s, "50"] if k < ends else cells))
    head = delimiter.join(["FIC1.PV", "", "FIC1.OP", "", "FIC1.SP", ""])
    (tmp_path / "plant.csv").write_text("\n".join([head, *rows]) + "\n")
    plant = read(tmp_path / "plant.csv")
    assert is_read(plant["FIC1"], 0) and not [n for n in plant.warnings if n.code == "ragged_rows"]


def test_a_row_of_pairs_that_ends_within_one_is_told(tmp_path):
    pv, op = signals(0)["PV"], signals(0)["OP"]
    rows = [",".join([s, f"{pv[k]:g}", s, f"{op[k]:g}", s, "50"]) for k, s in enumerate(STAMPS)]
    rows[200] = ",".join(rows[200].split(",")[:3])
    (tmp_path / "plant.csv").write_text("\n".join(["FIC1.PV,,FIC1.OP,,FIC1.SP,", *rows]) + "\n")
    plant = read(tmp_path / "plant.csv")
    assert [n.values["rows"] for n in plant.warnings if n.code == "ragged_rows"] == [1.0]


STEM = 40 + np.cos(K / 9 - 0.4)


@pytest.mark.parametrize("head", [
    "Time,Flow setpoint,Flow,Valve demand,Valve position feedback", "Time,Flow SP,Flow,Valve OP,Valve Position",
    "Time,Flow SP,Flow PV,Controller Output,Valve Position",
    "Time,Pressure setpoint,Pressure,Output,Actual valve position",
    "Time,Flow Setpoint,Flow,Valve Demand,Valve Feedback"])
def test_where_the_stem_stands_is_no_output_beside_the_demand(tmp_path, head):
    (record,) = columns(tmp_path, head, [STEM])
    assert record.loop == "FIC7" and is_read(record, 0)


def test_where_the_stem_stands_is_the_output_where_there_is_no_other(tmp_path):
    (record,) = columns(tmp_path, "Time,Flow SP,Flow,Valve Position")
    assert record.loop == "FIC7" and is_read(record, 0)


def test_a_second_temperature_beside_a_loop_in_words(tmp_path):
    (record,) = columns(tmp_path, "Time,Temperature Setpoint,Temperature,Heater Output,Ambient Temperature", [STEM / 2])
    assert record.loop == "FIC7" and is_read(record, 0)


@pytest.mark.parametrize(("name", "automatic", "manual"), [
    (name, *("TRUE", "FALSE")) for name in ("IsAuto", "InAuto", "AutoActive", "ModeAuto", "Auto_On")] + [
    ("IsManual", "FALSE", "TRUE"), ("ModeNum", "1", "0"), ("AUTO_SEL", "1", "0"), ("Auto Status", "ON", "OFF")])
@pytest.mark.parametrize("loop", ["", "TIC700."])
def test_flags_of_the_mode(tmp_path, name, automatic, manual, loop):
    head = ",".join(["Time", *(f"{loop}{signal}" for signal in ("SP", "PV", "OP", name))])
    mode = [manual if 100 <= k < 170 else automatic for k in K]
    (record,) = columns(tmp_path, head, [mode])
    assert np.flatnonzero(~record.usable).tolist() == list(range(100, 170)) and is_read(record, 0)


@pytest.mark.parametrize("names", ["SP1,PV1,OUT1", "sp1,pv1,out1", "SP12,PV12,CO12", "SP1,PV1,CV1",
                                   "SetPoint,ProcessValue,ControlVariable",
                                   "Setpoint,Temperature,Heater Power", "Settpunkt,Måling,Pådrag", "WorkingSP,PV,OP"])
def test_outputs_of_channels_and_heaters(tmp_path, names):
    assert is_read(columns(tmp_path, f"Time,{names}").records[0], 0)


def test_the_working_setpoint_goes_before_the_target(tmp_path):
    (record,) = columns(tmp_path, "Time,FIC7.WorkingSP,FIC7.PV,FIC7.OP,FIC7.TargetSP", [np.full(ROWS, 20.0)])
    assert is_read(record, 0)


@pytest.mark.parametrize("name", ["millis", "Milliseconds", "time_ms", "Elapsed [milliseconds]"])
def test_milliseconds_by_their_names(tmp_path, name):
    (record,) = columns(tmp_path, f"{name},Setpoint,Input,Output", stamps=[f"{500 * k}" for k in K])
    assert record.interval == 0.5 and is_read(record, 0)


@pytest.mark.parametrize("header", ["loop,signal", "loop_id,parameter", "controller,parameter"])
def test_loops_that_are_numbers_beside_a_column_of_signals(tmp_path, header):
    long(tmp_path / "plant.csv", f"Time,{header},value", lambda loop, role: f"{{t}},{loop},{role},{{v}}",
         ("101", "102"))
    assert are_read(read(tmp_path / "plant.csv"), ["101", "102"])


@pytest.mark.parametrize("head", [
    "Zeit,Set point FIC101,FIC101 PV,FIC101 OUT", "time,FIC101 SETPT,FIC101 PROCESS,FIC101 OUTPUT",
    "time,FIC101_SETPOINT,FIC101_MEASUREMENT,FIC101_CTRL_OUTPUT", "time,FIC101.SPV,FIC101.PV,FIC101.CNTRL_OUT",
    "time,FIC101_SETVAL,FIC101_MEAS_VAL,FIC101_CTL_OUT",
    "Data,FIC101 Setpoint,FIC101 Valor do processo,FIC101 Abertura da válvula",
    "Fecha,Set Point,Variable Procesada,% Apertura válvula",
    "Fecha,Punto de ajuste,Variable del proceso,Salida del controlador",
    "Horodatage,Consigne,Valeur procédé,Sortie vanne", "time,Desired Temperature,Actual Temperature,Valve Command"])
def test_words_for_setpoint_measurement_and_output(tmp_path, head):
    (found,) = columns(tmp_path, head, name="FIC101.csv")
    assert found.loop == "FIC101" and is_read(found, 0)


def test_cells_that_a_spreadsheet_is_to_take_as_they_are(tmp_path):
    rows = [f"{s}," + ",".join(f'="{cell}"' for cell in cells(k).split(",")) for k, s in enumerate(STAMPS)]
    (tmp_path / "plant.csv").write_text("\n".join(["Time,FIC7.SP,FIC7.PV,FIC7.OP", *rows]) + "\n")
    assert are_read(read(tmp_path / "plant.csv"), ["FIC7"])


@pytest.mark.parametrize("between", [",", ""])
def test_a_text_without_line_ends_is_refused_at_once(tmp_path, between):
    path = tmp_path / "plant.csv"
    rows = [f"{s},{cells(k)}" for k, s in enumerate(STAMPS)]
    path.write_text(between.join(["time,FIC7.SP,FIC7.PV,FIC7.OP", *rows] * 9))
    with pytest.raises(InputError, match=r"one line of 0\.\d MB: its line ends are lost") as found:
        read(path)
    assert found.value.remedy and str(path) in str(found.value)
