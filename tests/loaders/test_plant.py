"""Whole plants: several files, folders, sidecars, damage, and one clear message for each."""

from __future__ import annotations

import gzip
import os
import re
import zipfile
from datetime import timedelta

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from backlash_cli.errors import BacklashError, InputError, LoopError, MetadataError, UsageError
from backlash_cli.loaders import ReadOptions, read
from backlash_cli.record import SampleState

from .exports import SETTINGS, SIGNALS, STAMPS, arrow, cell, iso, long, wide


def save(folder, text, name="plant.csv", settings=SETTINGS):
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    if settings is not None:
        (folder / "loops.toml").write_text(settings, encoding="utf-8")
    return folder / name


def codes(notes):
    return [note.code for note in notes]


def edited(rows, column, texts):
    """The plain export with other texts in one column."""
    lines = [line.split(",") for line in wide().splitlines()]
    for row, text in zip(rows, texts, strict=True):
        lines[row + 1][column] = text
    return "\n".join(",".join(cells) for cells in lines) + "\n"


PV = 2  # column of FIC101.PV


def test_digital_states_are_missing_and_counted(tmp_path):
    words = [
        "Bad Input",
        "I/O Timeout",
        "[-11059] No Good Data",
        "#VALUE!",
        "kein Wert",
        "404.73 Bad",
        "?",
        "Bad",
        "nan",
        "-inf",
    ]
    plant = read(save(tmp_path, edited(range(100, 120), PV, words * 2)))
    record = plant["FIC101"]
    assert (record.state[100:120] == SampleState.MISSING).all() and record.usable.sum() == 580
    assert "not_numbers" in codes(record.notes)
    assert "Bad Input" in next(n.message for n in record.notes if n.code == "not_numbers")
    assert plant["PIC303"].usable.all()


def test_short_faults_are_filled_on_a_line(tmp_path):
    record = read(save(tmp_path, edited([50, 200, 201, 300], PV, ["Bad", "", "", "1e308"])))["FIC101"]
    assert (record.state[[50, 200, 201, 300]] == SampleState.FILLED).all() and record.usable.all()
    assert record.measurement[50] == pytest.approx((record.measurement[49] + record.measurement[51]) / 2)


def test_another_unit_in_a_few_cells_is_no_measurement(tmp_path):
    text = wide(value=lambda t, v: f"{cell(t, v)} {'%' if t.endswith('OP') else 'm3/h'}").split("\n")
    for row in range(300, 320):
        text[row] = text[row].replace(" m3/h", " l/s")
    record = read(save(tmp_path, "\n".join(text)))["FIC101"]
    assert record.usable.sum() == 580


@pytest.mark.parametrize(
    ("good", "bad"),
    [("Good", "Bad"), ("GOOD", "UNCERTAIN"), ("192", "0"), ("192", "24"), ("216", "64"), ("100", "0"),
     ("0", "2147483648"), ("Good, NonSpecific", "Bad, Comm Failure"), ("ok", "stale"), ("", "Bad"), ("1", "0")],
)  # fmt: skip
def test_quality_marks_are_no_measurements(tmp_path, good, bad):
    spoiled = set(range(100, 130))

    def row(tag, stamp, value):
        i = int((stamp - STAMPS[0]).total_seconds())
        wrong = tag == "FIC101.PV" and i in spoiled
        return f'{tag},{iso(stamp)},{"0.00" if wrong else value},"{bad if wrong else good}"'

    record = read(save(tmp_path, long(row, "tag,time,value,quality")))["FIC101"]
    assert (record.state[100:130] == SampleState.MISSING).all()
    assert record.usable.sum() == 570
    assert "bad_quality" in codes(record.notes)


@pytest.mark.parametrize("name", ["{}.Quality", "{} Status", "{}_Q", "Quality", "{}.ST"])
def test_quality_columns_beside_values(tmp_path, name):
    names = [x for tag in SIGNALS for x in (tag, name.format(tag))]
    lines = [",".join(["timestamp", *names])]
    for i, stamp in enumerate(STAMPS):
        wrong = 100 <= i < 130
        pairs = [
            ("0.0,Bad" if wrong and tag == "FIC101.PV" else f"{cell(tag, v[i])},Good") for tag, v in SIGNALS.items()
        ]
        lines.append(",".join([iso(stamp), *pairs]))
    record = read(save(tmp_path, "\n".join(lines) + "\n"))["FIC101"]
    assert (record.state[100:130] == SampleState.MISSING).all() and record.usable.sum() == 570


def test_a_quality_that_is_unknown_can_be_named(tmp_path):
    text = long(lambda n, t, v: f"{n},{iso(t)},{v},{'Fein' if t.second % 9 else 'Grob'}", "tag,time,value,quality")
    path = save(tmp_path, text)
    with pytest.raises(BacklashError):
        read(path)
    assert read(path, options=ReadOptions(good_quality=("fein", "grob")))["FIC101"].usable.all()


