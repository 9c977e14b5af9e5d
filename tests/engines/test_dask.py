"""The engine dask on a cluster of two worker processes: the local report, also when workers die."""

import os
import pickle
import signal
import sys
import threading
import time
from contextlib import nullcontext
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pyarrow.csv
import pytest

from backlash_cli.api import scan, scan_files
from backlash_cli.engines.cluster import connected, watch
from backlash_cli.engines.local import with_samples
from backlash_cli.errors import BacklashError, UsageError
from backlash_cli.history.unfinished import Unfinished
from backlash_cli.loaders import ReadOptions
from backlash_cli.loaders.plant import open_plant
from backlash_cli.loaders.tables import open_parquet
from backlash_cli.reporter.json_report import to_json
from backlash_cli.results import Verdict
from backlash_cli.scanning import ScanOptions
from backlash_cli.scratch import Room
from tests.commands.run import run
from tests.loaders.test_layouts import EXPORTS
from tests.loaders.test_more_layouts import MORE
from tests.loaders.test_partitions import single, write
from tests.small_plant import TRUTH, write_plant

pytestmark = pytest.mark.skipif(find_spec("distributed") is None,  # which takes seconds to load, in each worker
                                reason="dask is not installed: pip install 'backlash[dask]'")
QUICK = ScanOptions(confirm=False)
LOOPS = [f"{name}-{k}" for k in range(8) for name in sorted(TRUTH)]


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    """A partitioned folder of 24 loops."""
    folder = tmp_path_factory.mktemp("plant")
    table = pyarrow.csv.read_csv(write_plant(folder, hours=0.2))
    write(folder / "set", {f"loop={x}/part-0.parquet": single(table, x.split("-")[0]) for x in LOOPS})
    (folder / "set" / "loops.toml").write_text("[defaults]\nK = 1.1\nTi = 12.0\npv_range = [0, 200]\n")
    return folder


@pytest.fixture(scope="module")
def local(plant):
    return to_json(scan_files([plant / "set"], options=QUICK, jobs=1))


def on(client, plant, reading=None, change=lambda recipe: recipe, **more):
    """The scan of a plant on the cluster. change: of each recipe before it is sent."""
    opened = open_plant([plant / "set"], options=reading, salt="")
    return scan(replace(opened, recipes=tuple(map(change, opened.recipes))), QUICK, client=client, **more)


@pytest.mark.parametrize("times", [2, 3])
def test_a_greeting_that_dask_trips_over_is_tried_again(client, monkeypatch, times):
    """Dask asserts that its greeting comes alone; work that another client cancels at that moment comes with it."""
    left = [AssertionError] * times

    def tripping(*args, **options):
        if left:
            raise left.pop()
        return distributed_client(*args, **options)

    distributed = pytest.importorskip("distributed")
    distributed_client = distributed.Client
    monkeypatch.setattr(distributed, "Client", tripping)
    with nullcontext() if times == 2 else pytest.raises(BacklashError, match="no scheduler answers"), \
            connected(client.cluster.scheduler_address) as found:
        assert found.status == "running"


class Deadly:
    """Ends the process that unpickles it."""

    def __reduce__(self):
        return os._exit, (1,)


class Broken:
    def __reduce__(self):
        return exec, ("raise RuntimeError('out of order')",)


def with_note(loop, value):
    return lambda recipe: replace(recipe, notes=(value,)) if recipe.loop == loop else recipe


def test_the_report_is_that_of_the_local_engine(client, plant, local):
    seen = []
    assert to_json(on(client, plant, progress=seen.append)) == local
    assert sorted(report.loop for report in seen) == sorted(LOOPS)
    chosen = ReadOptions(sample="5", since="5min")
    want = scan_files([plant / "set"], reading=chosen, options=QUICK, jobs=1)
    assert to_json(on(client, plant, chosen)) == to_json(want)


@pytest.mark.parametrize("key", [*list(EXPORTS)[::8], *list(MORE)[::6]])
def test_every_export_gives_the_report_of_the_local_engine(client, key, tmp_path):
    """Samples of text files and of long ones travel with the loop, those of Parquet files are read by the worker."""
    export = EXPORTS.get(key) or MORE[key]
    inputs, reading = export.write(tmp_path), ReadOptions(**export.options)
    want = scan_files(inputs, reading=reading, options=QUICK, jobs=1)
    assert to_json(scan(open_plant(inputs, options=reading, room=Room(0)), QUICK, client=client)) == to_json(want)


def test_what_is_sent_needs_no_scratch_file(tmp_path):
    """Also of a loop that is made in chunks."""
    opened = open_plant(write_plant(tmp_path, hours=0.2), room=Room(0))
    sent = pickle.dumps([*map(with_samples, opened.recipes)])
    want = [recipe.record() for recipe in opened.recipes]
    del opened
    for recipe, record in zip(pickle.loads(sent), want, strict=True):
        found = recipe.record()
        assert np.array_equal(found.measurement, record.measurement, equal_nan=True) and found.notes == record.notes


def test_a_worker_killed_during_the_run_costs_nothing_but_time(client, plant, local):
    killed = []

    def kill_one(report):
        if not killed:
            killed.append(client.run(os.getpid).popitem()[1])
            os.kill(killed[0], signal.SIGKILL)

    assert to_json(on(client, plant, progress=kill_one)) == local
    assert killed


