"""Elapsed time of `backlash scan --no-confirm`, over that of a Python that reads the same with pyarrow.

    python -m tests.benchmarks.whole_commands [LOOPS] [--folder]

A wide CSV of so many loops and a day, or a folder of as many Parquet files, each of a loop and six hours. Both start
afresh and use all cores, in turn; start-up counts. A plant has hundreds of loops side by side, where parsing costs more
per column than in the 30 of `speed`; in a folder every file is opened by itself.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.benchmarks.made_plant import signals, write, write_settings

ROUNDS = 5
HOURS = 6


def seconds(*command: str) -> float:
    start = time.perf_counter()
    subprocess.run([sys.executable, *command], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - start


def a_file_per_loop(folder: Path, loops: int) -> Path:
    """Write the loops of `made_plant` to a file each, and their settings."""
    folder.mkdir()
    stamps = np.datetime64("2026-03-17T00:00:00", "ms") + 1000 * np.arange(3600 * HOURS)
    for number in range(loops):
        columns = zip(("SP", "PV", "OP"), signals(number % 3), strict=True)
        table = {"time": stamps} | {name: values[: len(stamps)] for name, values in columns}
        pq.write_table(pa.table(table), folder / f"FIC{number:04d}.parquet")
    write_settings(folder, loops)  # beside it
    return folder


def main() -> None:
    loops = next((int(word) for word in sys.argv[1:] if word.isdigit()), 300)
    with tempfile.TemporaryDirectory() as place:
        if "--folder" in sys.argv:
            path = a_file_per_loop(Path(place, "plant"), loops)
            files = f"pathlib.Path({str(path)!r}).glob('*.parquet')"
            alone = f"import pathlib, pyarrow.parquet as p; [p.read_table(file).num_rows for file in {files}]"
            size = sum(file.stat().st_size for file in path.iterdir()) / 1e6
        else:
            path = write(Path(place, "plant.csv"), loops, 1.0)
            alone, size = f"import pyarrow.csv as c; c.read_csv({str(path)!r})", path.stat().st_size / 1e6
        scan = ("-m", "backlash_cli", "scan", str(path), "--no-confirm", "--output", f"{place}/report.json")
        seconds(*scan)  # modules are compiled once
        both = np.array([(seconds("-c", alone), seconds(*scan)) for _ in range(ROUNDS)])
        read, own = np.median(both, axis=0)
        ratios = both[:, 1] / both[:, 0]
        print(f"{loops} loops, {size:.0f} MB: pyarrow alone {read:.1f} s, scan {own:.1f} s, "
              f"{np.median(ratios):.2f} times ({ratios.min():.2f} to {ratios.max():.2f})")


if __name__ == "__main__":
    main()
