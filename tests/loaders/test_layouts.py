"""Every usual way to write an export gives the same records."""

# One line per way of writing reads better than wrapped ones.
# ruff: noqa: E501

from __future__ import annotations

import bz2
import gzip
import lzma
from datetime import UTC, datetime, timedelta

import numpy as np
import pyarrow as pa
import pytest

from backlash_cli.loaders import ReadOptions, read

from .exports import DIGITS, RANGES, SETTINGS, SIGNALS, STAMPS, Export, arrow, cell, iso, long, wide
from .test_blocks import assert_same, read_in

EPOCH = datetime(1970, 1, 1)
MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]


def seconds(stamp: datetime) -> float:
    return (stamp - EPOCH).total_seconds()


def german(stamp: datetime) -> str:
    return stamp.strftime("%d.%m.%Y %H:%M:%S")


def comma(tag: str, value: float) -> str:
    return cell(tag, value).replace(".", ",")


def with_unit(tag: str, value: float) -> str:
    return f"{cell(tag, value)} {'%' if tag.endswith('OP') else 'bar'}"


def grouped(tag: str, value: float) -> str:
    return f'"{value * 1000:,.1f}"'


TIMES = {
    "iso": iso,
    "iso_blank": lambda t: t.strftime("%Y-%m-%d %H:%M:%S"),
    "iso_zulu": lambda t: iso(t) + "Z",
    "iso_micro": lambda t: iso(t) + ".000000",
    "iso_comma": lambda t: '"' + iso(t) + ',000"',
    "iso_offset_short": lambda t: iso(t + timedelta(hours=1)) + "+01",
    "iso_offset": lambda t: iso(t - timedelta(hours=5, minutes=30)) + "-05:30",
    "iso_offset_compact": lambda t: iso(t + timedelta(hours=2)) + "+0200",
    "iso_zone_word": lambda t: (t + timedelta(hours=1)).strftime("%Y-%m-%d %H:%M:%S CET"),
    "iso_utc_word": lambda t: t.strftime("%Y-%m-%d %H:%M:%S UTC"),
    "year_slash": lambda t: t.strftime("%Y/%m/%d %H:%M:%S"),
    "year_dot": lambda t: t.strftime("%Y.%m.%d %H:%M:%S"),
    "german": german,
    "german_milli": lambda t: t.strftime("%d.%m.%Y %H:%M:%S.000"),
    "german_short_year": lambda t: t.strftime("%d.%m.%y %H:%M:%S"),
    "finnish": lambda t: f"{t.day}.{t.month}.{t.year} {t.hour}.{t.minute:02d}.{t.second:02d}",
    "british": lambda t: t.strftime("%d/%m/%Y %H:%M:%S"),
    "dutch": lambda t: t.strftime("%d-%m-%Y %H:%M:%S"),
    "us": lambda t: t.strftime("%m/%d/%Y %H:%M:%S"),
    "us_am_pm": lambda t: t.strftime("%m/%d/%Y %I:%M:%S %p"),
    "us_bare": lambda t: f"{t.month}/{t.day}/{t.year} {t.hour % 12 or 12}:{t:%M:%S} {t:%p}",
    "us_milli": lambda t: t.strftime("%m/%d/%Y %H:%M:%S.000"),
    "pi": lambda t: t.strftime("%d-%b-%y %H:%M:%S"),
    "pi_long": lambda t: t.strftime("%d-%b-%Y %H:%M:%S.000000"),
    "month_name": lambda t: t.strftime("%d %B %Y %H:%M:%S"),
    "month_first": lambda t: '"' + t.strftime("%b %d, %Y %H:%M:%S") + '"',
    "at": lambda t: '"' + t.strftime("%b %d, %Y @ %H:%M:%S.000") + '"',
    "month_upper": lambda t: t.strftime("%d-%b-%Y %H:%M:%S").upper(),
    "german_month": lambda t: t.strftime("%d. März %Y %H:%M:%S"),
    "spanish_date": lambda t: t.strftime("%d de marzo de %Y %H:%M:%S"),
    "portuguese_date": lambda t: '"' + t.strftime("%d de março de %Y, %H:%M:%S") + '"',
    "french_month": lambda t: t.strftime("%d mars %Y %H:%M:%S"),
    "weekday": lambda t: t.strftime("%a %d %b %Y %H:%M:%S"),
    "compact": lambda t: t.strftime("%Y%m%d%H%M%S"),
    "compact_t": lambda t: t.strftime("%Y%m%dT%H%M%SZ"),
    "compact_blank": lambda t: t.strftime("%Y%m%d %H%M%S"),
    "epoch_s": lambda t: f"{seconds(t):.0f}",
    "epoch_s_fraction": lambda t: f"{seconds(t):.3f}",
    "epoch_ms": lambda t: f"{seconds(t) * 1e3:.0f}",
    "json_of_net": lambda t: f"/Date({seconds(t) * 1e3:.0f}+0000)/",
    "epoch_us": lambda t: f"{seconds(t) * 1e6:.0f}",
    "epoch_ns": lambda t: f"{int(seconds(t)) * 10**9}",
    "epoch_exponent": lambda t: f"{seconds(t):.9e}",
    "excel": lambda t: f"{seconds(t) / 86400 + 25569:.9f}",
}
NAMES = {
    "sv_mv": lambda n: n.replace("SP", "SV").replace("OP", "MV"),
    "lower": lambda n: n.lower().replace("fic", "FIC").replace("pic", "PIC"),
    "underscore": lambda n: n.replace(".", "_"),
    "dash": lambda n: n.replace(".", "-"),
    "slash": lambda n: n.replace(".", "/"),
    "blank": lambda n: n.replace(".", " "),
    "colon": lambda n: n.replace(".", ":"),
    "unit": lambda n: n + " [bar]",
    "unit_round": lambda n: n + " (m3/h)",
    "out_meas": lambda n: n.replace("OP", "OUT").replace("PV", "MEAS").replace("SP", "SPT"),
    "sw_iw": lambda n: n.replace("PV", "IW").replace("SP", "SW").replace("OP", "Y"),
    "words": lambda n: n.replace("OP", "Output").replace("PV", "Process Value").replace("SP", "Set Point"),
    "cv_attribute": lambda n: n + ".CV",
    "pi_path": lambda n: "\\\\PISRV01\\" + n,
    "deltav": lambda n: n.replace(".", "/PID1/") + ".CV",
}


