"""Exports behind addresses: the same plant as from a plain path, and one clear message for everything that fails."""

import builtins
import contextlib
import functools
import http.server
import pickle
import threading
from pathlib import Path

import numpy as np
import pytest

from backlash_cli.errors import InputError
from backlash_cli.loaders import ReadOptions, read
from backlash_cli.places import Remote, place
from tests.commands.run import run
from tests.small_plant import write_plant

fsspec = pytest.importorskip("fsspec", reason="fsspec is not installed: pip install 'backlash[remote]'")


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    """A plant as wide CSV, as gzip, as Parquet, and as a partitioned folder with its settings."""
    import pyarrow.csv
    import pyarrow.parquet as pq

    folder = tmp_path_factory.mktemp("plant")
    path = write_plant(folder, hours=0.2)
    table = pyarrow.csv.read_csv(path)
    pq.write_table(table, folder / "plant.parquet", row_group_size=200)
    for loop in ("FIC101", "PIC303"):
        part = folder / "parts" / f"loop={loop}"
        part.mkdir(parents=True)
        names = ["time", *(f"{loop}.{signal}" for signal in ("SP", "PV", "OP"))]
        own = table.select(names).rename_columns(["time", "SP", "PV", "OP"])
        pq.write_table(own.slice(0, 400), part / "part-0.parquet")
        pq.write_table(own.slice(400), part / "part-1.parquet")
    (folder / "parts" / "loops.toml").write_text((folder / "plant.loops.toml").read_text())
    return folder


@pytest.fixture(scope="module")
def bucket(plant):
    memory = fsspec.filesystem("memory")
    memory.put(str(plant), "/bucket/", recursive=True)
    yield f"memory://bucket/{plant.name}"
    memory.rm("/bucket", recursive=True)


def same(one, other):
    assert [r.loop for r in one] == [r.loop for r in other]
    for a, b in zip(one, other, strict=True):
        assert a.settings == b.settings and len(a) == len(b)
        np.testing.assert_array_equal(a.measurement, b.measurement)
        np.testing.assert_array_equal(a.time, b.time)


@pytest.mark.parametrize("name", ["plant.csv", "plant.parquet", "parts"])
def test_an_address_gives_the_plant_of_the_plain_path(plant, bucket, name):
    same(read(f"{bucket}/{name}"), read(plant / name))
    same(read((plant / name).as_uri()), read(plant / name))


def test_a_large_remote_text_is_read_in_blocks(plant, bucket, monkeypatch):
    monkeypatch.setattr("backlash_cli.loaders.opening.BLOCK", 1 << 14)
    same(read(f"{bucket}/plant.csv"), read(plant / "plant.csv"))


def test_settings_are_named_by_address_too(plant, bucket, tmp_path):
    copy = tmp_path / "other.csv"
    copy.write_bytes((plant / "plant.csv").read_bytes())
    same(read(copy, loops=f"{bucket}/plant.loops.toml"), read(plant / "plant.csv"))


def test_the_command_takes_addresses_and_names_them_in_the_report(capfd, bucket):
    import json

    done = run(capfd, "scan", f"{bucket}/plant.parquet", "--no-confirm", "--format", "json", "--jobs", 1)
    report = json.loads(done.out)
    assert done.status == 0 and report["inputs"] == [f"{bucket}/plant.parquet"] and len(report["loops"]) == 3


@pytest.mark.parametrize(("address", "words"), [
    ("memory://bucket/nothing.csv", "not found"), ("nostore://x/a.csv", "no storage is called nostore"),
])
def test_a_failure_is_one_message(capfd, bucket, address, words):
    done = run(capfd, "scan", address)
    assert done.status == 2 and words in done.err and address in done.err and " -> " in done.err
    assert done.err.count("\n") == 1


@pytest.mark.parametrize(("scheme", "package"), [("s3", "backlash[s3]"), ("abfs", "backlash[azure]"),
                                                 ("gs", "backlash[gcs]")])
def test_a_missing_driver_is_named_with_what_to_install(monkeypatch, scheme, package):
    real = builtins.__import__

    def no_driver(name, *rest, **more):
        if name.partition(".")[0] in ("s3fs", "adlfs", "gcsfs"):
            raise ImportError(f"No module named {name!r}")
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", no_driver)
    with pytest.raises(InputError) as caught:
        read(f"{scheme}://bucket/plant.parquet")
    assert "driver" in str(caught.value) and package in caught.value.remedy


def test_plain_paths_need_no_fsspec(plant, monkeypatch):
    real = builtins.__import__

    def no_fsspec(name, *rest, **more):
        if name.partition(".")[0] == "fsspec":
            raise ImportError("No module named 'fsspec'")
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", no_fsspec)
    assert len(read(plant / "plant.parquet")) == 3 and len(read((plant / "plant.csv").as_uri())) == 3
    with pytest.raises(InputError, match="needs fsspec") as caught:
        read("s3://bucket/plant.parquet")
    assert "pip install" in caught.value.remedy


def test_a_denied_object_says_what_to_check(bucket, monkeypatch):
    def denied(self, path, **more):
        raise PermissionError("Forbidden")

    monkeypatch.setattr(type(fsspec.filesystem("memory")), "info", denied)
    with pytest.raises(InputError, match="access denied: Forbidden") as caught:
        read(f"{bucket}/plant.csv")
    assert "credentials" in caught.value.remedy


class Web(http.server.SimpleHTTPRequestHandler):
    def send_head(self):
        if "secret" in self.path:
            self.send_error(403)
            return None
        return super().send_head()

    def log_message(self, *words):
        """Keep the test's output clean."""


@contextlib.contextmanager
def serving(folder):
    with http.server.ThreadingHTTPServer(("localhost", 0), functools.partial(Web, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://localhost:{server.server_address[1]}"
        finally:
            server.shutdown()


def test_a_web_server_is_a_place_too(plant):
    pytest.importorskip("aiohttp", reason="aiohttp is not installed: pip install aiohttp")
    with serving(plant) as address:
        same(read(f"{address}/plant.csv"), read(plant / "plant.csv"))
        with pytest.raises(InputError, match="not found"):
            read(f"{address}/nothing.csv")
        with pytest.raises(InputError, match="access denied"):
            read(f"{address}/secret.csv")
    with pytest.raises(InputError, match="cannot be read"):
        read(f"{address}/plant.csv")


def test_what_is_an_address():
    for text in ("s3://b/k.csv", "simplecache::s3://b/k.csv", "abfs://c@a/x", "memory://x"):
        assert isinstance(place(text), Remote)
    for text in ("plant.csv", "C:\\data\\plant.csv", "C:/data", "a:b.csv", "/x//y.csv", "FIC:101.csv"):
        assert isinstance(place(text), Path)
    assert place("file:///data/my%20plant.csv") == Path("/data/my plant.csv")


def test_addresses_have_parts_like_paths():
    key = Remote("s3://bucket/year/plant.csv.gz")
    assert (key.name, str(key.parent)) == ("plant.csv.gz", "s3://bucket/year")
    assert str(key.parent / "loops.toml") == "s3://bucket/year/loops.toml"
    assert Remote("memory://x.csv").parent / "loops.toml" == Remote("memory://loops.toml")
    assert pickle.loads(pickle.dumps(key)) == key
    assert Remote("https://host/a/plant.csv?sig=x/y").name == "plant.csv"


def test_options_hold_for_addresses(bucket):
    found = read(f"{bucket}/parts", options=ReadOptions(only_loops=("FIC*",), since="5min"))
    assert [r.loop for r in found] == ["FIC101"] and len(found["FIC101"]) == 301
