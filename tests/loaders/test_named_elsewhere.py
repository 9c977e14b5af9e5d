"""Exports whose dates, signals or loops are named in a way of their own: by day of the year, by script, beside the table."""

# One line per way of writing reads better than wrapped ones.
# ruff: noqa: E501

from __future__ import annotations

import io
import re
from datetime import timedelta
from functools import cache

import numpy as np
import pandas as pd
import pytest

from backlash_cli.errors import BacklashError
from backlash_cli.loaders import read
from backlash_cli.record import SampleState

from .exports import RANGES, ROWS, SETTINGS, SIGNALS, STAMPS, START, Export, cell, iso, long, wide
from .test_layouts import NEAR, comma, pairs, same_recording, seconds
from .test_more_layouts import packed, renamed, row

ATTRIBUTES = {"SP": "Setpoint", "PV": "Process Value", "OP": "Controller Output"}
SHORT = dict(zip("ABCDEF", SIGNALS, strict=True))
HALVES = {f"{day:%Y-%m-%d}": [i for i, t in enumerate(STAMPS) if t.date() == day] for day in dict.fromkeys(t.date() for t in STAMPS)}


def single(loop, rows=range(ROWS)):
    """SP, PV and OP of one loop, which the table does not name."""
    return "Time,OP,PV,SP\n" + "".join(f"{iso(STAMPS[i])},{row(loop, i)}\n" for i in rows)


@cache
def day_sheets(loop):
    """A workbook with a sheet for each day."""
    held = io.BytesIO()
    with pd.ExcelWriter(held) as book:
        for day, rows in HALVES.items():
            pd.read_csv(io.StringIO(single(loop, rows))).to_excel(book, sheet_name=day, index=False)
    return held.getvalue()


def below(above):
    """Tables of a tag each, one below the other."""
    return "".join(above.format(n) + "".join(f"{iso(t)},{cell(n, x)}\n" for t, x in zip(STAMPS, v, strict=True)) for n, v in SIGNALS.items())


def remarked(lines):
    """A table with something else between its rows."""
    rows = wide().splitlines()
    return "\n".join([*rows[:301], lines, *rows[301:]]) + "\n"