@pytest.mark.parametrize(
    ("auto", "manual"),
    [
        ("AUTO", "MAN"),
        ("Automatik", "Hand"),
        ("1", "0"),
        ("CAS", "LO"),
        ("16", "8"),
        ("RCAS", "IMAN"),
        ("2", "0"),
        ("AUTO", "HOLD"),
    ],
)
def test_manual_operation_is_marked(tmp_path, auto, manual):
    lines = wide().splitlines()
    lines = [
        f"{line},{'FIC101.MODE' if i == 0 else manual if 200 < i <= 300 else auto}" for i, line in enumerate(lines)
    ]
    record = read(save(tmp_path, "\n".join(lines) + "\n"))["FIC101"]
    assert np.array_equal(np.flatnonzero(record.state == SampleState.MANUAL), np.arange(200, 300))


def test_mode_recorded_on_change_only(tmp_path):
    rows = [f"{tag},{iso(t)},{cell(tag, v[i])}" for tag, v in SIGNALS.items() for i, t in enumerate(STAMPS)]
    rows += [f"FIC101.MODE,{iso(STAMPS[i])},{word}" for i, word in ((200, "MAN"), (300, "AUTO"))]
    record = read(save(tmp_path, "\n".join(["tag,time,value", *rows]) + "\n"))["FIC101"]
    assert np.array_equal(np.flatnonzero(record.state == SampleState.MANUAL), np.arange(200, 300))
    assert "mode_unknown" in codes(record.notes)


def test_two_files_of_one_loop_keep_the_gap(tmp_path):
    lines = wide().splitlines()
    later = wide(lambda t: iso(t + timedelta(days=90))).splitlines()
    a = save(tmp_path, "\n".join(lines) + "\n", "a.csv")
    b = save(tmp_path, "\n".join(later) + "\n", "b.csv")
    record = read([b, a])["FIC101"]
    assert len(record) == 1200
    assert (
        record.index[600] == 90 * 86400
        and record.start == (STAMPS[0] - STAMPS[0].__class__(1970, 1, 1)).total_seconds()
    )
    assert "gaps" in codes(record.notes)


def test_files_with_the_same_stamps_are_read_as_each_by_itself(tmp_path):
    """Their grid is worked out once; rows out of order in between, and one row less, are not taken for the same."""
    header, *rows = wide().splitlines()
    shuffled = [*rows[300:], *rows[:300]]
    exports = {"FIC201": rows, "FIC202": rows, "FIC203": shuffled, "FIC204": shuffled, "FIC205": rows[:-1],
               "FIC206": [*rows[:50], rows[49], *rows[50:]], "FIC207": rows, "FIC208": [*rows[:99], *rows[105:]]}
    for loop, lines in exports.items():
        save(tmp_path, "\n".join([header.replace("FIC101", loop), *lines]) + "\n", f"{loop}.csv")
    together = read(tmp_path)
    for loop in exports:
        alone = read(tmp_path / f"{loop}.csv")[loop]
        assert np.array_equal(together[loop].index, alone.index)
        assert np.array_equal(together[loop].measurement, alone.measurement, equal_nan=True)
        assert [note.message for note in together[loop].notes] == [note.message for note in alone.notes]
    assert len(together["FIC205"]) == 599 and "unsorted" in codes(together["FIC204"].notes)
    assert "unsorted" not in codes(together["FIC202"].notes)


def test_the_same_export_twice_is_one(tmp_path):
    path = save(tmp_path, wide())
    pq.write_table(arrow(), tmp_path / "copy.parquet")
    record = read([path, tmp_path / "copy.parquet"])["FIC101"]
    assert len(record) == 600 and "duplicate_times" in codes(record.notes)
    assert len(read([path, path])["FIC101"]) == 600


def test_rows_in_any_order_give_the_same(tmp_path):
    lines = wide().splitlines()
    turned = [lines[0], *np.random.default_rng(0).permutation(lines[1:])]
    plain = read(save(tmp_path, "\n".join(lines)))["FIC101"]
    mixed = read(save(tmp_path, "\n".join(turned)))["FIC101"]
    assert np.array_equal(plain.measurement, mixed.measurement) and "unsorted" in codes(mixed.notes)


def test_explicit_tags_of_the_metadata(tmp_path):
    names = dict(zip(SIGNALS, ("SC211.X", "FT211", "FV211", "PC7", "PT7", "PV7"), strict=True))
    settings = """
[loops.FIC101]
K = 1.0
Ti = 20
pv_range = [0, 900]
op_range = [0, 100]
sp = "SC211.X"
pv = "ft211"
op = "FV211"
"""
    plant = read(save(tmp_path, wide(name=names.__getitem__), settings=settings))
    assert [r.loop for r in plant] == ["FIC101"]
    np.testing.assert_allclose(plant["FIC101"].measurement * 900, SIGNALS["FIC101.PV"], atol=1e-6)


