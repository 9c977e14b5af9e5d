"""Rarer ways to write an export, each found in some product or spreadsheet; they too give the same records."""

# One line per way of writing reads better than wrapped ones.
# ruff: noqa: E501

from __future__ import annotations

import io
import zipfile

import pyarrow as pa
import pytest

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


MORE = {
    "lead_index": Export({"plant.csv": "\n".join((f",{r}" if i==0 else f"{i-1},{r}") for i,r in enumerate(wide().splitlines()))+"\n"}),
    "unit1": Export({"plant.csv": wide(name=lambda n:"AREA1/"+n)}),
    "described": Export({"plant.csv": wide(name=lambda n: f"{n} - Feed flow, unit 7", delimiter=";")}),
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
    "loop_signal_unit": Export({"plant.csv": long(lambda n,t,v:f"{';'.join(n.split('.'))};{iso(t)};{v.replace('.',',')};{'%' if n.endswith('OP') else 'bar' if n.startswith('P') else 'm3/h'}","Regler;Größe;Zeitpunkt;Messwert;Einheit")}),
    "name_comma": Export({"plant.csv": wide(name=lambda n: f'"{n.replace(".", ":MAIN,")}"')},settings=SETTINGS.replace("FIC101","'FIC101:MAIN'").replace("PIC303","'PIC303:MAIN'"),loops={"FIC101:MAIN":"FIC101","PIC303:MAIN":"PIC303"}),
    "described_behind_unit": Export({"plant.csv": wide(name=lambda n: f"{n} [m3/h] - Feed flow", delimiter=";")}),
    "string_view": Export({"plant.parquet": pa.table({"time": STAMPS, **{n: pa.array([cell(n, x) for x in v], pa.string_view()) for n, v in SIGNALS.items()}})}),
    "ticks": Export({"plant.csv": wide(lambda t: f"{(seconds(t)+62135596800)*1e7:.0f}", time_name="Ticks")}),
    "datenum": Export({"plant.csv": wide(lambda t: f"{seconds(t)/86400+719529:.8f}", time_name="datenum")}),
    "hda_hex": Export({"plant.csv": long(lambda n,t,v:f"{n};{iso(t)};{v};0x000C00C0","ItemID;Timestamp;Value;Quality")}),
    "hda_number": Export({"plant.csv": long(lambda n,t,v:f"{n};{iso(t)};{v};786624","ItemID;Timestamp;Value;Quality")}),
    "times_of_loops": Export({"plant.csv": "Time,FIC101.OP,FIC101.PV,FIC101.SP,,Time,PIC303.OP,PIC303.PV,PIC303.SP\n"+"".join(f"{iso(t)},{row('FIC101', i)},,{iso(t)},{row('PIC303', i)}\n" for i,t in enumerate(STAMPS))}),
    "spanish_words": Export({f"{loop}.csv": "Fecha;Hora;Salida;Medida;Consigna\n"+"".join(f"{t:%d/%m/%Y;%H:%M:%S};{row(loop, i).replace(',',';').replace('.',',')}\n" for i,t in enumerate(STAMPS)) for loop in RANGES}),
    "german_words": Export({f"{loop}.csv": "Zeit;Stellgröße;Istwert;Sollwert\n"+"".join(f"{t:%d.%m.%Y %H:%M:%S};{row(loop, i).replace(',',';').replace('.',',')}\n" for i,t in enumerate(STAMPS)) for loop in RANGES}),
    "zip": Export({"plant.zip": packed({"export/day.csv": wide(), "read.me": "of the plant"})}),
    "zip_per_tag": Export({"plant.zip": packed({f"{n}.csv": "Timestamp,Value\n"+"".join(f"{iso(t)},{cell(n, x)}\n" for t,x in zip(STAMPS, v, strict=True)) for n, v in SIGNALS.items()})}),
}  # fmt: skip
for key, (separator, decimal, delimiter) in GROUPED.items():
    MORE[f"grouped_{key}"] = Export(
        {"plant.csv": wide(value=grouped(separator, decimal), delimiter=delimiter)}, settings=THOUSANDFOLD
    )


@pytest.mark.parametrize("key", MORE)
def test_rarer_export_gives_the_recording(key, tmp_path):
    same_recording(MORE[key], tmp_path)