EXPORTS = {
    "folders_in_an_archive": Export({"plant.zip": packed({f"export/{loop}/data.csv": single(loop) for loop in RANGES})}),
    "folders_of_one_name_in_an_archive": Export({"plant.zip": packed({f"export/{loop}/trend.csv": single(loop) for loop in RANGES})}),
    "days_of_one_name_in_folders": Export({f"area/{loop}/trend_{day.replace('-', '')}.csv": single(loop, rows) for loop in RANGES for day, rows in HALVES.items()}, inputs=("area",)),
    "a_day_each_in_folders": Export({f"area/{loop}/shift_20260317.csv": single(loop) for loop in RANGES}, inputs=("area",)),
    "numbered_parts_in_folders": Export({f"area/{loop}/values_{k}.csv": single(loop, rows) for loop in RANGES for k, rows in enumerate(HALVES.values(), 1)}, inputs=("area",)),
    "annotations_above_each_table": Export({"plant.csv": "".join("#group,false,false,false,true,true,false,false,false\n#datatype,string,long,dateTime:RFC3339,string,string,double,double,double\n#default,_result,,,,,,,\n,result,table,_time,_measurement,loop,op,pv,sp\n"
        + "".join(f",,{k},{iso(STAMPS[i])}Z,pid,{loop},{row(loop, i)}\n" for i in range(ROWS)) + "\n" for k, loop in enumerate(RANGES))}),
    "zone_in_round_brackets": Export({"plant.csv": wide(lambda t: f"{t + timedelta(hours=1):%d.%m.%Y %H:%M:%S} (UTC+01:00)")}),
    "short_zone_in_round_brackets": Export({"plant.csv": wide(lambda t: f"{t + timedelta(hours=1):%Y-%m-%d %H:%M:%S} (CET)")}),
    "offset_in_square_brackets": Export({"plant.csv": wide(lambda t: f"{iso(t + timedelta(hours=1))} [+01:00]")}),
    "zone_in_brackets_behind_an_offset": Export({"plant.csv": wide(lambda t: f"{iso(t + timedelta(hours=1))}+01:00 (CET)")}),
    "zone_in_a_column": Export({"plant.csv": wide(lambda t: f"{iso(t + timedelta(hours=1))},MEZ", time_name="Zeit,Zone")}),
    "area_in_a_column_called_zone": Export({"plant.csv": wide(lambda t: f"{iso(t)},h", time_name="Time,Zone")}),
    "clock_before_the_name_of_a_month": Export({"plant.csv": wide(lambda t: f"{t:%H:%M:%S %d-%b-%Y}")}),
    "half_of_the_day_before_the_date": Export({"plant.csv": wide(lambda t: f"{t:%I:%M:%S %p %m/%d/%Y}")}),
    "no_blank_before_a_chinese_clock": Export({"plant.csv": wide(lambda t: f"{t:%Y年%m月%d日%H:%M:%S}", time_name="时间")}),
    "hungarian_months": Export({"plant.csv": wide(lambda t: f"{t.year}. március {t.day}. {t:%H:%M:%S}", time_name="Időpont")}),
    "counter_and_batch_beside_the_time": Export({"plant.csv": wide(lambda t: f"{iso(t)},4711,{(t - STAMPS[0]).seconds + 1}", time_name="Time,Batch,Index")}),
    "elapsed_beside_the_time": Export({"plant.csv": wide(lambda t: f"{iso(t)},4711,{(t - STAMPS[0]).seconds / 60:.4f}", time_name="Time,Batch,Elapsed Time (min)")}),
    "descriptions_below_tags_of_pairs": Export({"plant.csv": pairs(",".join(f"{t}," for t in SIGNALS) + "\n" + ",".join(f"{t[-2:]} of feed {t[:3]}," for t in SIGNALS))}, **NEAR),
    "units_below_tags_of_pairs": Export({"plant.csv": pairs(",".join(f"{t}," for t in SIGNALS) + "\n" + ",".join("m3/h," for t in SIGNALS))}, **NEAR),
    "units_and_qualities_of_pairs": Export({"plant.csv": ";".join(f"{n};;;" for n in SIGNALS) + "\n" + ";".join("Zeit;Wert;Einheit;Qualität" for _ in SIGNALS) + "\n" + "".join(
        ";".join(f"{t:%d.%m.%Y %H:%M:%S};{comma(n, v[i])};%;gut" for n, v in SIGNALS.items()) + "\n" for i, t in enumerate(STAMPS))}),
    "attributes_of_elements": Export({"plant.csv": long(lambda n, t, v: f"Plant\\{n[:6]};{ATTRIBUTES[n[-2:]]};{iso(t)}Z;{v};%;True", "Path;Attribute;TimeStamp;Value;UOM;IsGood") + "".join(
        f"Plant\\{loop};Mode;{iso(STAMPS[0])}Z;Auto;;True\n" for loop in RANGES)}),
    "values_of_two_types": Export({"plant.csv": long(lambda n, t, v: f"{n[:6]},{n[-2:].lower()},{iso(t)},-,{v}", "loop,measure_name,time,measure_value::varchar,measure_value::double")}),
    "values_of_a_web_api": Export({"plant.csv": long(lambda n, t, v: f"F1DPw,{n},{iso(t)}Z,,True,False,{v}", "WebId,Name,Items.Timestamp,Items.UnitsAbbreviation,Items.Good,Items.Questionable,Items.Value")}),
    "hours_in_folders": Export({f"area/{loop}/{hour[:10]}_{hour[11:13]}h.csv": single(loop, [i for i, t in enumerate(STAMPS) if iso(t)[:13] == hour]) for loop in RANGES for hour in dict.fromkeys(iso(t)[:13] for t in STAMPS)}, inputs=("area",)),
    "times_of_two_zones": Export({"plant.csv": wide(lambda t: f"{iso(t + timedelta(hours=2))},{iso(t)}", time_name="Time (local),Time (UTC)")}, notes=("not_read",)),
    "units_of_some_tags": Export({"plant.csv": long(lambda n, t, v: f"{iso(t)},{n},{v},{'' if n.endswith('SP') else '%' if n.endswith('OP') else 'bar'}", "Time,Tag,Value,Units")}),
    "signals_in_an_archive": Export({"plant.zip": packed({f"{n.replace('.', '/')}.csv": "Timestamp,Value\n" + "".join(f"{iso(t)},{cell(n, x)}\n" for t, x in zip(STAMPS, v, strict=True)) for n, v in SIGNALS.items()})}),
    "signal_and_day_in_a_folder": Export({f"set/{n.replace('.', '/')}_{day.replace('-', '')}.csv": "Time,Value\n" + "".join(f"{iso(STAMPS[i])},{cell(n, v[i])}\n" for i in rows) for n, v in SIGNALS.items() for day, rows in HALVES.items()}, inputs=("set",)),
    "days_in_folders_of_signals": Export({f"set/{n.replace('.', '/')}/{day}.csv": "Time,Value\n" + "".join(f"{iso(STAMPS[i])},{cell(n, v[i])}\n" for i in rows) for n, v in SIGNALS.items() for day, rows in HALVES.items()}, inputs=("set",)),
    "days_in_folders_of_years": Export({f"set/{loop}/{day.replace('-', '/')}.csv": single(loop, rows) for loop in RANGES for day, rows in HALVES.items()}, inputs=("set",)),
    "day_before_the_name": Export({f"set/{day.replace('-', '')}_{loop}.csv": single(loop, rows) for loop in RANGES for day, rows in HALVES.items()}, inputs=("set",)),
    "moment_behind_the_name": Export({f"set/{loop}_{day.replace('-', '')}T060000Z.csv": single(loop, rows) for loop in RANGES for day, rows in HALVES.items()}, inputs=("set",)),
    "archive_of_days": Export({f"{loop}.zip": packed({f"{day}.csv": single(loop, rows) for day, rows in HALVES.items()}) for loop in RANGES}),
    "values_called_measurements": Export({"plant.csv": long(lambda n, t, v: f"{n};{iso(t)};{v}", "Tag;Time;Measured value")}),
    "workbook_in_an_archive": Export({"plant.zip": packed({"export/FIC101.xlsx": day_sheets("FIC101"), "export/PIC303.csv": single("PIC303")})}),
    "sheets_of_days": Export({f"{loop}.xlsx": day_sheets(loop) for loop in RANGES}),
    "days_in_the_folder_of_a_loop": Export({f"plant/{loop}/{day}.csv": single(loop, rows) for loop in RANGES for day, rows in HALVES.items()}, inputs=("plant",)),
    "legend": Export({"plant.csv": "Trend export\n" + "".join(f"{short};{n};Feed valve of unit 7;%\n" for short, n in SHORT.items()) + "\n" + wide(lambda t: f"{t:%d.%m.%Y %H:%M:%S}", delimiter=";", value=comma, name={n: short for short, n in SHORT.items()}.get)}),
    "legend_of_a_logger": Export({"plant.csv": "CH,Signal name,Input,Range,Filter,Span\n" + "".join(f'{short},"{n.replace(".", " ")}",DC,20V,Off,100\n' for short, n in SHORT.items()) + "Data\n" + wide(lambda t: f"1,{t:%Y/%m/%d %H:%M:%S},0", time_name="Number,Date&Time,ms", name={n: short for short, n in SHORT.items()}.get)}),
    "types_before_signals": Export({"plant.csv": wide(name=lambda n: n.replace(".SP", ".fSetpoint").replace(".PV", ".rPV").replace(".OP", ".lrControlOutput"))}),
    "begin_and_end_above_a_time_for_each_tag": Export({"plant.txt": "Starttime of export\t134182653000000000\t2026-03-17 23:55:00\nEndtime of export\t134182658990000000\t2026-03-18 00:04:59\n\n" + "\t".join(f"Name\t{n}" for n in [*SIGNALS][:3]) + "\n" + "".join("\t".join(f"{1000 * (i - late)}\t{cell(n, v[max(i - late, 0)])}" for (n, v), late in zip([*SIGNALS.items()][:3], (5, 0, 0), strict=True)) + "\n" for i in range(ROWS))}, loops={"FIC101": "FIC101"}, options={"time_format": "millis"}),
    "a_moment_above_numbered_rows": Export({"plant.txt": "Name:\tFeed trend\nAcquisition Date:\t3/17/2026 11:55:00 PM\n" + wide(lambda t: f"{t.timestamp():.0f}\t{t:%m/%d/%Y %I:%M:%S:000 %p}", delimiter="\t", time_name="Scan\tTime", name=lambda n: f"101 <{n.replace('.', ' ')}> (VDC)")}),
    "log_of_a_system": Export({"plant.csv": long(lambda n, t, v: f'"$HS{n.replace(".SP", ",SETPOINT").replace(".PV", ",MEASURE").replace(".OP", ",OUTPUT")}-1-o",{t:%Y-%m-%d %H:%M:%S},{v},0', "LOG_NAME,TIMESTAMP,VALUE,STATUS", by_tag=True)}),
    "legend_of_pens": Export({"plant.csv": "Trend: Unit 3\n" + "".join(f"Pen {short}: {n} (m3/h)\n" for short, n in SHORT.items()) + "\n" + wide(name={n: f"Pen {short}" for short, n in SHORT.items()}.get)}),
    "legend_behind_marks": Export({"plant.csv": "".join(f"# {short},{n}\n" for short, n in SHORT.items()) + wide(name={n: short for short, n in SHORT.items()}.get)}),
    "tag_above_its_rows": Export({"plant.csv": "Tag,Time,Value\n" + "".join(f"{'' if i else n},{iso(t)},{cell(n, v[i])}\n" for n, v in SIGNALS.items() for i, t in enumerate(STAMPS))}, notes=("named_above",)),
    "tag_above_its_table": Export({"plant.csv": below("Tag: {}\nTimestamp,Value\n")}),
    "tag_in_the_header_of_its_table": Export({"plant.csv": below("Timestamp,{}\n")}),
    "tag_some_lines_above_its_table": Export({"plant.csv": below("\nTag,{}\nUnit,%\nRange,0,100\n\nTimestamp,Value\n")}),
    "loop_above_its_table": Export({"plant.csv": "".join(f"Loop: {loop}\n{single(loop)}\n" for loop in RANGES)}),
    "loop_between_its_table_and_another": Export({"FIC101.csv": f"{single('FIC101')}Loop: PIC303\n{single('PIC303')}"}),
    "remark_between_rows": Export({"plant.csv": remarked("# logger restarted")}, notes=("ragged_rows",)),
    "page_between_rows": Export({"plant.csv": remarked("Page 2 of 9\n" + wide().split("\n", 1)[0])}),
    "loop_and_signal_in_merged_cells": Export({"plant.csv": "loop,signal,time,value\n" + "".join(f"{n[:6] if not i and n.endswith('SP') else ''},{'' if i else n[7:]},{iso(t)},{cell(n, v[i])}\n" for n, v in SIGNALS.items() for i, t in enumerate(STAMPS))}, notes=("named_above",)),
    "tag_above_its_pages": Export({"plant.csv": "".join("Tag,Time,Value\n" * (i % 100 == 0) + f"{'' if i else n},{iso(t)},{cell(n, v[i])}\n" for n, v in SIGNALS.items() for i, t in enumerate(STAMPS))}, notes=("named_above",)),
    "loop_above_its_rows": Export({"plant.csv": "loop,time,OP,PV,SP\n" + "".join(f"{'' if i else loop},{iso(t)},{row(loop, i)}\n" for loop in RANGES for i, t in enumerate(STAMPS))}, notes=("named_above",)),
    "one_loop_above_its_signals": Export({f"{k}.csv": f"Point,{loop},{loop},{loop}\nParameter,OP,PV,SP\nUnits,%,m3/h,m3/h\nDate/Time,,,\n" + "".join(f"{iso(t)},{row(loop, i)}\n" for i, t in enumerate(STAMPS)) for k, loop in enumerate(RANGES)}),
    "levels_of_area_loop_and_signal": Export({"plant.csv": "area" + ",Unit1" * 6 + "\n" + ",".join(["loop", *(n[:6] for n in SIGNALS)]) + "\n" + ",".join(["signal", *(n[7:] for n in SIGNALS)]) + "\ntime,,,,,,\n" + wide().split("\n", 1)[1]}),
    "levels_of_one_loop": Export({f"{k}.csv": f"loop,{loop},{loop},{loop}\nsignal,OP,PV,SP\ntime,,,\n" + "".join(f"{iso(t)},{row(loop, i)}\n" for i, t in enumerate(STAMPS)) for k, loop in enumerate(RANGES)}),
    "blocks_of_a_controller": Export({"plant.csv": wide(name=renamed(SP="{}.PIDA.SP", PV="{}.DACA.PV", OP="{}.PIDA.OP"))}),
    "blocks_with_paths": Export({"plant.csv": wide(name=renamed(SP="A/{}/PID1/SP.CV", PV="A/{}/AI1/PV.CV", OP="A/{}/PID1/OUT.CV"))}),
    "day_of_the_year": Export({"plant.csv": wide(lambda t: t.strftime("%Y-%j %H:%M:%S"), delimiter=";", value=comma)}),
    "day_of_the_year_with_offset": Export({"plant.csv": wide(lambda t: t.strftime("%Y-%jT%H:%M:%S.000Z"))}),
    "dash_before_the_clock": Export({"plant.csv": wide(lambda t: t.strftime("%Y/%m/%d-%H:%M:%S"))}),
    "clock_before_the_date": Export({"plant.csv": wide(lambda t: t.strftime("%H:%M:%S %d.%m.%Y"))}),
    "signal_below_the_loop_in_its_cell": Export({"plant.csv": wide(name=lambda n: '"' + n.replace(".", "\n") + '"')}),
    "signal_below_loop_and_unit_in_its_cell": Export({"plant.csv": wide(name=lambda n: '"' + n.replace(".", "\n") + '\n%"')}),
    "description_behind_a_colon_between_blanks": Export({"plant.csv": wide(name=lambda n: f"{n} : Feed {n[-2:]}")}),
    "signals_of_metso": Export({"plant.csv": wide(name=renamed(SP="{}:spv", PV="{}:me", OP="{}:con"))}),
    "dot_behind_the_year": Export({"plant.csv": wide(lambda t: f"{t.day}.{t.month}.{t.year}. {t:%H:%M:%S}", time_name="Vrijeme")}),
    "greek_halves_of_the_day": Export({"plant.csv": wide(lambda t: f"{t:%d/%m/%Y %I:%M:%S} {'πμ' if t.hour < 12 else 'μμ'}", time_name="Ώρα")}),
    "vietnamese": Export({"plant.csv": wide(lambda t: f"{t:%d/%m/%Y} {t.hour % 12 or 12}:{t:%M:%S} {'SA' if t.hour < 12 else 'CH'}", name=renamed(SP="{} Giá trị đặt", PV="{} Giá trị đo", OP="{} Độ mở van"), time_name="Thời gian")}),
    "hours_of_south_africa": Export({"plant.csv": wide(lambda t: f"{t:%Y-%m-%d %H:%M:%S} SAST")}, start=START - timedelta(hours=2)),
    "german_abbreviations": Export({"plant.csv": wide(name=renamed(SP="{}.Sollw", PV="{}.Istw", OP="{}.Stellgr"))}),
    **{f"{word}_behind_the_signal": Export({"plant.csv": wide(name=lambda n, word=word: f"{n}{word}")})
       for word in (".ActualValue", "/Current Value", ".Interpolated", "_ReadValue", ".IO")},
    "word_before_the_clock": Export({"plant.csv": wide(lambda t: f"{t:%d/%m/%Y à %H:%M:%S}", time_name="Date")}),
    "russian_months": Export({"plant.csv": wide(lambda t: f"{t.day} марта {t:%Y %H:%M:%S}", time_name="Время")}),
    "date_and_clock_joined_by_a_colon": Export({"plant.csv": wide(lambda t: f"{t:%d%b%Y:%H:%M:%S}".upper())}),
    "stamps_in_brackets": Export({"plant.csv": wide(lambda t: t.strftime("[%Y-%m-%d %H:%M:%S]"))}),
    "no_blank_before_other_scripts": Export({"plant.csv": wide(name=renamed(SP="{}设定值", PV="{}测量值", OP="{}输出"), time_name="时间")}),
    "japanese_output": Export({"plant.csv": wide(name=renamed(SP="{} 設定値", PV="{} 現在値", OP="{} 操作出力"), time_name="日付時刻").encode("cp932")}, notes=("encoding",)),
    "french_command": Export({"plant.csv": wide(name=renamed(SP="{}.Consigne", PV="{}.Mesure", OP="{}.Commande"), time_name="Horodatage")}),
    "cells_a_spreadsheet_leaves_alone": Export({"plant.csv": "".join(";".join(f'="{c}"' for c in line.split(";")) + "\n" for line in wide(lambda t: f"{t:%d.%m.%Y %H:%M:%S}", delimiter=";", value=comma).splitlines())}),
    "logs_of_a_tag": Export({"plant.csv": wide(name=lambda n: f'"{n.replace(".", ":")},Log1s"')}),
    "day_above_times_of_day": Export({"plant.csv": wide(lambda t: f"{t:%H:%M:%S}", time_name="Time", before="Trend export\nDate: 2026-03-17\n\n")}, notes=("day_above",)),
    "day_beside_its_name_above": Export({"plant.csv": wide(lambda t: f"{t:%H:%M:%S}", delimiter=";", value=comma, time_name="Uhrzeit", before="Protokoll;Anlage 4\nDatum;17.03.2026\n\n")}, notes=("day_above",)),
    "start_and_end_above_milliseconds": Export({"plant.csv": wide(lambda t: f"{(t - STAMPS[0]).total_seconds() * 1e3:.0f}", delimiter=";", time_name="Time [ms]", before="Name;Trend 1\nStart Time:;17.03.2026 23:55:00\nEnd Time:;18.03.2026 00:12:00\n\n")}, notes=("day_above",)),
    "start_above_as_file_time": Export({"plant.csv": wide(lambda t: f"{(t - STAMPS[0]).total_seconds() * 1e3:.0f}", delimiter="\t", time_name="Time [ms]", before=f"File\tC:\\x.tcscopex\nStarttime of export\t{int(seconds(STAMPS[0]) * 10_000_000) + 116_444_736_000_000_000}\tTuesday, 17 March 2026 23:55:00\n\n")}, notes=("day_above",)),
    "start_above_in_a_zone": Export({"plant.csv": wide(lambda t: f"{(t - STAMPS[0]).total_seconds():.0f}", time_name="Seconds", before="Start time: 2026-03-18 00:55:00\n\n")}, options={"timezone": "Europe/Berlin"}, notes=("day_above",)),
    "start_above_with_its_offset": Export({"plant.csv": wide(lambda t: f"{(t - STAMPS[0]).total_seconds():.0f}", time_name="Seconds", before="Started: 2026-03-18T00:55:00+01:00\n\n")}, options={"timezone": "America/Chicago"}, notes=("day_above",)),
    "rows_of_tags_without_a_header": Export({"plant.dat": "".join(f"{88 + k}\t{n}\t{iso(t)}\t{float(cell(n, x)):.5f}\t192\n" for k, (n, x, t) in enumerate((n, v[i], t) for i, t in enumerate(STAMPS) for n, v in SIGNALS.items()))}),
    "date_and_time_above_seconds": Export({"plant.lvm": wide(lambda t: f"{(t - STAMPS[0]).total_seconds():.6f}", delimiter="\t", time_name="X_Value", before="Separator\tTab\nDate\t2026/03/17\nTime\t23:55:00.0\n***End_of_Header***\n\n")}, notes=("day_above",)),
    "seconds_of_matlab": Export({"plant.csv": wide(lambda t: f"{(t - STAMPS[0]).total_seconds():g} sec", time_name="Time", before="Start time: 2026-03-17 23:55:00\n\n")}, notes=("day_above",)),
    "minutes_with_decimal_comma": Export({"plant.csv": wide(lambda t: f"{(t - STAMPS[0]).total_seconds() / 60:.9f} min".replace(".", ","), delimiter=";", value=comma, time_name="Zeit", before="Start;17.03.2026 23:55:00\n\n")}, notes=("day_above",)),
    "labels_of_influx": Export({"plant.csv": "".join("name,tags,time,OP,PV,SP\n" + "".join(f"pid,\"site=A,loop={loop}\",{int(seconds(t)) * 10**9},{row(loop, i)}\n" for i, t in enumerate(STAMPS)) for loop in RANGES)}),
    "date_above_and_times_of_its_ends": Export({"plant.csv": wide(lambda t: f"{t:%H:%M:%S}", time_name="Time", before="Date: 2026-03-17\nStart time: 23:55:00\nEnd time: 00:12:00\n\n")}, notes=("day_above",)),
    "files_called_alike_in_folders_of_loops": Export({f"plant/{loop}/trend.csv": single(loop) for loop in RANGES}, inputs=("plant",)),
    "tag_above_files_called_after_signals": Export({f"plant/{k // 3}/{n[7:]}.csv": f"Tag: {n}\nTime,Value\n" + "".join(f"{iso(t)},{cell(n, x)}\n" for t, x in zip(STAMPS, v, strict=True)) for k, (n, v) in enumerate(SIGNALS.items())}, inputs=("plant",)),
    "folders_of_signals": Export({f"plant/{n[7:]}/{n[:6]}.csv": "Time,Value\n" + "".join(f"{iso(t)},{cell(n, x)}\n" for t, x in zip(STAMPS, v, strict=True)) for n, v in SIGNALS.items()}, inputs=("plant",)),
    "cells_that_are_to_stay_text": Export({"plant.csv": wide(value=lambda n, v: f"'{cell(n, v)}")}),
    "stamps_in_small_letters": Export({"plant.csv": wide(lambda t: f"{t:%Y-%m-%dt%H:%M:%Sz}")}),
    "day_first_in_australia": Export({"plant.csv": wide(lambda t: f"{t - timedelta(days=12, hours=10):%-d/%m/%Y %I:%M:%S %p}", time_name="Time")}, start=STAMPS[0] - timedelta(days=12, hours=10), notes=("time_format",)),
    "loops_in_a_column_of_any_name": Export({"plant.csv": "LogTime,Where from,SP,PV,OP\n" + "".join(f"{iso(t)},{loop},{','.join(cell(f'{loop}.{s}', SIGNALS[f'{loop}.{s}'][i]) for s in ('SP', 'PV', 'OP'))}\n" for i, t in enumerate(STAMPS) for loop in RANGES)}),
    "words_behind_the_signal_in_names_of_files": Export({f"set/{n.replace('.', '_')}_export_2026-03-17_to_2026-03-18.csv": "Time,Value\n" + "".join(f"{iso(t)},{cell(n, x)}\n" for t, x in zip(STAMPS, v, strict=True)) for n, v in SIGNALS.items()}, inputs=("set",)),
    "a_quantity_is_the_measurement": Export({f"set/{loop}.csv": single(loop).replace("Time,OP,PV,SP", "Time,Valve [%],Flow rate [m3/h],Setpoint [m3/h]") for loop in RANGES}, inputs=("set",)),
    "decimal_sign_of_each_column": Export({"plant.csv": wide(delimiter=";", value=lambda n, v: cell(n, v) if n.endswith("OP") else cell(n, v).replace(".", ","))}),
    "decimal_sign_that_changes": Export({"plant.csv": "\n".join([*wide(delimiter=";").splitlines()[:301], *wide(delimiter=";", value=comma).splitlines()[301:]]) + "\n"}),
    "microseconds_from_a_start": Export({"plant.csv": wide(lambda t: f"{(t - STAMPS[0]).total_seconds() * 1e6:.0f}", time_name="Time [us]", before="Start time: 2026-03-17 23:55:00\n\n")}, notes=("day_above",)),
    "one_value_in_a_row_of_epochs": Export({"plant.csv": "timestamp," + ",".join(SIGNALS) + "\n" + "".join(f"{seconds(t):.0f}{',' * (k + 1)}{cell(n, v[i])}{',' * (5 - k)}\n" for i, t in enumerate(STAMPS) for k, (n, v) in enumerate(SIGNALS.items()))}),
    "code_of_quality_that_is_the_same_everywhere": Export({"plant.csv": long(lambda n, t, v: f"{n},{iso(t)},{v},3", "Tagname,TimeStamp,Value,DataQuality")}, notes=("quality_one",)),
    "loops_called_controller": Export({"plant.csv": wide(name=lambda n: f"{n[:6]} Controller - {dict(SP='Setpoint', PV='Process Value', OP='Output')[n[7:]]}")}, loops={f"{loop} Controller": loop for loop in RANGES}, settings=SETTINGS.replace("FIC101]", "'FIC101 Controller']").replace("PIC303]", "'PIC303 Controller']")),
    "node_beside_its_last_part": Export({"plant.csv": long(lambda n, t, v: f'"ns=2;s={n}",{n[-2:]},{iso(t)},{v},0x00000000', "NodeId,DisplayName,SourceTimestamp,Value,StatusCode")}),
}  # fmt: skip


