"""Loop settings from TOML and CSV, with the place of every mistake."""

from __future__ import annotations

import pytest

from backlash_cli import read
from backlash_cli.errors import MetadataError
from backlash_cli.loaders.sources import Source, find_sidecars, read_metadata
from backlash_cli.settings.schema import merge, parse_table, parse_toml, settings_of

GOOD = """
[defaults]
Kp = 1.5
Ti = 30.0

[loops.FIC101]
K = 0.6
Ti = "0.5 min"
pv_range = [0, 900]
op_range = [0, 100]

[loops."Druck Ö1 (Süd)"]
PB = 50
reset = "2 /min"
"""


def test_defaults_hold_where_a_loop_says_nothing():
    metadata = parse_toml(GOOD, "loops.toml")
    settings = settings_of(metadata.loops["FIC101"])
    assert (settings.loop.K, settings.loop.Ti, settings.loop.Kp) == (0.6, 30.0, 1.5)
    assert settings.loop.source == {
        "K": "metadata", "Ti": "metadata", "Kp": "default", "pv_range": "metadata", "op_range": "metadata"
    }  # fmt: skip
    assert settings.pv_range == (0.0, 900.0)
    # the default Ti does not stand beside the loop's own reset
    assert settings_of(metadata.loops["Druck Ö1 (Süd)"]).loop.K == 2.0
    assert settings_of(metadata.fallback()).loop.Ti == 30.0


def test_names_match_without_case():
    metadata = parse_toml(GOOD, "x")
    assert metadata.match("fic101") == "FIC101"
    assert metadata.match("FIC-101") == "FIC101"
    assert metadata.match("FIC102") is None
    assert metadata.match("FIC10-1") is None  # a separator between digits is part of the name


@pytest.mark.parametrize(
    ("text", "where", "words"),
    [("[loops.A]\nK = 1\nTii = 3\n", "f.toml, loop A, line 3", "did you mean.*Ti"),
     ("[loop.A]\nK = 1\n", "f.toml, line 1", "did you mean loops"),
     ("[loops.A]\naction = 'direct'\n", "f.toml, loop A, line 2", "the action is the sign of K"),
     ("[loops.A]\npv_low = 0\n", "f.toml, loop A, line 2", r"give both ends: pv_range = \[0, 900\]"),
     ("[loops.A\nK = 1\n", "f.toml, line 1", "TOML"),
     ("[loops.A]\nK = 0,95\n", "f.toml, line 2", "decimal point"),
     ("[loops.A]\nK = 1\n[loops.A]\nK = 2\n", "f.toml, line 3", "TOML"),
     ("[defaults]\nkp = 1\n", "f.toml, line 2", "Kp"),
     ("loops = 3\n", "f.toml", "table"),
     ("[loops]\nA = 3\n", "f.toml", "table"),
     ("a = " + "[" * 3000, "f.toml", "TOML")],
)  # fmt: skip
def test_mistakes_are_placed(text, where, words):
    with pytest.raises(MetadataError, match=words) as caught:
        parse_toml(text, "f.toml")
    assert caught.value.where.startswith(where)


@pytest.mark.parametrize(
    ("values", "words"),
    [("pv_range = [450, 450]", "zero width"),
     ("pv_range = [900, 0]", "reversed"), ("op_range = [0, 5, 9]", "two numbers"),
     ("pv_range = 900", "two numbers"), ("op_range = ['a', 'b']", "must be a number"), ("Kp = 0", "must not be zero"),
     ("Kp = nan", "must be a number"), ("theta = -3", "must not be negative"), ("Tf = -1", "must not be negative"),
     ("Ti = 1e30", "longer than 30 days"), ("theta = 1e9", "longer than 30 days"), ("Kp = 1e-300", "is not possible"),
     ("K = 1e-300", "is not possible"), ("K = -1e12", "is not possible"), ("Td = '1e9 h'", "longer than 30 days"),
     ("pv = ['FT1']", "pv may not be"), ("mode = ''", "mode may not be"), ("op = 1.5", "op may not be"),
     ("auto_modes = true", "auto_modes may not be"), ("units = 'bar'", "units"),
     ("pv_range = [-1e308, 1e308]", "too wide"), ("Kp = 'x'", "must be a number")],
)  # fmt: skip
def test_wrong_values_name_key_and_remedy(values, words):
    usual = "".join(line for line in ("K = 1\n", "Ti = 2\n") if line.split()[0] != values.split()[0])
    metadata = parse_toml(f"[loops.A]\n{usual}{values}\n", "x")
    with pytest.raises(MetadataError, match=words) as caught:
        settings_of(metadata.loops["A"])
    assert caught.value.remedy


