"""The baseline that speed is compared with: Haegglund's estimate as one writes it in pandas on a first day.

    python -m tests.benchmarks.plain_pandas [LOOPS]

For each loop: filter, find the zero crossings of the control error, go from half period to half period, apply the two
gates, take the median. Written for clarity, with the vectorised functions of pandas wherever they are at hand; nothing
is read or computed twice. `oscillation=True` adds the oscillation detector, which `backlash scan --no-confirm` runs as
well (what that says of data quality is in neither); `by_loop=True` reads the columns of one loop at a time, as one does
with files that are larger than memory. The benchmark prints the time of each, and how well sizes agree with the tool.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from backlash_cli import ScanOptions, scan_files
from tests.benchmarks.made_plant import write

K, TI, KP = 0.8, 20.0, 1.2  # settings of all loops of `made_plant`
SPAN = 100.0


def loops_of(path: Path, by_loop: bool) -> Iterator[tuple[str, pd.DataFrame]]:
    """Name and samples of each loop."""
    if path.suffix == ".parquet":
        import pyarrow.parquet

        names = pyarrow.parquet.read_schema(path).names
    else:
        names = list(pd.read_csv(path, nrows=0).columns)
    loops = sorted({name.split(".")[0] for name in names if "." in name})
    whole = None if by_loop else _read(path)
    for loop in loops:
        columns = ["time", f"{loop}.SP", f"{loop}.PV", f"{loop}.OP"]
        frame = _read(path, columns) if whole is None else whole[columns]
        yield loop, frame.set_axis(["time", "SP", "PV", "OP"], axis=1).set_index("time")


def _read(path: Path, columns: list[str] | None = None) -> pd.DataFrame:
    if path.suffix == ".parquet":
        return pd.read_parquet(path, columns=columns)
    return pd.read_csv(path, usecols=columns, parse_dates=["time"])


def half_periods(error: pd.Series) -> pd.DataFrame:
    """Start, duration [s], mean and largest size of the error between its zero crossings."""
    sign = np.sign(error)
    rows = []
    for _, part in error.abs().groupby((sign != sign.shift()).cumsum()):
        rows.append((part.index[0], len(part), part.mean(), part.max()))
    return pd.DataFrame(rows, columns=["start", "duration", "mean", "peak"])


def lag(values: pd.Series, T: float) -> pd.Series:
    """First-order lag of T samples."""
    return values.ewm(alpha=1.0 - np.exp(-1.0 / T), adjust=False).mean()


def dead_bands(path: Path, *, oscillation: bool = False, by_loop: bool = False) -> dict[str, tuple[float, float]]:
    """Median estimate [span] of each loop, and the share of its half periods that an oscillation could be made of."""
    found = {}
    for loop, frame in loops_of(path, by_loop):
        setpoint, measurement = frame["SP"] / SPAN, frame["PV"] / SPAN
        filtered = lag(lag(measurement, TI / 10.0), TI / 10.0)
        smooth = lag(lag(filtered, TI / 2.0), TI / 2.0)
        parts = half_periods(setpoint - smooth)
        parts["d"] = (K * parts["duration"] / TI - 1.0 / KP) * parts["mean"]
        good = parts[(parts["duration"] >= 5.0 * TI) & (parts["peak"] < 2.0 * parts["mean"]) & (parts["d"] > 0.0)]
        large = np.nan
        if oscillation:
            plain = half_periods(setpoint - filtered)
            large = (plain["mean"] * plain["duration"] > 0.02 * TI / (2.0 * np.pi)).mean()
        found[loop] = float(good["d"].median()), float(large)
    return found


def seconds(work: Callable[[], object]) -> float:
    """CPU time of one run."""
    start = time.process_time()
    work()
    return time.process_time() - start


def compare(path: Path) -> None:
    """Print the time of each form of the baseline over that of `--no-confirm`, one process and one thread each."""
    def quick() -> object:
        return scan_files(path, options=ScanOptions(confirm=False), jobs=1)

    ours = min(seconds(quick) for _ in range(3))
    kinds: list[tuple[str, dict[str, bool]]] = [
        ("the estimate alone", {}), ("with the oscillation detector", {"oscillation": True}),
        ("the estimate, each loop's columns read for themselves", {"by_loop": True}),
    ]
    for words, how in kinds:
        plain = seconds(partial(dead_bands, path, **how))
        print(f"{path.suffix[1:]}: plain pandas, {words}: {plain:.2f} s, {plain / ours:.1f} times --no-confirm")


def agreement(path: Path) -> float:
    """Median of the relative difference between the medians of the baseline and of the tool, over loops with some."""
    plain = dead_bands(path)
    differences = []
    for report in scan_files(path, options=ScanOptions(confirm=False), jobs=1).loops:
        sizes = [e.d for e in report.estimates if e.accepted]
        if len(sizes) >= 5:
            differences.append(abs(plain[report.loop][0] / float(np.median(sizes)) - 1.0))
    return float(np.median(differences))


def main() -> None:
    loops = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    pa.set_cpu_count(1)
    with tempfile.TemporaryDirectory() as folder:
        small = write(Path(folder, "small.csv"), 3, 0.2)
        scan_files(small, jobs=1)
        print(f"{loops} loops of a day at 1 s; sizes agree to {100 * agreement(small):.1f} % (median)")
        for suffix in ("csv", "parquet"):
            compare(write(Path(folder, f"plant.{suffix}"), loops, 1.0))


if __name__ == "__main__":
    main()