@pytest.mark.parametrize("key", EXPORTS)
def test_an_export_with_names_of_its_own_gives_the_recording(key, tmp_path):
    same_recording(EXPORTS[key], tmp_path)


@pytest.mark.parametrize(("header", "encoding"), [
    ("Zeit;Valeur de consigne;Valeur mesurée;Valeur de sortie", "utf-8"),
    ("Fecha;Punto de consigna;Variable de proceso;Salida del controlador", "utf-8"),
    ("Data e ora;Setpoint;Variabile di processo;Uscita", "utf-8"), ("Tid;Settpunkt;Måleverdi;Pådrag", "utf-8"),
    ("Čas;Žádaná hodnota;Měřená hodnota;Akční veličina", "cp1250"), ("시간;설정값;측정값;출력값", "cp949"),
    ("Метка времени;Уставка;Текущее значение;Выход регулятора", "cp1251"),
    ("采样时间;给定值;过程值;阀位输出", "gb18030"), ("日時;目標値;計測値;操作量", "cp932"),
    ("Дата и время;Заданное значение;Измеренное значение;Управляющее воздействие", "cp1251"), ("Zeit;Soll;Messwert;Stellgrad", "utf-8"),
    ("Tarih;Ayar Noktası;Ölçüm;Vana Çıkışı", "cp1254"), ("Czas;Zadana;Pomiar;Sterowanie", "cp1250"), ("Aika;Ohjearvo;Mittausarvo;Lähtö", "utf-8"), ("時間;設定值;量測值;輸出", "big5")])
