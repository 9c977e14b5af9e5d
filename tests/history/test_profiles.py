"""Limits profile, nightly configuration and lock: what is wrong is said with file, key and remedy."""

import subprocess
import sys
from contextlib import nullcontext

import pytest

from backlash_cli.errors import BacklashError
from backlash_cli.history.limits import parse_limits, read_limits
from backlash_cli.history.nightly import check_places, find_exports, lock, read_config
from backlash_cli.loaders import ReadOptions

CLASSES = '[classes.a]\nlimit = 3\nsource = "s"\n[classes.b]\nlimit = 1.5\n'


def test_the_first_pattern_that_fits_counts_and_a_loop_of_its_own_goes_first():
    limits = parse_limits('default = "a"\n' + CLASSES + '[[assign]]\nloops = ["FIC1*"]\nclass = "b"\n'
                          '[[assign]]\nloops = "*"\nclass = "a"\n[loops.FIC100]\nlimit = 2\n'
                          '[loops.X]\nclass = "b"', "f")
    assert limits.of("fic101").value == 0.015 and limits.of("TIC1").value == 0.03
    assert limits.of("FIC100").value == 0.02 and limits.of("X").name == "b"


@pytest.mark.parametrize(("text", "words"), [
    ("", "no class"), ("[classes.a]\nlimit = 0", "limit = 3.0 is 3 %"),
    ("[classes.a]\nlimit = 0.03", "limit = 3.0 is 3 %"), ("[classes.a]\nlimit = true", "per cent"),
    ("[classes.a]\nlimit = 3\nsorce = 1", "sorce"), (CLASSES + "[[assign]]\nloops = 'x'\nclass = 'c'", "no class 'c'"),
    ("default = 'z'\n" + CLASSES, "no class 'z'"), (CLASSES + "[[assign]]\nclass = 'a'", "loops is missing"),
    ("assign = 3\n" + CLASSES, "list"), ("classes = 3", "table"), ("[", "TOML"), (CLASSES + "[loops]\nX = 1", "table"),
])
def test_a_wrong_profile_is_refused_in_words(text, words):
    with pytest.raises(BacklashError) as caught:
        parse_limits(text, "limits.toml")
    assert words in str(caught.value) and "limits.toml" in caught.value.where and caught.value.remedy


def test_a_profile_that_is_not_there(tmp_path):
    with pytest.raises(BacklashError, match="--limits"):
        read_limits(tmp_path / "absent.toml")


GOOD = 'inputs = "x_{date}.csv"\nhistory = "h.db"\n'


def config(tmp_path, text):
    (tmp_path / "n.toml").write_text(text)
    return read_config(tmp_path / "n.toml", ReadOptions)


def test_paths_are_relative_to_the_configuration(tmp_path):
    found = config(tmp_path, GOOD + 'fail_on = "d>3%"\n[outputs]\nreport = "out/wear"\nscan = "s/{date}.json"\n'
                   '[reading]\ntimezone = "Europe/Berlin"\nauto_modes = ["A"]')
    assert found.history == tmp_path / "h.db" and found.lock == tmp_path / "h.db.lock"
    assert found.inputs == (str(tmp_path / "x_{date}.csv"),) and found.outputs.report == tmp_path / "out/wear"
    assert found.fail_on == ("d>3%",) and found.reading == ReadOptions(
        timezone="Europe/Berlin", auto_modes=("A",))