def test_a_tag_that_the_metadata_give_to_another_loop_stays_in_its_own(tmp_path):
    cascade = SETTINGS.replace("[loops.FIC101]", '[loops.FIC101]\nsp = "PIC303.OP"')
    plant = read(save(tmp_path, wide(), settings=cascade))  # PIC303 gives FIC101 its setpoint
    np.testing.assert_allclose(plant["PIC303"].output * 100, SIGNALS["PIC303.OP"], atol=1e-6)
    np.testing.assert_allclose(plant["FIC101"].setpoint * 900, SIGNALS["PIC303.OP"], atol=1e-6)
    assert "shared_tag" not in codes(plant.warnings)
    (said,) = (note for note in plant["PIC303"].notes if note.code == "cascade")
    assert said.values["effect"] == "limits" and "setpoint of FIC101" in said.message
    assert "cascade" not in codes(plant["FIC101"].notes)
    twice = SETTINGS.replace("[loops.FIC101]", '[loops.FIC101]\npv = "PIC303.PV"')
    plant = read(save(tmp_path, wide(), settings=twice))
    assert np.isfinite(plant["PIC303"].measurement).all()
    said = next(n.message for n in plant.warnings if n.code == "shared_tag")
    assert "PIC303.PV is the PV of FIC101, PIC303" in said


def test_a_signal_named_for_another_role_of_its_own_loop_is_one_tag_for_two(tmp_path):
    wrong = SETTINGS.replace("[loops.FIC101]", '[loops.FIC101]\nop = "FIC101.PV"')
    plant = read(save(tmp_path, wide(), settings=wrong))
    assert [note.code for note in plant.failures] == ["same_tag"] and "FIC101.PV" in plant.failures[0].message


def test_stamps_that_change_from_counts_to_dates_are_told(tmp_path):
    lines = wide().splitlines()
    for k in range(1, 301):
        rest = lines[k].partition(",")[2]
        lines[k] = f"{STAMPS[k - 1].timestamp():.0f},{rest}"
    record = read(save(tmp_path, "\n".join(lines) + "\n"))["FIC101"]
    assert "300 rows without a readable time stamp were dropped, the first in line 2" in " ".join(
        note.message for note in record.notes)
    assert len(record) == 300


def test_a_setpoint_column_without_numbers_is_none(tmp_path):
    record = read(save(tmp_path, edited(range(600), 1, [""] * 600)))["FIC101"]
    assert record.usable.all() and [note.code for note in record.notes].count("no_setpoint") == 1


def test_files_in_different_units_are_told(tmp_path):
    half = [*range(300)], [*range(300, 600)]
    lines = wide().splitlines()
    save(tmp_path, "\n".join([lines[0], *(lines[k + 1] for k in half[0])]) + "\n", "a.csv")
    other = wide(value=lambda tag, value: cell(tag, value / (9.0 if tag.startswith("FIC101") else 1.0))).splitlines()
    save(tmp_path, "\n".join([other[0], *(other[k + 1] for k in half[1])]) + "\n", "b.csv")
    plant = read([tmp_path / "a.csv", tmp_path / "b.csv"])
    said = next(note for note in plant["FIC101"].notes if note.code == "unit_change")
    assert said.values == {"samples": 300, "effect": "blocks"} and "unit_change" not in codes(plant["PIC303"].notes)


def test_the_line_of_tags_that_the_settings_name_is_the_header(tmp_path):
    names = dict(zip(SIGNALS, ("SC211.X", "FT211", "FV211.CMD", "PC7", "PT7", "PV7"), strict=True))
    settings = SETTINGS
    for loop, tags in (("FIC101", ("SC211.X", "FT211", "FV211.CMD")), ("PIC303", ("PC7", "PT7", "PV7"))):
        given = "".join(f'{role} = "{tag}"\n' for role, tag in zip(("sp", "pv", "op"), tags, strict=True))
        settings = settings.replace(f"[loops.{loop}]\n", f"[loops.{loop}]\n{given}")
    head, *rows = wide(name=names.__getitem__).splitlines()
    words = ",Setpoint feed,Measured feed,Valve feed,Setpoint header,Measured header,Valve header"
    for lines in ([head, words, *rows], [words, head, *rows]):
        plant = read(save(tmp_path, "\n".join(lines) + "\n", settings=settings))
        assert sorted(r.loop for r in plant) == ["FIC101", "PIC303"]
        np.testing.assert_allclose(plant["PIC303"].output * 100, SIGNALS["PIC303.OP"], atol=1e-6)


@pytest.mark.parametrize("spelt", ["{}", "LOOP.{}"])
def test_columns_that_are_called_alike_in_the_files_of_several_loops(tmp_path, spelt):
    settings = SETTINGS
    for loop in ("FIC101", "PIC303"):
        tags = "".join(f'{r} = "{spelt.format(c).replace("LOOP", loop)}"\n' for r, c in zip(("sp", "pv", "op"), "wxy",
                                                                                         strict=True))
        settings = settings.replace(f"[loops.{loop}]\n", f"[loops.{loop}]\n{tags}")
        lines = [line.split(",") for line in wide().splitlines()[1:]]
        place = 1 if loop == "FIC101" else 4
        rows = [",".join([line[0], *line[place : place + 3]]) for line in lines]
        save(tmp_path, "\n".join(["Zeit,w,x,y", *rows]) + "\n", f"{loop}.csv", settings)
    plant = read([tmp_path / "FIC101.csv", tmp_path / "PIC303.csv"])
    assert not plant.failures
    for loop, span in (("FIC101", 900.0), ("PIC303", 16.0)):
        record = plant[loop]
        low, high = record.settings.pv_range
        np.testing.assert_allclose(record.measurement * (high - low) + low, SIGNALS[f"{loop}.PV"], atol=1e-6 * span)


