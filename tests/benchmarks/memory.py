"""Peak resident memory of a whole scan of an export made on the fly, for two lengths of the same plant.

    python -m tests.benchmarks.memory [LOOPS] [DAYS] [--confirm] [--long] [--parquet]
    python -m tests.benchmarks.memory --kinds [DAYS] [NAME ...]

--long: rows of tag, time and value instead of a wide file. --kinds: one loop in the less usual ways of `made_kinds`,
nothing kept in memory, so that the two peaks tell what grows with the file. Files are made below
TMPDIR and deleted again; the scan needs as much room beside them for its scratch file.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from backlash_cli.loaders.clean import CHUNK
from backlash_cli.scratch import IN_MEMORY
from tests.benchmarks.made_kinds import KINDS, write_kind
from tests.benchmarks.made_plant import write, write_long

_SCAN = """
import sys, time
from backlash_cli import ScanOptions, scan
from backlash_cli.loaders import clean
from backlash_cli.loaders.options import ReadOptions
from backlash_cli.loaders.plant import open_plant
from backlash_cli.scratch import Room
confirm, room, zone, clean.CHUNK = sys.argv[1], int(sys.argv[2]), sys.argv[3], int(sys.argv[4])
for path in sys.argv[5:]:
    opened = open_plant(path, options=ReadOptions(timezone=zone or None), room=Room(room))
    result = scan(opened, ScanOptions(confirm=confirm == "confirm"), jobs=1)
    # what getrusage says begins with the memory of the process that started this one
    peak = next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM")) / (1 << 10)
    print(len(result.loops), peak, time.process_time())
    del opened, result
"""


def peaks_of(*paths: Path, confirm: bool = False, room: int = IN_MEMORY, zone: str = "", chunk: int = CHUNK
             ) -> list[tuple[int, float, float]]:
    """Return (loops, peak resident memory so far [MB], CPU time so far [s]) of one process that scans file after file.

    room: bytes of samples that are kept in memory. zone: of the stamps. chunk: rows of a long loop in memory at once.
    """
    run = [sys.executable, "-c", _SCAN, "confirm" if confirm else "", str(room), zone, str(chunk), *map(str, paths)]
    lines = subprocess.run(run, capture_output=True, text=True, check=True).stdout.splitlines()
    return [(int(loops), float(peak), float(seconds)) for loops, peak, seconds in map(str.split, lines)]


def kinds(days: int, names: list[str]) -> None:
    """Print the peaks of one loop in several kinds of files, of so many days and of a quarter of them."""
    with tempfile.TemporaryDirectory() as folder:
        for name in names or KINDS:
            peaks = []
            for length in (max(days // 4, 1), days):
                path = write_kind(Path(folder, "plant.csv"), KINDS[name], length)
                _, peak, seconds = peaks_of(path, room=0, zone=KINDS[name].zone)[0]
                peaks.append(peak)
            print(f"{name:20} {path.stat().st_size / 1e6:5.0f} MB: peak {peaks[0]:4.0f} MB of a quarter, "
                  f"{peaks[1]:4.0f} MB of the whole, CPU {seconds:.1f} s", flush=True)


def main() -> None:
    if "--kinds" in sys.argv:
        words = [word for word in sys.argv[1:] if word[0] != "-"]
        given = [int(word) for word in words if word.isdigit()]
        kinds(given[0] if given else 60, [word for word in words if not word.isdigit()])
        return
    numbers = [float(word) for word in sys.argv[1:] if word[0] != "-"]
    loops, days = int(numbers[0]) if numbers else 100, numbers[1] if len(numbers) > 1 else 1.0
    with tempfile.TemporaryDirectory() as folder:
        for length in (days / 4.0, days):
            name = "plant.parquet" if "--parquet" in sys.argv else "plant.csv"
            path = (write_long if "--long" in sys.argv else write)(Path(folder, name), loops, length)
            count, peak, seconds = peaks_of(path, confirm="--confirm" in sys.argv)[0]
            print(f"{path.stat().st_size / 1e9:.2f} GB, {count} loops, {length:g} days: peak {peak:.0f} MB, "
                  f"CPU {seconds:.0f} s", flush=True)


if __name__ == "__main__":
    main()
