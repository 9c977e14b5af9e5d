"""Whatever stands in a file, only the project's own errors leave the readers."""

from __future__ import annotations

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from backlash_cli.errors import BacklashError, MetadataError
from backlash_cli.loaders import read
from backlash_cli.settings.schema import parse_table, parse_toml, settings_of
from tests.benchmarks.fuzz_readers import TOKENS, broken_promise, mutate, seeds

from .exports import SETTINGS, arrow, iso, long, wide

quick = settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
SEEDS = seeds()


def attempt(path, data):
    path.write_bytes(data)
    (path.parent / "loops.toml").write_text(SETTINGS)
    try:
        plant = read(path)
    except BacklashError as error:
        assert str(error).strip()
    else:
        assert broken_promise(plant) == ""


@quick
@given(choice=st.integers(0, len(SEEDS) - 1), seed=st.integers(0, 2**32 - 1))
def test_mutated_exports(tmp_path, choice, seed):
    name, data = SEEDS[choice]
    attempt(tmp_path / name, mutate(data, [b for _, b in SEEDS[:40]], np.random.default_rng(seed)))


cells = st.one_of(
    st.sampled_from([t.decode("latin-1") for t in TOKENS if len(t) < 30]),
    st.floats().map(repr),
    st.integers(-(10**20), 10**20).map(str),
    st.text(max_size=8),
    st.datetimes().map(iso),
)


@quick
@given(st.lists(st.lists(cells, min_size=1, max_size=5), max_size=12), st.sampled_from([",", ";", "\t"]), st.booleans())
def test_tables_of_odd_cells(tmp_path, rows, delimiter, header):
    lines = [delimiter.join(["time", "A.SP", "A.PV", "A.OP"])] * header
    lines += [delimiter.join(row) for row in rows]
    attempt(tmp_path / "plant.csv", "\n".join(lines).encode("utf-8", errors="surrogatepass"))


@quick
@given(st.dictionaries(st.sampled_from(["timestamp", "A.SP", "A.PV", "A.OP", "A.MODE", "tag", "value", "quality"]),
                       st.sampled_from(["int64", "float64", "string", "bool", "timestamp[ns]", "date32",
                                        "decimal128(9, 2)",
                                        "binary"]),
                       min_size=1), st.integers(0, 30), st.integers(0, 2**32 - 1))  # fmt: skip
def test_parquet_of_any_types(tmp_path, columns, rows, seed):
    rng = np.random.default_rng(seed)
    made = {}
    for name, kind in columns.items():
        numbers = rng.integers(-(2**40), 2**40, rows) if rng.random() < 0.5 else np.arange(rows)
        known = {"string": pa.string(), "binary": pa.binary(), "decimal128(9, 2)": pa.decimal128(38, 2)}
        values = pa.array(numbers.astype(str)) if kind in ("string", "binary") else pa.array(numbers)
        try:
            made[name] = values.cast(known[kind] if kind in known else pa.type_for_alias(kind), safe=False)
        except pa.ArrowException:
            made[name] = values
    buffer = io.BytesIO()
    pq.write_table(pa.table(made), buffer)
    attempt(tmp_path / "plant.parquet", buffer.getvalue())


@quick
@given(st.text(alphabet='[]loopsA.=\n"KTi 0123456789-,nafPB/m', max_size=120))
def test_any_text_as_metadata(text):
    for parse in (parse_toml, parse_table):
        try:
            metadata = parse("[loops.A]\n" + text, "x")
            for values in metadata.loops.values():
                settings_of(values)
        except MetadataError as error:
            assert str(error).strip()


values = st.one_of(
    st.floats(), st.integers(), st.text(max_size=6), st.booleans(), st.lists(st.floats(), max_size=3), st.none()
)


@quick
@given(
    st.dictionaries(
        st.sampled_from(
            ["K", "Ti", "Td", "Kp", "Tf", "theta", "PB", "Ki", "Kd", "reset", "pv_range", "form", "units", "sp"]
        ),
        values,
    )
)
def test_any_values_in_metadata(given_values):
    from backlash_cli.settings.schema import LoopValues

    try:
        result = settings_of(LoopValues(given_values, "x"))
    except MetadataError:
        return
    assert result.loop.Ti is None or result.loop.Ti > 0
    assert result.loop.K is None or result.loop.K != 0


# Inputs that once broke something.
def test_bad_bytes_in_a_row_that_is_too_long(tmp_path, capfd):
    text = wide().encode().replace(b"2026-03-18T00:01:00,", b"2026-03-18T00:01:00,\xdc\xff,,,", 1)
    attempt(tmp_path / "plant.csv", text)
    assert "Traceback" not in capfd.readouterr().err


def test_unreadable_stamp_among_the_last_rows(tmp_path):
    path = tmp_path / "plant.csv"
    path.write_text(wide() + "Total,600,,,,,\n")
    (tmp_path / "loops.toml").write_text(SETTINGS)
    assert len(read(path)["FIC101"]) == 600


def test_text_of_a_parquet_file_that_is_no_text(tmp_path):
    words = pa.Array.from_buffers(
        pa.string(), 2, [None, pa.py_buffer(np.array([0, 2, 4], np.int32)), pa.py_buffer(b"\xce\xff20")]
    )
    table = arrow().slice(0, 2).append_column("A.PV", words).append_column("time2", words)
    pq.write_table(table, tmp_path / "plant.parquet")
    attempt(tmp_path / "plant.parquet", (tmp_path / "plant.parquet").read_bytes())


@pytest.mark.parametrize("name", ["q." * 400 + "PV", "." * 5000, "A" * 30_000 + ".PV", "time." * 300])
def test_names_that_never_end(tmp_path, name):
    attempt(tmp_path / "plant.csv", wide(name=lambda n: name if n == "FIC101.PV" else n).encode())


def test_far_off_stamps_take_no_memory(tmp_path):
    rows = "".join(
        f"X.{s},{t},1\n"
        for t in ("1970-01-01T00:00:00", "2026-01-01T00:00:00", "9999-12-31T23:59:59")
        for s in ("PV", "SP")
    )
    attempt(tmp_path / "plant.csv", ("tag,time,value\n" + rows).encode())
    attempt(
        tmp_path / "plant.csv",
        long(lambda n, t, v: f"{n},{iso(t.replace(year=2026 if t.second else 1000))},{v}", "tag,time,value").encode(),
    )