def pairs(header: str, blank: bool = False, quality: bool = False) -> str:
    kept = {t: [i for i in range(len(STAMPS)) if t.endswith("PV") or i % (300 if t.endswith("SP") else 2) == 0]
            for t in SIGNALS}  # fmt: skip
    lines = [header]
    for row in range(len(STAMPS)):
        cells = []
        for tag, index in kept.items():
            if row < len(index):
                stamp = STAMPS[index[row]].strftime("%d-%b-%y %H:%M:%S")
                cells += [stamp, cell(tag, SIGNALS[tag][index[row]])] + (["Good"] if quality else [])
            else:
                cells += ["", ""] + ([""] if quality else [])
            cells += [""] if blank else []
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def influx() -> str:
    lines = []
    for table, (tag, values) in enumerate(SIGNALS.items()):
        loop, field = tag.split(".")
        if table % 3 == 0:
            lines += ["#group,false,false,true,false,false,true,true", "#default,_result,,,,,,",
                      "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,double,string,string",
                      ",result,table,_start,_time,_value,_field,_measurement"]  # fmt: skip
        lines += [f",,{table},2026-03-17T00:00:00Z,{iso(t)}Z,{cell(tag, v)},{field},{loop}"
                  for t, v in zip(STAMPS, values, strict=True)]  # fmt: skip
        lines += [""] if table % 3 == 2 else []
    return "\r\n".join(lines) + "\r\n"


def single(loop: str) -> str:
    rows = [f"{iso(t)},{','.join(cell(f'{loop}.{s}', SIGNALS[f'{loop}.{s}'][i]) for s in ('SP', 'PV', 'OP'))}"
            for i, t in enumerate(STAMPS)]  # fmt: skip
    return "\n".join(["Time,Setpoint,Measurement,Output", *rows]) + "\n"