def test_signals_of_one_loop_in_words_of_several_languages(tmp_path, header, encoding):
    rows = zip(STAMPS, *(SIGNALS[f"FIC101.{signal}"] for signal in ("SP", "PV", "OP")), strict=True)
    lines = [header, *(";".join([f"{stamp:%Y-%m-%d %H:%M:%S}", *map(str, values)]) for stamp, *values in rows)]
    (tmp_path / "FIC101.csv").write_bytes("\n".join(lines).encode(encoding))
    record, = read(tmp_path / "FIC101.csv").records
    assert record.loop == "FIC101" and record.output is not None
    low, high = record.settings.pv_range
    np.testing.assert_allclose(low + record.measurement * (high - low), SIGNALS["FIC101.PV"], atol=1e-6)


def test_the_measurement_may_stand_in_another_block_of_the_controller(tmp_path):
    """Without settings the loop is called after the block of the controller, and the report says what its PV is."""
    of_blocks = renamed(SP="{}.PIDA.SP", PV="{}.DACA.PV", OP="{}.PIDA.OP")
    (tmp_path / "plant.csv").write_text(wide(name=of_blocks))
    plant = read(tmp_path)
    assert [r.loop for r in plant] == ["FIC101.PIDA", "PIC303.PIDA"] and not plant.failures
    assert any(note.code == "bare_pv" and "FIC101.DACA.PV" in note.message for note in plant["FIC101.PIDA"].notes)
    (tmp_path / "plant.csv").write_text(wide(name=of_blocks).replace("PIC303.PIDA.SP", "FIC101.AI2.PV"))
    failure, = (note for note in read(tmp_path).failures if note.values["loop"] == "FIC101.PIDA")  # which of two?
    assert failure.code == "no_measurement"


