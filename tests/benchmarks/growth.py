"""How CPU time grows with samples and with loops: the exponent of a fitted power, which should be 1.

    python -m tests.benchmarks.growth
"""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path

import numpy as np

from backlash_cli import ScanOptions, scan_files
from tests.benchmarks.made_plant import write
from tests.benchmarks.speed import cpu

SIZES = ((4, 1.0), (4, 2.0), (4, 4.0), (4, 8.0), (8, 1.0), (16, 1.0), (32, 1.0))  # (loops, days)
FIXED = 0.01  # days of the file whose time is taken off: what a scan costs without samples


def main() -> None:
    for suffix in ("csv", "parquet"):
        spent = {}
        with tempfile.TemporaryDirectory() as folder:
            for loops, days in ((1, FIXED), *SIZES):
                path = write(Path(folder, f"plant.{suffix}"), loops, days)
                spent[loops, days] = cpu(partial(scan_files, path, options=ScanOptions(confirm=False), jobs=1))
        fixed = spent[1, FIXED]
        longer, more = [s for s in SIZES if s[0] == 4], [s for s in SIZES if s[1] == 1.0]
        for what, chosen in (("samples", longer), ("loops", more)):
            size = [np.log(days if what == "samples" else loops) for loops, days in chosen]
            exponent = np.polyfit(size, np.log([spent[s] - fixed for s in chosen]), 1)[0]
            print(f"{suffix}, --no-confirm: CPU time grows with {what} to the power {exponent:.2f}", flush=True)


if __name__ == "__main__":
    main()
