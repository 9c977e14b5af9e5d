"""CPU time of a scan, as ratios in one run to reading the same file with pyarrow alone.

    python -m tests.benchmarks.speed [LOOPS]

Start-up is taken off (every step runs once on a small file first); one thread each. The baseline `plain_pandas` makes
the same estimate loop by loop.
"""

from __future__ import annotations

import gc
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from backlash_cli import ScanOptions, scan_files
from backlash_cli.loaders.plant import open_plant
from backlash_cli.loaders.signals import Joiner
from tests.benchmarks.made_plant import DAY, write
from tests.benchmarks.plain_pandas import dead_bands


def cpu(work: Callable[[], object], times: int = 3) -> float:
    """Smallest CPU time [s] of several runs."""
    found = []
    for _ in range(times):
        start = time.process_time()
        work()
        found.append(time.process_time() - start)
    return min(found)


def records_of(path: Path) -> int:
    """Read all loops and do nothing with them; return the number of samples."""
    opened = open_plant(path)
    joiner = Joiner(opened.recipes[0].options.good_quality)
    return sum(len(recipe.record(joiner)) for recipe in opened.recipes)


def ratios(path: Path, loops: int) -> None:
    """Print the time of each stage, and the ratios."""
    samples = loops * DAY
    if path.suffix == ".csv":
        alone = cpu(lambda: pa_csv.read_csv(path, read_options=pa_csv.ReadOptions(use_threads=False)))
    else:
        alone = cpu(lambda: pa_parquet.read_table(path, use_threads=False))
    opened = cpu(lambda: open_plant(path))
    read = cpu(lambda: records_of(path))
    quick = cpu(lambda: scan_files(path, options=ScanOptions(confirm=False), jobs=1))
    full = cpu(lambda: scan_files(path, jobs=1), 2)
    steps = {"pyarrow alone": alone, "open": opened, "records": read - opened, "estimates": quick - read,
             "confirmation": full - quick}
    print(f"{path.suffix[1:]}: " + ", ".join(f"{name} {1e9 * t / samples:.0f}" for name, t in steps.items())
          + f" ns a loop-sample; --no-confirm {quick / alone:.2f} times pyarrow alone ({1e3 * quick / loops:.1f} ms a "
          f"loop-day), full verdict {full / alone:.2f} times ({1e3 * full / loops:.1f} ms)", flush=True)
    plain = cpu(lambda: dead_bands(path), 1)
    print(f"plain pandas program, the estimate alone: {plain / quick:.1f} times --no-confirm, {plain / full:.1f} times "
          "full verdict")


def main() -> None:
    loops = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    pa.set_cpu_count(1)
    print(f"{loops} loops of a day at 1 s, {os.cpu_count()} cores, one used")
    with tempfile.TemporaryDirectory() as folder:
        for suffix in ("csv", "parquet"):
            small = write(Path(folder, f"small.{suffix}"), 2, 0.2)
            scan_files(small, jobs=1)
            gc.freeze()  # as the command does: the program itself holds no garbage
            ratios(write(Path(folder, f"plant.{suffix}"), loops, 1.0), loops)


if __name__ == "__main__":
    main()