def test_gain_signs_belong_together():
    settings = settings_of(parse_toml("[loops.A]\nK = -0.5\nTi = 3\nKp = 1.2\n", "x").loops["A"])
    assert settings.loop.Kp == -1.2
    assert [note.code for note in settings.notes] == ["kp_sign"]
    assert not settings_of(parse_toml("[loops.A]\nK = -0.5\nTi = 3\nKp = -1.2\n", "x").loops["A"]).notes


@pytest.mark.parametrize(("values", "told"), [
    ("Td = 500", "Td = 500 can"), ("Tf = 5000", "Tf = 5000 can"), ("Kp = 130", "Kp = 130 can"),
    ("Tf = 40\nKp = -200", "Tf = 40 and Kp = -200 can"),
    ("Td = 7\nTf = 1.4\nKp = 1.3\ntheta = 90", ""), ("Kp = 20", ""), ("theta = 200", "")])
def test_times_and_gains_that_can_hardly_be_are_told(values, told):
    text = f"[loops.A]\nK = 0.6\nTi = 28\n{values}\n"
    notes = [note for note in settings_of(parse_toml(text, "x").loops["A"]).notes if note.code != "kp_sign"]
    assert [note.code for note in notes] == ["settings_doubtful"] * bool(told)
    assert all(note.message.startswith(told) for note in notes)


@pytest.mark.parametrize(("text", "messages"), [
    ("Kp = 130", []), ("Ti = 28\nKp = 130", []),
    ("K = 0.6\nKp = 130", ["Kp = 130 can hardly be beside K = 0.6: check value and unit"]),
    ("Ti = 28\nTf = 90", ["Tf = 90 can hardly be beside Ti = 28 s: check value and unit"])])
def test_settings_are_doubted_beside_those_that_are_given(text, messages):
    notes = settings_of(parse_toml(f"[loops.A]\n{text}\n", "x").loops["A"]).notes
    assert [note.message for note in notes] == messages


def test_the_report_of_a_scan_is_no_table_of_settings():
    assert not parse_table('"loop","verdict","confidence"\n"FIC101","backlash",0.9\n', "loops.csv").loops


def test_table_with_the_same_keys(tmp_path):
    path = tmp_path / "plant.loops.csv"
    path.write_text(
        "loop;K;Ti;pv_range;op_range;Kp\ndefaults;;;;0..100;1.5\nFIC101;0,6;0,5 min;0..900;;\nLIC1;1;20;[0, 5];;2\n"
    )
    metadata = read_metadata(path)
    settings = settings_of(metadata.loops["FIC101"])
    assert (settings.loop.K, settings.loop.Ti, settings.loop.Kp) == (0.6, 30.0, 1.5)
    assert (settings.pv_range, settings.op_range) == ((0.0, 900.0), (0.0, 100.0))
    assert settings_of(metadata.loops["LIC1"]).loop.Kp == 2.0


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252"])
def test_a_table_as_spreadsheets_save_it(tmp_path, encoding):
    (tmp_path / "loops.csv").write_bytes("loop\tK\tTi\nÖl 1\t0,6\t20\n".encode(encoding))
    assert settings_of(read_metadata(tmp_path / "loops.csv").loops["Öl 1"]).loop.K == 0.6


def test_settings_called_as_the_exports_without_their_day(tmp_path):
    sources = [Source(tmp_path / f"plant_202603{day}.csv") for day in (17, 18)]
    (tmp_path / "plant.loops.toml").write_text("[defaults]\nK = 1.0\n")
    assert find_sidecars([source.path for source in sources], sources) == [tmp_path / "plant.loops.toml"]


def test_the_settings_nearest_to_the_data_count_first(tmp_path):
    (tmp_path / "b").mkdir()
    for path in (tmp_path / "loops.toml", tmp_path / "b" / "two.loops.toml"):
        path.write_text("[loops.A]\nK = 1.0\n")
    found = find_sidecars([tmp_path], [Source(tmp_path / "one.csv"), Source(tmp_path / "b" / "two.csv")])
    assert found == [tmp_path / "b" / "two.loops.toml", tmp_path / "loops.toml"]


def test_a_setpoint_in_a_table_is_a_number_or_a_tag():
    table = parse_table("loop;sp;pv;op\nA;405,5;FT1;FV1\nB;9.6;;\nC;1011;1012;1013\nD;SC1;FT2;FV2\n", "t.csv")
    assert [settings_of(table.loops[name]).constant_setpoint for name in "ABCD"] == [405.5, 9.6, None, None]
    assert (table.loops["C"].values["sp"], table.loops["D"].values["sp"]) == ("1011", "SC1")


