"""Kill a scan into a history at random moments and resume it, again and again: report and history are those of one run.

    python -m tests.benchmarks.resume [SCANS] [LOOPS]
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from backlash_cli.history.store import History
from tests.benchmarks.dask_folder import make

TABLES = ("nights", "half_periods", "runs")


def scan(folder: Path, name: str, jobs: int, *more: str) -> subprocess.Popen[bytes]:
    """Start a scan of the folder into a history and a report of that name."""
    told = ["scan", str(folder / "plant"), "--history", str(folder / f"{name}.db"), "--output",
            str(folder / f"{name}.json"), "--jobs", str(jobs), *more]
    return subprocess.Popen([sys.executable, "-m", "backlash_cli", *told], stderr=subprocess.PIPE)


def content(path: Path) -> list[tuple[object, ...]]:
    """All rows of a history."""
    with History(path) as store:
        return [tuple(row) for table in TABLES for row in store.db.execute(f"SELECT * FROM {table}")]


def main() -> None:
    scans, loops = (int(a) for a in (*sys.argv[1:], *("6", "60")[len(sys.argv) - 1 :]))
    draw = random.Random(1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make(folder / "plant", loops, 7200)
        began = time.perf_counter()
        scan(folder, "whole", 1).communicate()
        whole = time.perf_counter() - began
        want = (folder / "whole.json").read_bytes(), content(folder / "whole.db")
        kills = 0
        for number in range(scans):
            more: tuple[str, ...] = ()
            longer = 1.0  # a run has to start before it can be killed at work
            while True:
                child = scan(folder, str(number), 1 + number % 2, *more)
                more = ("--resume",)
                try:
                    child.wait(longer * draw.uniform(0.4, 1.0) * whole)
                    break
                except subprocess.TimeoutExpired:
                    child.send_signal(signal.SIGKILL)
                    child.communicate()
                    kills, longer = kills + 1, 1.3 * longer
                    report, history = folder / f"{number}.json", folder / f"{number}.db"
                    assert not report.exists() or report.read_bytes() == want[0], number  # whole, or not there
                    assert not history.exists() or content(history) in ([], want[1]), number
            assert child.returncode == 0, child.stderr and child.stderr.read()
            found = (folder / f"{number}.json").read_bytes(), content(folder / f"{number}.db")
            assert found == want, number
            assert not list(folder.glob(f"{number}.db.unfinished-*")), number
    print(f"{scans} scans of {loops} loops killed {kills} times and resumed: report and history of one run")


if __name__ == "__main__":
    main()