@pytest.mark.parametrize(("text", "words"), [
    ('history = "h.db"', "inputs is missing"), ('inputs = "x"', "history is missing"),
    (GOOD + "inputz = 3", "did you mean inputs"),
    (GOOD + "horizon = -1", "positive"), (GOOD + 'together = "yes"', "true or false"), (GOOD + "loops = 3", "text"),
    (GOOD + '[outputs]\nscan = "s.json"', "needs its date"), (GOOD + '[outputs]\nscan = "{date}.doc"', ".doc"),
    (GOOD + '[outputs]\nreprt = "x"', "did you mean report"), (GOOD + '[log]\nformat = "xml"', "text, json"),
    (GOOD + '[reading]\ntimezon = "x"', "timezone"), (GOOD + '[reading]\nheader_row = "1"', "header_row"),
    (GOOD + '[reading]\ntimezone = "Mars/Olympus"', "n.toml, line 4: no time zone 'Mars/Olympus'"),
    (GOOD + '[reading]\nauto_modes = "BLK"', "a list"), (GOOD + "[reading]\ndelimiter = 5", "delimiter = 5"),
    ("inputs = [3]\nhistory = 'h'", "text in quotes"), ("[", "TOML"),
])
def test_a_wrong_configuration_is_refused_in_words(tmp_path, text, words):
    with pytest.raises(BacklashError) as caught:
        config(tmp_path, text)
    assert words in str(caught.value) and "n.toml" in caught.value.where and caught.value.remedy


@pytest.mark.parametrize(("text", "file"), [
    ('lock = "n.toml"', "n.toml"), ('lock = "h.db"', "h.db"), ('lock = "x_2026-03-02.csv"', "x_2026-03-02.csv"),
    ('loops = "l.toml"\n[outputs]\ntrend = "l.toml"', "l.toml"), ('[outputs]\nreport = "h.db"', "h.db"),
    ('[outputs]\ntrend = "x_2026-03-02.csv"', "x_2026-03-02.csv"), ('[log]\nfile = "loops.toml"', "loops.toml"),
    ('[log]\nfile = "link"', "x_2026-03-02.csv"), ('[outputs]\nscan = "x_{date}.csv"', "x_2026-03-02.csv"),
    ('[outputs]\nscan = "{date}.csv"', "2026-03-04.csv"), ('[outputs]\nscan = "s/{date}.csv"\ntrend = "t.json"', "")])
def test_no_result_takes_the_place_of_what_the_job_reads(tmp_path, text, file):
    for name in ("x_2026-03-02.csv", "2026-03-04.csv", "loops.toml", "n.toml"):
        (tmp_path / name).write_text("")
    (tmp_path / "link").symlink_to(tmp_path / "x_2026-03-02.csv")
    found = config(tmp_path, f'inputs = ["x_{{date}}.csv", "*04.csv"]\nhistory = "h.db"\n{text}')
    exports, *_ = find_exports(found.inputs)
    read = [*(path for export in exports for path in export.files), tmp_path / "loops.toml"]
    assert len(exports) == 2
    with pytest.raises(BacklashError, match=f"n.toml: {file} is named for two things") if file else nullcontext():
        check_places(found, exports, read)


def test_a_configuration_that_is_not_there(tmp_path):
    with pytest.raises(BacklashError, match="docs/nightly"):
        read_config(tmp_path / "absent.toml")


def test_only_one_job_works_and_a_stale_lock_is_taken_over(tmp_path):
    path = tmp_path / "x.lock"
    with lock(path) as stale:
        assert stale == ""
        with pytest.raises(BacklashError, match="another nightly job is working \\(process"), lock(path):
            pass
    assert path.read_text() == ""
    with pytest.raises(ValueError), lock(path):
        raise ValueError
    assert path.read_text() == ""
    code = ("import os, sys\nfrom pathlib import Path\nfrom backlash_cli.history.nightly import lock\n"
            "with lock(Path(sys.argv[1])):\n    os.kill(os.getpid(), 9)\n")
    subprocess.run([sys.executable, "-c", code, str(path)], check=False)
    with lock(path) as stale:
        assert "stopped before its end" in stale


@pytest.mark.parametrize("content", [b"timestamp,FIC101.PV\n1,2\n", b"SQLite format 3\0", b"\xff\xfe"])
def test_a_file_that_is_no_lock_stays_as_it_is(tmp_path, content):
    (tmp_path / "x").write_bytes(content)
    with pytest.raises(BacklashError, match="not a lock of a nightly job"), lock(tmp_path / "x"):
        pass
    assert (tmp_path / "x").read_bytes() == content


def test_a_lock_that_cannot_be_made(tmp_path):
    with pytest.raises(BacklashError, match="lock file"), lock(tmp_path / "no" / "x.lock"):
        pass