def test_extra_columns_are_disturbances(tmp_path):
    lines = wide().splitlines()
    lines = [f"{line},{'FIC101.DV1' if i == 0 else i}" for i, line in enumerate(lines)]
    record = read(save(tmp_path, "\n".join(lines) + "\n"))["FIC101"]
    assert np.array_equal(record.disturbances["DV1"], np.arange(1, 601))


def test_constant_setpoint_from_the_metadata(tmp_path):
    lines = [",".join(np.delete(line.split(","), 1)) for line in wide().splitlines()]
    path = save(tmp_path, "\n".join(lines) + "\n", settings=SETTINGS)
    record = read(path)["FIC101"]
    assert np.isnan(record.setpoint).all() and "no_setpoint" in codes(record.notes)
    path = save(tmp_path, "\n".join(lines) + "\n", settings=SETTINGS.replace("FIC101]\n", "FIC101]\nsp = 405.0\n"))
    assert np.allclose(read(path)["FIC101"].setpoint, 0.45)


def test_interpolation_can_be_chosen(tmp_path):
    rng = np.random.default_rng(1)
    rows = []
    for tag, values in SIGNALS.items():
        keep = range(600) if tag.endswith("SP") else np.flatnonzero(rng.random(600) < 0.3)
        rows += [f"{tag},{iso(STAMPS[i])},{cell(tag, values[i])}" for i in keep]
    path = save(tmp_path, "\n".join(["tag,time,value", *rows]) + "\n")
    auto = read(path)["FIC101"]
    held = read(path, options=ReadOptions(interpolation="hold"))["FIC101"]
    line = read(path, options=ReadOptions(interpolation="linear"))["FIC101"]
    assert "compressed" in codes(auto.notes)
    assert len(np.unique(held.measurement)) < len(np.unique(auto.measurement))
    assert np.array_equal(auto.measurement, line.measurement)
    assert len(np.unique(line.output)) > len(np.unique(auto.output))