def per_tag(tag: str, header: str = "Timestamp,Value") -> str:
    every = 300 if tag.endswith("SP") else 2 if tag.endswith("OP") else 1
    return "\n".join([header, *(f"{iso(STAMPS[i])},{cell(tag, SIGNALS[tag][i])}" for i in range(0, 600, every))]) + "\n"


def parquet_long(dictionary: bool) -> pa.Table:
    tags = [tag for tag in SIGNALS for _ in STAMPS]
    table = pa.table({
        "TagName": pa.array(tags).dictionary_encode() if dictionary else pa.array(tags, pa.large_string()),
        "DateTime": pa.array(STAMPS * len(SIGNALS), pa.timestamp("us")),
        "Value": np.concatenate(list(SIGNALS.values())),
        "Quality": pa.array([192] * len(tags), pa.int32()),
    })  # fmt: skip
    return table


def by_loop(loop: str) -> pa.Table:
    return pa.table({"ts": pa.array(STAMPS), **{k.split(".")[1]: v for k, v in SIGNALS.items() if k.startswith(loop)}})


def zone_local(zone: str, form: str = "%Y-%m-%d %H:%M:%S") -> str:
    from zoneinfo import ZoneInfo

    info = ZoneInfo(zone)
    return wide(lambda t: t.replace(tzinfo=UTC).astimezone(info).strftime(form))


