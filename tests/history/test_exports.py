"""Exports found by pattern: dates in names, late and missing days, fingerprints."""

from datetime import date

import pytest

from backlash_cli.errors import MetadataError
from backlash_cli.history.nightly import expand, find_exports, matches
from backlash_cli.results.history import missing_days


def touch(folder, *names):
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)


def test_files_of_one_date_are_one_night(tmp_path):
    touch(tmp_path, "a_2026-03-01.csv", "b_2026-03-01.csv", "a_2026-03-03.csv", "a_2026-13-01.csv", "a_2026_03_011.csv",
          "a_20260301_1.csv", "notes.txt")
    patterns = [str(tmp_path / name) for name in ("a_{date}.csv", "b_{date}.csv", "c_{date}.csv")]
    found, older, nothing = find_exports(patterns)
    assert nothing == [*patterns[2:], "a_2026-13-01.csv (no such day)"]
    assert older == []
    assert [(e.name, len(e.files)) for e in found] == [("2026-03-01", 2), ("2026-03-03", 1)]
    assert missing_days(e.name for e in found) == ["2026-03-02"]


@pytest.mark.parametrize(("pattern", "name"), [
    ("x_{date:%Y%m%d}_*.csv.gz", "x_20260302_2155.csv.gz"), ("{date:%d.%m.%y}/plant.csv", "02.03.26/plant.csv"),
    ("**/plant_{date}.csv", "unit1/deep/plant_2026-03-02.csv"), ("{date:%Y/%m/%d}.csv", "2026/03/02.csv"),
    ("{date:%Y}/x{date:%Y-%m-%d}.csv", None), ("p{date:%Y}[1].csv", None),
])
def test_the_date_is_read_wherever_the_pattern_says(tmp_path, pattern, name):
    touch(tmp_path, "x_20260302_2155.csv.gz", "02.03.26/plant.csv", "unit1/deep/plant_2026-03-02.csv",
          "2026/03/02.csv", "x_2026_2155.csv.gz")
    found = matches(str(tmp_path / pattern))
    assert found == ([] if name is None else [(tmp_path / name, date(2026, 3, 2))])


def test_only_the_last_days_are_looked_at_counted_from_the_newest_export(tmp_path):
    touch(tmp_path, *(f"p_2026-03-{day:02d}.csv" for day in (1, 10, 20, 25)))
    found, older, _ = find_exports([str(tmp_path / "p_{date}.csv")], look_back=14)
    assert [e.name for e in found] == ["2026-03-20", "2026-03-25"] and older == ["2026-03-01", "2026-03-10"]


def test_exports_without_a_date(tmp_path):
    touch(tmp_path, "u1.csv", "u2.csv")
    assert [e.name for e in find_exports([str(tmp_path / "*.csv")])[0]] == ["u1.csv", "u2.csv"]
    assert [len(e.files) for e in find_exports([str(tmp_path / "*.csv")], together=True)[0]] == [2]
    assert find_exports([str(tmp_path / "none*.csv")]) == ([], [], [str(tmp_path / "none*.csv")])


def test_exports_without_a_date_that_are_called_alike_are_told_apart(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        touch(tmp_path / folder, "plant.csv")
    names = [e.name for e in find_exports([str(tmp_path / "*/plant.csv")])[0]]
    assert names == [str(tmp_path.resolve() / folder / "plant.csv") for folder in ("a", "b")]


def test_a_file_that_two_inputs_name_is_one_export(tmp_path):
    touch(tmp_path, "p_2026-03-01.csv")
    found, *_ = find_exports([str(tmp_path / "p_{date}.csv"), str(tmp_path / "*.csv")])
    assert [(e.name, len(e.files)) for e in found] == [("2026-03-01", 1)]


def test_a_fingerprint_follows_content_and_settings(tmp_path):
    touch(tmp_path, "p_2026-03-01.csv", "loops.toml")
    (export,), *_ = find_exports([str(tmp_path / "p_{date}.csv")])
    first = export.fingerprint([tmp_path / "loops.toml"])
    assert export.fingerprint([tmp_path / "loops.toml"]) == first != export.fingerprint()
    (tmp_path / "loops.toml").write_text("other")
    assert export.fingerprint([tmp_path / "loops.toml"]) != first


def test_names_of_reports_get_the_date():
    assert expand("scans/{date}.html", "2026-03-02") == "scans/2026-03-02.html"
    assert expand("{date:%Y%m}/s.json", "2026-03-02") == "202603/s.json"
    assert expand("s_{date}.json", "my plant.csv") == "s_my_plant.csv.json"


def test_an_unknown_date_code_is_refused(tmp_path):
    with pytest.raises(MetadataError, match="%Q"):
        matches(str(tmp_path / "{date:%Q}.csv"))
