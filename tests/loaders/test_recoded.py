"""Text that is not UTF-8 is brought to UTF-8 some bytes at a time, and its loops are those of the file read whole."""

import contextlib
import gzip
import io

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from backlash_cli.loaders import ReadOptions, files, lazy_tables, plain_csv, read, recoded
from backlash_cli.loaders.lazy_tables import Lazily, lazy_table
from backlash_cli.loaders.recoded import Recoded, Western
from backlash_cli.loaders.text_blocks import read_up_to
from tests.loaders.test_lazy import assert_same, outcome, read_lazily
from tests.small_plant import write_plant

ENCODINGS = ["cp1252", "latin-1", "utf-16-le", "utf-16-be", "utf-32-le", "cp1250", "shift_jis", "gb18030", "utf-7"]


def whole(data, encoding):
    """What `files` makes of all bytes, and its remarks."""
    content = files._decoded("here", data, ReadOptions(encoding=encoding), ())
    return content.data, [note.message for note in content.notes]


@given(text=st.text(), damage=st.binary(max_size=3), at=st.integers(0, 40), encoding=st.sampled_from(ENCODINGS),
       size=st.integers(1, 9), begun=st.integers(0, 9))
@settings(max_examples=300, deadline=None)
def test_pieces_of_any_size_give_the_text_of_all_bytes(text, damage, at, encoding, size, begun):
    made = b"x" + text.encode(encoding, errors="replace") if "16" not in encoding and "32" not in encoding else (
        "x" + text).encode(encoding, errors="replace")
    data = made[: at + 1] + damage + made[at + 1 :]
    expected = outcome_of(whole, data, encoding)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recoded, "CHUNK", size)
        mark = files.guess_encoding(data, "here", ReadOptions(encoding=encoding))[1]
        rest = io.BytesIO(data)
        rest.seek(mark)
        first = rest.read(begun)
        if encoding == "cp1252":
            source = Western(first, rest, lambda: contextlib.nullcontext(io.BytesIO(data[mark:])))
        else:
            source = Recoded(first, rest, encoding)
        found = read_up_to(source, 4 * len(data) + 100), [note.message for note in source.notes]
    assert mark or found == expected


def outcome_of(function, *args):
    try:
        return function(*args)
    except UnicodeDecodeError as error:
        return str(error)


def test_an_encoding_of_something_else_than_text_is_refused():
    with pytest.raises(ValueError, match="not a text encoding"):
        Recoded(b"", io.BytesIO(b"00"), "hex")


def in_german(tmp_path, encoding, form="wide"):
    """The small plant with a column of texts that are not ASCII, one of them far behind the beginning."""
    path = write_plant(tmp_path)
    lines = path.read_text("utf-8").splitlines()
    lines = [line + (",Gerät" if k == 0 else ",°C" if k == 5000 else ",C") for k, line in enumerate(lines)]
    if form == "long":
        names = lines[0].split(",")[1:-1]
        lines = ["time,tag,value,Gerät", *(f"{cells[0]},{name},{value},{'°C' if k == 5000 else 'C'}"
                 for k, cells in enumerate(line.split(",") for line in lines[1:])
                 for name, value in zip(names, cells[1:-1], strict=True))]
    lines.insert(6000, "one cell")
    path.write_bytes(("\ufeff" * encoding.startswith("utf") + "\n".join(lines) + "\n").encode(encoding))
    return path


@pytest.mark.parametrize("form", ["wide", "long"])
@pytest.mark.parametrize("encoding", ["cp1252", "utf-16-le", "utf-16-be", "utf-32-le"])
def test_other_encodings_are_read_block_by_block(tmp_path, monkeypatch, encoding, form):
    path = in_german(tmp_path, encoding, form)
    monkeypatch.setattr(lazy_tables, "BLOCK", 100_000)
    assert lazy_table(path, ReadOptions(), {}, Lazily()) is not None
    there, lazy = read(path), read_lazily(path)
    assert_same(there, lazy)
    assert any("line 6001" in note.message for note in lazy.warnings)
    assert any(note.code == "encoding" for note in lazy.warnings) == (encoding == "cp1252")


@pytest.mark.parametrize("late", [False, True])
def test_a_letter_of_another_encoding_is_found_wherever_it_stands(tmp_path, monkeypatch, late):
    path = in_german(tmp_path, "cp1252")
    data = path.read_bytes().replace(b"Ger\xe4t", b"Device") if late else path.read_bytes()
    path.write_bytes(data + b"\x81\n")
    monkeypatch.setattr(lazy_tables, "HEAD", 60_000)
    monkeypatch.setattr(lazy_tables, "BLOCK", 50_000)
    assert lazy_table(path, ReadOptions(), {}, Lazily()) is not None
    assert_same(read(path), read_lazily(path))


def test_a_packed_file_of_another_encoding_is_read_block_by_block(tmp_path):
    path = in_german(tmp_path, "cp1252")
    packed = path.with_suffix(".csv.gz")
    packed.write_bytes(gzip.compress(path.read_bytes()))
    path.unlink()
    assert lazy_table(packed, ReadOptions(), {}, Lazily()) is not None
    assert_same(read(packed), read_lazily(packed))


@given(encoding=st.sampled_from([*ENCODINGS[:6], None]), place=st.integers(0, 3000), damage=st.binary(max_size=4),
       size=st.integers(60, 4000))
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_text_is_read_alike(tmp_path, encoding, place, damage, size):
    lines = ["time;Gerät.SP;Gerät.PV;Gerät.OP",
             *(f"2026-03-17 08:00:{s:02};1,5;{s % 7};{s % 5}" for s in range(60))]
    data = "\r\n".join(lines).encode(encoding or "utf-8")
    path = tmp_path / "plant.csv"
    path.write_bytes(data[:place] + damage + data[place:])
    for options in (ReadOptions(encoding=encoding), ReadOptions()):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(lazy_tables, "BLOCK", size)
            patch.setattr(lazy_tables, "HEAD", 10_000)  # the encoding is guessed from all there is
            patch.setattr(plain_csv, "LEAST", 0)
            patch.setattr(recoded, "CHUNK", 500)
            assert_same(outcome(lambda: read(path, options=options)),  # noqa: B023
                        outcome(read_lazily, path, options))
