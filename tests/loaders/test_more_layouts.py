"""Rarer ways to write an export, each found in some product or spreadsheet; they too give the same records."""

# One line per way of writing reads better than wrapped ones.
# ruff: noqa: E501

from __future__ import annotations

import io
import zipfile
from datetime import datetime, timedelta

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from backlash_cli.errors import BacklashError
from backlash_cli.loaders import ReadOptions, read

from .exports import RANGES, SETTINGS, SIGNALS, STAMPS, Export, arrow, cell, iso, long, wide
from .test_layouts import comma, same_recording, seconds, single

GROUPED = {
    "apostrophe": ("'", ".", ","),
    "blank": (" ", ",", ";"),
    "hard_blank": ("\u00a0", ",", ";"),
    "narrow_blank": ("\u202f", ",", "\t"),
    "point": (".", ",", ";"),
    "point_quoted": (".", ",", ","),
    "comma": (",", ".", "\t"),
}
THOUSANDFOLD = SETTINGS.replace("900.0", "900000.0").replace("16.0", "16000.0").replace("[0, 100]", "[0, 100000]")


def grouped(separator, decimal):
    """Values times 1000 with a separator between groups of three digits."""
    signs = str.maketrans({",": separator, ".": decimal})
    return lambda tag, value: f'"{value * 1000:,.1f}"'.translate(signs)


def influx(tags, header):
    """Annotated CSV whose tags, not its field, name loop and signal."""
    lines = ["#group,false,false,true,false,false,true,true,true,true", "#default,_result,,,,,,,,",
             f",result,table,_start,_time,_value,_field,{header}"]  # fmt: skip
    for name, values in SIGNALS.items():
        loop, signal = name.split(".")
        own = tags.format(loop=loop, signal=signal)
        lines += [
            f",,0,2026-03-17T00:00:00Z,{iso(t)}Z,{cell(name, v)},value,{own}"
            for t, v in zip(STAMPS, values, strict=True)
        ]
    return "\n".join(lines) + "\n"


def packed(files):
    """A zip archive of texts."""
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return held.getvalue()


def row(loop, i):
    """OP, PV and SP of one loop at one time."""
    return ",".join(cell(f"{loop}.{s}", SIGNALS[f"{loop}.{s}"][i]) for s in ("OP", "PV", "SP"))


def blanks(time, widths=(24, 14), name="timestamp", number=str, before="", after=""):
    """Columns that are aligned with blanks, as reports are printed."""
    rows = [(name, SIGNALS), *((time(t), [number(cell(n, v[i])) for n, v in SIGNALS.items()])
                               for i, t in enumerate(STAMPS))]
    return before + "".join(f"{first:<{widths[0]}}" + "".join(f"{c:>{widths[1]}}" for c in own) + "\n"
                            for first, own in rows) + after


def renamed(**words):
    """A name of each signal in the words of a control system: loop between braces."""
    return lambda name: words[name.split(".")[1]].format(name.split(".")[0])


