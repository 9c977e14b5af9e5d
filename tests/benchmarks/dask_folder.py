"""A partitioned Parquet folder of many loops on two worker processes: the local report, and the time of both.

    python -m tests.benchmarks.dask_folder [LOOPS] [SAMPLES]
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from backlash_cli.api import scan, scan_files
from backlash_cli.engines.cluster import connected
from backlash_cli.engines.local import context_of_processes
from backlash_cli.loaders.plant import open_plant
from backlash_cli.reporter.json_report import to_json
from backlash_cli.scanning import ScanOptions


def make(folder: Path, loops: int, samples: int, seed: int = 0) -> None:
    """Write loop=FIC0000/part-0.parquet ... with noisy cycles of random amplitude and period."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(samples)
    stamps = pa.array((1_770_000_000 + time_s).astype("datetime64[s]"))
    for k in range(loops):
        wave = rng.uniform(1, 5) * np.sign(np.sin(time_s * 2 * np.pi / rng.uniform(60, 400)))
        columns = {"time": stamps, "SP": np.full(samples, 50.0), "PV": 50 + wave + 0.05 * rng.standard_normal(samples),
                   "OP": 40 + np.cumsum(-wave) * 0.02}
        part = folder / f"loop=FIC{k:04}"
        part.mkdir(parents=True)
        pq.write_table(pa.table(columns), part / "part-0.parquet")
    (folder / "loops.toml").write_text("[defaults]\nK = 0.6\nTi = 12.0\nKp = 1.1\npv_range = [0, 100]\n")


def workers_cpu(client: Any) -> float:
    """CPU time [s] of all workers so far."""
    return float(sum(client.run(time.process_time).values()))


def main() -> None:
    loops, samples = (int(a) for a in (*sys.argv[1:], *("2000", "1800")[len(sys.argv) - 1 :]))
    options = ScanOptions(confirm=False)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "plant"
        make(folder, loops, samples)
        began = time.perf_counter(), time.process_time()
        local = to_json(scan_files([folder], options=options, jobs=1))
        print(f"local, one process: {time.perf_counter() - began[0]:.1f} s, CPU {time.process_time() - began[1]:.1f} s")
        began = time.perf_counter(), 0.0
        with connected(None, 2, method=context_of_processes().get_start_method()) as client:
            print(f"cluster of two processes started: {time.perf_counter() - began[0]:.1f} s")
            began, before = (time.perf_counter(), time.process_time()), workers_cpu(client)
            found = to_json(scan(open_plant([folder]), options, client=client))
            print(f"whole scan on the cluster: {time.perf_counter() - began[0]:.1f} s, CPU here "
                  f"{time.process_time() - began[1]:.1f} s, of the workers {workers_cpu(client) - before:.1f} s")
    print(f"{loops} loops, {samples} samples each; reports are {'the same' if found == local else 'DIFFERENT'}")


if __name__ == "__main__":
    main()
