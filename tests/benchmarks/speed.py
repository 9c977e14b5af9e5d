"""CPU time of a scan, as ratios in one run to reading the same file with pyarrow alone.

    python -m tests.benchmarks.speed [LOOPS]

A wide CSV, the same as Parquet, and a third of the loops as rows of tag, time and value.
Start-up is taken off (every step runs once on a small file first); one thread each. What is compared runs in turn,
because the same work takes half as long again from one minute to the next on a shared machine; a ratio is the median
of those of the rounds, with the smallest and the largest beside it. The baseline `plain_pandas` makes the same estimate
loop by loop.
"""

from __future__ import annotations

import gc
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from backlash_cli import ScanOptions, scan_files
from backlash_cli.loaders.plant import open_plant
from backlash_cli.loaders.signals import Joiner
from tests.benchmarks.made_plant import DAY, write, write_long
from tests.benchmarks.plain_pandas import dead_bands

ROUNDS = 7


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
    in_one_thread = pa_csv.ReadOptions(use_threads=False)
    work: dict[str, Callable[[], object]] = {
        "alone": (lambda: pa_csv.read_csv(path, read_options=in_one_thread)) if path.suffix == ".csv" else (
            lambda: pa_parquet.read_table(path, use_threads=False)),
        "opened": lambda: open_plant(path), "read": lambda: records_of(path),
        "quick": lambda: scan_files(path, options=ScanOptions(confirm=False), jobs=1)}
    rounds = pd.DataFrame([{name: cpu(run, 1) for name, run in work.items()} for _ in range(ROUNDS)])
    alone, opened, read, quick = rounds.median()
    ratio, full = rounds["quick"] / rounds["alone"], cpu(lambda: scan_files(path, jobs=1), 1)
    steps = {"pyarrow alone": alone, "open": opened, "records": read - opened, "estimates": quick - read,
             "confirmation": full - quick}
    print(f"{path.name}: " + ", ".join(f"{name} {1e9 * t / samples:.0f}" for name, t in steps.items())
          + f" ns a loop-sample; --no-confirm {ratio.median():.2f} ({ratio.min():.2f} to {ratio.max():.2f}) times "
          f"pyarrow alone ({1e3 * quick / loops:.1f} ms a loop-day), full verdict {full / alone:.2f} times "
          f"({1e3 * full / loops:.1f} ms)", flush=True)
    if path.stem == "long":
        return
    plain = cpu(lambda: dead_bands(path), 1)
    print(f"plain pandas program, the estimate alone: {plain / quick:.1f} times --no-confirm, {plain / full:.1f} times "
          "full verdict")


def main() -> None:
    loops = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    pa.set_cpu_count(1)
    print(f"{loops} loops of a day at 1 s, {os.cpu_count()} cores, one used")
    with tempfile.TemporaryDirectory() as folder:
        for name, make, count in (("wide.csv", write, loops), ("wide.parquet", write, loops),
                                  ("long.csv", write_long, max(1, loops // 3))):
            scan_files(make(Path(folder, f"small-{name}"), 2, 0.2), jobs=1)
            gc.freeze()  # as the command does: the program itself holds no garbage
            ratios(make(Path(folder, name), count, 1.0), count)


if __name__ == "__main__":
    main()