NEAR = dict(tolerance=0.002)  # signals on their own times are held: SP and OP differ by up to one record
EXPORTS = {
    **{f"time_{key}": Export({"plant.csv": wide(time)}) for key, time in TIMES.items()},
    **{f"name_{key}": Export({"plant.csv": wide(name=name)}) for key, name in NAMES.items() if key != "deltav"},
    "semicolon": Export({"plant.csv": wide(delimiter=";")}),
    "semicolon_comma": Export({"plant.csv": wide(german, delimiter=";", value=comma)}),
    "semicolon_comma_unit": Export({"plant.csv": wide(german, delimiter=";", value=lambda t, v: comma(t, v) + " %")}),
    "tab_comma": Export({"plant.txt": wide(german, delimiter="\t", value=comma)}),
    "pipe": Export({"plant.txt": wide(delimiter="|")}),
    "caret": Export({"plant.txt": wide(delimiter="^")}),
    "quoted_comma": Export({"plant.csv": wide(value=lambda t, v: f'"{comma(t, v)}"')}),
    "sep_line": Export({"plant.csv": wide(delimiter=";", before="sep=;\n")}),
    "crlf_bom": Export({"plant.csv": ("\ufeff" + wide(line_end="\r\n")).encode()}),
    "mac": Export({"plant.csv": wide(line_end="\r")}),
    "utf16": Export({"plant.txt": wide(delimiter="\t", line_end="\r\n").encode("utf-16")}),
    "utf16_be": Export({"plant.txt": b"\xfe\xff" + wide(delimiter="\t").encode("utf-16-be")}),
    "utf16_no_mark": Export({"plant.txt": wide(delimiter="\t").encode("utf-16-le")}),
    "latin1_units": Export({"plant.csv": wide(between=",°C,°C,%,bar,bar,%").encode("latin-1")}),
    "gzip": Export({"plant.csv.gz": gzip.compress(wide().encode())}),
    "gzip_unnamed": Export({"plant.csv": gzip.compress(wide().encode())}),
    "gzip_members": Export({"plant.csv.gz": b"".join(gzip.compress(p) for p in (wide()[:9000].encode(), wide()[9000:].encode()))}),
    "zstd": Export({"plant.csv.zst": pa.Codec("zstd").compress(wide().encode(), asbytes=True)}),
    "bz2": Export({"plant.csv.bz2": bz2.compress(wide().encode())}),
    "xz": Export({"plant.csv.xz": lzma.compress(wide().encode())}),
    "units": Export({"plant.csv": wide(between=",m3/h,m3/h,%,bar,bar,%")}),
    "units_and_text": Export({"plant.csv": wide(between="Units,m3/h,m3/h,%,bar,bar,%\nDesc,Flow,Flow,Valve,Press,Press,Valve")}),
    "description_above": Export({"plant.csv": wide(before="Description,Feed flow,Feed flow,Feed flow,Steam,Steam,Steam\n")}),
    "dashes": Export({"plant.csv": wide(between="---,---,---,---,---,---,---")}),
    "preamble_hash": Export({"plant.csv": wide(before="# Historian\n# From 2026-03-17 08:00:00\n#\n")}),
    "preamble_text": Export({"plant.csv": wide(before="Plant report\nServer: HIST01\nStart,2026-03-17 08:00:00\nRows,600\n\n")}),
    "preamble_quoted": Export({"plant.csv": wide(before='"Report of 17 March, 2026"\n"Made by","J. Doe"\n')}),
    "preamble_long": Export({"plant.csv": wide(before="".join(f"Remark {i}: nothing, really\n" for i in range(70)))}),
    "commented_header": Export({"plant.csv": wide(time_name="# timestamp")}),
    "trailing": Export({"plant.csv": wide(tail=",,,")}),
    "trailing_data_only": Export({"plant.csv": wide(tail=",").replace(".OP,\n", ".OP\n", 1)}),
    "footer": Export({"plant.csv": wide() + "\nEnd of report\n"}),
    "footer_rows": Export({"plant.csv": wide() + "Total,600,,,,,\n"}),
    "header_again": Export({"plant.csv": "\n".join((x := wide().splitlines())[:300] + x[:1] + x[300:]) + "\n"}, notes=("unreadable_times",)),
    "padded": Export({"plant.csv": wide(value=lambda t, v: f"{cell(t, v):>12}")}),
    "plus_sign": Export({"plant.csv": wide(value=lambda t, v: "+" + cell(t, v))}),
    "exponent": Export({"plant.csv": wide(value=lambda t, v: f"{v:.8E}")}),
    "all_quoted": Export({"plant.csv": wide(lambda t: f'"{iso(t)}"', name=lambda n: f'"{n}"', value=lambda t, v: f'"{cell(t, v)}"')}),
    "units_in_cells": Export({"plant.csv": wide(value=with_unit)}),
    "date_and_time": Export({"plant.csv": wide(lambda t: t.strftime("%Y-%m-%d,%H:%M:%S"), time_name="Date,Time")}),
    "date_and_time_us": Export({"plant.csv": wide(lambda t: t.strftime("%m/%d/%Y,%I:%M:%S %p"), time_name="Date,Time")}),
    "date_and_time_de": Export({"plant.csv": wide(lambda t: t.strftime("%d.%m.%Y;%H:%M:%S"), time_name="Datum;Uhrzeit", delimiter=";", value=comma)}),
    "two_time_columns": Export({"plant.csv": wide(lambda t: f"{iso(t + timedelta(hours=1))},{iso(t)}", time_name="Local Time,UTC Time")}),
    "index_column": Export({"plant.csv": wide(lambda t: f"{int(seconds(t)) % 600},{iso(t)}", time_name="No,Timestamp")}),
    "index_beside_dates": Export({"plant.csv": wide(lambda t: f"{int(seconds(t)) % 600},{iso(t)}", time_name="Index,Recorded at")}),
    "time_last": Export({"plant.csv": "\n".join(",".join(r.split(",")[1:] + r.split(",")[:1]) for r in wide().splitlines()) + "\n"}),
    "two_header_lines": Export({"plant.csv": ",FIC101,FIC101,FIC101,PIC303,PIC303,PIC303\n" + wide(name=lambda n: n.split(".")[1])}),
    "two_header_lines_merged": Export({"plant.csv": ",FIC101,,,PIC303,,\n" + wide(name=lambda n: n.split(".")[1])}),
    "two_header_lines_units": Export({"plant.csv": ",FIC101,,,PIC303,,\n" + wide(name=lambda n: n.split(".")[1], between=",m3/h,m3/h,%,bar,bar,%")}),
    "two_header_lines_below": Export({"plant.csv": wide(name=lambda n: n.split(".")[0], between=",SP,PV,OP,SP,PV,OP")}),
    "timezone": Export({"plant.csv": zone_local("Europe/Berlin")}, options={"timezone": "Europe/Berlin"}),
    "region": Export({"plant.csv": zone_local("Europe/Berlin", "%Y-%m-%dT%H:%M:%S[Europe/Berlin]")}),
    "region_in_capitals": Export({"plant.csv": zone_local("Europe/Berlin", "%d-%b-%y %I.%M.%S.%f %p EUROPE/BERLIN")}),
    "time_format": Export({"plant.csv": wide(lambda t: t.strftime("%S.%M.%H of %d %m %Y"))}, options={"time_format": "%S.%M.%H of %d %m %Y"}),
    "no_header": Export({"plant.csv": wide().split("\n", 1)[1]}, options={"columns": ("timestamp", *SIGNALS)}),
    "deltav": Export({"plant.csv": wide(name=NAMES["deltav"])}, loops={"FIC101/PID1": "FIC101", "PIC303/PID1": "PIC303"}, settings=SETTINGS.replace("101]", '101/PID1"]').replace("303]", '303/PID1"]').replace("loops.", 'loops."')),
    "null_words": Export({"plant.csv": wide(name=lambda n: n + ",X" if n == "PIC303.OP" else n, value=lambda t, v: cell(t, v) + (",null" if t == "PIC303.OP" else ""))}),
    "long_time_order": Export({"plant.csv": long(lambda n, t, v: f"{n},{iso(t)},{v},Good", "tag,timestamp,value,quality")}),
    "long_tag_order": Export({"plant.csv": long(lambda n, t, v: f"{iso(t)};{n};{v.replace('.', ',')}", "DateTime;TagName;Value", by_tag=True)}),
    "long_opc": Export({"plant.csv": long(lambda n, t, v: f"{n},{v},{iso(t)},192", "Name,Val,TS,Quality")}),
    "long_percent": Export({"plant.csv": long(lambda n, t, v: f"{n},{t.strftime('%m/%d/%Y %H:%M:%S.000')},{v},100", "Tagname,TimeStamp,Value,Confidence", before="*Exported\n*\n[Data]\n")}),
    "long_epoch": Export({"plant.csv": long(lambda n, t, v: f"{n},{seconds(t):.0f},{v}", "point,epoch,val")}),
    "long_unnamed": Export({"plant.csv": long(lambda n, t, v: f"{n},{iso(t)},{v}", "what,when,how much")}),
    "long_loop_signal": Export({"plant.csv": long(lambda n, t, v: f"{','.join(n.split('.'))},{iso(t)},{v}", "loop,signal,time,value")}),
    "influx": Export({"plant.csv": influx()}),
    "pairs": Export({"plant.csv": pairs(",".join(f"{t} Time,{t}" for t in SIGNALS))}, **NEAR),
    "pairs_axes": Export({"plant.csv": pairs(",".join(f"{t} ValueX,{t} ValueY" for t in SIGNALS))}, **NEAR),
    "pairs_same_name": Export({"plant.csv": pairs(",".join(f"Time,{t}" for t in SIGNALS))}, **NEAR),
    "pairs_two_lines": Export({"plant.csv": pairs(",".join(f"{t}," for t in SIGNALS) + "\n" + ",".join("Timestamp,Value" for _ in SIGNALS))}, **NEAR),
    "pairs_blank": Export({"plant.csv": pairs(",".join(f"{t} Time,{t}," for t in SIGNALS), blank=True)}, **NEAR),
    "pairs_quality": Export({"plant.csv": pairs(",".join(f"{t} Time,{t},{t} Quality" for t in SIGNALS), quality=True)}, **NEAR),
    "singles": Export({f"{loop}.csv": single(loop) for loop in RANGES}),
    "per_tag": Export({f"{t}.csv": per_tag(t) for t in SIGNALS}, **NEAR),
    "per_tag_named": Export({f"export{i}.csv": per_tag(t, f"Date,{t}") for i, t in enumerate(SIGNALS)}, **NEAR),
    "per_tag_underscore_gz": Export({f"{t.replace('.', '_')}.csv.gz": gzip.compress(per_tag(t, "ts,val").encode()) for t in SIGNALS}, **NEAR),
    "folder": Export({f"night/{loop}.csv": single(loop) for loop in RANGES}, inputs=("night",)),
    "halves": Export({"b.csv": (w := wide()).split("\n", 1)[0] + "\n" + "\n".join(w.splitlines()[301:]) + "\n", "a.csv": "\n".join(w.splitlines()[:301]) + "\n"}),
    "tall": Export({"plant.csv": "\n".join(["Loop,Time,SP,PV,OP", *(f"{loop},{row}" for loop in RANGES for row in single(loop).splitlines()[1:])]) + "\n"}),
    **{f"parquet_{u}": Export({"plant.parquet": arrow(u)}) for u in ("s", "ms", "us", "ns")},
    "parquet_zone": Export({"plant.parquet": arrow("ns", "America/New_York")}),
    "parquet_text_time": Export({"plant.parquet": arrow().set_column(0, "t", pa.array([iso(t) for t in STAMPS]))}),
    "parquet_epoch": Export({"plant.parquet": arrow().set_column(0, "time", pa.array([int(seconds(t)) * 1000 for t in STAMPS]))}),
    "parquet_float32": Export({"plant.parquet": pa.table({"timestamp": pa.array(STAMPS), **{k: v.astype(np.float32) for k, v in SIGNALS.items()}})}, tolerance=1e-6),
    "parquet_index_last": Export({"plant.parquet": arrow().select([*range(1, 7), 0]).rename_columns([*SIGNALS, "__index_level_0__"])}),
    "parquet_long": Export({"plant.parquet": parquet_long(False)}),
    "parquet_long_dictionary": Export({"plant.parquet": parquet_long(True)}),
    "dataset": Export({f"set/loop={loop}/part-0.parquet": by_loop(loop) for loop in RANGES}, inputs=("set",)),
    "dataset_days": Export({f"set/loop={loop}/day={d}/p.parquet": by_loop(loop).slice(300 * d, 300) for loop in RANGES for d in (0, 1)}, inputs=("set",)),
    "dataset_wide_days": Export({f"set/day={d}/p.parquet": arrow().slice(200 * d, 200) for d in (2, 0, 1)}, inputs=("set",)),
    "csv_days": Export({f"set/day={d}/p.csv": "\n".join(wide().splitlines()[:1] + wide().splitlines()[1 + 200 * d : 201 + 200 * d]) for d in (2, 0, 1)}, inputs=("set",)),
}  # fmt: skip