def test_a_stopped_scan_goes_on_where_it_was_stopped(client, plant, local, tmp_path):
    class Stop(Exception):
        pass

    def stop(report):
        if report.loop == "PIC303-2":
            raise Stop

    before = Unfinished(tmp_path / "h.db", (), resume=False)
    with pytest.raises(Stop):
        on(client, plant, progress=stop, keep=before)
    again, seen = Unfinished(tmp_path / "h.db", (), resume=True), []
    known = {report.loop for report in again.known.values()}
    assert "PIC303-2" in known and len(known) < len(LOOPS)
    assert to_json(on(client, plant, change=with_note("PIC303-2", Deadly()), progress=seen.append, keep=again)) == local
    assert sorted(report.loop for report in seen) == sorted(LOOPS)


@pytest.mark.parametrize(("fault", "code", "words"), [
    (Deadly(), "process_died", "killed every time"), (Broken(), "internal_error", "RuntimeError: out of order"),
])
def test_a_loop_that_kills_its_worker_is_named_and_the_others_survive(client, plant, local, fault, code, words):
    import json

    found = on(client, plant, change=with_note("PIC303-2", fault))
    wrong = [report for report in found.loops if report.verdict is Verdict.ERROR]
    assert [report.loop for report in wrong] == ["PIC303-2"]
    assert wrong[0].reasons[0].code == code and words in wrong[0].reasons[0].message
    others = [loop for loop in json.loads(local)["loops"] if loop["loop"] != "PIC303-2"]
    found = replace(found, loops=tuple(report for report in found.loops if report.loop != "PIC303-2"))
    assert json.loads(to_json(found))["loops"] == others


def test_the_command_works_on_a_running_cluster(capfd, client, plant, tmp_path):
    address = client.cluster.scheduler_address
    told = ("scan", plant / "set", "--no-confirm", "--format", "json", "--loops-matching", "FIC*")
    there = run(capfd, *told, "--engine", "dask", "--scheduler", address)
    here = run(capfd, *told, "--jobs", 1)
    assert there.status == here.status == 0 and there.out == here.out
    page = run(capfd, "scan", plant / "set", "--no-confirm", "--loop", "FIC101-0", "--engine", "dask", "--scheduler",
               address, "--output", tmp_path / "page.html", "--plot", tmp_path / "pictures")
    assert page.status == 0 and (tmp_path / "page.html").exists() and list((tmp_path / "pictures").glob("*.png"))


def test_wrong_use_is_one_message(capfd, plant):
    began = time.perf_counter()
    done = run(capfd, "scan", plant / "set", "--engine", "dask", "--scheduler", "tcp://localhost:9")
    assert done.status == 2 and "no scheduler answers" in done.err and time.perf_counter() - began < 12.0
    dask = ("--engine", "dask", "--scheduler")
    for arguments, words in (((*dask, "bad://x"), "no address of a scheduler"),
                             (("--scheduler", "tcp://localhost:9"), "goes with --engine dask"),
                             ((*dask, "tcp://localhost:9", "--jobs", 2), "leave --jobs out"),
                             (("--engine", "spark"), "Invalid value")):
        done = run(capfd, "scan", plant / "set", *arguments)
        assert done.status == 2 and words in done.err


def test_without_dask_the_message_says_how_to_install_it(capfd, plant, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    done = run(capfd, "scan", plant / "set", "--engine", "dask")
    assert done.status == 2 and "pip install 'backlash[dask]'" in done.err


def test_workers_that_do_not_come_back_are_replaced_or_waited_for():
    class Few:
        """A cluster, and its client, of which one worker is left; what is added comes at once."""

        alive = 1

        def scheduler_info(self, n_workers):
            self.looks = getattr(self, "looks", 0) + 1
            if self.looks == 3:
                raise OSError("for a moment")
            if self.looks > 40:
                ended.set()
            return {"workers": dict.fromkeys(range(self.alive))}

        def scale(self, count):
            self.alive = count

    for ours, want in ((True, []), (False, ["the scheduler has no workers any more; waiting for new ones"])):
        ended, said, few = threading.Event(), [], Few()
        few.alive = 1 if ours else 0
        watch(few, few if ours else None, 2 if ours else 1, said.append, ended, pause=0.0)
        assert few.alive == (2 if ours else 0) and said == want


def test_files_that_a_worker_does_not_see_are_named(client, plant, tmp_path):
    (tmp_path / "set").mkdir()
    path = tmp_path / "set" / "FIC101.parquet"
    path.write_bytes((plant / "set" / "loop=FIC101-0" / "part-0.parquet").read_bytes())
    opened = open_plant([path])
    path.unlink()
    open_parquet.cache_clear()
    with pytest.raises(BacklashError, match=r"does not see this file.*s3://") as caught:
        scan(opened, QUICK, client=client)
    assert caught.value.code == "not_shared"


def test_no_data_is_the_same_error_as_here(client, tmp_path):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "a.csv").write_text("")
    with pytest.raises(BacklashError, match="empty"):
        on(client, tmp_path)
    with pytest.raises(UsageError, match="--since"):
        ReadOptions(since="x")
