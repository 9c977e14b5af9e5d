"""Elapsed time of `backlash scan --no-confirm` on a wide CSV, over that of a Python that reads it with pyarrow.

    python -m tests.benchmarks.whole_commands [LOOPS]

Both start afresh and use all cores, in turn; start-up counts. A plant has hundreds of loops side by side, where parsing
costs more per column than in the 30 of `speed`.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.benchmarks.made_plant import write

ROUNDS = 5


def seconds(*command: str) -> float:
    start = time.perf_counter()
    subprocess.run([sys.executable, *command], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> None:
    loops = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    with tempfile.TemporaryDirectory() as folder:
        path = str(write(Path(folder, "plant.csv"), loops, 1.0))
        scan = ("-m", "backlash_cli", "scan", path, "--no-confirm", "--output", f"{folder}/report.json")
        seconds(*scan)  # kernels are compiled once
        both = np.array([(seconds("-c", f"import pyarrow.csv as c; c.read_csv({path!r})"), seconds(*scan))
                         for _ in range(ROUNDS)])
        alone, own = np.median(both, axis=0)
        ratios = both[:, 1] / both[:, 0]
        size = Path(path).stat().st_size / 1e6
        print(f"{loops} loops, {size:.0f} MB: pyarrow alone {alone:.1f} s, scan {own:.1f} s, "
              f"{np.median(ratios):.2f} times ({ratios.min():.2f} to {ratios.max():.2f})")


if __name__ == "__main__":
    main()
