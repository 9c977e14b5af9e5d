"""scan --history --resume: a scan killed at any moment goes on where it stopped, and ends with the same report."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pyarrow.csv
import pytest

from backlash_cli.engines import local
from backlash_cli.history.store import History
from tests.commands.run import COMMAND, run
from tests.loaders.test_partitions import single, write
from tests.small_plant import TRUTH, write_plant

pytestmark = pytest.mark.usefixtures("analysed_once")
LOOPS = [f"{name}-{k}" for k in range(4) for name in sorted(TRUTH)]


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    return pyarrow.csv.read_csv(write_plant(tmp_path_factory.mktemp("made"), hours=0.3))


@pytest.fixture
def plant(tmp_path, table):
    """A folder of 12 loops."""
    write(tmp_path / "set", {f"loop={x}/part-0.parquet": single(table, x.split("-")[0]) for x in LOOPS})
    (tmp_path / "set" / "loops.toml").write_text("[defaults]\nK = 1.1\nTi = 12.0\nKp = 1.1\npv_range = [0, 200]\n")
    return tmp_path / "set"


@pytest.fixture
def analysed(monkeypatch):
    """Names of the loops that this process analyses; `stop` after so many."""
    names, real = [], local.analyse_loop

    def counted(record, options, *more):
        if len(names) == counted.stop:
            raise KeyboardInterrupt
        names.append(record.loop)
        return real(record, options, *more)

    counted.stop = -1
    monkeypatch.setattr(local, "analyse_loop", counted)
    return names, counted


def told(plant, history, *more):
    return ("scan", plant, "--history", history, "--format", "json", "--jobs", 1, *more)


def content(history):
    with History(history) as store:
        return [row for table in ("nights", "half_periods", "runs")
                for row in map(tuple, store.db.execute(f"SELECT * FROM {table}"))]


def killed(plant, history, jobs, lines):
    """Start a scan, kill it when so many loops are in its file, and return how many there are then."""
    child = subprocess.Popen([*COMMAND, *map(str, told(plant, history)), "--jobs", str(jobs)],
                             stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until = time.monotonic() + 60.0
    while time.monotonic() < until and child.poll() is None:
        if sum(path.read_bytes().count(b"\n") // 2 for path in unfinished(history)) >= lines:
            break
        time.sleep(0.002)
    others = processes_of(child.pid)
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    until = time.monotonic() + 20.0
    while any(map(working, others)) and time.monotonic() < until:
        time.sleep(0.02)
    assert not any(map(working, others))  # they end with the first
    return sum(path.read_bytes().count(b"\n") // 2 for path in unfinished(history))


def processes_of(first):
    """The processes that one has started, where the system tells."""
    try:
        return Path(f"/proc/{first}/task/{first}/children").read_text().split()
    except OSError:
        return []


def working(number):
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def unfinished(history):
    return list(history.parent.glob(f"{history.name}.unfinished-*"))


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_killed_scan_goes_on_where_it_stopped(capfd, plant, tmp_path, analysed, jobs):
    want = run(capfd, *told(plant, tmp_path / "whole.db"))
    assert want.status == 0 and not unfinished(tmp_path / "whole.db")
    analysed[0].clear()
    history = tmp_path / "h.db"
    done = killed(plant, history, jobs, 3)
    assert 3 <= done < len(LOOPS)
    found = run(capfd, *told(plant, history, "--resume"))
    assert found.out == want.out and found.status == 0
    known = int(found.err.split(" of 12 loops were finished before")[0].rpartition(" ")[2])
    assert known >= done and len(analysed[0]) == len(LOOPS) - known and len(set(analysed[0])) == len(analysed[0])
    assert content(history) == content(tmp_path / "whole.db") and not unfinished(history)


def stopped(capfd, plant, history, analysed, after=5):
    analysed[1].stop = after
    done = run(capfd, *told(plant, history))
    assert done.status == 130 and f"{after} of 12 loops were analysed" in done.err and "--resume" in done.err
    analysed[1].stop = -1
    names = list(analysed[0])
    analysed[0].clear()
    return names


def test_a_changed_file_or_setting_is_analysed_again(capfd, plant, tmp_path, table, analysed):
    history = tmp_path / "h.db"
    names = stopped(capfd, plant, history, analysed)
    assert names == sorted(LOOPS)[:5]
    write(plant, {f"loop={names[1]}/part-0.parquet": single(table, "PIC303")})
    touched = plant / f"loop={names[3]}" / "part-0.parquet"
    os.utime(touched, ns=(touched.stat().st_atime_ns,) * 2)
    settings = plant / "loops.toml"
    settings.write_text(settings.read_text() + f'[loops."{names[2]}"]\nK = 1.3\n')
    found = run(capfd, *told(plant, history, "--resume"))
    assert set(analysed[0]) == {*LOOPS} - {names[0], names[4]} and "2 of 12 loops" in found.err
    assert found.out == run(capfd, *told(plant, tmp_path / "whole.db")).out


def test_other_options_or_no_resume_begin_anew(capfd, plant, tmp_path, analysed):
    history = tmp_path / "h.db"
    stopped(capfd, plant, history, analysed)
    other = run(capfd, *told(plant, history, "--resume", "--no-confirm"))
    assert len(analysed[0]) == 12 and "begins anew" in other.err and len(unfinished(history)) == 1
    analysed[0].clear()
    plain = run(capfd, *told(plant, history))
    assert len(analysed[0]) == 12 and "finished before" not in plain.err and not unfinished(history)
    again = run(capfd, *told(plant, history, "--resume"))
    assert again.out == plain.out and len(analysed[0]) == 24 and "begins anew" in again.err


def test_a_scan_may_be_stopped_again_and_again(capfd, tmp_path, analysed):
    export = write_plant(tmp_path, hours=0.3)
    want = run(capfd, *told(export, tmp_path / "whole.db", "--since", "10min"))
    analysed[0].clear()
    for after in (1, 2):
        analysed[1].stop = after
        stop = run(capfd, *told(export, tmp_path / "h.db", "--since", "10min", "--resume"))
        assert stop.status == 130
    analysed[1].stop = -1
    found = run(capfd, *told(export, tmp_path / "h.db", "--since", "10min", "--resume"))
    assert found.out == want.out and len(analysed[0]) == 3 and "2 of 3 loops" in found.err


def test_resume_needs_a_history(capfd, plant):
    done = run(capfd, "scan", plant, "--resume")
    assert done.status == 2 and "--history" in done.err


def test_the_nightly_job_goes_on_by_itself(capfd, plant, tmp_path, analysed):
    (tmp_path / "job").mkdir()
    for path in plant.rglob("*.parquet"):
        path.rename(tmp_path / "job" / f"{path.parent.name.removeprefix('loop=')}.parquet")
    config, history = tmp_path / "n.toml", tmp_path / "h.db"
    for name in ("whole", "h"):
        config.write_text('inputs = ["job/*.parquet"]\ntogether = true\nloops = "set/loops.toml"\n'
                          f'history = "{name}.db"\n'
                          f'[log]\nfile = "{name}.log"\n[outputs]\nscan = "{name}.{{date}}.json"\n')
        analysed[1].stop = -1 if name == "whole" else len(analysed[0]) + 5
        stopped = run(capfd, "nightly", config)
    assert stopped.status == 130 and unfinished(history) and not content(history)
    analysed[1].stop = -1
    analysed[0].clear()
    assert run(capfd, "nightly", config).status == 0
    assert len(analysed[0]) == 7 and "resumed" in (tmp_path / "h.log").read_text()
    assert content(history) == content(tmp_path / "whole.db") and not unfinished(history)
    (whole,), (resumed,) = tmp_path.glob("whole.*.json"), tmp_path.glob("h.*.json")
    assert resumed.read_bytes() == whole.read_bytes()
