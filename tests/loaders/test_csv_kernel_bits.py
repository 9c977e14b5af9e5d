"""The compiled CSV parser against pyarrow, bit by bit, and within its buffers."""

import os
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.loaders.csv_kernel import DONE
from tests.loaders.test_csv_kernel import parsed

NUMBERS = st.one_of(
    st.from_regex(r"-?0{0,3}[0-9]{1,25}(\.[0-9]{0,25})?([eE][+-]?[0-9]{1,3})?", fullmatch=True),
    st.from_regex(r"-?\.[0-9]{1,25}", fullmatch=True),
    st.floats(allow_nan=False, allow_infinity=False).map(repr),  # subnormal ones too
    st.floats(-1e3, 1e3).map(lambda x: f"{x:.5f}"),
    st.integers(-(2**70), 2**70).map(str),
)
ODD = st.sampled_from(["", " ", "-", "+1", "nan", "inf", "-inf", "1e", "1e+", "e5", ".", "1.2.3", '"1.5"', "1 ", "é",
                       "Bad", "0x10", "1_000", "--1", "1e9999", "-1e-9999"])


def with_pyarrow(text: bytes, columns: int):
    """The numbers pyarrow makes, None where it makes none."""
    names = [f"c{i}" for i in range(columns)]
    try:
        table = pa_csv.read_csv(
            pa.BufferReader(text), read_options=pa_csv.ReadOptions(column_names=names, use_threads=False),
            convert_options=pa_csv.ConvertOptions(column_types=dict.fromkeys(names, pa.float64()), null_values=[""]))
    except pa.ArrowInvalid:
        return None
    return np.stack([column.to_numpy() for column in table.columns])


@given(rows=st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=20), odd=st.lists(ODD, max_size=1),
       end=st.sampled_from(["\n", "\r\n"]), extra=st.sampled_from(["", "", ",1", "\n"]))
@settings(max_examples=400, deadline=None)
def test_what_the_parser_settles_is_what_pyarrow_makes(rows, odd, end, extra):
    lines = [",".join(row) for row in rows]
    if odd:
        lines.append(f"{odd[0]},1.5")
    text = (end.join(lines) + extra + end).encode()
    values, _, words, ended = parsed(text, (0, 1))
    if ended != DONE or words:
        return
    expected = with_pyarrow(text, 2)
    assert expected is not None
    np.testing.assert_array_equal(values.view(np.int64), expected.view(np.int64))


_FUZZ = """
import numpy as np
from tests.loaders.test_csv_kernel import parsed
random = np.random.default_rng(4)
letters = np.frombuffer(b'0123456789012345678901234567890.-,,,\\n\\n\\r\\r"eE+ aBx', np.uint8)
for k in range(20000):
    text = random.choice(letters, random.integers(0, 60)).tobytes() + b"\\n"
    parsed(text, ((0,), (0, 1), (-2, 0), (-1, 0, -2), (-2, -2, 0))[k % 5], words=k % 3)
names = parsed.__globals__
for size in (1, 2):
    ended = names["parse_lines"](np.frombuffer(b"1\\n", np.uint8), size, np.array([0]), 44, 46,
        np.zeros((1, 1), np.uint64), np.zeros((1, 0, 2), np.int64), np.zeros((1, 4), np.int64), np.full(1, -1),
        *(names[n] for n in ("TENS", "WHOLE_TENS", "FIVES")))[-1]
    assert ended == names["STRANGE"]
print("room behind the lines is asked for")
"""


def test_it_never_leaves_its_buffers(tmp_path):
    checked = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", _FUZZ], env=checked, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "room behind the lines is asked for\n"), done.stderr[-2000:]