def test_a_folder_with_broken_files(tmp_path):
    good = wide().splitlines()
    for i in range(30):
        rows = [good[0].replace("FIC101", f"F{i:02d}").replace("PIC303", f"P{i:02d}"), *good[1:]]
        (tmp_path / f"e{i:02d}.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "junk.csv").write_bytes(bytes(range(256)) * 40)
    (tmp_path / "page.csv").write_text("<html><body>Login</body></html>\n" * 5)
    (tmp_path / "cut.parquet").write_bytes(b"PAR1" + bytes(500))
    (tmp_path / "notes.md").write_text("not an export")
    plant = read(tmp_path)
    assert len(plant) == 60
    assert sorted(str(n.values["file"]).rsplit("/", 1)[-1] for n in plant.failures) == [
        "cut.parquet", "empty.csv", "junk.csv", "page.csv"
    ]  # fmt: skip


def test_unknown_and_failed_loops(tmp_path):
    plant = read(save(tmp_path, wide(), settings=SETTINGS.replace("Ti = 20.0", "Ti = 0", 1)))
    assert [n.values["loop"] for n in plant.failures] == ["FIC101"]
    with pytest.raises(LoopError, match="Ti must be positive"):
        plant["FIC101"]
    with pytest.raises(UsageError, match="PIC303"):
        plant["PIC304"]
    with pytest.raises(UsageError, match="FIC101"):
        read(tmp_path / "plant.csv", options=ReadOptions(only_loops=("FIC102",)))
    assert [r.loop for r in read(tmp_path / "plant.csv", options=ReadOptions(only_loops=("p*",)))] == ["PIC303"]


def test_a_setpoint_that_stands_still_does_not_narrow_the_guessed_range(tmp_path):
    rng = np.random.default_rng(1)
    pv = -20.0 + 0.01 * rng.normal(size=4000) + 15.0 * np.sin(np.arange(4000) / 60.0) * (np.arange(4000) % 1000 < 300)
    lines = [f"{t},-20,{y:.3f},{50 + y:.3f}" for t, y in enumerate(pv.tolist())]
    path = tmp_path / "P1.csv"
    path.write_text("time,SP,PV,OP\n" + "\n".join(lines))
    record = read(path)["P1"]
    low, high = record.settings.pv_range
    assert low <= np.quantile(pv, 0.001) and np.quantile(pv, 0.999) <= max(high, 0.0)
    assert "implausible" not in codes(record.notes)


def test_ranges(tmp_path):
    def settings(text):
        return f"[loops.FIC101]\n{text}\n[loops.PIC303]\nK = 1\nTi = 9\npv_range = [0, 16]\n"

    plant = read(save(tmp_path, wide(), settings=settings("K = 1\nTi = 5")))
    assert codes(plant.failures) == ["missing_range"] and "pv_range" in plant.failures[0].message
    assert "op_percent" in codes(plant["PIC303"].notes)
    record = read(save(tmp_path, wide(), settings=settings("Ti = 5")))["FIC101"]
    assert record.settings.pv_range[1] > 450 and "guessed_pv_range" in codes(record.notes)
    record = read(
        save(tmp_path, wide(), settings=settings('K = 0.1\nTi = 5\nKp = 9\nunits = "engineering"\npv_range = [0, 900]'))
    )["FIC101"]
    assert pytest.approx(0.9) == record.settings.K and record.settings.Kp == pytest.approx(1.0)
    assert record.settings.source["op_range"] == "data"


def test_units_of_the_signals_do_not_matter(tmp_path):
    base = read(save(tmp_path, wide()))["FIC101"]
    scaled = read(save(tmp_path, wide(value=lambda t, v: f"{v * 7 - 3 if 'FIC' in t and 'OP' not in t else v:.6f}"),
                       settings=SETTINGS.replace("[0.0, 900.0]", "[-3, 6297]")))["FIC101"]  # fmt: skip
    np.testing.assert_allclose(scaled.measurement, base.measurement, atol=1e-9)


def test_sidecars(tmp_path):
    path = save(tmp_path, wide())
    (tmp_path / "plant.loops.toml").write_text(SETTINGS.replace("K = 0.9", "K = 0.3"))
    assert read(path)["FIC101"].settings.K == 0.3
    (tmp_path / "other.toml").write_text(SETTINGS.replace("K = 0.9", "K = 0.4") + "\n[loops.LIC9]\nK = 1\n")
    plant = read(path, loops=tmp_path / "other.toml")
    assert plant["FIC101"].settings.K == 0.4
    assert [n.values["loop"] for n in plant.warnings if n.code == "loop_not_found"] == ["LIC9"]
    many = "".join(f"\n[loops.LIC{k}]\nK = 1\n" for k in range(20))
    (tmp_path / "other.toml").write_text(SETTINGS + many)
    noted = [n.message for n in read(path, loops=tmp_path / "other.toml").warnings if n.code == "loop_not_found"]
    assert len(noted) == 1 and noted[0].startswith("20 loops") and "LIC0" in noted[0]
    for sidecar in tmp_path.glob("*.toml"):
        sidecar.unlink()
    assert "no_metadata" in codes(read(path).warnings)


def bomb() -> bytes:
    begun = wide().split("\n")[0].encode() + b"\n2026-03-17 08:00:00" + b",405.0" * 6
    return gzip.compress(begun + b"\n" * (80 << 20), 6)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.csv", b"", "empty"),
        ("a.csv", b"timestamp,FIC101.SP,FIC101.PV,FIC101.OP\n", "only a header"),
        ("a.csv", b"\n\n\n", "no data"),
        ("a.csv", bytes(range(256)) * 100, "binary"),
        ("a.csv", b"PK\x03\x04" + bytes(100), "zip archive"),
        ("a.xlsx", b"PK\x03\x04" + bytes(100), "damaged workbook"),
        ("a.csv.gz", b"\x1f\x8b\x08" + bytes(100), "damaged gzip"),
        ("a.csv.zst", b"\x28\xb5\x2f\xfd" + b"x" * 100, "damaged zstd"),
        ("a.csv.gz", bomb, "expand"),
        ("a.parquet", b"PAR1" + bytes(100), "damaged Parquet"),
        ("a.csv", b"<html><head><title>Login</title></head></html>\n", "no"),
        ("a.csv", b'{"error": "session expired"}\n', "no"),
        ("a.csv", wide().split("\n", 1)[1].encode(), "no header"),
        ("a.csv", b"time,comment\n2026-03-17 08:00:00,hello\n2026-03-17 08:00:01,you\n", "no signal columns"),
        ("a.csv", b"a,b\n1,x\n2,y\n", "no"),
        ("a.csv", wide(lambda t: t.strftime("02/03/%Y 08:%M:%S")).encode(), "ambiguous"),
        ("a.csv", wide(lambda t: "yesterday").encode(), "no"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_says_so(tmp_path, name, content, words):
    data = content() if callable(content) else content
    path = save(tmp_path, data, name)
    with pytest.raises(BacklashError, match=words) as caught:
        read(path)
    assert name in str(caught.value)


def test_wrong_inputs(tmp_path):
    for inputs in (tmp_path / "nothing.csv", tmp_path, [], tmp_path / "a\x00b"):
        with pytest.raises(InputError):
            read(inputs)
    with pytest.raises(MetadataError, match="No such file"):
        read(save(tmp_path, wide()), loops=tmp_path / "no.toml")
    for options in ({"interpolation": "cubic"}, {"delimiter": "ab"}, {"timezone": "Europe/Nowhere"},
                    {"time_format": "hms"}, {"encoding": "utf-9"}, {"layout": "rows"}, {"header_row": 0}):  # fmt: skip
        with pytest.raises(UsageError):
            ReadOptions(**options)


def test_ragged_rows_are_counted_with_their_line(tmp_path):
    lines = wide().splitlines()
    lines[250] = lines[250].rsplit(",", 2)[0]
    lines[400] += ",1,2"
    plant = read(save(tmp_path, "\n".join(lines) + "\n"))
    note = next(n for n in plant.warnings if n.code == "ragged_rows")
    assert note.message.startswith("2 rows") and "line 251" in note.message
    assert plant["FIC101"].usable.all()


def test_rows_inside_an_open_quotation_mark_are_counted(tmp_path):
    lines = wide().splitlines()
    lines[100] = '"' + lines[100]
    note = next(n for n in read(save(tmp_path, "\n".join(lines) + "\n")).warnings if n.code == "ragged_rows")
    assert note.message.startswith(f"{len(lines) - 100} rows") and "line 101" in note.message
    assert "not closed" in note.message


@pytest.mark.parametrize(("suffix", "pack"), [
    ("gz", gzip.compress), ("zst", lambda text: pa.Codec("zstd").compress(text, asbytes=True))])
def test_of_a_truncated_file_what_is_whole_is_read(tmp_path, suffix, pack):
    rng = np.random.default_rng(0)
    text = wide(value=lambda t, v: f"{v + rng.random():.{9 if suffix == 'gz' else 60}f}")
    plant = read(save(tmp_path, pack(text.encode())[:-5000], f"plant.csv.{suffix}"))
    assert "truncated" in codes(plant.warnings) and 100 < len(plant["FIC101"]) < 600


def test_other_bytes_behind_a_compressed_text_do_no_harm(tmp_path):
    whole = wide()
    plant = read(save(tmp_path, gzip.compress(whole.encode()) + b"GARBAGE" * 300, "plant.csv.gz"))
    assert "truncated" in codes(plant.warnings) and len(plant["FIC101"]) == 600


def test_of_an_archive_one_member_of_which_has_a_password_the_others_are_read(tmp_path):
    with zipfile.ZipFile(tmp_path / "plant.zip", "w") as archive:
        archive.writestr("FIC101.csv", wide().replace("PIC303", "XIC303"))
        archive.writestr("secret.csv", wide())
    data = bytearray((tmp_path / "plant.zip").read_bytes())
    data[data.rfind(b"PK\x03\x04") + 6] |= 1  # as if it were encrypted
    data[data.rfind(b"PK\x01\x02") + 8] |= 1
    (tmp_path / "plant.zip").write_bytes(data)
    plant = read(tmp_path / "plant.zip")
    assert len(plant["FIC101"]) == 600
    (lost,) = plant.failures
    assert "secret.csv" in lost.message and "password" in lost.message


@pytest.mark.parametrize("delimiter", [",", ";"])
def test_cells_in_single_quotation_marks(tmp_path, delimiter):
    quoted = "\n".join(delimiter.join(f"'{cell}'" for cell in line.split(",")) for line in wide().splitlines()) + "\n"
    plant, plain = read(save(tmp_path, quoted)), read(save(tmp_path, wide(), "plain.csv"))
    assert [r.loop for r in plant] == [r.loop for r in plain]
    assert all(np.array_equal(one.measurement, other.measurement) for one, other in zip(plant, plain, strict=True))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name on this system")
def test_a_link_to_a_pipe_is_there_but_no_file(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link.csv").symlink_to(tmp_path / "pipe")
    with pytest.raises(InputError, match="not a regular file"):
        read(tmp_path / "link.csv")


def test_what_is_wrong_with_a_text_is_told_of_the_tables_in_it_too(tmp_path):
    rng = np.random.default_rng(0)
    text = "\n\n".join(f"Loop: {loop}\nTime,SP,PV,OP\n" + "".join(
        f"{iso(t)},50,{50 + rng.random():.9f},{40 + rng.random():.9f}\n" for t in STAMPS) for loop in ("FIC101", "Süd"))
    cut = read(save(tmp_path, gzip.compress(text.encode())[:-5000], "cut.csv.gz"))
    assert "truncated" in codes(cut.warnings) and [record.loop for record in cut] == ["FIC101", "Süd"]
    other = read(save(tmp_path, text.encode("cp1252"), "other.csv"))
    assert codes(other.warnings).count("encoding") == 1 and "Süd" in other


def test_columns_of_one_name(tmp_path):
    lines = [line.split(",") for line in wide().splitlines()]
    doubled = "\n".join(",".join([*c[:3], c[2] if i == 0 else "1.0", *c[3:]]) for i, c in enumerate(lines)) + "\n"
    plant = read(save(tmp_path, doubled))
    assert codes(plant.failures) == ["duplicate_columns"] and "FIC101.PV" in plant.failures[0].message
    same = "\n".join(",".join([*c[:3], c[2], *c[3:]]) for c in lines) + "\n"
    assert read(save(tmp_path, same))["FIC101"].usable.all()


@pytest.mark.parametrize(
    "name",
    [
        "../../etc/x",
        "<script>alert(1)</script>",
        '=HYPERLINK("http://x")',
        "A" * 10_000,
        "Druckregler Ö1 (Süd)",
        "a, b",
    ],
)
def test_any_name_of_a_loop(tmp_path, name):
    quoted = name.replace('"', '""')
    text = wide(name=lambda n: '"' + n.replace("FIC101", quoted) + '"')
    key = name.replace("\\", "\\\\").replace('"', '\\"')
    plant = read(save(tmp_path, text, settings=SETTINGS.replace("FIC101", f'"{key}"')))
    assert plant[name].settings.K == 0.9


def test_one_sample_and_few_samples(tmp_path):
    lines = wide().splitlines()
    for count in (1, 2, 3, 7):
        path = save(tmp_path, "\n".join(lines[: count + 1]) + "\n")
        if count == 1:
            with pytest.raises(BacklashError, match=r"only 1 sample|too few|no rows"):
                read(path)
        else:
            assert len(read(path)["FIC101"]) == count


def test_partitions_in_time_of_many_files(tmp_path):
    lines = wide().splitlines()
    for part in range(12):
        folder = tmp_path / "set" / f"hour={part}"
        folder.mkdir(parents=True)
        (folder / "x.csv").write_text("\n".join([lines[0], *lines[1 + 50 * part : 51 + 50 * part]]) + "\n")
    record = read(tmp_path / "set")["FIC101"]
    assert len(record) == 600 and np.array_equal(record.index, np.arange(600))
    assert not [n for n in record.notes if n.code in ("unsorted", "gaps")]


def test_arrow_types_that_are_no_signals(tmp_path):
    table = arrow().append_column("list", pa.array([[1.0]] * 600)).append_column("blob", pa.array([b"x"] * 600))
    pq.write_table(table, tmp_path / "plant.parquet")
    (tmp_path / "loops.toml").write_text(SETTINGS)
    assert len(read(tmp_path / "plant.parquet")) == 2


def test_characters_cut_by_the_reading_buffer(tmp_path):
    from backlash_cli.loaders.opening import Text

    for text in ("ö" * 700_001, "a" + "€" * 500_000, "x" * 600_000 + "\n" + "𝄞" * 1_300_000):
        for end, notes in ((b"", 0), (b"\xb0\n", 1)):
            (tmp_path / "a.txt").write_bytes(text.encode() + end)
            opened = Text(tmp_path / "a.txt", ReadOptions())
            found = b"".join([opened.head, *opened.rest]).decode()
            assert len(opened.notes) == notes and (notes or found == text)


def test_a_byte_that_is_no_text_far_below_the_header(tmp_path):
    text = wide().encode().replace(b"\n2026-03-18T00:04:00,", b"\n2026-03-18T00:04:00 \xb0,")
    plant = read(save(tmp_path, text))
    assert "encoding" in codes(plant.warnings) and plant["FIC101"].usable.all()


def test_the_doubled_hour_for_all_tags_of_a_long_export(tmp_path):
    """Wall clock of New York without offset: the rarely recorded setpoint goes back with the measurement."""
    from datetime import datetime

    start = datetime(2026, 11, 1, 0, 30)
    rng = np.random.default_rng(3)
    rows = ["tag,time,value"]
    for i in range(7200):
        clock = iso(start + timedelta(seconds=i - (3600 if i >= 5400 else 0)))
        if i % 60 == 0:
            rows.append(f"FIC101.SP,{clock},{405 if i < 6000 else 450}")
        rows.append(f"FIC101.PV,{clock},{405 + rng.standard_normal():.2f}")
        if i % 5 == 0:
            rows.append(f"FIC101.OP,{clock},{40 + rng.standard_normal():.2f}")
    path = save(tmp_path, "\n".join(rows) + "\n")
    plain = read(path)["FIC101"]
    zoned = read(path, options=ReadOptions(timezone="America/New_York"))["FIC101"]
    for record in (plain, zoned):
        assert np.array_equal(record.index, np.arange(7200))
        assert np.flatnonzero(np.diff(record.setpoint)).tolist() == [5999]
        assert "dst_repeated_hour" in codes(record.notes)
    assert zoned.start == plain.start + 4 * 3600


def test_long_holes_are_gaps_and_short_ones_are_filled_by_the_integral_time(tmp_path):
    lines = wide().splitlines()
    kept = [line for i, line in enumerate(lines) if not (100 < i <= 108 or 200 < i <= 215 or 300 < i <= 400)]
    record = read(save(tmp_path, "\n".join(kept) + "\n"))["FIC101"]  # Ti = 20 s
    assert (record.state[100:108] == SampleState.FILLED).all()
    assert (record.state[200:215] == SampleState.MISSING).all()
    assert np.flatnonzero(np.diff(record.index) > 1).tolist() == [299] and len(record) == 500


def test_a_special_file_is_no_export(tmp_path):
    with pytest.raises(InputError, match="regular file"):
        read("/dev/zero")


def test_tags_that_are_no_loops_are_left_out(tmp_path):
    lines = [f"{line},{'TI7.PV,Pump OUT,TI4711' if i == 0 else '5,6,7'}" for i, line in enumerate(wide().splitlines())]
    plant = read(save(tmp_path, "\n".join(lines) + "\n"))
    assert {r.loop for r in plant} == {"FIC101", "PIC303"} and not plant.failures
    (warning,) = [note for note in plant.warnings if note.code == "single_signals"]
    assert all(tag in warning.message for tag in ("TI7.PV", "Pump OUT", "TI4711"))


@pytest.mark.parametrize(("one", "other"), [("AREA1/", "AREA2/"), ("[PLC1]", "[PLC2]")])
def test_names_in_the_data_that_contain_a_loop_of_the_metadata(tmp_path, one, other):
    plant = read(save(tmp_path, wide(name=lambda n: one + n)))
    assert "matched_name" in codes(plant["FIC101"].notes) and plant["FIC101"].settings.Ti == 20.0
    both = wide(name=lambda n: n.replace("FIC101", one + "FIC101").replace("PIC303", other + "FIC101"))
    assert {r.loop for r in read(save(tmp_path, both), options=ReadOptions())} == {one + "FIC101", other + "FIC101"}


def test_a_small_parquet_file_that_expands_without_end(tmp_path):
    pq.write_table(
        pa.table({"timestamp": np.zeros(300_000, np.int64), "A.PV": np.zeros(300_000)}), tmp_path / "a.parquet"
    )
    with pytest.raises(InputError, match="expand"):
        read(tmp_path / "a.parquet", options=ReadOptions(max_bytes=1 << 20))


def test_an_output_recorded_on_change_holds_until_the_next_change(tmp_path):
    rows = [f"FIC101.{s},{iso(t)},{SIGNALS[f'FIC101.{s}'][i]}" for i, t in enumerate(STAMPS) for s in ("SP", "PV")]
    rows += [f"FIC101.OP,{iso(STAMPS[i])},{40 + i}" for i in (0, 3, 5, 9, 12, 15, 400, 402, 405)]
    record = read(save(tmp_path, "\n".join(["tag,time,value", *rows]) + "\n"))["FIC101"]
    assert np.allclose(record.output[15:400], 0.55)
    rows = [row for row in rows if ".OP" not in row]
    rows += [f"FIC101.OP,{iso(STAMPS[i])},{40 + i % 3}" for i in range(0, 600, 5) if not 200 < i < 400]
    record = read(save(tmp_path, "\n".join(["tag,time,value", *rows]) + "\n"))["FIC101"]
    assert np.isfinite(record.output[:220]).all() and np.isnan(record.output[250:399]).all()


def test_a_loop_without_a_setpoint_is_not_judged_by_half_periods(tmp_path):
    from backlash_cli.scanning import scan

    lines = [",".join(np.delete(line.split(","), 1)) for line in wide().splitlines()]
    report = scan(read(save(tmp_path, "\n".join(lines) + "\n"))["FIC101"])
    assert "no_setpoint" in codes(report.reasons) or "no_setpoint" in [w.values.get("why") for w in report.warnings]
    assert not len(report.estimates)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"timezone": "Mars/X"}, "for example Europe/Berlin"),
        ({"timezone": "Europe/Berlim"}, "did you mean Europe/Berlin"),
        ({"timezone": "CET+1"}, "^write for example .* one hour east of UTC all year Etc/GMT-1"),
        ({"time_format": "qqq"}, "one of: iso, ymd"),
        ({"decimal": "x"}, r"one of: \.  ,"),
    ],
)
def test_a_wrong_option_is_answered_with_what_there_is(tmp_path, options, says):
    with pytest.raises(UsageError) as raised:
        read(save(tmp_path, wide()), options=ReadOptions(**options))
    assert re.search(says, str(raised.value.remedy)) and "known: " not in raised.value.remedy


