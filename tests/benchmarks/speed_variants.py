"""CPU time of a scan with --no-confirm as a ratio to pyarrow alone, over files as different historians write them.

    python -m tests.benchmarks.speed_variants [WORD ...]     only variants whose name holds one of the words
"""

from __future__ import annotations

import sys
import tempfile
from functools import partial
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from backlash_cli import ScanOptions, scan_files
from backlash_cli.loaders.plant import open_plant
from tests.benchmarks.speed import cpu, records_of
from tests.benchmarks.variants import VARIANTS, Variant, write

OWED = {".csv": 2.0, ".parquet": 4.0}  # at most, times what pyarrow alone takes


def measure(path: Path, variant: Variant) -> tuple[float, float, float, float]:
    """CPU time [s] of pyarrow alone, of finding the loops, of reading them too, of the scan with --no-confirm."""
    if path.suffix == ".csv":
        alone = cpu(lambda: pa_csv.read_csv(path, read_options=pa_csv.ReadOptions(use_threads=False)), 5)
    else:
        alone = cpu(lambda: pa_parquet.read_table(path, use_threads=False), 5)
    opened = cpu(partial(open_plant, path))
    read = cpu(partial(records_of, path))
    return alone, opened, read, cpu(partial(scan_files, path, options=ScanOptions(confirm=False), jobs=1))


def main() -> None:
    words = [word.lower() for word in sys.argv[1:]]
    chosen = [v for v in VARIANTS if not words or any(word in v.name.lower() for word in words)]
    pa.set_cpu_count(1)
    print(f"{'ns a loop-sample':32} pyarrow   open records estimates  ratio")
    for variant in chosen:
        with tempfile.TemporaryDirectory() as folder:
            path = write(Path(folder), variant)
            alone, opened, read, quick = measure(path, variant)
        each = 1e9 / (variant.loops * variant.rows)
        ratio = quick / alone
        print(f"{variant.name:32} {each * alone:7.0f} {each * opened:6.0f} {each * (read - opened):7.0f} "
              f"{each * (quick - read):9.0f} {ratio:6.2f}{' *' if ratio > OWED[variant.suffix] else ''}", flush=True)


if __name__ == "__main__":
    main()