@pytest.mark.parametrize("name", ["FIC101_20260317", "FIC101 2026-03-18 0800", "FIC101_18.03.2026", "FIC101-18-03-2026"])
def test_a_loop_is_not_called_after_the_day_of_its_file(tmp_path, name):
    """With or without settings, so that the files of several days are one loop."""
    days = [single("FIC101", rows) for rows in HALVES.values()]
    (tmp_path / f"{name}.csv").write_text(days[1])
    (tmp_path / "FIC101_2026-03-17.csv").write_text(days[0])
    assert [(r.loop, len(r)) for r in read(tmp_path)] == [("FIC101", ROWS)]


def test_what_stands_above_tags_is_no_legend_and_an_area_above_signals_no_loop(tmp_path):
    sources = "".join(f"{n},DCS1.{n.replace('.', '_')}\n" for n in SIGNALS)
    (tmp_path / "plant.csv").write_text("Tag,Source\n" + sources + "\n" + wide())
    assert [r.loop for r in read(tmp_path / "plant.csv")] == ["FIC101", "PIC303"]
    (tmp_path / "FIC101.csv").write_text("area,Unit1,Unit1,Unit1\n" + single("FIC101"))
    assert [r.loop for r in read(tmp_path / "FIC101.csv")] == ["FIC101"]


