"""Loop settings read a line at a time are those that the full reader gives."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.loaders.plain_toml import plain_toml

VALUES = st.one_of(
    st.integers(-(2**60), 2**60).map(str), st.floats(-1e9, 1e9).map(repr), st.sampled_from([
         "[0, 100]", "[ -1.5,2 ]", "[]", "true", "false", '"0.5 min"', "'x'", '"a\\n"', '"é"', "01", "1_000", "+1",
         "1.", ".5", "inf", "nan", "0x1F", "1e5", "1E-3", '""', '"#"', "[1, [2]]", "{}", "1979-05-27", "[1,]", "1 2",
         ""]))
KEYS = st.sampled_from(["K", "Ti", "Td", "pv_range", '"K"', "a.b", "pv", "é", "sp-1", ""])
NAMES = st.sampled_from(["[defaults]", "[loops]", "[loops.A]", "[loops.B]", '[loops."C D"]', "[loops.'E']",
                         "[ loops.F ]", "[loops.A.x]", "[[loops]]", "[defaults.K]", "[loops.A] # yes", "[loops.A"])
ROWS = st.one_of(NAMES, st.tuples(KEYS, VALUES).map(lambda pair: f"{pair[0]} = {pair[1]}"),
                 st.sampled_from(["", "# note", "   ", "\t# é", "K = 1 # gain", " Ti=2", "garbage", "\x01"]))


def full(text):
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, ValueError):
        return None


@given(st.lists(ROWS, max_size=14), st.sampled_from(["\n", "\r\n"]))
@settings(max_examples=600, deadline=None)
def test_what_is_read_is_what_the_full_reader_gives(rows, end):
    text = end.join(rows)
    found = plain_toml(text)
    if found is not None:
        assert repr(found) == repr(full(text))


@pytest.mark.parametrize("path", sorted(Path(__file__).resolve().parents[2].joinpath("sample_data").glob("*.toml")))
def test_the_settings_of_the_samples_are_read(path):
    text = path.read_text("utf-8")
    assert plain_toml(text) == tomllib.loads(text)


def test_usual_settings_need_no_full_reader():
    text = '[defaults]\nKp = 1.5\n\n[loops.FIC101]  # feed\nK = 0.6\nTi = "0.5 min"\npv_range = [0, 900]\n'
    assert plain_toml(text) == {"defaults": {"Kp": 1.5}, "loops": {"FIC101": {"K": 0.6, "Ti": "0.5 min",
                                                                              "pv_range": [0, 900]}}}