@pytest.mark.parametrize(
    ("text", "words"),
    [("loop,K,Tii\nA,1,2\n", "unknown key"), ("K,Ti\n1,2\n", "no column 'loop'"),
     ('loop,K,Ti\nA,1,"7\nB,2,8\n', "not a CSV table"), ("loop,K,Ti,K\nA,1,7,2\n", "two columns are called 'K'"),
     ("name,loop,K\nx,A,1\n", "unknown key 'name'"),
     ("loop,K\nA,1\nA,2\n", "listed twice"), ("loop,K,Ti\nA,1,7,25\n", "4 cells in a row"),
     ("loop,pv_range\nA,wide\n", "not a range"), ("loop,K\n,1\n", "without a loop name")],
)  # fmt: skip
def test_table_mistakes(text, words):
    with pytest.raises(MetadataError, match=words) as caught:
        parse_table(text, "t.csv")
    assert "t.csv" in caught.value.where


def test_settings_without_an_end_are_refused():
    with pytest.raises(MetadataError, match="not valid TOML"):
        read_metadata("/dev/zero")


@pytest.mark.parametrize("make", [lambda path: path.symlink_to("nowhere"), lambda path: path.mkdir()])
def test_settings_beside_the_data_that_cannot_be_read_are_no_missing_ones(tmp_path, make):
    (tmp_path / "plant.csv").write_text("t,A.SP,A.PV,A.OP\n2026-03-17 00:00:00,1,1,1\n2026-03-17 00:00:01,1,1,1\n")
    make(tmp_path / "plant.loops.toml")
    with pytest.raises(MetadataError, match=r"plant\.loops\.toml"):
        read(tmp_path / "plant.csv")


def test_tags_may_be_numbers():
    metadata = parse_toml("[loops.A]\nsp = 1001\npv = 1002\nop = 1003\n[loops.B]\nsp = 45\npv = 'FT2'\n", "f.toml")
    assert metadata.loops["A"].tags == {"sp": "1001", "pv": "1002", "op": "1003"}
    assert metadata.loops["B"].tags == {"pv": "FT2"}
    assert [settings_of(metadata.loops[loop]).constant_setpoint for loop in "AB"] == [None, 45.0]


def test_files_that_are_no_metadata(tmp_path):
    with pytest.raises(MetadataError, match="No such file"):
        read_metadata(tmp_path / "nothing.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\x00K")
    with pytest.raises(MetadataError, match="UTF-8"):
        read_metadata(tmp_path / "b.toml")
    with pytest.raises(MetadataError):
        read_metadata(tmp_path)
    (tmp_path / "bom.toml").write_text("\ufeff[loops.A]\nK = 1\n", encoding="utf-8")
    assert read_metadata(tmp_path / "bom.toml").loops["A"].values == {"K": 1}


def test_first_file_counts_and_conflicts_are_named():
    merged = merge([parse_toml("[loops.A]\nK = 1\n", "a"), parse_toml("[loops.A]\nK = 2\n[loops.B]\nK = 3\n", "b")])
    assert merged.loops["A"].values["K"] == 1
    assert merged.loops["B"].values["K"] == 3
    assert len(merged.conflicts) == 1


def test_a_loop_that_only_defaults_hold_for_is_not_said_to_have_no_settings(tmp_path):
    (tmp_path / "x.csv").write_text("time,A.SP,A.PV,A.OP\n" + "".join(
        f"2026-03-17T00:00:{i:02},50,{50 + i % 3},{40 + i % 5}\n" for i in range(60)), "utf-8")
    for text, said in (("[defaults]\nKp = 2\n", "its [defaults] hold for all"),
                       ("[defaults]\nKp = 2\n[loops.B]\nTi = 9\n", "A is not in the loops file: only its [defaults]"),
                       ("[loops.B]\nTi = 9\n", "loop A is not in the loops file: its settings are missing")):
        (tmp_path / "loops.toml").write_text(text, "utf-8")
        plant = read(tmp_path / "x.csv")
        assert said in " ".join(note.message for note in (*plant.warnings, *plant["A"].notes))
        given = plant["A"].settings.Kp
        assert given == (2.0 if "defaults" in text else None)


def test_of_settings_beside_the_data_in_both_forms_the_toml_counts_and_says_so(tmp_path):
    data, _ = tmp_path / "plant.csv", (tmp_path / "plant.loops.toml").write_text("[loops.F1]\nK = 0.6\nTi = 40.0\n")
    for K, told in (("0.6", 0), ("0.3", 1)):
        (tmp_path / "plant.loops.csv").write_text(f"loop,K,Ti\nF1,{K},40\n")
        data.write_text("")
        found = merge(map(read_metadata, find_sidecars([data], [Source(data)])))
        assert found.loops["F1"].values["K"] == 0.6 and len(found.conflicts) == told