def test_a_loop_above_its_table_is_that_of_its_signals(tmp_path):
    (tmp_path / "export.csv").write_text(f"Loop: PIC303\n\n{single('PIC303')}")
    assert [record.loop for record in read(tmp_path / "export.csv")] == ["PIC303"]


def test_a_month_that_does_not_exist_is_no_date(tmp_path):
    (tmp_path / "plant.csv").write_text(wide(lambda t: t.strftime("%Y-00-%d %H:%M:%S")))
    with pytest.raises(BacklashError, match="2026-00-17"):
        read(tmp_path / "plant.csv")


@pytest.mark.parametrize(("header", "said"), [
    ("Time,Klap,Meting,Setpoint", "no measurement .PV. column; there is SP only .further columns: Klap, Meting. -> name"),
    ("Time,Klap,PV,SP", "no output .OP. recorded .further columns: Klap.: it is rebuilt")])
def test_the_columns_are_named_of_which_one_may_be_what_is_missing(tmp_path, header, said):
    (tmp_path / "FIC101.csv").write_text(single("FIC101").replace("Time,OP,PV,SP", header))
    try:
        messages = "\n".join(note.message for note in read(tmp_path / "FIC101.csv")["FIC101"].notes)
    except BacklashError as error:
        messages = str(error)
    assert re.search(said, messages)


