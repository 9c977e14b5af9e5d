"""Loops in one or several processes: same reports, same order; one loop's failure stays its own."""

import multiprocessing
import os
import subprocess
import sys
import time
from dataclasses import replace

import pytest

from backlash_cli.engines import local
from backlash_cli.engines.local import analyse, processes
from backlash_cli.record import record_from_arrays
from backlash_cli.results import Verdict
from tests.small_plant import records, write_plant


class Deadly:
    """Ends the process that unpickles it, as the kernel does when memory runs out."""

    def __reduce__(self):
        return os._exit, (1,)


@pytest.fixture(scope="module")
def plant():
    return [replace(r, loop=f"{r.loop}-{k}") for k in range(2) for r in records(hours=0.5)]


@pytest.fixture(scope="module")
def alone(plant):
    """The reports of one process."""
    return list(analyse(plant, jobs=1))


def test_number_of_processes_follows_the_work():
    small, large = records()[:1] * 8, [record_from_arrays(0.0, [0.0], interval=1.0)] * 8
    assert processes(small) == 1 and processes([]) == 1
    assert processes(small, 3) == 3 and processes(small, 100) == 8
    assert processes(large) == 1


def test_a_process_is_started_where_it_works_longer_than_it_starts(monkeypatch):
    monkeypatch.setattr(local, "cores", lambda: 64)
    days, hours = [range(86_400)] * 400, [range(3600)] * 2000  # only their length is asked for
    assert processes(days) > 2 * processes(days, confirm=False) > 2
    assert processes(days[:40], confirm=False) == 1
    assert processes(hours) > 2 * processes(hours, confirm=False) > 2  # a loop costs something, however short


def left(others):
    """Processes started since `others` were there, when they have had the time to end."""
    # a dead child still counts as alive while another thread is about to note its end
    limit = time.monotonic() + 10.0
    while (found := set(multiprocessing.active_children()) - others) and time.monotonic() < limit:
        time.sleep(0.02)
    return found


def test_reports_are_the_same_in_processes(plant, alone):
    assert [r.loop for r in alone] == [r.loop for r in plant]
    others = set(multiprocessing.active_children())
    assert list(analyse(plant, jobs=2)) == alone
    assert not left(others)


def test_a_failing_loop_is_reported_and_the_others_go_on(plant):
    broken = replace(plant[1], measurement=None)
    for jobs in (1, 2):
        found = list(analyse([plant[0], broken, plant[2]], jobs=jobs))
        assert [r.verdict is Verdict.ERROR for r in found] == [False, True, False]
        assert found[1].loop == plant[1].loop and found[1].reasons[0].code == "internal_error"
        assert "Error" in found[1].reasons[0].message and "Traceback" not in found[1].reasons[0].message


def test_a_dead_process_costs_only_its_loop(plant):
    deadly = replace(plant[1], disturbances={"x": Deadly()})
    found = list(analyse([plant[0], deadly, *plant[2:]], jobs=2))
    assert [r.loop for r in found] == [r.loop for r in plant]
    assert found[1].verdict is Verdict.ERROR and found[1].reasons[0].code == "process_died"
    assert all(r.verdict is not Verdict.ERROR for r in found[:1] + found[2:])


def test_a_pool_that_closes_while_a_process_of_it_begins_costs_no_loop(plant, alone, monkeypatch):
    calls = []

    class Closing(local.ProcessPoolExecutor):
        def submit(self, *args):  # the pool's own thread closes what is handed to the process that begins
            calls.append(args)
            if len(calls) == 2:
                raise OSError(9, "Bad file descriptor")
            return super().submit(*args)

    monkeypatch.setattr(local, "ProcessPoolExecutor", Closing)
    assert list(analyse(plant, jobs=2)) == alone and len(calls) > len(plant)


def test_stopping_in_the_middle_leaves_no_process(plant):
    others = set(multiprocessing.active_children())
    reports = analyse(plant * 4, jobs=2)
    next(iter(reports))
    reports.close()  # what an interrupt does on its way out
    assert not left(others)


SCRIPT = """from backlash_cli import ScanOptions, read, scan
result = scan(read({path!r}), ScanOptions(confirm=False), {options})
print(*(report.loop for report in result.loops))
"""


@pytest.mark.parametrize("options", ["", "jobs=2"])
def test_a_script_needs_no_guard_unless_it_asks_for_processes(tmp_path, options):
    (tmp_path / "script.py").write_text(SCRIPT.format(path=str(write_plant(tmp_path, hours=0.3)), options=options))
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    if options:
        assert "no further process could be started -> ask for one job" in done.stderr.splitlines()[-1]
        assert done.stderr.count("Traceback") <= 6 and not done.stdout
    else:
        assert done.stdout == "FIC101 PIC303 TIC202\n" and not done.stderr