MORE = {
    "pcs7": Export({"plant.csv": wide(name=renamed(SP='"{}|SP_Out#Value"', PV='"{}|PV_Out#Value"', OP='"{}|MV#Value"'))}),
    "pcs7_long": Export({"plant.csv": long(lambda n,t,v:f'"{n.replace(".", "|").replace("OP", "MV").replace("V", "V_Out")}#Value";"{t:%d.%m.%Y %H:%M:%S}";{v.replace(".", ",")};1','"VarName";"TimeString";"VarValue";"Validity"')}),
    "behind_the_signal": Export({"plant.csv": wide(name=renamed(SP="{}_SP_EU", PV="{}.PV_ACT", OP="{}.OP_pct"))}),
    "two_words": Export({"plant.csv": wide(name=renamed(SP="{}|Set Point", PV="{}|Process Variable", OP="{}|Controller Output"))}),
    "mean_of_tag": Export({"plant.csv": wide(name=renamed(SP="avg({}.SP)", PV="Feed flow [{}.PV]", OP="[{}.OP]"))}),
    "labels": Export({"plant.csv": wide(name=renamed(SP='"SP {{loop=""{}""}}"', PV='"PV {{loop: {}}}"', OP="plant.mean{{tag={}.OP}}"))}),
    "w_x_y": Export({"plant.csv": wide(name=renamed(SP="{}.W", PV="{}.X", OP="{}.Y"))}),
    "cv": Export({"plant.csv": wide(name=renamed(SP="{}.SP", PV="{}.PV", OP="{}.CV"))}),
    "cv_per_tag": Export({f"{n.replace('.', '_')}.csv": "Timestamp,CV\n"+"".join(f"{iso(t)},{cell(n, x)}\n" for t,x in zip(STAMPS, v, strict=True)) for n, v in SIGNALS.items()}),
    "node_quoted": Export({"plant.csv": wide(name=renamed(SP='"ns=3;s=""{}"".""SP"""', PV='"ns=3;s=""{}"".""PV"""', OP='"ns=3;s=""{}"".""OP"""'))}),
    "blanks_iso": Export({"plant.txt": blanks(iso)}),
    "blanks_report": Export({"plant.txt": blanks(lambda t: f"{t:%d-%b-%Y %H:%M:%S}", before="Report of unit 7\nPrinted 18-Mar-2026 08:00\n\n", after="\nEnd of report\n")}),
    "blanks_am_pm": Export({"plant.txt": blanks(lambda t: f"  {t:%m/%d/%Y %I:%M:%S %p}", widths=(28, 14))}),
    "blanks_comma": Export({"plant.txt": blanks(lambda t: f"{t:%d.%m.%Y %H:%M:%S}", number=lambda x: x.replace(".", ",")).replace("\n", "\r\n")}),
    "blanks_date_apart": Export({"plant.txt": blanks(lambda t: f"{t:%Y-%m-%d  %H:%M:%S}")}),
    "blank_between": Export({"plant.txt": wide(lambda t: f"{t:%Y-%m-%d %H:%M:%S}", delimiter=" ")}),
    "date_clock_digits": Export({"plant.csv": wide(lambda t: f"{t:%Y%m%d},{int(f'{t:%H%M%S}')}", time_name="Date,Time")}),
    "date_clock_footer": Export({"plant.csv": wide(lambda t: f"{t:%Y%m%d},{t:%H%M%S}", time_name="Date,Time") + "Mean,,1,1,1,1,1,1\n"}, notes=("unreadable_times",)),
    "date_digits": Export({"plant.csv": wide(lambda t: f"{t:%Y%m%d;%H:%M:%S}", time_name="Datum;Uhrzeit", delimiter=";", value=comma)}),
    "date_seconds": Export({"plant.csv": wide(lambda t: f"{t:%d.%m.%Y};{seconds(t) % 86400:.0f}", time_name="Datum;Sekunden", delimiter=";")}),
    "date_time_in_seconds": Export({"plant.csv": wide(lambda t: f"{t:%Y-%m-%d},{seconds(t) % 86400:.1f}", time_name="Date,Time (s)")}),
    "date_time_in_ms": Export({"plant.csv": wide(lambda t: f"{t:%Y-%m-%d},{seconds(t) % 86400 * 1e3:.0f}", time_name="Date,Time [ms]")}),
    "date_part_of_day": Export({"plant.csv": wide(lambda t: f"{t:%Y-%m-%d},{seconds(t) % 86400 / 86400:.9f}", time_name="Date,Time")}),
    "parts_of_time": Export({"plant.csv": wide(lambda t: f"{t:%Y,%m,%d,%H,%M,%S}", time_name="YYYY,MM,DD,HH,mm,ss") + "Mean,,,,,,1,1,1,1,1,1\n"}, notes=("unreadable_times",)),
    "parts_of_time_de": Export({"plant.csv": wide(lambda t: f"{t:%d;%m;%Y;%H;%M;%S}", time_name="Tag;Monat;Jahr;Stunde;Minute;Sekunde", delimiter=";", value=comma)}),
    "day_of_year": Export({"plant.csv": wide(lambda t: f"{t.year},{t.timetuple().tm_yday},{seconds(t) % 86400:.0f}", time_name="Year,DayOfYear,Seconds")}),
    "day_of_year_beside_month_and_day": Export({"plant.csv": wide(lambda t: f"{t:%Y,%m,%d},{t.timetuple().tm_yday},{t:%H,%M,%S}", time_name="Year,Month,Day,DOY,Hour,Minute,Second")}),
    "values_called_data": Export({"plant.csv": wide(lambda t: f"{seconds(t):.0f}", time_name="time").replace(".PV", ".PV.Data").replace(".OP", ".OP.Data").replace(".SP", ".SP.Data")}),
    "spreadsheet_day_and_part": Export({"plant.csv": wide(lambda t: f"{seconds(t) // 86400 + 25569:.0f},{seconds(t) % 86400 / 86400:.8f}", time_name="Date,Time")}),
    "yymmdd": Export({"plant.csv": wide(lambda t: t.strftime("%y%m%d,%H%M%S"), time_name="Date,Time")}, options={"time_format": "ymd"}),
    "japanese": Export({"plant.csv": wide(lambda t: t.strftime("%Y年%m月%d日 %H時%M分%S秒"), time_name="日時").replace(".PV", " 測定値").replace(".SP", " 設定値").replace(".OP", " 操作量")}),
    "chinese_half_days": Export({"plant.csv": wide(lambda t: f"{t:%Y/%m/%d }" + ("下午" if t.hour > 11 else "上午") + f"{t.hour % 12 or 12}:{t:%M:%S}", time_name="日期")}),
    "polish": Export({"plant.csv": wide(lambda t: t.strftime("%Y-%m-%d %H-%M-%S"), time_name="Data i godzina").replace(".PV", " Wartość mierzona").replace(".SP", " Wartość zadana").replace(".OP", " Wyjście")}),
    "hungarian": Export({"plant.csv": wide(lambda t: t.strftime("%Y. %m. %d. %H:%M:%S"), time_name="Idő")}),
    "french_hms": Export({"plant.csv": wide(lambda t: t.strftime("%Y-%m-%d %Hh%Mm%Ss"), time_name="Date")}),
    "db2": Export({"plant.csv": wide(lambda t: t.strftime("%Y-%m-%d-%H.%M.%S.000000"), time_name="TS")}),
    "text_formula": Export({"plant.csv": wide(lambda t: f'="{t:%Y-%m-%d %H:%M:%S}"')}),
    "german_uhr": Export({"plant.csv": wide(lambda t: t.strftime("%d.%m.%Y %H:%M:%S Uhr"), time_name="Zeit")}),
    "parts_in_parquet": Export({"plant.parquet": pa.table({**{w: [getattr(t, w) for t in STAMPS] for w in ("year", "month", "day", "hour", "minute", "second")}, **SIGNALS})}),
    "parts_beside_stamps": Export({"plant.csv": wide(lambda t: f"{iso(t)},{t:%Y,%m,%d,%H}", time_name="timestamp,year,month,day,hour")}),
    "parts_beside_epoch": Export({"plant.csv": wide(lambda t: f"{seconds(t):.0f},{t:%Y,%m,%d,%H}", time_name="time,year,month,day,hour")}),
    "date_and_parts": Export({"plant.csv": wide(lambda t: f"{t:%Y-%m-%d},{t.hour},{t.minute},{t.second}", time_name="Date,Hour,Minute,Second")}),
    "long_date_clock_digits": Export({"plant.csv": long(lambda n,t,v:f"{n},{t:%Y%m%d},{t:%H%M%S},{v},192","TAG,DATE,TIME,VALUE,QUAL")}),
    "value_before_time": Export({"plant.csv": ",".join(f"{n}.Value,{n}.Timestamp,{n}.Quality" for n in SIGNALS)+"\n"+"".join(",".join(f"{cell(n, v[i])},{iso(t)},192" for n, v in SIGNALS.items())+"\n" for i,t in enumerate(STAMPS))}),
    "row_numbers_unnamed": Export({"plant.csv": (w := wide().splitlines())[0]+"\n"+"".join(f'"{i}",{line}\n' for i,line in enumerate(w[1:], 1))}),
    "period_above": Export({"plant.csv": "Report,,,,,,,\n,Start,,,,,,\nFrom,2026-03-17 22:00,,,,,,\n" + "".join(f",{line}\n" for line in wide().splitlines())}),
    "lead_index": Export({"plant.csv": "\n".join((f",{r}" if i==0 else f"{i-1},{r}") for i,r in enumerate(wide().splitlines()))+"\n"}),
    "unit1": Export({"plant.csv": wide(name=lambda n:"AREA1/"+n)}),
    "described": Export({"plant.csv": wide(name=lambda n: f"{n} - Feed flow, unit 7", delimiter=";")}),
    "signal_of_loop": Export({"plant.csv": wide(name=lambda n: "{1} ({0})".format(*n.split(".")))}),
    "signal_in_loop": Export({"plant.csv": wide(name=lambda n: "{1} [{0}]".format(*n.split(".")))}),
    "tags_in_labels": Export({"plant.csv": "name,tags,time,co,pv,sp\n" + "".join(f'pid,"loop={n},site=A",{seconds(t):.0f},{SIGNALS[f"{n}.OP"][k]},{SIGNALS[f"{n}.PV"][k]},{SIGNALS[f"{n}.SP"][k]}\n' for k, t in enumerate(STAMPS) for n in RANGES)}),
    "metric_and_loop": Export({"plant.csv": long(lambda n, t, v: f"pid_{n[-2:].lower()},{n[:-3]},{seconds(t):.0f},{v}", "metric,loop,timestamp,value")}),
    "measure_name": Export({"plant.csv": long(lambda n, t, v: f"{n[:-3]},{n[-2:].lower()},{t},{v}", "loop_id,measure_name,time,measure_value::double")}),
    "messages": Export({"plant.csv": long(lambda n, t, v: f"{iso(t)},plant/{n.replace('.', '/')},{v},0,false", "timestamp,topic,payload,qos,retain")}),
    "date_time_one_blank": Export({"plant.prn": "".join(line + "\n" for line in wide(lambda t: f"{t:%d-%m-%Y %H:%M:%S}", time_name="Date  Time", delimiter="  ").splitlines())}),
    "lines_in_names": Export({"plant.tsv": wide(delimiter="\t", name=lambda n: '"{}\n{}"'.format(n[:-3], {"SP": "Durchfluss Sollwert\nm³/h", "PV": "Durchfluss Istwert\nm³/h", "OP": "Stellgröße\n%"}[n[-2:]]))}),
    "described_tags": Export({"plant.csv": wide(name=lambda n: "{} {}".format(n[:-3], {"SP": "Feed flow SP", "PV": "Feed flow PV", "OP": "Valve OP"}[n[-2:]]))}),
    "word_of_all_rows": Export({"plant.csv": long(lambda n, t, v: f"{n};{t};{v};SPONT", "Variable;Zeitstempel;Wert;Status")}, notes=("quality_words",)),
    "go_stamps": Export({"plant.csv": wide(lambda t: f"{t} +0000 UTC")}),
    "day_of_year_slash": Export({"plant.csv": wide(lambda t: f"{t:%Y/%j %H:%M:%S}")}),
    "day_of_year_colons": Export({"plant.csv": wide(lambda t: f"{t:%Y:%j:%H:%M:%S}")}),
    "iec_stamps": Export({"plant.csv": wide(lambda t: f"DT#{t:%Y-%m-%d-%H:%M:%S}")}),
    "french_date_and_hms": Export({"plant.csv": wide(lambda t: f"{t:%d/%m/%Y;%Hh%Mm%Ss}", time_name="Date;Heure", delimiter=";")}),
    "pandas_durations": Export({"plant.csv": wide(lambda t: str(pd.Timedelta(t - STAMPS[0])), time_name="")}, start=datetime(1970, 1, 1)),
    "structs": Export({"plant.parquet": pa.table({"ts": pa.array(STAMPS, pa.timestamp("us")), **{n: pa.StructArray.from_arrays([SIGNALS[f"{n}.{s}"] for s in ("SP", "PV", "OP")], ["sp", "pv", "op"]) for n in RANGES}})}),
    "durations": Export({"plant.parquet": pa.table({"elapsed": pa.array([t - STAMPS[0] for t in STAMPS]), **SIGNALS})}, start=datetime(1970, 1, 1)),
    "days_in_names": Export({f"PIC303_{t:%Y-%m-%d}.csv": "Time of day,SP,PV,OP\n" + "".join(f"{u:%H:%M:%S},{SIGNALS['PIC303.SP'][k]},{SIGNALS['PIC303.PV'][k]},{SIGNALS['PIC303.OP'][k]}\n" for k, u in enumerate(STAMPS) if u.day == t.day) for t in (STAMPS[0], STAMPS[-1])}, inputs=(".",), loops={"PIC303": "PIC303"}),
    "sections": Export({"plant.txt": "".join(f"[{n}]\nTime;SP;PV;OUT\n" + "".join(f"{t};{SIGNALS[f'{n}.SP'][k]};{SIGNALS[f'{n}.PV'][k]};{SIGNALS[f'{n}.OP'][k]}\n" for k, t in enumerate(STAMPS)) for n in RANGES)}),
    "numbered_signals": Export({"plant.csv": wide(name=lambda n: n[-2:] + {"FIC101": "1", "PIC303": "2"}[n[:-3]])}, loops={"1": "FIC101", "2": "PIC303"}, settings=SETTINGS.replace("FIC101", "1").replace("PIC303", "2")),
    "counted_rows": Export({"plant.csv": wide(lambda t: f"{(t - STAMPS[0]).total_seconds() + 1:.0f}", time_name="Sample", before=f"Start time: {STAMPS[0]}\nSample interval: 1000 ms\n\n")}),
    "tag_beside_measurement": Export({"plant.csv": long(lambda n, t, v: f"{iso(t)}Z,pid,{n[:-3]},{n[-2:].lower()},{v}", "time,measurement,tag,field,value")}),
    "measured_at": Export({"plant.csv": long(lambda n, t, v: f"{t},{n},{v}", "measured_at,tag,value")}),
    "ingested_later": Export({"plant.csv": long(lambda n, t, v: f"{t + timedelta(seconds=3 + t.second % 5)},{t},{n},{v}", "ingest_ts,event_ts,tag,value")}),
    "period_until_now": Export({"plant.csv": "Start,17-Mar-26 21:40:00" + "," * 15 + "\nEnd,*" + "," * 15 + "\n\n" + ",".join(f"{n},," for n in SIGNALS)[:-1] + "\n" + "".join(",".join(f"{t:%d-%b-%y %H:%M:%S},{cell(n, v[k])}," for n, v in SIGNALS.items())[:-1] + "\n" for k, t in enumerate(STAMPS))}),
    "interval_starts": Export({"plant.csv": "Start;FT1;FS1;FO1;PT3;PS3;PO3\n" + "".join(";".join([f"{t}", *(cell(n, SIGNALS[n][k]) for n in ("FIC101.PV", "FIC101.SP", "FIC101.OP", "PIC303.PV", "PIC303.SP", "PIC303.OP"))]) + "\n" for k, t in enumerate(STAMPS))}, settings=SETTINGS.replace("[loops.FIC101]", '[loops.FIC101]\npv = "FT1"\nsp = "FS1"\nop = "FO1"').replace("[loops.PIC303]", '[loops.PIC303]\npv = "PT3"\nsp = "PS3"\nop = "PO3"')),
    "pida": Export({"plant.csv": wide(name=lambda n:n.replace('.','.PIDA.'))}),
    "preamble_wide": Export({"plant.csv": wide(before="Server,HIST01,,,,,\nPeriod,2026-03-17 08:00:00,2026-03-17 10:00:00,,,,\n,,,,,,\n")}),
    "preamble_semi": Export({"plant.csv": wide(before="; comment, one\n; comment, two\n")}),
    "preamble_quote": Export({"plant.csv": wide(before="' comment, one\nREM two, three\n")}),
    "preamble_key": Export({"plant.csv": wide(before="Start Time: 2026-03-17 08:00:00\nEnd Time: 2026-03-17 10:00:00\nInterval: 1 s\n\n")}),
    "units_row_unit": Export({"plant.csv": wide(between="yyyy-mm-dd hh:mm:ss,m3/h,m3/h,%,bar,bar,%")}),
    "units_row_br": Export({"plant.csv": wide(between="[-],[m3/h],[m3/h],[%],[bar],[bar],[%]")}),
    "types_row": Export({"plant.csv": wide(between="DateTime,Float32,Float32,Float32,Float32,Float32,Float32")}),
    "units_num_row": Export({"plant.csv": wide(between="0,1,1,1,1,1,1")}),
    "th_ints": Export({"plant.csv": wide(value=lambda t,v:f'"{v*10000:,.0f}"')},settings=SETTINGS.replace("900.0", "9000000.0").replace("16.0", "160000.0").replace("[0, 100]", "[0, 1000000]"),tolerance=.01),
    "mi_parquet": Export({"plant.parquet": pa.table({'timestamp':pa.array(STAMPS),**{str(tuple(k.split('.'))):v for k,v in SIGNALS.items()}})}),
    "pq_tagpart": Export({f"set/tag={t}/p.parquet": pa.table({'ts':pa.array(STAMPS),'value':v}) for t,v in SIGNALS.items()},inputs=("set",)),
    "pq_two_part": Export({f"set/loop={t.split('.')[0]}/signal={t.split('.')[1]}/p.parquet": pa.table({'ts':pa.array(STAMPS),'value':v}) for t,v in SIGNALS.items()},inputs=("set",)),
    "pq_year_month": Export({f"set/year=2026/month=03/p{i}.parquet": arrow().slice(300*i,300) for i in (0,1)},inputs=("set",)),
    "influx_tags": Export({"plant.csv":influx('plant,{loop},{signal}', '_measurement,loop,signal')}),
    "influx_tagname": Export({"plant.csv":influx('opcua,siteA,{loop}.{signal}', '_measurement,site,tag')}),
    "influx_pivot": Export({"plant.csv":"#group,false,false,false,true,false,false,false\n#datatype,string,long,dateTime:RFC3339,string,double,double,double\n#default,_result,,,,,,\n,result,table,_time,_measurement,OP,PV,SP\n"+"".join(f",,0,{iso(t)}Z,{loop},{row(loop, i)}\n" for loop in RANGES for i,t in enumerate(STAMPS))}),
    "influx1": Export({"plant.csv":"name,time,OP,PV,SP\n"+"".join(f"{loop},{int(seconds(t))*10**9},{row(loop, i)}\n" for loop in RANGES for i,t in enumerate(STAMPS))}),
    "wonderware": Export({"plant.csv":long(lambda n,t,v:f"{t.strftime('%Y-%m-%d %H:%M:%S.0000000')},{n},{v},{v},0,192,192","DateTime,TagName,Value,vValue,Quality,QualityDetail,OPCQuality")}),
    "phd": Export({"plant.csv":long(lambda n,t,v:f"{n},{t.strftime('%d-%b-%Y %H:%M:%S')},{v},100","Tagname,Timestamp,Value,Confidence")}),
    "ip21": Export({"plant.csv":long(lambda n,t,v:f'"{n}","{t.strftime("%d-%b-%y %H:%M:%S.0").upper()}","{v}","Good"',"NAME,TS,VALUE,STATUS")}),
    "proficy_tags": Export({"plant.csv":"[Tags]\nTagname,Description,EngineeringUnits\nFIC101.PV,Flow,m3/h\n[Data]\n"+long(lambda n,t,v:f"{n},{t.strftime('%m/%d/%Y %H:%M:%S.000')},{v},Good","Tagname,TimeStamp,Value,DataQuality")}),
    "proficy_fcv": Export({"plant.csv":long(lambda n,t,v:f"PLANT.{n.replace('.','_')}.F_CV,{t.strftime('%m/%d/%Y %H:%M:%S.000')},{v},Good","Tagname,TimeStamp,Value,DataQuality",before="*Exp\n[Data]\n")}),
    "signalcol": Export({"plant.csv":long(lambda n,t,v:f"{n.split('.')[0]};{n.split('.')[1]};{iso(t)};{v.replace('.',',')}","Regelkreis;Signal;Zeit;Wert")}),
    "single_stem_date": Export({f"{loop}_20260317.csv":single(loop) for loop in RANGES}),
    "tall_quality": Export({"plant.csv":"\n".join(["Tag,Time,SP,PV,OP",*(f"{loop},{r}" for loop in RANGES for r in single(loop).splitlines()[1:])])+"\n"}),
    "spaces": Export({"plant.csv": wide(delimiter=", ")}),
    "semi_space": Export({"plant.csv": wide(delimiter="; ",value=comma)}),
    "caret": Export({"plant.csv": wide(delimiter="^")},options={"delimiter":"^"}),
    "iso_z_zone": Export({"plant.csv": wide(lambda t:t.strftime('%Y-%m-%dT%H:%M:%S.000Z[UTC]'))}),
    "time_colon_ms": Export({"plant.csv": wide(lambda t:t.strftime('%d/%m/%Y %H:%M:%S:000'))}),
    "ctime": Export({"plant.csv": wide(lambda t:t.strftime('%a %b %d %H:%M:%S %Y'))}),
    "js": Export({"plant.csv": wide(lambda t:t.strftime('%a %b %d %Y %H:%M:%S GMT+0000 (UTC)'))}),
    "rfc": Export({"plant.csv": wide(lambda t:'"'+t.strftime('%a, %d %b %Y %H:%M:%S GMT')+'"')}),
    "asp": Export({"plant.csv": wide(lambda t:t.strftime('%d-%b-%y %I:%M:%S.0 %p'))}),
    "pm_nospace": Export({"plant.csv": wide(lambda t:t.strftime('%m/%d/%Y %I:%M:%S%p'))}),
    "jp": Export({"plant.csv": wide(lambda t:t.strftime('%Y年%m月%d日 %H:%M:%S'))}),
    "year_h": Export({"plant.csv": wide(lambda t:t.strftime('%d/%m/%Y %Hh%M:%S'))}),
    "quotedtimes": Export({"plant.csv": wide(lambda t:"'"+iso(t)+"'")}),
    "tabs_trailing": Export({"plant.txt": wide(delimiter="\t",tail="\t")}),
    "blank_lines": Export({"plant.csv": wide().replace("\n","\n\n")}),
    "crcrlf": Export({"plant.csv": wide(line_end="\r\r\n")}),
    "empty_col_between": Export({"plant.csv": wide(name=lambda n:n+"," if n.endswith('OP') else n,value=lambda t,v:cell(t,v)+("," if t.endswith('OP') else ''))}),
    "name_first": Export({"plant.csv": wide(name=lambda n:n.split('.')[1]+"_"+n.split('.')[0])}),
    "name_suffix_avg": Export({"plant.csv": wide(name=lambda n:n+".AVG")}),
    "name_br": Export({"plant.csv": wide(name=lambda n:n.replace('.','[')+"]")}),
    "name_nosep": Export({"plant.csv": wide(name=lambda n:n.replace('.',''))}),
    "pm_behind_narrow_blank": Export({"plant.csv": wide(lambda t:'"'+t.strftime('%b %d, %Y, %I:%M:%S\u202f%p')+'"')}),
    "spanish_pm_hard_blank": Export({"plant.csv": wide(lambda t:t.strftime('%d/%m/%Y %I:%M:%S ')+('a.\u00a0m.' if t.hour<12 else 'p.\u00a0m.'))}),
    "epoch_in_t_stamp": Export({"plant.csv": long(lambda n,t,v:f"area1/{n.replace('.','/')},{v},192,{seconds(t)*1e3:.0f}","tagpath,floatvalue,dataintegrity,t_stamp")}),
    "epoch_in_ts_ms": Export({"plant.csv": long(lambda n,t,v:f"{seconds(t)*1e3:.0f},{n},{v}","ts_ms,metric,val")}),
    "pairs_wert": Export({"plant.csv": ";".join(f"{n} Zeitstempel;{n} Wert" for n in SIGNALS)+"\n"+"".join(";".join(f"{t:%d.%m.%Y %H:%M:%S};{comma(n, v[i])}" for n, v in SIGNALS.items())+"\n" for i,t in enumerate(STAMPS))}),
    "quality_of_profibus": Export({"plant.csv": long(lambda n,t,v:f"{n};{iso(t)};{v.replace('.',',')};128;0","Archive variable;Time stamp;Value;Quality code;Flags")}),
    "quality_yes": Export({"plant.csv": long(lambda n,t,v:f"{iso(t)};{n};{v.replace('.',',')};Y","Zeit;Tag;Wert;Gültig")}),
    "pairs_above_units": Export({"plant.csv": ",".join(f"{n}," for n in SIGNALS)+"\n"+",".join("Time,m3/h" for _ in SIGNALS)+"\n"+"".join(",".join(f"{iso(t)},{cell(n, v[i])}" for n, v in SIGNALS.items())+"\n" for i,t in enumerate(STAMPS))}),
    "pairs_tag_beside_unit": Export({"plant.csv": ",".join(f"{n},{'%' if n.endswith('OP') else 'm3/h'}" for n in SIGNALS)+"\n"+",".join("Time,Value" for _ in SIGNALS)+"\n"+"".join(",".join(f"{iso(t)},{cell(n, v[i])}" for n, v in SIGNALS.items())+"\n" for i,t in enumerate(STAMPS))}),
    "title_with_a_comma": Export({"plant.csv": wide(time_name=",".join(["",*(f'"{n[:-3]}, main feed"' for n in SIGNALS)]) + "\nTime", name=lambda n: n.rpartition(".")[2])}),
    "loop_signal_unit": Export({"plant.csv": long(lambda n,t,v:f"{';'.join(n.split('.'))};{iso(t)};{v.replace('.',',')};{'%' if n.endswith('OP') else 'bar' if n.startswith('P') else 'm3/h'}","Regler;Größe;Zeitpunkt;Messwert;Einheit")}),
    "name_comma": Export({"plant.csv": wide(name=lambda n: f'"{n.replace(".", ":MAIN,")}"')},settings=SETTINGS.replace("FIC101","'FIC101:MAIN'").replace("PIC303","'PIC303:MAIN'"),loops={"FIC101:MAIN":"FIC101","PIC303:MAIN":"PIC303"}),
    "described_behind_unit": Export({"plant.csv": wide(name=lambda n: f"{n} [m3/h] - Feed flow", delimiter=";")}),
    "string_view": Export({"plant.parquet": pa.table({"time": STAMPS, **{n: pa.array([cell(n, x) for x in v], pa.string_view()) for n, v in SIGNALS.items()}})}),
    "ticks": Export({"plant.csv": wide(lambda t: f"{(seconds(t)+62135596800)*1e7:.0f}", time_name="Ticks")}),
    "datenum": Export({"plant.csv": wide(lambda t: f"{seconds(t)/86400+719529:.8f}", time_name="datenum")}),
    "hda_hex": Export({"plant.csv": long(lambda n,t,v:f"{n};{iso(t)};{v};0x000C00C0","ItemID;Timestamp;Value;Quality")}),
    "hda_number": Export({"plant.csv": long(lambda n,t,v:f"{n};{iso(t)};{v};786624","ItemID;Timestamp;Value;Quality")}),
    "node_id": Export({"plant.csv": long(lambda n,t,v:f'"ns=2;s={n}",{iso(t)}Z,{v},0',"NodeId,SourceTimestamp,Value,StatusCode")}),
    "rockwell": Export({"plant.csv": wide(name=lambda n: n.replace(".OP", ".CVEU"))}),
    "status_nr": Export({"plant.csv": long(lambda n,t,v:f"{t:%Y/%m/%d %H:%M:%S},{n},{v},NR","Time,Tag,Value,Status")}),
    "times_of_loops": Export({"plant.csv": "Time,FIC101.OP,FIC101.PV,FIC101.SP,,Time,PIC303.OP,PIC303.PV,PIC303.SP\n"+"".join(f"{iso(t)},{row('FIC101', i)},,{iso(t)},{row('PIC303', i)}\n" for i,t in enumerate(STAMPS))}),
    "spanish_words": Export({f"{loop}.csv": "Fecha;Hora;Salida;Medida;Consigna\n"+"".join(f"{t:%d/%m/%Y;%H:%M:%S};{row(loop, i).replace(',',';').replace('.',',')}\n" for i,t in enumerate(STAMPS)) for loop in RANGES}),
    "german_words": Export({f"{loop}.csv": "Zeit;Stellgröße;Istwert;Sollwert\n"+"".join(f"{t:%d.%m.%Y %H:%M:%S};{row(loop, i).replace(',',';').replace('.',',')}\n" for i,t in enumerate(STAMPS)) for loop in RANGES}),
    "zip": Export({"plant.zip": packed({"export/day.csv": wide(), "read.me": "of the plant"})}),
    "zip_per_tag": Export({"plant.zip": packed({f"{n}.csv": "Timestamp,Value\n"+"".join(f"{iso(t)},{cell(n, x)}\n" for t,x in zip(STAMPS, v, strict=True)) for n, v in SIGNALS.items()})}),
    "half_of_day_column": Export({"plant.csv": wide(lambda t: f"{t:%m/%d/%Y,%I:%M:%S,%p}", time_name="Date,Time,AM/PM")}),
    "half_behind_stamp": Export({"plant.csv": wide(lambda t: f"{t:%m/%d/%Y %I:%M:%S},{t:%p}", time_name="Time,AM/PM")}),
    "half_iso_date": Export({"plant.csv": wide(lambda t: f"{t:%Y-%m-%d,%I:%M:%S,%p}", time_name="Date,Time,Half")}),
    "tag_behind_description": Export({"plant.csv": wide(name=lambda n: f"Feed {'setpoint' if n.endswith('SP') else 'flow'} [{n}]")}),
    "tag_in_second_line_of_cell": Export({"plant.csv": wide(name=lambda n: f'"Feed flow setpoint\n{n}\n[m3/h]"')}),
    "tag_before_its_value": Export({"plant.csv": wide(name=lambda n: f"Tag: {n}")}),
    "signal_said_twice": Export({"plant.csv": wide(name=renamed(SP="{} 設定値(SV)", PV="{} 測定値(PV)", OP="{} 操作量(MV)"))}),
    "rows_as_one_cell": Export({"plant.csv": '"' + wide().strip().replace("\n", '"\n"') + '"\n'}),
    "rows_as_one_cell_quoted": Export({"plant.csv": '"' + wide(iso, name=lambda n: f'""{n}""', line_end='"\r\n"').rstrip('"')}),
    "savetxt": Export({"plant.txt": wide(lambda t: f"{seconds(t):.18e}", delimiter=" ", before="# ", tail=" ")}),
    "pandas_levels": Export({"plant.csv": wide(name=lambda n: f'"{tuple(n.split("."))}"')}),
    "tag_name_above_descriptions": Export({"plant.txt": wide(delimiter="\t", time_name="Tag Name", between="Description\t" + "\t".join(["Feed flow"] * 6) + "\nUnits\t" + "\t".join(["m3/h", "%", "bar", "kW", "s", "t"]) + "\nTimestamp" + "\tValue" * 6)}),
    "rockwell_trend": Export({"plant.csv": wide(lambda t: f'"Data:","{t:%m/%d/%Y}","{t:%H:%M:%S};000"', time_name='"Header:","Date","Time"', before='"Trend Name:","Trend1"\n"Start Time:","03/17/2026","23:55:00;000"\n')}),
    "wincc_unified": Export({"plant.csv": long(lambda n, t, v: f'"HMI_RT_1::{n.replace(".", "_")}:LoggingTag_1";"{iso(t)}Z";"{v}";"Good"', "LoggingTag;Timestamp;Value;Quality")}),
    "abb_log": Export({"plant.csv": wide(name=lambda n: f'"$HS{n.replace(".OP", ".OUT").replace(".", ",")}-1-o"')}),
    "periods_in_file_names": Export({f"{n}_20260317235500_20260318000500.csv": "Timestamp,Value\n" + "".join(f"{iso(t)},{cell(n, x)}\n" for t, x in zip(STAMPS, v, strict=True)) for n, v in SIGNALS.items()}),
    "dates_in_file_names": Export({f"{n}_{part}.csv": "Timestamp,Value\n" + "".join(f"{iso(t)},{cell(n, x)}\n" for i, (t, x) in enumerate(zip(STAMPS, v, strict=True)) if i // 300 == k) for n, v in SIGNALS.items() for k, part in enumerate(["20260317", "2026-03-18"])}),
    "arrow": Export({"plant.csv": wide(name=lambda n: n.replace(".", "->"))}),
    "tag_alone_is_pv": Export({"plant.csv": wide(name=lambda n: n.removesuffix(".PV"))}, notes=("bare_pv",)),
    "tag_above_its_table": Export({f"export{k}.csv": f"Tag:,{n}\nDescription:,Feed flow\n\nTimestamp,Value\n" + "".join(f"{iso(t)},{cell(n, x)}\n" for t, x in zip(STAMPS, v, strict=True)) for k, (n, v) in enumerate(SIGNALS.items())}),
    "loops_of_dated_files": Export({f"{loop}_{part}.csv": "Time,OP,PV,SP\n" + "".join(f"{iso(t)},{row(loop, i)}\n" for i, t in enumerate(STAMPS) if i // 300 == k) for loop in RANGES for k, part in enumerate(["20260317", "2026-03-18"])}),
    "described_twin": Export({"plant.csv": wide(name=lambda n: n + (f',"High limit: {n}"' if n.endswith("PV") else ""), value=lambda t, v: cell(t, v) + (",7" if t.endswith("PV") else ""))}, notes=("several_columns",)),
    "sentence_above_values": Export({f"{n}.csv": f"Export of {n}\nTimestamp,Value\n" + "".join(f"{iso(t)},{cell(n, x)}\n" for t, x in zip(STAMPS, v, strict=True)) for n, v in SIGNALS.items()}),
    "thousands_points": Export({"plant.csv": wide(lambda t: f"{t:%d.%m.%Y %H:%M:%S}", delimiter=";", value=lambda n, v: f"{v:,.4f}".translate(str.maketrans(",.", ".,")).removesuffix(",0000"))}, settings=SETTINGS, tolerance=1e-4),
    "thousands_points_parquet": Export({"plant.parquet": pa.table({"time": STAMPS, **{n: [f"{1000 * x:,.3f}".translate(str.maketrans(",.", ".,")).removesuffix(",000") for x in v] for n, v in SIGNALS.items()}})}, settings=THOUSANDFOLD),
    "words_of_two_parts": Export({f"{loop}.csv": "Time,Output,Process Value,Setpoint\n" + "".join(f"{iso(t)},{row(loop, i)}\n" for i, t in enumerate(STAMPS)) for loop in RANGES}),
    "units_without_brackets": Export({"plant.csv": wide(name=lambda n: f"{n} {'%' if n.endswith('OP') else 'm3/h'}")}),
    "units_behind_slash": Export({"plant.csv": wide(name=lambda n: f"{n} / {'%' if n.endswith('OP') else 'bar'}")}),
    "units_below_qualities": Export({"plant.csv": wide(name=lambda n: f"{n},Quality", value=lambda n, v: f"{cell(n, v)},Good", between="," + ",".join("%," if n.endswith("OP") else "bar," for n in SIGNALS))}),
    "two_blanks_in_stamps": Export({"plant.csv": wide(lambda t: f"{t:%d-%b-%y  %H:%M:%S}")}),
    "day_of_access": Export({"plant.csv": wide(lambda t: f"{t:%d.%m.%Y} 00:00:00;30.12.1899 {t:%H:%M:%S}", delimiter=";", time_name="Datum;Uhrzeit", value=comma)}),
    "day_of_access_us": Export({"plant.csv": wide(lambda t: f"{t:%m/%d/%Y},12/30/1899 {t:%I:%M:%S %p}", time_name="Date,Time")}),
    "pq_time_of_day_as_text": Export({"plant.parquet": pa.table({"date": pa.array([t.date() for t in STAMPS]), "time": [f"{t:%H:%M:%S}" for t in STAMPS], **SIGNALS})}),
    "loop_in_two_cases": Export({"plant.csv": wide(name=lambda n: n.lower() if n.endswith("PV") else n)}),
    "folders_name_loops": Export({f"plant/{n.replace('.', '/')}.csv": "Timestamp,Value\n" + "".join(f"{iso(t)},{cell(n, x)}\n" for t, x in zip(STAMPS, v, strict=True)) for n, v in SIGNALS.items()}, inputs=("plant",)),
    "tag_of_settings_with_unit": Export({"plant.csv": wide(name=lambda n: rf"\\PISRV\{n.split('.')[0].replace('IC', 'T')} (m3/h)" if n.endswith("PV") else n)}, settings=SETTINGS.replace("[loops.FIC101]", '[loops.FIC101]\npv = "FT101"').replace("[loops.PIC303]", '[loops.PIC303]\npv = "PT303"')),
    "tag_of_settings_beside_another_unit": Export({"plant.csv": wide(name=lambda n: n.replace("FIC101.PV", "FT101 (avg),FT101 (max)"), value=lambda t, v: cell(t, v) + (",7" if t == "FIC101.PV" else ""))}, settings=SETTINGS.replace("[loops.FIC101]", '[loops.FIC101]\npv = "FT101 (avg)"')),
    "folder_of_loop_with_tag_files": Export({f"set/loop={n.split('.')[0]}/{n}.parquet": pa.table({"ts": STAMPS, "xyz": v}) for n, v in SIGNALS.items()}, inputs=("set",)),
    "no_header_but_the_file": Export({f"{n}.csv": "".join(f"{iso(t)},{cell(n, x)}\n" for t, x in zip(STAMPS, v, strict=True)) for n, v in SIGNALS.items()}),
    "quality_in_french": Export({"plant.csv": long(lambda n,t,v:f"{n};{t:%d/%m/%Y %H:%M:%S};{v.replace('.',',')};{'Mauvaise' if t == STAMPS[0] and n == 'PIC303.X' else 'Bonne'}","Repère;Horodate;Valeur;Qualité")}),
    "flags_of_values": Export({f"{n}.csv": "Timestamp,Value,Annotated,Questionable,Substituted\n" + "".join(f"{t:%m/%d/%Y %I:%M:%S %p},{cell(n, x)},False,False,False\n" for t, x in zip(STAMPS, v, strict=True)) for n, v in SIGNALS.items()}),
    "units_behind_in": Export({"plant.csv": wide(name=lambda n: f"{n} in {'%' if n.endswith('OP') else 'm3/h'}", delimiter=";")}),
    "tag_in_every_row": Export({"plant.txt": "".join(f"{n},{t:%d-%b-%y %H:%M:%S},{cell(n, v[i])}\n" for n, v in SIGNALS.items() for i, t in enumerate(STAMPS))}),
    "header_ends_with_a_tag": Export({"plant.csv": ",,".join(SIGNALS) + "\n" + "".join(",".join(f"{iso(t)},{cell(n, v[i])}" for n, v in SIGNALS.items()) + "\n" for i, t in enumerate(STAMPS))}),
    **{f"code_page_{page}_{words['PV']}": Export({"plant.csv": wide(lambda t, form=form: t.strftime(form), time_name=time, delimiter=";", name=lambda n, words=words: f"{n[:-2]}{words[n[-2:]]}").encode(page)}, notes=("encoding",)) for page, time, form, words in (
        ("cp932", "日時", "%Y年%m月%d日 %H時%M分%S秒", {"SP": "SV", "PV": "PV", "OP": "MV"}), ("cp932", "日時", "%Y/%m/%d %H:%M:%S", {"SP": "設定値", "PV": "測定値", "OP": "操作量"}),
        ("gb18030", "时间", "%Y-%m-%d %H:%M:%S", {"SP": "设定值", "PV": "测量值", "OP": "输出值"}), ("big5", "時間", "%Y/%m/%d %H:%M:%S", {"SP": "給定值", "PV": "過程值", "OP": "輸出值"}),
        ("cp1251", "Время", "%d.%m.%Y %H:%M:%S", {"SP": "Задание", "PV": "Измерение", "OP": "Выход"}), ("cp1252", "Zeit", "%d.%m.%Y %H:%M:%S", {"SP": "Sollwert", "PV": "Istwert", "OP": "Stellgröße"}),
        ("cp1250", "Data", "%Y-%m-%d %H:%M:%S", {"SP": " Wartość zadana", "PV": " Wartość mierzona", "OP": " Wyjście"}))},
}  # fmt: skip
for key, (separator, decimal, delimiter) in GROUPED.items():
    MORE[f"grouped_{key}"] = Export(
        {"plant.csv": wide(value=grouped(separator, decimal), delimiter=delimiter)}, settings=THOUSANDFOLD
    )


@pytest.mark.parametrize("key", MORE)
def test_rarer_export_gives_the_recording(key, tmp_path):
    same_recording(MORE[key], tmp_path, in_blocks=True)


@pytest.mark.parametrize(("text", "said"), [
    (wide(lambda t: f"2026,{13 + t.second % 5},{t:%d,%H,%M,%S}", time_name="Year,Month,Day,Hour,Minute,Second"), "Month"),
    (wide(lambda t: f"{t:%Y%m%d},{990000 + t.second}", time_name="Date,Time"), "time"),
    (wide(lambda t: f"{t:%Y,%m,%d}", time_name="Year,Month,Day"), "time"),
    (wide(name=renamed(SP="{}.PV_HH", PV="{}.PV_LL", OP="{}.PV_HI")), "SP, PV or OP"),
    ('{\n "data": [1, 2, 3]\n}\n', "JSON"),
])
def test_parts_that_make_no_time_or_loop_are_refused(tmp_path, text, said):
    (tmp_path / "plant.csv").write_text(text)
    with pytest.raises(BacklashError, match=said):
        read(tmp_path / "plant.csv")


@pytest.mark.parametrize(("row_of", "found"), [
    (lambda t, v: f"{iso(t)},{v}".replace(".", ","), 13),  # decimal commas between commas
    (lambda t, v: f"{t:%Y-%m-%d},{t:%H:%M:%S},x,{v}", 9),
    (lambda t, v: f"{iso(t)},7,{v}", 8)])
def test_a_header_that_names_too_few_columns_is_refused(tmp_path, row_of, found):
    """Which name belongs to which number cannot be known."""
    rows = [row_of(t, ",".join(f"{v[i]:.2f}" for v in SIGNALS.values())) for i, t in enumerate(STAMPS)]
    (tmp_path / "plant.csv").write_text("\n".join([",".join(["timestamp", *SIGNALS]), *rows]) + "\n")
    with pytest.raises(BacklashError, match=f"header names 7 columns, the rows below have {found} cells.*semicolon"):
        read(tmp_path / "plant.csv")


def test_a_tag_that_the_loops_file_names_goes_before_a_bare_one(tmp_path):
    (tmp_path / "plant.csv").write_text(wide(name=lambda n: n.removesuffix(".PV")))
    (tmp_path / "loops.toml").write_text(SETTINGS.replace("[loops.FIC101]", '[loops.FIC101]\npv = "FI101"'))
    plant = read(tmp_path / "plant.csv")
    assert [r.loop for r in plant] == ["PIC303"] and plant.failures[0].code == "tag_not_found"
    assert [r.loop for r in read(tmp_path / "plant.csv", options=ReadOptions(only_loops=("PIC303",)))] == ["PIC303"]


@pytest.mark.parametrize("below", [
    wide().replace("FIC101.PV,FIC101.OP", "FIC101.OP,FIC101.PV"),
    wide(name=lambda n: {"F": "PIC303", "P": "FIC101"}[n[0]] + n[6:])])
def test_a_header_that_comes_again_in_another_order_holds_for_the_rows_below_it(tmp_path, below):
    for name, text in (("one", wide() + below.replace("2026-03-1", "2026-04-1")), ("other", below)):
        (tmp_path / f"{name}.csv").write_text(text)
    (tmp_path / "loops.toml").write_text("[defaults]\nK = 1.0\nTi = 20.0\npv_range = [0, 1000]\nop_range = [0, 100]\n")
    one, other = (read(tmp_path / f"{name}.csv") for name in ("one", "other"))
    for record in other:
        both = one[record.loop]
        assert len(both) == 2 * len(record) and both.index[len(record)] - both.index[0] > 30 * 86_400
        for signal in ("setpoint", "measurement", "output"):
            assert np.array_equal(getattr(both, signal)[len(record) :], getattr(record, signal)) and np.isfinite(record.measurement).all()


def test_another_recording_in_the_same_file_is_no_clock_that_was_set_back(tmp_path):
    (tmp_path / "plant.csv").write_text("".join("Time,OP,PV,SP\n" + "".join(f"{iso(t)},{row(loop, i)}\n" for i, t in enumerate(STAMPS)) for loop in RANGES))
    with pytest.raises(BacklashError, match="most rows repeat a time stamp with another value"):
        read(tmp_path / "plant.csv")


def test_two_sources_of_one_tag_are_not_spread_over_the_time(tmp_path):
    """Stamps are cut to seconds or minutes; two rows every two seconds are two recordings."""
    rows = [f"{n},{iso(t)},{v[i] * factor:.3f}" for i, t in enumerate(STAMPS) if i % 2 == 0 for n, v in SIGNALS.items() for factor in (1.0, 1.03)]
    (tmp_path / "plant.csv").write_text("tag,time,value\n" + "\n".join(rows) + "\n")
    with pytest.raises(BacklashError, match="most rows repeat a time stamp with another value"):
        read(tmp_path / "plant.csv")


@pytest.mark.parametrize("moved", [
    lambda k: 0.7 * (k % 20 == 10), lambda k: 0.9 * (k // 20), lambda k: -0.9 * (k // 20), lambda k: 0.6 * (k // 100)])
def test_rows_between_others_and_clocks_that_slip_do_not_move_what_follows(tmp_path, moved):
    """Steps that are rounded one by one would add up to minutes."""
    begin, n = STAMPS[0], 3000
    times = sorted({2.0 * k + moved(k) for k in range(n)} | {2.0 * k for k in range(n) if moved(10) == 0.7})
    rows = (f"{begin + timedelta(seconds=t):%Y-%m-%dT%H:%M:%S.%f},50,{50 + t / 100:.4f},40" for t in times)
    (tmp_path / "FIC101.csv").write_text("Time,SP,PV,OP\n" + "\n".join(rows) + "\n")
    record = read(tmp_path / "FIC101.csv")["FIC101"]
    found = record.start + record.interval * record.index - seconds(begin)
    assert abs(found[-1] - times[-1]) <= 2.1
    value = record.measurement * (record.settings.pv_range[1] - record.settings.pv_range[0]) + record.settings.pv_range[0]
    assert abs((value - 50.0) * 100.0 - found)[record.usable].max() <= 1.6


def test_one_tag_for_two_signals_is_refused(tmp_path):
    (tmp_path / "plant.csv").write_text(wide())
    (tmp_path / "loops.toml").write_text(SETTINGS.replace("[loops.FIC101]", '[loops.FIC101]\nsp = "FIC101.PV"\npv = "FIC101.PV"'))
    plant = read(tmp_path / "plant.csv")
    assert [r.loop for r in plant] == ["PIC303"]
    assert "tag FIC101.PV stands for two of SP, PV and OP -> give each its own tag" in plant.failures[0].message


def test_a_column_called_questionable_marks_what_is_not_good(tmp_path):
    for n, values in SIGNALS.items():
        rows = [f"{iso(t)},{'0' if i % 50 == 7 else cell(n, v)},{i % 50 == 7}" for i, (t, v) in enumerate(zip(STAMPS, values, strict=True))]
        (tmp_path / f"{n}.csv").write_text("Timestamp,Value,Questionable\n" + "\n".join(rows) + "\n")
    (tmp_path / "loops.toml").write_text(SETTINGS)
    record = read(tmp_path)["FIC101"]
    assert (record.measurement > 0.3).all() and any(note.code == "bad_quality" for note in record.notes)


def test_milliseconds_may_stand_in_a_column_of_their_own(tmp_path):
    """As controllers log them: date, time of day, and what is behind the second."""
    times = [STAMPS[0] + timedelta(milliseconds=250 * i) for i in range(len(STAMPS))]
    rows = (f"{t:%m/%d/%Y;%H:%M:%S};{t.microsecond // 1000};{row('FIC101', i).replace(',', ';')}" for i, t in enumerate(times))
    (tmp_path / "FIC101.csv").write_text("Date;Time;Millitm;OP;PV;SP\n" + "\n".join(rows) + "\n")
    record = read(tmp_path / "FIC101.csv")["FIC101"]
    assert record.interval == 0.25 and len(record) == len(STAMPS) and record.start == seconds(STAMPS[0])


@pytest.mark.parametrize(("form", "name", "step"), [("%H%M%S", "Time", 1), ("%H%M", "Time", 60), ("%H%M%S", "HHMMSS", 1)])
def test_times_of_day_as_numbers_may_begin_at_midnight(tmp_path, form, name, step):
    """00:00:01 written as 1 is told from 00:01 by what follows."""
    begin = STAMPS[0].replace(hour=0, minute=0, second=0)
    times = [begin + timedelta(seconds=step * i) for i in range(1000 if name == "HHMMSS" else 3000)]
    rows = (f"{t:%Y%m%d},{int(t.strftime(form))},{50 + i % 7},{40 + i % 5},{i % 90}" for i, t in enumerate(times))
    (tmp_path / "FIC101.csv").write_text(f"Date,{name},SP,PV,OP\n" + "\n".join(rows) + "\n")
    record = read(tmp_path / "FIC101.csv")["FIC101"]
    assert record.interval == step and len(record) == len(times) and record.start == seconds(times[0])


def test_a_year_that_is_a_measurement_is_no_date(tmp_path):
    table = pa.table({"Time": [0, 1, 2], "year": [50.0, 51.0, 49.0], "month": [1, 2, 3], "day": [1, 2, 3],
                      "second": pa.array(STAMPS[:3], pa.timestamp("us")), "A.PV": [1.0, 2.0, 3.0], "A.OP": [1.0, 2.0, 3.0]})
    pq.write_table(table, tmp_path / "plant.parquet")
    assert read(tmp_path / "plant.parquet")["A"].start == seconds(STAMPS[0])