@pytest.mark.parametrize("unit", ["l/s", "L/S", "%"])
def test_samples_in_another_unit_than_before_are_not_used(tmp_path, unit):
    """A change of the unit by a factor of 3.6 read as a jump of the measurement."""
    def of_sample(tag, stamp, value):
        other = tag == "FIC101.PV" and stamp in STAMPS[200:400]
        of_tag = "%" if tag.endswith("OP") else "m3/h"
        return f"{tag};{stamp:%Y-%m-%d %H:%M:%S};{float(value) / 3.6 if other else value};{unit if other else of_tag}"

    (tmp_path / "plant.csv").write_text(long(of_sample, "Tag;Time;Value;Units"))
    plant = read(tmp_path / "plant.csv")
    assert np.count_nonzero(plant["FIC101"].usable) == len(STAMPS) - 200
    said, = (note.message for note in plant["FIC101"].notes if note.code == "other_unit")
    assert "Units" in said and f"(m3/h, {unit})" in said and "only samples in m3/h" in said
    assert not [note for note in plant["PIC303"].notes if note.code in ("other_unit", "bad_quality")]


def test_bad_rows_of_a_text_in_a_code_page_are_not_used(tmp_path):
    """Zła is no word, and Jakość no column of qualities, when they are read in the Western European code page."""
    def of_sample(tag, stamp, value):
        bad = tag == "FIC101.PV" and stamp in STAMPS[200:400]
        return f"{tag};{stamp:%Y-%m-%d %H:%M:%S};{'0' if bad else value};{'Zła' if bad else 'Dobra'}"

    (tmp_path / "plant.csv").write_bytes(long(of_sample, "Nazwa;Czas;Wartość;Jakość").encode("cp1250"))
    record = read(tmp_path / "plant.csv")["FIC101"]
    assert np.count_nonzero(record.usable) == len(STAMPS) - 200


def test_a_day_above_numbers_that_are_dates_is_not_needed(tmp_path):
    (tmp_path / "plant.csv").write_text(wide(lambda t: f"{seconds(t):.0f}", time_name="Time", before="Date: 2026-05-01\n\n"))
    record = read(tmp_path)["FIC101"]
    assert record.start == seconds(STAMPS[0]) and not {n.code for n in record.notes} & {"day_above", "relative_time"}


@pytest.mark.parametrize("above", ["Printed: 2026-03-18", "Date: 2026-03-17\nDate: 2026-03-18", "Date: 03/04/2026"])
def test_a_day_above_that_may_be_another_is_not_taken(tmp_path, above):
    (tmp_path / "plant.csv").write_text(wide(lambda t: f"{t:%H:%M:%S}", time_name="Time", before=f"{above}\n\n"))
    plant = read(tmp_path)
    assert all(f"{record.time[0]:.0f}" == str(86_100) for record in plant)
    assert "relative_time:of_day" in {note.code for record in plant for note in record.notes} | {
        note.code for note in plant.warnings} or any("1970" in n.message for record in plant for n in record.notes)


@pytest.mark.parametrize("name", ["output", "x"])
def test_tags_of_the_settings_go_before_the_name_of_the_file(tmp_path, name):
    tags = dict(zip(SIGNALS, ("AV12", "AI12", "AO12", "AV13", "AI13", "AO13"), strict=True))
    (tmp_path / f"{name}.csv").write_text(wide(name=tags.get), encoding="utf-8")
    (tmp_path / "loops.toml").write_text("".join(f"[loops.{loop}]\n" + "".join(
        f"{role.lower()} = '{tags[f'{loop}.{role}']}'\n" for role in ("SP", "PV", "OP")) for loop in RANGES))
    plant = read(tmp_path)
    assert [record.loop for record in plant] == [*RANGES] and not plant.failures
    assert all(record.output is not None for record in plant)


@pytest.mark.parametrize(("first", "rest", "words"), [
    ("timestamp;FIC101.SP;FIC101.PV;FIC101.OP", ",", "1 cells"), ("timestamp,FIC101.SP,FIC101.PV,FIC101.OP,MODE", ",", "5 cells")])
def test_a_header_that_does_not_fit_is_shown(tmp_path, first, rest, words):
    rows = [rest.join((iso(t), row("FIC101", i))) for i, t in enumerate(STAMPS)]
    (tmp_path / "plant.csv").write_text("\n".join([first, *rows]) + "\n", encoding="utf-8")
    with pytest.raises(BacklashError, match=f"line 1 cannot be the header: it has {words} and the rows below have 4"):
        read(tmp_path / "plant.csv")


def test_times_of_day_over_midnight_newest_first(tmp_path):
    head, *rows = wide(lambda t: f"{t:%H:%M:%S}", time_name="Time").splitlines()
    for name, lines in {"oldest": rows, "newest": rows[::-1]}.items():
        (tmp_path / f"{name}.csv").write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    assert rows[0].startswith("23:55") and not rows[-1].startswith("23")
    for one, other in zip(read(tmp_path / "oldest.csv"), read(tmp_path / "newest.csv"), strict=True):
        assert np.array_equal(one.measurement, other.measurement) and np.array_equal(one.index, other.index)
        assert {note.code for note in other.notes} - {note.code for note in one.notes} == {"unsorted"}


