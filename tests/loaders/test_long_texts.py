"""Texts of a length that nobody writes, in places where expressions look for what is usual: none may hold a scan."""

import re
import time

import pytest

from backlash_cli.errors import BacklashError
from backlash_cli.loaders import read
from backlash_cli.loaders.cells import Lexicon
from backlash_cli.loaders.names import bare_tag, plain, undated
from backlash_cli.loaders.opening import _REWRITTEN, _ROW, _at_edges
from backlash_cli.settings import parse_toml

from .exports import SETTINGS, wide

SECONDS = 3.0  # each of these took minutes, or for ever


@pytest.mark.parametrize("look", [
    lambda: plain("x" + 200_000 * " " + "y"), lambda: bare_tag("x" + 200_000 * " " + "y"),
    lambda: plain(50_000 * "[("),
    lambda: undated("FIC101" + 4000 * "_20260317" + "x"),
    lambda: Lexicon(["x" + 200_000 * " " + "y"]).parsed,
    lambda: _ROW.match(b"x" + 200_000 * b"\t" + b"y"),
    lambda: [form.match("a" + 50_000 * "  b" + ";") for form, _ in _REWRITTEN],
    lambda: re.match(_at_edges(48 * "-" + " " + 8 * "-")[1][0][0], ("Ж" * 60).encode()),
])
def test_a_long_text_is_looked_at_once(look):
    begun = time.process_time()
    look()
    assert time.process_time() - begun < SECONDS


@pytest.mark.parametrize("line", ["Speisewasserregelventilstellungsregler", 200 * "-", 200 * ". ", 60 * "a b "])
def test_lines_of_a_text_in_the_settings_are_no_keys(line):
    text = f'[loops.A]\ndescription = """\n{line}\n"""\n[loops.B]\nKx = 1\n'
    begun = time.process_time()
    with pytest.raises(BacklashError) as caught:
        parse_toml(text, "f.toml")
    assert "line 6" in caught.value.where and time.process_time() - begun < SECONDS


def test_a_column_of_very_long_texts_holds_no_scan(tmp_path):
    rest = "x" + 3000 * " " + "y"
    (tmp_path / "plant.csv").write_text(wide(name=lambda n: n + ",Remark" * n.endswith("SP"),
                                             value=lambda n, v: f"{v}" + f",{rest}" * n.endswith("SP")))
    (tmp_path / "loops.toml").write_text(SETTINGS)
    begun = time.process_time()
    assert len(read(tmp_path / "plant.csv")) == 2 and time.process_time() - begun < SECONDS
