"""The engine dask on a cluster of two worker processes: the local report, also when workers die."""

import os
import signal
import sys
import threading
import time

import pyarrow.csv
import pytest

from backlash_cli.api import scan_files, scan_part
from backlash_cli.engines.cluster import watch
from backlash_cli.errors import BacklashError, UsageError
from backlash_cli.history.unfinished import Unfinished
from backlash_cli.loaders import ReadOptions
from backlash_cli.reporter.json_report import to_json
from backlash_cli.results import Verdict
from tests.commands.run import run
from tests.engines.parts import QUICK
from tests.loaders.test_partitions import single, write
from tests.small_plant import TRUTH, write_plant

pytest.importorskip("distributed", reason="dask is not installed: pip install 'backlash[dask]'")
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


@pytest.fixture(autouse=True)
def many_small_parts(monkeypatch):
    monkeypatch.setattr("backlash_cli.loaders.parts.MOST_LOOPS", 3)


def on(client, plant, work, reading=None, **more):
    from backlash_cli.engines.plant import DaskPlant

    found = DaskPlant(client, [plant / "set"], loops=None, reading=reading or ReadOptions(), absolute=False)
    return found.scan(work, **more)


def quick(part):
    return scan_part(part, QUICK)


def slow(part):
    time.sleep(0.3)
    return scan_part(part, QUICK)


def deadly(part):
    if "PIC303-2" in part.loops:
        os._exit(1)
    return scan_part(part, QUICK)


def deadly_for_a(part):
    if "A" in part.loops:
        os._exit(1)
    return scan_part(part, QUICK)


def broken(part):
    if "PIC303-2" in part.loops:
        raise RuntimeError("out of order")
    return scan_part(part, QUICK)


def test_the_report_is_that_of_the_local_engine(client, plant, local):
    seen = []
    assert to_json(on(client, plant, quick, progress=seen.append)) == local
    assert sorted(report.loop for report in seen) == sorted(LOOPS)
    chosen = ReadOptions(sample="5", since="5min")
    want = scan_files([plant / "set"], reading=chosen, options=QUICK, jobs=1)
    assert to_json(on(client, plant, quick, chosen)) == to_json(want)


def test_a_worker_killed_during_the_run_costs_nothing_but_time(client, plant, local):
    killed = []

    def kill_one(report):
        if not killed:
            killed.append(client.run(os.getpid).popitem()[1])
            os.kill(killed[0], signal.SIGKILL)

    assert to_json(on(client, plant, slow, progress=kill_one)) == local
    assert killed


def test_a_stopped_scan_goes_on_where_it_was_stopped(client, plant, tmp_path):
    """With what was said of the files of loops that are not read again: a row that is no row, a file that is none."""
    folder = tmp_path / "set"
    rows = "\n".join(f"2026-03-01T00:{s // 60:02}:{s % 60:02},50,{50 + s % 7},{40 + s % 5}" for s in range(300))
    write(folder, {f"loop={x}/part-0.parquet": single(pyarrow.csv.read_csv(plant / "plant.csv"), x.split("-")[0])
                   for x in LOOPS[:6]})
    (folder / "A.csv").write_text(f"time,A.SP,A.PV,A.OP\nx,y\n{rows}\n")
    (folder / "loops.toml").write_bytes((plant / "set" / "loops.toml").read_bytes())
    want = to_json(scan_files([folder], options=QUICK, jobs=1))

    class Stop(Exception):
        pass

    def stop(report):
        if report.loop == "A":
            raise Stop

    before = Unfinished(tmp_path / "h.db", (), resume=False)
    with pytest.raises(Stop):
        on(client, tmp_path, quick, progress=stop, keep=before)
    again, seen = Unfinished(tmp_path / "h.db", (), resume=True), []
    assert "A" in {kept.report.loop for kept in again.known.values()}
    assert to_json(on(client, tmp_path, deadly_for_a, progress=seen.append, keep=again)) == want
    assert sorted(report.loop for report in seen) == sorted(["A", *LOOPS[:6]])
    assert to_json(on(client, tmp_path, quick, keep=Unfinished(tmp_path / "h.db", (), resume=True))) == want


@pytest.mark.parametrize(("work", "code", "words"), [
    (deadly, "process_died", "killed every time"), (broken, "internal_error", "RuntimeError: out of order"),
])
def test_a_loop_that_kills_its_worker_is_named_and_the_others_survive(client, plant, local, work, code, words):
    import json

    found = on(client, plant, work)
    wrong = [report for report in found.loops if report.verdict is Verdict.ERROR]
    assert [report.loop for report in wrong] == ["PIC303-2"]
    assert wrong[0].reasons[0].code == code and words in wrong[0].reasons[0].message
    others = [loop for loop in json.loads(local)["loops"] if loop["loop"] != "PIC303-2"]
    assert [loop for loop in json.loads(to_json(found))["loops"] if loop["loop"] != "PIC303-2"] == others


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


def test_workers_that_do_not_see_the_files_are_named(client, plant, monkeypatch):
    from backlash_cli.engines import plant as room

    def unseen(sources, options, end=False):
        from backlash_cli.errors import InputError
        from backlash_cli.loaders.parts import Survey

        return [Survey(s, failure=InputError("no such file: x", where=str(s.path))) for s in sources]

    monkeypatch.setattr(room, "survey_all", unseen)
    with pytest.raises(BacklashError, match="workers do not see") as caught:
        on(client, plant, quick)
    assert "s3://" in caught.value.remedy


def test_no_data_is_the_same_error_as_here(client, tmp_path):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "a.csv").write_text("")
    with pytest.raises(BacklashError, match="empty"):
        on(client, tmp_path, quick)
    with pytest.raises(UsageError, match="--since"):
        ReadOptions(since="x")