@pytest.mark.parametrize("block", [1 << 12, 1 << 22])
@pytest.mark.parametrize(("above", "start"), [("", 0.0), ("Date: 2026-03-17\n\n", 1773705600.0)])
def test_hours_since_a_start_go_on_beyond_a_day(tmp_path, monkeypatch, above, start, block):
    monkeypatch.setattr("backlash_cli.loaders.opening.BLOCK", block)
    monkeypatch.setattr("backlash_cli.loaders.opening.CHUNK", 1 << 10)
    rows = [f"{k // 6:02d}:{k % 6}0:00,50,{50 + k % 7 / 10},{40 + k % 11}" for k in range(800)]
    (tmp_path / "plant.csv").write_text("\n".join([f"{above}Time,FIC101.SP,FIC101.PV,FIC101.OP", *rows]) + "\n")
    (record,) = read(tmp_path / "plant.csv")
    assert record.start == start and record.interval == 600.0 and np.array_equal(record.index, np.arange(800))


@pytest.mark.parametrize(("above", "interval"), [
    ("Sample rate: 10 Hz", 0.1), ("# Sampling frequency [Hz]: 4", 0.25), ("Abtastrate,0.5 Hz", 2.0), ("# dt = 0.2 s", 0.2), ("Sample rate,2", 0.5),
    ("Sampling rate: 500 ms", 0.5), ("Zykluszeit: 5 s", 5.0), ("Scan rate: 2 s", 2.0), ("Ts = 0.25 s", 0.25),
    ("Resolution (ms): 200", 0.2), ("Update interval: 00:00:05", 5.0), ("Sample rate: 0 Hz", 1.0), ("Sample rate: fast", 1.0)])
def test_lines_above_counted_rows_name_their_rate(tmp_path, above, interval):
    rows = [f"{k},50,{50 + k % 7 / 10},{40 + k % 11}" for k in range(300)]
    (tmp_path / "plant.csv").write_text("\n".join([above, "", "Sample,FIC101.SP,FIC101.PV,FIC101.OP", *rows]) + "\n")
    (record,) = read(tmp_path / "plant.csv")
    assert record.interval == interval and len(record) == 300


@pytest.mark.parametrize(("good", "bad"), [
    ("GoodNonspecific", "BadCommFailure"), ("16#80", "16#00"), ("0x000000C0 GOOD", "0x00000000 BAD"), ("Quality Good", "Quality Bad"),
    ("[Good]", "[Bad]"), ("GoodQuality", "BadQuality"), ("GOOD|RAW", "BAD|RAW"), ("No error", "Sensor failure"), ("i.O.", "n.i.O.")])
@pytest.mark.parametrize("faults", [0, 3])
def test_words_of_qualities(tmp_path, good, bad, faults):
    rows = [f"{iso(t)},50,{50 + k % 7 / 10},{bad if k % 100 < faults else good},{40 + k % 11}" for k, t in enumerate(STAMPS)]
    (tmp_path / "plant.csv").write_text("\n".join(["Time,FIC101.SP,FIC101.PV,Quality,FIC101.OP", *rows]) + "\n")
    (record,) = read(tmp_path / "plant.csv")
    assert np.array_equal(np.flatnonzero(record.state), np.flatnonzero(np.arange(ROWS) % 100 < faults))


@pytest.mark.parametrize("quality", [False, True])
@pytest.mark.parametrize(("role", "every"), [("SP", 100), ("OP", 50), ("OP", 10), ("OP", 1), ("PV", 1)])
def test_no_signal_is_known_from_a_bad_record_to_the_next_good_one(tmp_path, role, every, quality):
    rows = []
    for k in range(ROWS):
        for name, value in (("SP", 50 + k // 100), ("PV", 50 + k % 7 / 10), ("OP", 40 + k % 11)):
            bad = name == role and 300 <= k < 400
            if name != role or (k == 300 if bad else k % every == 0):
                rows.append(f"FIC101.{name},{iso(STAMPS[k])}," + (
                    f"{value},{'Bad' if bad else 'Good'}" if quality else "I/O Timeout" if bad else f"{value}"))
    (tmp_path / "plant.csv").write_text("\n".join([f"Tag,Time,Value{',Quality' * quality}", *rows]) + "\n")
    (tmp_path / "loops.toml").write_text(SETTINGS)
    (record,) = read(tmp_path / "plant.csv")
    state = dict(zip(record.index.tolist(), record.state.tolist(), strict=True))
    assert all(state.get(k, SampleState.MISSING) == SampleState.MISSING for k in range(301, 399))
    assert all(state[k] < SampleState.MISSING for k in (*range(200, 299), *range(400, 500)))


def test_an_export_may_be_called_as_settings_are(tmp_path):
    (tmp_path / "loops.csv").write_text(wide(), encoding="utf-8")
    plant = read(tmp_path / "loops.csv")
    assert [record.loop for record in plant] == [*RANGES] and "no_metadata" in {note.code for note in plant.warnings}


@pytest.mark.parametrize("above", ["", "# of unit 7\n\n# tuned in May\n"])
def test_settings_given_as_an_export_are_called_so(tmp_path, above):
    (tmp_path / "plant.toml").write_text(above + SETTINGS)
    with pytest.raises(BacklashError, match=r"this is a file of loop settings.* --loops"):
        read(tmp_path / "plant.toml")


def test_a_column_of_loops_without_a_cell_names_no_loop(tmp_path):
    text = single("FIC101").replace("\n", "\n,")[:-1].replace("Time", "Loop,Time", 1)
    (tmp_path / "FIC101.csv").write_text(text, encoding="utf-8")
    assert [record.loop for record in read(tmp_path / "FIC101.csv")] == ["FIC101"]