def test_a_wrong_delimiter_is_named(tmp_path):
    with pytest.raises(InputError, match="not divided by ';'"):
        read(save(tmp_path, wide()), options=ReadOptions(delimiter=";"))


def test_columns_that_belong_to_no_loop_are_named(tmp_path):
    rows = [f"2026-03-02T00:00:{s:02},1,2" for s in range(60)]
    (tmp_path / "a.csv").write_text("\n".join(["time,apples,pears", *rows]))
    with pytest.raises(InputError) as raised:
        read(tmp_path / "a.csv")
    assert "did you mean" not in raised.value.remedy


def test_a_time_pattern_is_heeded_where_stamps_look_like_iso(tmp_path):
    """Year, day, month: Arrow alone would take the third of January for the first of March."""
    stamps = [f"2026-{day:02d}-03 {hour:02d}:00:00" for day in (1, 2, 3) for hour in range(24)]
    text = "time,A.SP,A.PV,A.OP\n" + "".join(f"{t},0.5,0.{k % 7},0.{k % 5}\n" for k, t in enumerate(stamps))
    record = read(save(tmp_path, text), options=ReadOptions(time_format="%Y-%d-%m %H:%M:%S"))["A"]
    assert record.start == 1772323200 and record.interval == 3600 and np.array_equal(record.index, np.arange(72))


@pytest.mark.parametrize("delimiter", [",", ";"])
def test_rows_that_an_open_quotation_mark_takes_in_are_counted_where_no_cell_is_missing(tmp_path, delimiter):
    """A remark in the last column took in the rest of the file without a word."""
    lines = [delimiter.join([line, ""]) for line in wide(delimiter=delimiter).splitlines()]
    lines[0] += "note"
    lines[100] += '"valve\nstuck"'
    (tmp_path / "plant.csv").write_text("\n".join(lines) + "\n")
    assert not [note for note in read(tmp_path).warnings if note.code == "ragged_rows"]
    lines[300] += '"operator'
    (tmp_path / "plant.csv").write_text("\n".join(lines) + "\n")
    plant = read(tmp_path)
    said, = (note for note in plant.warnings if note.code == "ragged_rows")
    assert said.values["rows"] == len(lines) - 301.0 and "operator" in said.message
    assert {len(record) for record in plant} == {300}
    lines[301] += '"'  # one row is lost
    (tmp_path / "plant.csv").write_text("\n".join(lines) + "\n")
    said, = (note for note in read(tmp_path).warnings if note.code == "ragged_rows")
    assert said.values["rows"] == 1.0 and "quotation" in said.message
