"""What a scan costs: loop-days per core-hour, measured here, and what a large plant then needs in a year.

    python -m tests.benchmarks.cost [LOOPS]

One-day Parquet files of one loop each at one second; CPU time of one process, start-up of the tool left out.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from backlash_cli.api import scan_files
from backlash_cli.scanning import ScanOptions
from tests.benchmarks.dask_folder import make

PLANT, DAYS = 100_000, 365


def main() -> None:
    loops = int(sys.argv[1]) if len(sys.argv) > 1 else 12
    with tempfile.TemporaryDirectory() as name:
        make(Path(name) / "warm", 1, 7200)
        make(Path(name) / "plant", loops, 86_400)
        print("| verdict | CPU per loop and day | loop-days per core-hour | 100,000 loops, one night | and a year |")
        print("|---|---|---|---|---|")
        for words, confirm in (("full", True), ("`--no-confirm`", False)):
            options = ScanOptions(confirm=confirm)
            scan_files([Path(name) / "warm"], options=options, jobs=1)
            began = time.process_time()
            scan_files([Path(name) / "plant"], options=options, jobs=1)
            each = (time.process_time() - began) / loops
            night = PLANT * each / 3600.0
            print(f"| {words} | {1000 * each:.0f} ms | {3600.0 / each:,.0f} | {night:,.1f} core-hours | "
                  f"{night * DAYS:,.0f} core-hours |")


if __name__ == "__main__":
    main()