@pytest.mark.parametrize("key", EXPORTS)
def test_export_gives_the_recording(key, tmp_path):
    same_recording(EXPORTS[key], tmp_path, in_blocks=True)


def same_recording(export, tmp_path, in_blocks=False):
    """Hold the records of an export to the recording it was made from, and to what is read of it block by block."""
    inputs, options = export.write(tmp_path), ReadOptions(**export.options)
    plant = read(inputs, options=options)
    assert not plant.failures
    if in_blocks:
        assert_same(plant, read_in(inputs, options, block=20_001))
    assert {r.loop for r in plant} == set(export.loops)
    for name, origin in export.loops.items():
        record = plant[name]
        low, high = RANGES[origin]
        assert record.settings.K == 0.9
        assert record.interval == 1.0
        assert len(record) == 600 and np.array_equal(record.index, np.arange(600))
        assert record.start == seconds(export.start)
        assert record.usable.all()
        near = 1e-6 if export.tolerance < 1e-6 else 2e-4
        np.testing.assert_allclose(record.measurement * (high - low) + low, SIGNALS[f"{origin}.PV"], atol=near * high)
        assert record.output is not None
        gap = 0.05 if export.tolerance > 1e-3 else near
        np.testing.assert_allclose(record.setpoint * (high - low) + low, SIGNALS[f"{origin}.SP"], rtol=near)
        assert np.abs(record.output - SIGNALS[f"{origin}.OP"] / 100).max() < gap
        codes = {note.code for note in record.notes} | {note.code for note in plant.warnings}
        assert set(export.notes) <= codes


def test_thousands_separators(tmp_path):
    (tmp_path / "plant.csv").write_text(wide(value=grouped))
    settings = SETTINGS.replace("900.0", "900000.0").replace("16.0", "16000.0").replace("[0, 100]", "[0, 100000]")
    (tmp_path / "loops.toml").write_text(settings)
    record = read(tmp_path / "plant.csv")["FIC101"]
    np.testing.assert_allclose(record.measurement * 900, SIGNALS["FIC101.PV"], atol=1e-3)
    assert DIGITS["FIC101"] == 2
