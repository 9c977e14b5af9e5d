"""The compiled CSV parser makes the numbers that Python makes, and leaves what it does not know to pyarrow."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.loaders import fast_csv, lazy_tables, plain_csv
from backlash_cli.loaders.csv_kernel import DONE, STAMP, STRANGE, WORDS_FULL, look, parse_lines
from backlash_cli.loaders.decimal_kernel import FIVES, TENS, WHOLE_TENS
from backlash_cli.loaders.lazy_tables import Lazily
from backlash_cli.loaders.stamp_kernel import copy_cells
from backlash_cli.loaders.text_blocks import PAD
from tests.loaders.test_lazy import assert_same, outcome, read, read_lazily


def parsed(text: bytes, slots=(0,), point=".", words=50):
    data = np.frombuffer(text + bytes(PAD), np.uint8)
    lines = look(data[: len(text)])[0]
    bits = np.zeros((sum(s >= 0 for s in slots), lines), np.uint64)
    stamps, found = np.zeros((lines, sum(s == STAMP for s in slots), 2), np.int64), np.zeros((words, 4), np.int64)
    rows, count, ended = parse_lines(
        data, len(text), np.array(slots), ord(","), ord(point), bits, stamps, found, np.full(len(bits), -1), TENS,
        WHOLE_TENS, FIVES)
    cells = [text[a:b].decode() for _, a, b, _ in found[:count]]
    out = np.zeros(len(text) + stamps.size, np.uint8)
    written = copy_cells(data, stamps[:rows], ord(","), out)
    return bits.view(np.float64)[:, :rows], bytes(out[:written]).decode(), cells, ended


def assert_numbers(texts):
    values, _, words, ended = parsed("".join(f"{t}\n" for t in texts).encode())
    assert ended == DONE and not words
    expected = np.array([float(t) for t in texts])
    np.testing.assert_array_equal(values[0].view(np.int64), expected.view(np.int64))


def test_numbers_of_all_lengths_are_rounded_as_python_does():
    random = np.random.default_rng(5)
    texts = [repr(x) for x in (random.uniform(-1, 1, 5000) * 10.0 ** random.integers(-8, 9, 5000)).tolist()]
    for digits in random.integers(0, 2**63, 5000).tolist():
        text = str(digits)[: random.integers(1, 20)]
        point = random.integers(0, len(text) + 1)
        texts.append(f"{text[:point]}.{text[point:]}")
    assert_numbers(texts)


def test_numbers_half_way_between_two_are_rounded_to_the_even_one():
    random = np.random.default_rng(6)
    odd = [2 * m + 1 for m in random.integers(2**52, 2**53, 2000).tolist()]
    assert_numbers([f"{m // 2}.5" for m in odd] + [str(m) for m in odd] + [str(2 * m) for m in odd])


@given(st.lists(st.floats(1e-35, 1e35) | st.floats(-1e6, 1e6).map(lambda x: round(x, 6)), min_size=1, max_size=30))
@settings(max_examples=60, deadline=None)
def test_any_number_python_writes_is_read_back(values):
    assert_numbers([repr(v) for v in values])


@pytest.mark.parametrize("text", ["0", "-0", "-0.0", "5.", ".5", "1e5", "1E-05", "-2.5e-30", "00012.50", "12e+3",
                                  "0.000000000000000000000123", "9007199254740993", "18446744073709551615"])
def test_odd_forms_of_numbers(text):
    if len(text) >= 20 and not text.startswith("0."):
        assert parsed(f"{text}\n".encode())[3] == STRANGE
    else:
        assert_numbers([text])


@pytest.mark.parametrize("text", ["1,2,3\n", "1\n", '"1",2\n', "\n", "1,2\n\n", "1,2\r3", '"a\n"b,2\n'])
def test_what_is_no_plain_line_is_left_to_pyarrow(text):
    assert parsed(f"{text}\n".encode(), (0, 1))[3] == STRANGE


def test_words_are_told_once_while_they_last():
    values, stamps, words, ended = parsed(b"10:00,1,AUTO\n10:01,,AUTO\r\n10:02,+3,MAN\n10:03,-4,MAN\n", (STAMP, 0, 1))
    assert ended == DONE and words == ["AUTO", "+3", "MAN"]
    assert stamps == "10:00\n10:01\n10:02\n10:03\n"
    assert values[0, [0, 3]].tolist() == [1.0, -4.0] and np.isnan(values[0, 1:3]).all()
    assert parsed(b"a\nb\na\nc\n", words=3)[3] == WORDS_FULL


def test_a_column_that_changes_its_mind_and_foreign_lines_are_read_as_in_the_whole_file(tmp_path, monkeypatch):
    random = np.random.default_rng(8)
    lines = ["time,A.SP,A.PV,A.OP,A.MODE,A.PV.Quality"]
    for k in range(6000):
        cells = [f"2026-03-17T{8 + k // 3600:02}:{k // 60 % 60:02}:{k % 60:02}", "0.5", repr(random.uniform(0.4, 0.6)),
                 f"{random.uniform(0.4, 0.6):.3f}", "AUTO" if k % 1000 < 950 else "MAN", "Good" if k % 37 else "Bad"]
        if 3000 < k < 3100:
            cells[2] = ["Bad Input", "", '"0.55"', "0.5 bar", "nan"][k % 5]
        lines.append(",".join(cells))
    path = tmp_path / "plant.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    (tmp_path / "loops.toml").write_text("[defaults]\nK = 0.6\nTi = 8\npv_range = [0, 1]\nop_range = [0, 1]\n")
    for name, value in (("BLOCK", 30_000), ("HEAD", 10_000)):
        monkeypatch.setattr(lazy_tables, name, value)
    monkeypatch.setattr(plain_csv, "LEAST", 0)
    taken = []
    whole = plain_csv.PlainLines.parse
    monkeypatch.setattr(fast_csv.PlainLines, "parse", lambda self, text: taken.append(whole(self, text)) or taken[-1])
    assert_same(outcome(read, path), outcome(read_lazily, path, None, Lazily()))
    assert sum(block is None for block in taken) < 3 < len(taken)
